"""Unusable samples are refused in one sentence with place and reason; real recordings can be used."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from test_recording import arm
from test_recording_formats import refusal, sentence
from test_recording_sampling import ROBOT, Columns, everything, motion, surveyed

from signid.recording import read_recording
from signid.recording.sampling import samples, survey
from signid.robot import load_robot

N = 2000
T = np.arange(N) * 0.01
Change = Callable[[Columns], object]


def put(name: str, where: Any, value: Any) -> Change:
    return lambda columns: columns[name].__setitem__(where, value)


def scale(name: str, by: float) -> Change:
    return lambda columns: columns[name].__imul__(by)


def keep(rows: slice) -> Change:
    return lambda columns: columns.update({name: x[rows] for name, x in columns.items()})


BAD: dict[str, tuple[Change, tuple[str, ...]]] = {
    "back": (put("t", 811, 3.0), ("row 812", "from 8.1 to 3", "sort")),
    "all back": (lambda c: c.update(t=c["t"][::-1].copy()), ("goes back",)),
    "back over a hole": (put("t", slice(500, 502), [np.nan, 0.3]), ("row 502", "from 4.99 to 0.3")),
    "stands still": (put("t", slice(None), 3.0), ("does not change", "3")),
    "no time": (put("t", slice(None), np.nan), ("'t'", "no value")),
    "infinite time": (put("t", N - 1, np.inf), ("'t'", "infinite")),
    "repeats": (
        lambda c: c.update({k: np.repeat(x[::5], 5, axis=0)[:N] for k, x in c.items()}),
        ("1600 of 2000", "repeat"),
    ),
    "milliseconds": (scale("t", 1e3), ("milliseconds", "'t'", "10")),
    "milliseconds at 1 kHz": (lambda c: c.update(t=np.arange(N) * 1.0), ("milliseconds", "1")),
    "microseconds": (scale("t", 1e6), ("microseconds",)),
    "nanoseconds": (scale("t", 1e9), ("nanoseconds",)),
    "epoch in nanoseconds": (lambda c: c.update(t=1.7e18 + T * 1e9), ("nanoseconds",)),
    "hours": (scale("t", 1 / 3600), ("hours",)),
    "days": (scale("t", 1 / 86400), ("days",)),
    "infinite position": (put("q", (77, 1), -np.inf), ("'q_2'", "row 78", "infinite")),
    "infinite torque": (put("tau", (0, 0), np.inf), ("'tau_1'", "row 1")),
    "no position": (put("q", (slice(None), 0), np.nan), ("'q_1'", "no value")),
    "no torque": (put("tau", (slice(None), 1), np.nan), ("'tau_2'", "no value")),
    "torque zero": (put("tau", (slice(None), 1), 0.0), ("'tau_2'", "zero", "elbow")),
    "torque constant": (put("tau", (slice(None), 0), 0.3), ("'tau_1'", "constant", "shoulder")),
    "degrees": (scale("q", 180 / np.pi), ("'q_1'", "degrees", "radians")),
    "nothing moves": (put("q", slice(None), 0.5), ("no joint moves", "q_1, q_2")),
    "one sample": (keep(slice(1)), ("too short", "single")),
    "few samples": (keep(slice(15)), ("too short", "0 of 15")),
    "full of holes": (put("q", (np.arange(N) % 40 < 6, 1), np.nan), ("too short", "q_2", "300")),
    "short runs": (put("t", slice(None), T + np.floor(T / 0.3)), ("too short", "half a second")),
}


@pytest.mark.parametrize("case", BAD)
def test_samples_that_cannot_be_used(case: str) -> None:
    change, culprits = BAD[case]
    columns = motion(T.copy())
    change(columns)
    with refusal("the recording", *culprits):
        surveyed(columns)


def test_degrees_of_a_joint_without_limits() -> None:
    free = replace(ROBOT, lower=np.full(2, -np.inf), upper=np.full(2, np.inf))
    columns = motion(T)
    columns["q"] *= 180 / np.pi
    with refusal("q_1", "degrees"):
        surveyed(columns, free)
    slow = motion(T)
    slow["q"][:, 0] = 5 * T  # a wheel: 100 rad, but at 5 rad/s
    assert surveyed(slow, free)[1].upper[0] > 60
    sliding = replace(free, prismatic=np.ones(2, bool))
    assert surveyed(columns, sliding)[1].rows == N


NOTED: dict[str, tuple[Change, tuple[str, ...]]] = {
    "gap": (lambda c: c.update(t=T + 0.5 * (T >= 10)), ("1 gap ", "0.51 s", "t = 9.99")),
    "two gaps": (lambda c: c.update(t=T + 0.5 * (T >= 5) + 2 * (T >= 15)), ("2 gaps", "2.01 s", "t = 15.49")),
    "holes": (put("tau", (slice(700, 705), 0), np.nan), ("5 in tau_1", "5 samples of 2000")),
    "duplicates": (put("t", 9, 0.08), ("1 sample ", "same time as the previous")),
    "still joint": (put("q", (slice(None), 1), 0.4), ("q_2", "constant", "elbow did not move")),
    "a bit beyond": (scale("q", 3.0), ("shoulder", "beyond the limits", "rad")),
    "no torque of one": (lambda c: c.update(tau=c["tau"][:, :1]), ("elbow moves",)),
    "dead velocity": (lambda c: c.update(dq=np.gradient(c["q"], T, axis=0) * [1, 0]), ("dq_2", "zero")),
    "too short": (put("q", (np.r_[300:306, 330:336], 0), np.nan), ("1 stretch", "0.5 s")),
    "jitter": (put("t", slice(None, None, 2), T[::2] + 0.002), ("from 8 to 12 ms", "resampled every")),
}


@pytest.mark.parametrize("case", NOTED)
def test_notes_of_unusual_samples(case: str) -> None:
    change, culprits = NOTED[case]
    columns = motion(T.copy())
    change(columns)
    sampling = surveyed(columns)[1]
    notes = [note for note in sampling.notes if culprits[0] in note]
    assert len(notes) == 1, sampling.notes
    sentence(notes[0], *culprits)


@pytest.mark.slow
def test_long_recordings_need_no_more_memory() -> None:
    """Reads are bounded by a few chunks, whatever the length."""

    class Long:
        columns, rows, largest = ("t", "q_1", "tau_1"), 3_000_000, 0

        def read(self, names: tuple[str, ...], start: int, stop: int) -> np.ndarray:
            t = np.arange(start, min(stop, self.rows)) * 1e-3
            t += 1e-4 * np.sin(np.arange(start, start + len(t)) * 0.7)  # not uniform
            Long.largest = max(Long.largest, len(t))
            every = {"t": t, "q_1": np.sin(t), "tau_1": np.cos(t)}
            return np.array([every[name] for name in names]).reshape(len(names), len(t)).T

    recording = replace(read_recording(motion(T), ROBOT), table=Long(), joints=("shoulder",), signed=np.array([True]))
    columns = {"t": ("t",), "q": ("q_1",), "tau": ("tau_1",)}
    recording = replace(recording, columns=columns, torque_per_unit=np.ones(1))
    sampling = survey(recording, arm("shoulder"))
    (span,) = sampling.spans
    assert span == (0, Long.rows) and not sampling.uniform and Long.largest == 65_536
    assert sum(len(stretch.stamps) for stretch in sampling.stretches) < 1000
    Long.largest = 0
    found = samples(recording, sampling, span, 2_000_000, 2_010_000)
    assert Long.largest < 20_000 and len(found.t) == 10_000
    np.testing.assert_allclose(found.q[:, 0], np.sin(found.t), atol=1e-9)


REAL: dict[str, tuple[str, str, bool | None, float, int]] = {  # description, clock, uniform, period [s], rows
    "panda_gaz2019/exciting_traj_1.csv.gz": ("panda.urdf", "stamps", False, 1e-3, 20544),
    "ur10e_mamedov/identification_data__20_02_10_30sec_12harm.csv.gz": ("ur10e.urdf", "", False, 1e-2, 3691),
    "ur10e_mamedov/identification_data__20_02_12_40sec_12harm.csv.gz": ("ur10e.urdf", "stamps", None, 0, 0),
    "kuka_lwr4_flobaroid/measurements_1.csv.gz": ("kuka_lwr4.urdf", "even", True, 5e-3, 5027),  # stamps jitter
    "kuka_lwr4_flobaroid/measurements_3.csv.gz": ("kuka_lwr4.urdf", "even", None, 0, 0),
    "staubli_tx40/exciting_traj.csv.gz": ("tx40.urdf", "", True, 2e-4, 45000),
    "emps_janot/emps_train.csv.gz": ("emps.urdf", "", True, 1e-3, 24841),
    "emps_janot/emps_pulses.csv.gz": ("emps.urdf", "", None, 0, 0),
    "so101_sage/multisine.csv.gz": ("so101.urdf", "", True, 0.02006, 6000),
    "mit_arm_saloutos/arm_log_2.csv.gz": ("mit_arm.urdf", "stamps", None, 0, 0),
    "rokae_xmate/excit_motor.csv.gz": ("xmate3pro.urdf", "stamps", None, 0, 0),
    "rokae_xmate/excit_joint_sensor.csv.gz": ("xmate3pro.urdf", "", None, 0, 0),
    "seed_penne/3dof_experiment123.csv.gz": ("seed_3r.urdf", "", None, 0, 0),
    "dvrk_wpi/psm3_one.csv.gz": ("psm3.urdf", "", None, 0, 0),
}


@pytest.mark.parametrize("file", REAL)
def test_real_recordings(file: str, data: Path) -> None:
    urdf, clock, uniform, period, rows = REAL[file]
    robot = load_robot((data / file).with_name(urdf))
    drives = replace(robot.actuators, torque_constant=np.full(len(robot.joints), 10.0))
    robot = replace(robot, actuators=drives)
    columns = {f"abs_tau_{i}": f"tau_abs_{i}" for i in range(1, 7)} if "so101" in file else None
    recording = read_recording(data / file, robot, columns=columns)
    sampling = survey(recording, robot)
    assert sampling.content is None and sampling.content_rate == pytest.approx(1 / sampling.step)
    if clock:
        unsigned = survey(read_recording(data / file, robot, columns=columns, unsigned=True), robot)
        assert sampling.clock.kind == unsigned.clock.kind == clock
    if uniform is None:
        return
    assert recording.joints == robot.joints and sampling.spans == ((0, rows),)
    assert sampling.uniform == uniform and sampling.period == pytest.approx(period, rel=1e-3)
    assert recording.signed.all() == ("so101" not in file)
    found = everything(recording, sampling)
    assert np.isfinite(found.q).all() and np.isfinite(found.tau).all()
    raw = recording.read()
    assert np.abs(found.q - np.column_stack([np.interp(found.t, raw.t, x) for x in raw.q.T])).max() < 0.01
