"""Signs of thinned samples reach every row of a file, and a recording with signs is like one that never lost them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal

from signid.errors import RecordingError
from signid.recording import read_recording, with_signs
from signid.recording.sampling import Sampling, samples, split, survey
from signid.signs.samples import signs_of_rows
from signid.types import Recording

Columns = dict[str, np.ndarray]
ROBOT = arm("shoulder", "elbow")
EDGE, STEP = 30, 5  # samples that the filter takes at the ends of a span; samples for one that is kept


def torque(t: np.ndarray) -> np.ndarray:
    """Two joints whose torque changes sign several times a second."""
    return np.column_stack([3 * np.cos(1.7 * t) + 2 * np.sin(5.3 * t), np.sin(7 * t) + 0.4 * np.cos(11 * t) - 0.1])


def recorded(t: np.ndarray) -> Columns:
    q = np.column_stack([np.sin(1.3 * t) + 0.2 * np.sin(4 * t), 0.5 * np.cos(0.9 * t)])
    return {"t": t.copy(), "q": q, "tau": torque(t)}


def jittered(n: int, period: float = 0.01, share: float = 0.4) -> np.ndarray:
    return np.cumsum(period * (1 + share * np.random.default_rng(3).uniform(-1, 1, n)))


def with_gap(t: np.ndarray) -> np.ndarray:
    return np.where(np.arange(len(t)) < len(t) // 3, t, t + 1.234)


def repeating(t: np.ndarray) -> np.ndarray:
    return np.sort(np.concatenate([t, t[7::191]]))


def holey(columns: Columns) -> Columns:
    columns["tau"][700, 1] = columns["tau"][1500, 0] = columns["q"][2100, 1] = np.nan
    columns["tau"][2100:2130] = np.nan
    columns["q"][2160:2165] = np.nan  # the part between is too short to be used
    return columns


CASES: dict[str, Callable[[], Columns]] = {
    "even": lambda: recorded(np.arange(4000) * 0.004),
    "far from zero": lambda: recorded(1.7e9 + np.arange(4000) * 0.004),
    "gap": lambda: recorded(with_gap(np.arange(4000) * 0.004)),
    "repeated stamps": lambda: recorded(repeating(np.arange(4000) * 0.004)),
    "uneven": lambda: recorded(jittered(4000)),
    "uneven, gap, repeated, missing": lambda: holey(recorded(repeating(with_gap(jittered(4000))))),
    "gap, repeated, missing": lambda: holey(recorded(repeating(with_gap(np.arange(4000) * 0.01)))),
}


def absolute(columns: Columns, **more: Any) -> tuple[Recording, Sampling]:
    recording = read_recording(columns, ROBOT, unsigned=True, **more)
    return recording, survey(recording, ROBOT)


def kept(recording: Recording, sampling: Sampling) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, beginnings and right signs of samples as the search for signs keeps them; short spans give none."""
    grids = [samples(recording, sampling, span, 0, sampling.length(span)).t for span in sampling.spans]
    thin = [grid[EDGE : len(grid) - EDGE : STEP] for grid in grids if len(grid) > 2 * EDGE]
    t = np.concatenate(thin)
    return t, np.cumsum([0, *map(len, thin[:-1])]), np.sign(torque(t)).astype(np.int8)


def usable(sampling: Sampling, rows: int) -> np.ndarray:
    inside = np.zeros(rows, bool)
    for start, stop in sampling.spans:
        inside[start:stop] = True
    return inside


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("chunk", [65_536, 97])
def test_signs_reach_every_row(case: str, chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys.modules["signid.signs.samples"], "CHUNK_ROWS", chunk)
    columns = CASES[case]()
    recording, sampling = absolute(columns)
    signs = signs_of_rows(recording, sampling, *kept(recording, sampling))
    truth, inside = np.sign(torque(columns["t"])), usable(sampling, len(recording))
    assert signs.dtype == np.int8 and signs.shape == columns["tau"].shape
    assert not signs[~inside].any() and signs[inside].all()
    right = signs[inside] == truth[inside]
    assert right.mean() > 0.999, f"{(~right).sum()} of {right.size} wrong"


def test_signs_reach_the_ends_wherever_the_filter_stops(monkeypatch: pytest.MonkeyPatch) -> None:
    columns = recorded(jittered(700))
    recording, sampling = absolute(columns)
    for edge in range(15, 45):
        monkeypatch.setattr(sys.modules[__name__], "EDGE", edge)
        signs = signs_of_rows(recording, sampling, *kept(recording, sampling))
        assert np.sum(signs != np.sign(torque(columns["t"]))) <= 1, edge


