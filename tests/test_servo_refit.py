"""Servo mode: the model that is written is fitted to all rows, once its errors on held-out rows are known."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from servo_loops import SWING, driven, pendulum

import signid
from signid.cli import run
from signid.deadline import time_limit
from signid.servo.identify import ServoIdentification, ServoOptions
from signid.servo.simulate import simulate_servos
from signid.servos import Servo
from signid.types import Array

RATE, NOISE = 100.0, 3e-4
ONE_NUMBER = {"damping": SWING.kd + SWING.viscous_friction, "lag": SWING.delay + SWING.damping / SWING.kp}
EXACT = ["masses=1+-1e-6"]  # those of the plant: intervals of noise alone
OPTIONS = ServoOptions(additional=())


@cache
def log(seconds: float, loud: float = 1.0, servo: Servo = SWING, seed: int = 1) -> dict[str, Array]:
    """Columns of the simulated pendulum; `loud`: size of the commands after 70 %, over that before."""
    model, rng = driven(pendulum(), {"swing": servo}), np.random.default_rng(seed)
    t = np.arange(int(seconds * RATE)) / RATE
    u = 0.3 * sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / (1 + f) for f in (0.3, 0.7, 1.3, 2.1))
    u *= 1 + (loud - 1) * np.clip((t / seconds - 0.705) / 0.015, 0, 1)
    made = simulate_servos(model, signid.read_recording({"t": t, "q_swing": u, "q_des_swing": u}, model.robot))
    q = made.columns["q_swing"] + NOISE * rng.standard_normal(len(t))
    return {"t": t, "q_swing": q, "q_des_swing": made.columns["q_des_swing"]}


@cache
def found(refit: bool | None, seconds: float = 12.0, loud: float = 1.0, servo: Servo = SWING) -> ServoIdentification:
    robot = pendulum()
    given = signid.read_recording(log(seconds, loud, servo), robot)
    return signid.identify_servos(robot, given, prior=EXACT, refit=refit, options=OPTIONS)


def notes(result: ServoIdentification) -> list[str]:
    return [note for note in result.notes if "not fitted again to the held-out rows" in note]


def test_all_rows_narrow_the_intervals_and_keep_the_figures_of_the_split() -> None:
    split, whole = found(False), found(None)
    assert (split.refit, whole.refit) == (False, True) and not notes(whole)
    for name in ("whole_rms", "one_second_rms", "nominal_whole_rms"):
        assert np.array_equal(getattr(split.rollout, name), getattr(whole.rollout, name)), name
    assert np.array_equal(split.traces[0].simulated, whole.traces[0].simulated)
    assert split.inputs == whole.inputs and split.joints[0].law == whole.joints[0].law
    before, after = split.joints[0].numbers, whole.joints[0].numbers
    ratios = [(after[name].std or np.inf) / std for name, one in before.items() if (std := one.std)]
    assert len(ratios) > 5 and np.median(ratios) < 0.92, "square root of .7 is .84"
    for name, one in after.items():
        truth = ONE_NUMBER.get(name, getattr(SWING, name, None))
        if one.value is not None and one.std is not None and truth is not None:
            assert abs(one.value - truth) < 3 * one.std, name
    assert whole.servos["swing"].kp == whole.model.servos["swing"].kp == after["kp"].value != before["kp"].value


@pytest.mark.slow
def test_given_recordings_are_learned_from_only_if_asked() -> None:
    robot = pendulum()
    first, other = (signid.read_recording(log(8.0, seed=seed), robot) for seed in (1, 2))
    split, whole = (
        signid.identify_servos(robot, first, held_out=other, prior=EXACT, refit=refit, options=OPTIONS)
        for refit in (None, True)
    )
    assert (split.refit, whole.refit) == (False, True)
    assert np.array_equal(split.rollout.whole_rms, whole.rollout.whole_rms)
    assert (whole.joints[0].numbers["kp"].std or 1) < 0.9 * (split.joints[0].numbers["kp"].std or 0)


@pytest.mark.slow
def test_a_limit_that_only_held_out_rows_reach_is_not_averaged_into_the_numbers() -> None:
    limited = SWING.with_(effort_limit=0.7)
    split, whole = (found(refit, 20.0, 2.0, limited) for refit in (False, None))
    assert not whole.refit and whole.servos == split.servos
    assert "only they reach an effort limit, which the model lacks (swing)" in notes(whole)[0]
    assert not notes(split)


@pytest.mark.slow
def test_bounds_of_all_rows_are_those_of_the_written_model() -> None:
    bounds = []
    for refit in (False, None):
        (line,) = [line for line in found(refit, 20.0, 2.0).joints[0].not_identifiable if "effort limit" in line]
        bounds.append(float(line.split("above ")[1].split()[0]))
    assert bounds[1] > 1.2 * bounds[0], "the held-out rows ask for more torque, and nothing saturates"


def test_no_time_left_keeps_the_first_fit() -> None:
    robot = pendulum()
    with time_limit(1e-3):
        late = signid.identify_servos(robot, signid.read_recording(log(12.0), robot), options=OPTIONS)
    assert not late.refit and late.servos == found(False).servos
    assert any("the fit of drives to all rows was cut short" in flag for flag in late.flags)


@pytest.mark.slow
def test_the_command_says_it_in_json_and_can_leave_it_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "actuators.toml").write_text(
        "[joint.joint_1.servo]\nkp = 60.0\nkd = 1.5\nviscous_friction = 0.5\ndelay = 0.02\ncoulomb_friction = 0.5\n"
        "armature = 0.1\n"
    )
    t, path = np.arange(600) / 50, tmp_path / "log.csv"
    u = 0.5 * np.sin(2 * np.pi * 0.4 * t) + 0.2 * np.sin(2 * np.pi * 1.1 * t)
    robot = signid.load_robot("1r", actuators=str(tmp_path / "actuators.toml"))
    grid = {"t": t, "q_joint_1": u, "q_des_joint_1": u}
    made = simulate_servos(signid.load_model(robot), signid.read_recording(grid, robot)).columns
    q = made["q_joint_1"] + NOISE * np.random.default_rng(0).standard_normal(len(t))
    pl.DataFrame({"t": t, "q_joint_1": q, "q_des_joint_1": u}).write_csv(path)
    rms = []
    for words, refit in (([], True), (["--no-refit"], False)):
        assert run(["identify", "1r", str(path), "--json", *words]) in (0, 3)
        content = json.loads(capsys.readouterr().out)
        assert content["fit"]["refit"] is refit
        rms.append(content["fit"]["held_out_rms"])
    assert rms[0] == rms[1]
