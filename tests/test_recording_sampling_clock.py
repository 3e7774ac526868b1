"""The clock of a recording: stamps that jitter about an even clock, dropped rows, and stamps that are right."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
import pytest
from test_recording_formats import sentence

from signid.errors import RecordingError
from signid.estimation.least_squares import estimate
from signid.recording import read_recording
from signid.recording.sampling import Sampling, samples, survey
from signid.recording.sampling.clock import Clock, fit_even, read_clock
from signid.regression.session import prepare
from signid.robot import configuration, load_robot
from signid.robot.dynamics import rigid_torque
from signid.types import Recording, Robot

PERIOD = 0.008
Columns = dict[str, np.ndarray]


@cache
def robot_of(name: str) -> Robot:
    return load_robot(name)


def moved(name: str, t: np.ndarray, seed: int = 0) -> Columns:
    """Rigid-body torque and friction of a motion at times t (N,) [s], with encoder and torque noise."""
    robot, rng = robot_of(name), np.random.default_rng(seed)
    n = len(robot.joints)
    low, high = (np.where(np.isfinite(x), x, y) for x, y in ((robot.lower, -1.0), (robot.upper, 1.0)))
    middle, room = (low + high) / 2, np.minimum((high - low) / 2, 1.0)
    speed, phase = rng.uniform(1, 6, (n, 4)), rng.uniform(0, 2 * np.pi, (n, 4))
    angle = speed * t[:, None, None] + phase
    q = middle + room / 4 * np.sin(angle).sum(axis=2)
    v = room / 4 * (speed * np.cos(angle)).sum(axis=2)
    a = -room / 4 * (speed**2 * np.sin(angle)).sum(axis=2)
    drive = robot.drive.T
    tau = rigid_torque(robot, configuration(robot, q), v @ drive, a @ drive) + 0.3 * np.sign(v) + 0.5 * v
    tau = tau + 0.02 * tau.std(axis=0) * rng.standard_normal(tau.shape)
    return {"t": t, "q": q + 1e-6 * rng.standard_normal(q.shape), "tau": tau}


def surveyed(name: str, columns: Columns, **options: Any) -> tuple[Recording, Sampling]:
    recording = read_recording(columns, robot_of(name), **options)
    return recording, survey(recording, robot_of(name))


def even(rows: int = 2500) -> np.ndarray:
    return np.round(PERIOD * np.arange(rows), 9)


def jitter(t: np.ndarray, seed: int = 1) -> np.ndarray:
    """Stamps in whole ms with errors of -1, 0 or 1 ms."""
    return np.round(t * 1000 + np.random.default_rng(seed).integers(-1, 2, len(t))) / 1000


def without(columns: Columns, rows: list[int]) -> Columns:
    return {name: np.delete(column, rows, axis=0) for name, column in columns.items()}


ROBOTS = ["3r", "ur5", "panda"]


@pytest.mark.parametrize("unsigned", [False, True])
@pytest.mark.parametrize("name", ROBOTS)
def test_jittered_stamps_of_an_even_clock_are_replaced(name: str, unsigned: bool) -> None:
    exact = moved(name, even())
    recording, sampling = surveyed(name, exact | {"t": jitter(exact["t"])}, unsigned=unsigned)
    assert (sampling.clock.kind, sampling.clock.missing, sampling.uniform) == ("even", 0, True)
    assert sampling.period == pytest.approx(PERIOD, rel=1e-5)
    assert sampling.clock.jitter == pytest.approx(np.sqrt(2 / 3) * 1e-3, rel=0.05)
    found = samples(recording, sampling, sampling.spans[0], 0, len(recording))
    np.testing.assert_array_equal(found.q, exact["q"])
    assert np.ptp(found.t - exact["t"]) < 0.01 * PERIOD
    sentence(sampling.notes[0], "jitter by 0.8", "even clock of 8 ms", "is used")


@pytest.mark.parametrize("name", ROBOTS)
def test_dropped_rows_are_counted(name: str) -> None:
    exact = without(moved(name, even()), [100, 700, 701, 1500, *range(2000, 2100)])
    recording, sampling = surveyed(name, exact | {"t": jitter(exact["t"])})
    other, truth = surveyed(name, exact)
    assert (sampling.clock.kind, sampling.clock.missing) == ("ticks", 4)
    sentence(sampling.notes[1], "4 rows are missing")
    assert len(sampling.spans) == len(truth.spans) == 2
    for span, same in zip(sampling.spans, truth.spans, strict=True):
        mine = samples(recording, sampling, span, 0, sampling.length(span))
        theirs = samples(other, truth, same, 0, truth.length(same))
        assert len(mine.t) == len(theirs.t) and np.abs(mine.t - theirs.t).max() < 0.05 * PERIOD
        np.testing.assert_allclose(mine.q, theirs.q, atol=1e-4)


@pytest.mark.parametrize("unsigned", [False, True])
@pytest.mark.parametrize("name", ROBOTS)
def test_right_stamps_of_uneven_samples_stay(name: str, unsigned: bool) -> None:
    late = jitter(even())  # the samples are taken at these times
    _, sampling = surveyed(name, moved(name, late), unsigned=unsigned)
    assert (sampling.clock.kind, sampling.clock.jitter, sampling.uniform) == ("stamps", 0.0, False)
    assert sampling.period == pytest.approx(PERIOD)
    sentence(sampling.notes[0], "time steps vary from 6 to 10 ms", "resampled")


@pytest.mark.parametrize("seed", [1, 2])
def test_numbers_are_those_of_the_exact_clock(seed: int) -> None:
    exact = moved("ur5", even(5000), seed)
    found = []
    for t in (exact["t"], jitter(exact["t"], seed)):
        session = prepare(robot_of("ur5"), [read_recording(exact | {"t": t}, robot_of("ur5"))])
        found.append((session.task.band.cutoff, estimate(session.reduce(session.train), session.task.base)))
    (cutoff, truth), (other, mine) = found
    assert other == pytest.approx(cutoff, rel=0.01)
    np.testing.assert_array_less(np.abs(mine.value - truth.value), 0.1 * truth.std + 1e-12)
    np.testing.assert_allclose(mine.std, truth.std, rtol=0.2)


def noisy(seed: int, rms: float, period: float, rows: int, lost: int) -> tuple[np.ndarray, np.ndarray]:
    """True times (N,) and stamps (N,) [s] with white errors [periods]."""
    rng = np.random.default_rng(seed)
    ticks = np.delete(np.arange(rows), rng.choice(np.arange(5, rows - 5), lost, replace=False))
    times = 3.3 + period * ticks
    return times, times + period * np.clip(rms * rng.standard_normal(len(ticks)), -0.49, 0.49)


@pytest.mark.parametrize(("rms", "lost"), [(0.02, 40), (0.1, 40), (0.2, 4), (0.25, 0)])
@pytest.mark.parametrize("period", [0.001, 1 / 120, 0.0333])
def test_an_even_clock_is_recovered(period: float, rms: float, lost: int) -> None:
    times, stamps = noisy(4, rms, period, 4000, lost)
    steps = np.diff(stamps)
    found = fit_even(stamps, Clock(float(np.median(steps)), float(steps.mean()), 1e-9))
    assert found is not None and found.missing == lost
    assert found.period == pytest.approx(period, rel=1e-4) and found.jitter == pytest.approx(rms * period, rel=0.1)
    assert np.median(np.abs(found.times - times)) < 0.02 * period


def test_a_stall_of_the_logger_is_no_gap() -> None:
    times = PERIOD * np.arange(2000)
    stamps = times.copy()
    stamps[500:504] = times[503] + np.array([1e-4, 2e-4, 3e-4, 4e-4])  # written at once
    steps = np.diff(stamps)
    found = fit_even(stamps, Clock(PERIOD, float(steps.mean()), 1e-9))
    assert found is not None and found.missing == 0 and np.abs(np.diff(found.times) - PERIOD).max() < 0.05 * PERIOD


def test_wandering_stamps_are_of_no_even_clock() -> None:
    steps = PERIOD * (1 + 0.2 * np.random.default_rng(2).uniform(-1, 1, 4000))
    assert fit_even(np.cumsum(steps), Clock(PERIOD, PERIOD, 1e-9)) is None
    slowing = np.cumsum(np.linspace(1, 1.1, 4000)) * PERIOD
    assert fit_even(slowing, Clock(PERIOD, 1.05 * PERIOD, 1e-9)) is None


def test_steps_that_are_almost_nothing_are_refused() -> None:
    stamps = np.arange(30) * 5e-324
    columns = {"t": stamps, "q_1": np.sin(np.arange(30)), "tau_1": np.cos(np.arange(30))}
    recording = read_recording(columns, "1r")
    with pytest.raises(RecordingError, match="cannot be seconds"):
        read_clock(recording, "the recording")
