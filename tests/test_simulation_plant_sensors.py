"""Simulated sensors: rates, encoder counts, noise, sampling times, losses."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from plant import law, model, waves

import signid
from signid.errors import OptionError
from signid.model import Model
from signid.recording.formats import find_format
from signid.simulation.plant import Sensors, Simulation, record, simulate, track

SECONDS, STEP = 20.0, 1e-3


@cache
def made(robot: str = "3r") -> tuple[Model, Simulation]:
    given = model(robot, law("viscous_friction", 0, coefficient=0.5))
    return given, simulate(given, track(given, waves(given.robot.joints, SECONDS)), SECONDS)


def recorded(sensors: Sensors | None = None, seed: int = 0, robot: str = "3r") -> dict[str, np.ndarray]:
    given, simulation = made(robot)
    return record(given.robot, simulation, sensors, seed=seed)


def matrix(columns: dict[str, np.ndarray], kind: str) -> np.ndarray:
    return np.column_stack([x for name, x in columns.items() if name.startswith(f"{kind}_joint")])


def test_perfect_sensors_record_the_true_motion() -> None:
    simulation, columns = made()[1], recorded()
    assert list(columns) == ["t", *(f"{k}_joint_{j}" for k in ("q", "tau", "q_des") for j in (1, 2, 3))]
    for kind, values in (("q", simulation.q), ("tau", simulation.tau), ("q_des", simulation.desired)):
        assert np.array_equal(matrix(columns, kind), values)
    assert np.allclose(columns["t"], simulation.t, rtol=0, atol=1e-9)


def test_the_rate_takes_every_nth_step() -> None:
    columns, simulation = recorded(Sensors(rate=250.0)), made()[1]
    assert len(columns["t"]) == SECONDS * 250 and np.allclose(np.diff(columns["t"]), 0.004)
    assert np.array_equal(matrix(columns, "q"), simulation.q[::4])


@pytest.mark.parametrize("rate", [300.7, 333.333, 150.0, 1500.0])
def test_the_rate_that_a_refusal_proposes_is_taken(rate: float) -> None:
    with pytest.raises(OptionError, match="does not fit steps") as refused:
        Sensors(rate=rate).every(STEP)
    proposed = float(str(refused.value).partition("such as ")[2].partition(" Hz")[0])
    assert Sensors(rate=proposed).every(STEP) == max(1, round(1 / (rate * STEP)))


@pytest.mark.parametrize(("robot", "turn"), [("3r", 2 * np.pi), ("emps", 1.0)])
def test_encoders_count_from_a_zero_of_their_own(robot: str, turn: float) -> None:
    count = turn / 2**12
    q, true = matrix(recorded(Sensors(encoder_bits=12), robot=robot), "q"), made(robot)[1].q
    part = q / count % 1
    assert np.abs(q - true).max() <= count / 2 * (1 + 1e-9)
    assert np.allclose(np.exp(2j * np.pi * part), np.exp(2j * np.pi * part[0]), atol=1e-6)
    other = matrix(recorded(Sensors(encoder_bits=12), seed=1, robot=robot), "q") / count % 1
    assert np.abs(other[0] - part[0]).min() > 1e-3
    assert np.std(q - true) == pytest.approx(count / np.sqrt(12), rel=0.1)


def test_noise_has_its_size_and_colour() -> None:
    tau = made()[1].tau
    size = np.sqrt(np.mean(tau**2, axis=0))
    white = (matrix(recorded(Sensors(noise=0.05)), "tau") - tau) / size
    assert np.allclose(white.std(0), 0.05, rtol=0.03)
    assert np.abs(np.mean(white[1:] * white[:-1], axis=0)).max() < 0.03 * 0.05**2
    coloured = (matrix(recorded(Sensors(coloured_noise=0.05)), "tau") - tau) / size
    assert np.allclose(coloured.std(0), 0.05, rtol=0.2)
    lag = round(1 / (2 * np.pi * 3.0) / STEP)
    kept = np.mean(coloured[lag:] * coloured[:-lag], axis=0) / np.mean(coloured**2, axis=0)
    assert np.allclose(kept, np.exp(-1), atol=0.12), "correlated over the time constant of 3 Hz"
    assert np.abs(coloured[:5]).max() > 1e-3, "from the first row on"


def test_jitter_moves_the_moments_and_says_so() -> None:
    simulation, columns = made()[1], recorded(Sensors(rate=200.0, jitter=0.1))
    off = columns["t"] - np.arange(len(columns["t"])) * 0.005
    assert off[1:-1].std() == pytest.approx(0.1 * 0.005, rel=0.05)
    assert np.all(np.diff(columns["t"]) > 0)
    j = 1
    assert np.abs(matrix(columns, "q")[:, j] - np.interp(columns["t"], simulation.t, simulation.q[:, j])).max() < 1e-5
    assert np.abs(matrix(columns, "q")[:, j] - simulation.q[::5, j]).max() > 1e-4
    wild = recorded(Sensors(rate=200.0, jitter=10.0))["t"]
    assert np.all(np.diff(wild) > 0), "rows stay in order"


@pytest.mark.parametrize("share", [0.01, 0.1, 0.9])
def test_rows_are_lost_in_bursts(share: float) -> None:
    whole, t = made()[1].t, recorded(Sensors(drop_outs=share))["t"]
    kept = np.isin(np.round(whole / STEP), np.round(t / STEP))
    assert 1 - kept.mean() == pytest.approx(share, rel=0.25)
    assert kept[0] and kept[-1]
    burst = (~kept).sum() / max(1, (np.diff(kept.astype(int)) == -1).sum())
    assert burst == pytest.approx(max(4.0, share / (1 - share)), rel=0.3)


def test_signs_are_lost() -> None:
    columns = recorded(Sensors(unsigned=True))
    assert np.array_equal(matrix(columns, "abs_tau"), np.abs(made()[1].tau))
    assert not any(name.startswith("tau") for name in columns)
    assert not signid.read_recording(columns, made()[0].robot).signed.any()


@pytest.mark.parametrize("suffix", [".csv.gz", ".parquet", ".npz"])
def test_every_format_keeps_every_digit_and_the_same_bytes(suffix: str, tmp_path: Path) -> None:
    sensors, path = (
        Sensors(rate=100.0, encoder_bits=17, noise=0.02, jitter=0.05, drop_outs=0.02),
        tmp_path / f"r{suffix}",
    )
    columns, form = recorded(sensors, seed=5), find_format(path)
    path.write_bytes(form.encode(columns, path.name))
    assert form.encode(recorded(sensors, seed=5), path.name) == path.read_bytes()
    assert form.encode(recorded(sensors, seed=6), path.name) != path.read_bytes()
    read = signid.read_recording(path, made()[0].robot).read()
    assert np.array_equal(read.t, columns["t"]) and np.array_equal(read.q, matrix(columns, "q"))
    assert np.array_equal(read.tau, matrix(columns, "tau"))
    assert read.q_des is not None and np.array_equal(read.q_des, matrix(columns, "q_des"))


@pytest.mark.parametrize(
    ("options", "says"),
    [
        ({"rate": 300.0}, "333.333 Hz"),
        ({"rate": 3000.0}, "does not fit steps"),
        ({"rate": -1.0}, "positive"),
        ({"noise": -0.1}, "noise"),
        ({"coloured_noise": np.nan}, "coloured noise"),
        ({"jitter": -1.0}, "jitter"),
        ({"drop_outs": 1.0}, "drop-outs"),
        ({"encoder_bits": 0.0}, "bits"),
    ],
)
def test_impossible_sensors_are_refused(options: dict[str, float], says: str) -> None:
    with pytest.raises(OptionError, match=says):
        recorded(Sensors(**options))  # type: ignore[arg-type]
