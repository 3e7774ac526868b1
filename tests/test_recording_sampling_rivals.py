"""Two columns of time: one that agrees is ignored, one that disagrees is asked about."""

from __future__ import annotations

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal

from signid.errors import RecordingError
from signid.recording import read_recording
from signid.recording.convert import convert
from signid.recording.read import read_bare
from signid.recording.reading import draft_map

ROBOT = arm("shoulder", "elbow")
T = np.round(0.008 * np.arange(2000), 6)
NOISE = np.random.default_rng(0).uniform(0, 1, len(T))
ARRIVAL = T + 0.001 + 0.004 * NOISE


def columns(**more: np.ndarray) -> dict[str, np.ndarray]:
    q, tau = (np.column_stack([np.sin(T + k), np.cos(2 * T)]) for k in (0, 1))
    return {"t": T, "q": q, "tau": tau, **more}


ALIKE = {
    "time": T + 12.5,
    "timestamp": 1_700_000_000_000_000_000 + np.rint(T * 1e9),
    "time_ms": np.round(T * 1e3),
    "header.stamp.secs": np.floor(T + 1_700_000_000),
    "stamp_s": T + 1e-5 * NOISE,
}
OTHER = {
    "cycle_time": 0.001 + 1e-4 * NOISE,  # a duration
    "timeout": ARRIVAL,
    "clock": np.arange(len(T)) * 37.0,  # a counter
    "start_time": np.full(len(T), 5.0),
    "time_to_go": 16.0 - ARRIVAL,
    "lifetime": ARRIVAL,
}
RIVALS = {
    "time": ARRIVAL,
    "timestamp": 1_700_000_000 + ARRIVAL,
    "receive_time": 1_700_000_000 + ARRIVAL,
    "headerStamp": np.round(ARRIVAL * 1e3),
    "t_ms": ARRIVAL * 1e3,
    "stamp": T * 1.01,
    "time [ns]": 1e9 * ARRIVAL,
}


@pytest.mark.parametrize("name", [*ALIKE, *OTHER])
def test_other_columns_are_no_question(name: str) -> None:
    recording = read_recording(columns(**{name: {**ALIKE, **OTHER}[name]}), ROBOT)
    assert recording.columns["t"] == ("t",)


@pytest.mark.parametrize("name", RIVALS)
def test_a_second_time_is_asked_about(name: str) -> None:
    both = columns(**{name: RIVALS[name]})
    with refusal("two columns of time", f"t and {name}", f'write t = "t" or t = "{name}"'):
        read_recording(both, ROBOT)
    assert read_recording(both, ROBOT, columns={"t": "t"}).columns["t"] == ("t",)
    assert read_recording(both, ROBOT, columns={"t": name}).columns["t"] == (name,)


def test_two_times_neither_of_which_is_named_t() -> None:
    both = columns(header_stamp=T + 1e9, receive_stamp=ARRIVAL + 1e9)
    del both["t"]
    with pytest.raises(RecordingError, match='header_stamp and receive_stamp; write t = "header_stamp" or'):
        read_recording(both, ROBOT)


def test_servo_logs_and_conversions_ask_too() -> None:
    log = {"t": T, "stamp": ARRIVAL, "q_1": np.sin(T), "q_des_1": np.sin(T + 0.1)}
    with pytest.raises(RecordingError, match="two columns of time"):
        read_bare(log)
    assert read_bare(log, columns={"t": "stamp"})[0].columns["t"] == ("stamp",)
    done = convert(log, columns={"t": "t"})
    assert "stamp" not in done.columns and any(note.endswith("stated time: stamp") for note in done.notes)
    np.testing.assert_array_equal(convert(log, columns={"t": "stamp"}).columns["t"], ARRIVAL)
    assert any("t and stamp differ by up to 4" in sentence for sentence in draft_map(log, ROBOT).lacking)