def test_a_recording_with_signs_is_one_that_never_lost_them() -> None:
    columns = CASES["repeated stamps"]()
    recording, sampling = absolute(columns)
    signed = with_signs(recording, np.sign(columns["tau"]).astype(np.int8))
    original = read_recording(columns, ROBOT)
    for start, stop in ((0, None), (17, 1003), (3990, 5000)):
        np.testing.assert_array_equal(signed.read(start, stop).tau, original.read(start, stop).tau)
        np.testing.assert_array_equal(signed.read(start, stop).q, original.read(start, stop).q)
    assert signed.signed.all() and not recording.signed.any()
    assert (signed.path, signed.sha256, signed.notes) == (recording.path, recording.sha256, recording.notes)
    again = survey(signed, ROBOT)
    assert again.spans == sampling.spans and again.period == sampling.period


def test_currents_and_torques_with_a_sign_stay_unchanged() -> None:
    robot, t = arm("shoulder", "elbow", "wrist", constants=[2.0, -3.0, 1.0]), np.arange(200) * 0.01
    wave = np.sin(9 * t + 0.1)
    columns = {"t": t, **{f"q_{j}": np.sin(j * t) for j in (1, 2, 3)}}
    columns |= {"tau_1": wave, "abs_current_2": np.abs(wave)}
    recording = read_recording(columns, robot)
    np.testing.assert_array_equal(recording.signed, [True, False, True])
    signs = np.ones((200, 3), np.int8)
    signs[:, 1] = np.sign(wave)
    signs[5, 1] = signs[5, 0] = 0
    found = with_signs(recording, signs).read().tau
    expected = np.where(np.arange(200) == 5, np.nan, 3.0 * wave)
    np.testing.assert_array_equal(found, np.column_stack([wave, expected, np.full(200, np.nan)]))
    np.testing.assert_array_equal(recording.read().tau[:, 1], 3.0 * np.abs(wave))  # the original is untouched


def test_joints_with_a_sign_get_one_everywhere() -> None:
    columns = {key: value for key, value in recorded(np.arange(2000) * 0.004).items() if key != "tau"}
    tau = torque(columns["t"])
    recording = read_recording({**columns, "tau_1": tau[:, 0], "abs_tau_2": np.abs(tau[:, 1])}, ROBOT)
    sampling = survey(recording, ROBOT)
    t, first, signs = kept(recording, sampling)
    found = signs_of_rows(recording, sampling, t, first, signs)
    assert (found[:, 0] == 1).all() and np.mean(found[:, 1] == np.sign(tau[:, 1])) > 0.999
    np.testing.assert_array_equal(with_signs(recording, found).read().tau[:, 0], tau[:, 0])


def test_parts_of_a_recording_have_rows_of_their_own() -> None:
    for case in ("even", "uneven, gap, repeated, missing"):
        columns = CASES[case]()
        recording, sampling = absolute(columns)
        whole = signs_of_rows(recording, sampling, *kept(recording, sampling))
        parts = [signs_of_rows(recording, part, *kept(recording, part)) for part in split(sampling, 0.7)]
        assert not np.any((parts[0] != 0) & (parts[1] != 0))
        both = parts[0] + parts[1]
        assert np.mean((both == whole) | (both == 0)) > 0.999 and np.mean((both == 0) & (whole != 0)) < 0.02


def test_a_smooth_touch_of_zero_in_the_filters_edge_is_no_change() -> None:
    t = np.arange(1000) * 0.01
    touching = (t - 0.15) ** 2 + 1e-4  # rms of some tens
    through = touching.copy()
    through[:14] = -np.sqrt(touching[:14])
    columns = {**recorded(t), "tau": np.column_stack([touching, 3 * np.sin(6 * (t - 0.155))])}
    recording, sampling = absolute(columns)
    thin = t[EDGE:-EDGE:STEP]
    signs = np.sign(np.column_stack([np.ones(len(thin)), np.sin(6 * (thin - 0.155))])).astype(np.int8)
    found = signs_of_rows(recording, sampling, thin, np.array([0]), signs)
    np.testing.assert_array_equal(found, np.sign(columns["tau"]))


def test_flat_zero_at_the_end_keeps_the_nearest_sign() -> None:
    t = np.arange(1000) * 0.01
    tau = np.column_stack([np.where(t < 0.2, 1e-3, 5.0), np.where(t > 9.8, 0.0, -5.0)])
    recording, sampling = absolute({**recorded(t), "tau": tau})
    thin = t[EDGE:-EDGE:STEP]
    signs = np.repeat(np.array([[1, -1]], np.int8), len(thin), axis=0)
    assert (signs_of_rows(recording, sampling, thin, np.array([0]), signs) == [1, -1]).all()


def test_signs_of_another_shape_are_refused() -> None:
    recording, _ = absolute(recorded(np.arange(100) * 0.01))
    with refusal("100 rows of 2 joints", "(99, 2)"):
        with_signs(recording, np.ones((99, 2), np.int8))
    with pytest.raises(RecordingError, match="signs have the shape"):
        with_signs(replace(recording, path="some.csv"), np.ones((100, 3), np.int8))
