"""Short holes are bridged from the rows beside them and said; they move no parameter, and longer ones still split."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from test_recording_formats import sentence

import signid
from signid.cli import run
from signid.recording import missing, read_bare, read_recording
from signid.recording.sampling import survey

ROBOTS = Path(__file__).parents[1] / "robots"
T = np.arange(3000) * 0.004
Columns = dict[str, np.ndarray]


def pendulum() -> Columns:
    """Columns of a pendulum: a cubic in time, which is bridged exactly, and a smooth torque."""
    return {"t": T.copy(), "q_1": 1e-3 * (T - 6) ** 3, "tau_1": np.sin(3 * T), "q_des_1": 0.1 * T}


@cache
def recorded() -> Columns:
    frame = pl.read_parquet(ROBOTS / "3r" / "recording.parquet")
    return {name: frame[name].to_numpy().astype(float) for name in frame.columns}


def holed(share: float, kinds: str, seed: int = 1) -> Columns:
    """The recording of 3r without a random share of the values of some kinds of columns."""
    random = np.random.default_rng(seed)
    lost = {name: (random.random(len(x)) < share) & (name.split("_")[0] in kinds) for name, x in recorded().items()}
    return {name: np.where(lost[name], np.nan, x) for name, x in recorded().items()}


@cache
def parameters() -> tuple[np.ndarray, np.ndarray]:
    found = signid.identify("3r", read_recording(recorded(), "3r"))
    return found.base_value, found.estimate.std


@pytest.mark.parametrize("kinds", ["q", "tau", "q tau"])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.02, 0.05])
def test_random_holes_move_no_parameter_by_a_standard_deviation(share: float, kinds: str) -> None:
    recording = read_recording(holed(share, kinds.split()), "3r")
    found = signid.identify("3r", recording)
    value, std = parameters()
    assert np.all(np.abs(found.base_value - value) < std)
    assert not recording.flags and len(recording.notes) == (share > 0)


@pytest.mark.parametrize("name", ["q_2", "tau_2"])
def test_a_long_hole_still_splits(name: str) -> None:
    columns = dict(recorded(), **{name: recorded()[name].copy()})
    columns[name][2000:2250] = np.nan
    recording = read_recording(columns, "3r")
    assert survey(recording, signid.load_robot("3r")).spans == ((0, 2000), (2250, 6000)) and not recording.notes


@pytest.mark.parametrize("chunk", [65_536, 700, 33])
def test_values_are_known_and_do_not_depend_on_chunks(chunk: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(missing, "CHUNK", chunk)
    whole, lost = pendulum(), {"q_1": [33, 699, 700, 701], "tau_1": [32, 34, 1400], "q_des_1": [65], "t": [900]}
    columns = pendulum()
    for name, rows in lost.items():
        columns[name][rows] = np.nan
    columns["tau_1"][2000:2007] = np.nan
    recording = read_recording(columns, "1r")
    found = recording.read()
    np.testing.assert_allclose(found.q[:, 0], whole["q_1"], atol=1e-12)
    np.testing.assert_allclose(found.t, T, atol=1e-12)
    assert found.q_des is not None and np.allclose(found.q_des[:, 0], whole["q_des_1"], atol=1e-12)
    assert np.flatnonzero(np.isnan(found.tau[:, 0])).tolist() == list(range(2000, 2007))
    assert np.nanmax(np.abs(found.tau[:, 0] - whole["tau_1"])) < 1e-6
    (note,) = recording.notes
    sentence(note, "9 missing values are bridged", "1 in t", "4 in q_1", "3 in tau_1", "26 ms")


def test_what_is_no_short_hole_is_left_alone() -> None:
    columns = pendulum()
    columns["q_1"] = (0.9 * T + np.pi) % (2 * np.pi) - np.pi
    wrap = int(np.argmin(np.diff(columns["q_1"])))
    columns["q_1"][[0, wrap, len(T) - 1]] = np.nan
    columns["tau_1"][1000], columns["t"][1001:] = np.nan, T[1001:] + 1
    recording = read_recording(columns, "1r")
    assert np.isnan(recording.read().q[[0, wrap, -1]]).all() and np.isnan(recording.read().tau[1000])
    assert recording.notes == () and recording.flags == ()


def test_absolute_torques_stay_nonnegative() -> None:
    columns = pendulum() | {"tau_1": (np.arange(len(T)) % 7 == 3).astype(float)}
    columns["tau_1"][5::7] = np.nan
    for unsigned in (True, False):
        found = read_recording(columns, "1r", unsigned=unsigned).read().tau
        assert (np.nanmin(found) >= 0) == unsigned


def test_much_that_is_bridged_is_flagged(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pl.DataFrame(holed(0.15, "q")).write_csv(tmp_path / "a.csv")
    assert run(["identify", "3r", str(tmp_path / "a.csv"), "-o", str(tmp_path / "r")]) == 3
    assert "intervals do not hold this" in "".join(capsys.readouterr())


def test_servos_without_a_description() -> None:
    columns = pendulum()
    columns["q_1"][40], columns["q_des_1"][[50, 51]] = np.nan, np.nan
    del columns["tau_1"]
    recording, _ = read_bare(columns)
    found = recording.read()
    assert found.q_des is not None and np.isfinite(found.q).all() and np.isfinite(found.q_des).all()
    sentence(recording.notes[-1], "3 missing values are bridged", "2 in q_des_1")
