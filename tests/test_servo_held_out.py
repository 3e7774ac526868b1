"""Servo mode: sentences on limits agree with held-out rows, and a held-out error far above that of the fit is flagged.

The plant is the simulated closed loop, and MuJoCo with the benchmark's drives. A limit of torque is reached in the last
30 % of the recording only, which are held out.
"""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from servo_loops import SWING, driven, pendulum

import signid
from benchmarks.servo.drive import Drive, Truth
from benchmarks.servo.plant import record
from benchmarks.servo.robots import PENDULUM
from signid.servo.identify import ServoIdentification, ServoOptions
from signid.servo.simulate import simulate_servos
from signid.types import Array

SECONDS, RATE, NOISE = 20.0, 100.0, 2e-4
OPTIONS = ServoOptions(additional=())


def command(grows: float, size: float = 0.25) -> Array:
    """Sines (N,) [rad] whose size grows in the last 29 %."""
    t, rng = np.arange(int(SECONDS * RATE)) / RATE, np.random.default_rng(1)
    waves = [np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / (1 + f) for f in (0.3, 0.7, 1.3, 2.1)]
    larger = np.clip((t / SECONDS - 0.705) / 0.015, 0, 1)
    return np.asarray(size * np.sum(waves, axis=0) * (1 + (grows - 1) * larger))


@cache
def found(limit: float, grows: float, refit: bool | None = None) -> ServoIdentification:
    """Identification of the simulated pendulum, whose last 30 % are held out."""
    model, u = driven(pendulum(), {"swing": SWING.with_(effort_limit=limit)}), command(grows)
    t = np.arange(len(u)) / RATE
    made = simulate_servos(model, signid.read_recording({"t": t, "q_swing": u, "q_des_swing": u}, model.robot))
    columns = {name: x for name, x in made.columns.items() if name in ("t", "q_swing", "q_des_swing")}
    columns["q_swing"] = columns["q_swing"] + NOISE * np.random.default_rng(2).standard_normal(len(columns["t"]))
    given = signid.read_recording(columns, model.robot)
    return signid.identify_servos(model.robot, given, prior=["masses=1+-1e-6"], refit=refit, options=OPTIONS)


def far(result: ServoIdentification) -> list[str]:
    return [flag for flag in result.flags if "far worse than that of the training data" in flag]


def about_limits(result: ServoIdentification) -> str:
    return " ".join(line for line in result.joints[0].not_identifiable if "effort limit" in line)


def test_a_limit_that_only_held_out_motion_reaches_is_no_bound() -> None:
    result = found(0.6, 2.0)
    sentence = about_limits(result)
    assert "effort limit is above" not in " ".join((*result.flags, *result.notes))
    assert "held-out motion is predicted better with an effort limit near" in sentence and sentence in result.flags
    assert float(sentence.split("near ")[1].split()[0]) == pytest.approx(0.6, rel=0.05)
    assert result.joints[0].numbers["effort_limit"].value is None
    assert not any("nothing saturates" in note for note in result.notes)


def test_a_held_out_error_far_above_that_of_the_fit_is_flagged() -> None:
    result = found(0.6, 2.0)
    assert result.rollout.one_second_rms[0] > 100 * NOISE
    (flag,) = far(result)
    assert flag.startswith("the held-out motion of swing (") and "signid diagnose with model.json" in flag


def test_a_limit_that_pwm_shows_is_in_the_model_though_only_held_out_motion_reaches_it() -> None:
    drive = SWING.with_(effort_limit=0.8, viscous_friction=0.0, delay=0.0)
    model, u = driven(pendulum(), {"swing": replace(drive, law="duty")}), command(5.0, 0.12)
    t = np.arange(len(u)) / RATE
    made = simulate_servos(model, signid.read_recording({"t": t, "q_swing": u, "q_des_swing": u}, model.robot)).columns
    q = made["q_swing"]
    duty = drive.kp * (u - q) / drive.effort_limit
    assert np.abs(duty[: int(0.7 * len(u))]).max() < 1 < np.abs(duty).max()
    columns = {"t": t, "q_swing": q + NOISE * np.random.default_rng(2).standard_normal(len(q)), "q_des_swing": u}
    given = signid.read_recording({**columns, "pwm_swing": np.clip(duty, -1, 1)}, model.robot)
    result = signid.identify_servos(model.robot, given, prior=["masses=1+-1e-6"], options=OPTIONS)
    limit, gain = (result.joints[0].numbers[name] for name in ("effort_limit", "kp"))
    assert result.servos["swing"].law == "duty" and not about_limits(result)
    assert limit.value is not None and limit.std is not None and 0 < limit.std < 0.05
    assert limit.value == pytest.approx(0.8, abs=3 * limit.std) and gain.value == pytest.approx(8.0, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("grows", [1.0, 3.0])
def test_a_healthy_recording_keeps_its_bound(grows: float) -> None:
    result = found(np.inf, grows, refit=False)
    assert not far(result) and len(result.flags) == 1
    bound = float(about_limits(result).split("above ")[1].split()[0])
    assert 0.4 < bound < 0.62, "the training data ask for 0.62 N.m"


@pytest.mark.slow
def test_the_plant_of_mujoco(tmp_path: Path) -> None:
    path = tmp_path / "pendulum.urdf"
    path.write_text(PENDULUM)
    robot, u = signid.load_robot(path), 0.2 + command(2.5, size=0.2)[:, None]
    drive = Drive(kp=12.0, kd=0.35, delay=0.012, coulomb_friction=0.06, armature=0.008, effort_limit=2.0)
    recording = signid.read_recording(record(path, Truth({"joint": drive}), u, RATE, 3), robot)
    result = signid.identify_servos(robot, recording, options=OPTIONS, known="kp=12")
    assert far(result) and float(about_limits(result).split("near ")[1].split()[0]) == pytest.approx(2.0, rel=0.05)
