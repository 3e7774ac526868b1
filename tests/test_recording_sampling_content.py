"""The rate at which a file has content of its own: interpolated and held columns, and recordings that are neither."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from functools import cache
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import Akima1DInterpolator, CubicSpline, PchipInterpolator, interp1d

import signid
from signid.cli import run
from signid.recording import read_recording
from signid.recording.sampling import Sampling, samples, survey
from signid.recording.sampling.grid import find_content
from signid.robot import load_robot
from signid.types import Samples

ROBOT = Path(__file__).parents[1] / "robots" / "3r"
RATE = 250.0  # [Hz] of the recordings of 3r
Columns = dict[str, np.ndarray]
Way = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
WAYS: dict[str, Way] = {
    "linear": lambda t, x, new: interp1d(t, x, axis=0)(new),
    "cubic": lambda t, x, new: CubicSpline(t, x)(new),
    "pchip": lambda t, x, new: PchipInterpolator(t, x)(new),
    "akima": lambda t, x, new: Akima1DInterpolator(t, x)(new),
    "held": lambda t, x, new: interp1d(t, x, axis=0, kind="previous")(new),
    "nearest": lambda t, x, new: interp1d(t, x, axis=0, kind="nearest")(new),
}


@cache
def original(name: str = "recording") -> Columns:
    frame = pl.read_parquet(ROBOT / f"{name}.parquet")
    return {column: frame[column].to_numpy() for column in frame.columns}


def resampled(columns: Columns, rate: float, way: str, torque_way: str = "", thin: tuple[int, int] = (1, 1)) -> Columns:
    """Columns at another rate [Hz]; positions and torques first keep one of `thin` samples."""
    t = columns["t"]
    new = np.arange(t[0], t[-17], 1 / rate)
    found = {"t": new}
    for name in columns:
        if name != "t":
            how, few = (torque_way or way, thin[1]) if name.startswith("tau") else (way, thin[0])
            found[name] = WAYS[how](t[::few], columns[name][::few], new)
    return found


def surveyed(columns: Columns) -> tuple[Any, Sampling]:
    robot = load_robot("3r")
    recording = read_recording(columns, robot)
    return recording, survey(recording, robot)


@pytest.mark.parametrize(("way", "rate"), [(way, 625.0 if way in ("pchip", "nearest") else 1250.0) for way in WAYS])
def test_samples_of_the_original_come_back(way: str, rate: float) -> None:
    recording, sampling = surveyed(resampled(original(), rate, way))
    assert sampling.content_rate == pytest.approx(RATE, rel=1e-4) and 1 / sampling.step == pytest.approx(rate)
    how = "held" if way in ("held", "nearest") else "interpolated"
    assert any(f"{how} from about 250 Hz" in note for note in sampling.notes)
    found = samples(recording, sampling, sampling.spans[0], 0, 4000)
    first = round((found.t[0] - original()["t"][0]) * RATE)
    for name, values, noise in (("q_1", found.q[:, 0], 5e-6), ("tau_1", found.tau[:, 0], 0.02)):
        shift = 0 if way != "nearest" else int(np.argmin([_distance(values, name, first + k) for k in (0, 1)]))
        assert _distance(values, name, first + shift) < 0.15 * noise


def _distance(values: np.ndarray, name: str, first: int) -> float:
    """Rms distance from the original recording."""
    return float(np.sqrt(np.mean((values - original()[name][first : first + len(values)]) ** 2)))


@pytest.mark.parametrize(
    ("rate", "ways", "thin", "content"),
    [
        (500.0, ("linear", "linear"), (1, 1), 250.0),
        (300.0, ("held", "held"), (1, 1), 250.0),
        (500.0, ("linear", "cubic"), (2, 1), 125.0),
        (250.0, ("held", "linear"), (1, 2), 125.0),
    ],
)
def test_numbers_are_those_of_the_original(
    rate: float, ways: tuple[str, str], thin: tuple[int, int], content: float
) -> None:
    robot = load_robot("3r")
    train, test = (resampled(original(name), rate, *ways, thin) for name in ("recording", "held_out"))
    found = signid.identify(robot, [train], held_out=[test])
    truth = found.base.combination @ _example().true_parameters(found)
    wrong = np.abs(found.base_value - truth) / found.estimate.std
    assert [s.content_rate for _, s in found.session.whole] == pytest.approx([content] * 2, rel=1e-4)
    assert found.cutoff <= content / 6 and not found.flags
    assert np.sum(wrong > 1.96) <= 2 and wrong.max() < 3


def _example() -> Any:
    sys.path.insert(0, str(ROBOT))
    try:
        return import_module("identify")
    finally:
        sys.path.remove(str(ROBOT))
        sys.modules.pop("identify", None)


def test_stretches_between_gaps_keep_the_knots() -> None:
    columns = resampled(original(), 1250.0, "linear")
    columns["tau_2"] = columns["tau_2"].copy()
    columns["tau_2"][np.r_[7003:7023, 21111:21131]] = np.nan
    recording, sampling = surveyed(columns)
    assert len(sampling.spans) == 3 and sampling.content_rate == pytest.approx(RATE)
    for span in sampling.spans:
        found = samples(recording, sampling, span, 0, sampling.length(span))
        at = np.rint((found.t - original()["t"][0]) * RATE).astype(int)
        assert np.abs(found.q[:, 2] - original()["q_3"][at]).max() < 1e-12


def test_any_range_of_samples_is_the_same() -> None:
    recording, sampling = surveyed(resampled(original(), 700.0, "cubic"))
    span = sampling.spans[0]
    whole = samples(recording, sampling, span, 0, sampling.length(span))
    part = samples(recording, sampling, span, 501, 1502)
    assert np.array_equal(part.q, whole.q[501:1502]) and np.array_equal(part.tau, whole.tau[501:1502])


@pytest.mark.slow
def test_the_rate_stands_in_the_documents(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("recording", "held_out"):
        pl.DataFrame(resampled(original(name), 1250.0, "cubic")).write_parquet(tmp_path / f"{name}.parquet")
    files = [str(tmp_path / f"{name}.parquet") for name in ("recording", "held_out")]
    assert run(["check", "3r", files[0], "--json"]) == 0
    checked = json.loads(capsys.readouterr().out)
    assert checked["recordings"][0]["rate"] == pytest.approx(1250)
    assert checked["recordings"][0]["content_rate"] == pytest.approx(RATE) and not checked["flags"]
    assert run(["identify", "3r", files[0], "--held-out", files[1], "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert [each["content_rate"] for each in found["recordings"]] == pytest.approx([RATE, RATE])
    assert found["recordings"][0]["clock"]["period"] == pytest.approx(1 / 1250)
    assert any("interpolated from about 250 Hz" in note for note in found["notes"])


def test_recordings_with_content_up_to_their_rate() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(8192) / 500
    smooth = np.sin(3 * t)[:, None] * [1.0, 0.5] + np.sin(11 * t + 1)[:, None] * [0.1, 0.3]
    steady = 2 / np.pi * np.arcsin(np.sin(0.8 * t))[:, None]  # constant speed, back and forth
    quantised = [np.round(x / size) * size for x in (smooth, steady) for size in (1e-4, 1e-3, 5e-3)]
    noisy = smooth + 1e-4 * rng.standard_normal(smooth.shape)
    for x in (smooth, noisy, *quantised, np.where(t[:, None] < 8, noisy, noisy[4000]), np.zeros_like(smooth)):
        rows = Samples(t, x, x[::-1], None, None, None)

        def read(low: int, high: int, rows: Samples = rows) -> Samples:
            return rows._replace(t=rows.t[low:high], q=rows.q[low:high], tau=rows.tau[low:high])

        assert find_content(read, len(x)) is None
    assert surveyed(original())[1].content is None


@pytest.mark.slow
def test_a_healthy_robot_stays_healthy(tmp_path: Path) -> None:
    motion, recording = str(tmp_path / "motion.csv"), str(tmp_path / "recording.csv")
    assert run(["excite", "1r", "--duration", "10", "-o", motion]) == 0
    words = ["--noise", "0.02", "--encoder-bits", "17", "-o", recording]
    assert run(["simulate", "1r", "--motion", motion, *words]) == 0
    frame = pl.read_csv(recording)
    columns = {name: frame[name].to_numpy() for name in frame.columns}
    for way in ("cubic", "held"):
        found = signid.diagnose(signid.load_model("1r"), [resampled(columns, 4 * RATE, way)])
        assert found.verdict == "nothing_missing" and not found.causes


@pytest.mark.parametrize("wave", [np.sin, lambda phase: np.arcsin(np.sin(phase))])
@pytest.mark.parametrize("frequency", [1.5, 6.0, 7.74])
def test_a_periodic_motion_is_not_interpolated(wave: Callable[[np.ndarray], np.ndarray], frequency: float) -> None:
    t = np.arange(0, 20, 1 / 200)
    noise = 1e-6 * np.random.default_rng(0).standard_normal((3, len(t)))
    q = 0.1 * np.sin(2 * np.pi * frequency * t) + noise[0]
    torque = wave(2 * np.pi * frequency * t + 0.4) + noise[1]
    columns = {"t": t, "q_1": q, "tau_1": torque, "q_2": 0.2 * np.cos(t) + noise[2], "tau_2": torque}
    robot = load_robot("3r")
    assert survey(read_recording({**columns, "q_3": q, "tau_3": torque}, robot), robot).content is None
