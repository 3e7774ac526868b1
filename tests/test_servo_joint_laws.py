"""Laws of the joint are found in commands and positions: the plant that records torque makes the data."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest

from signid.effects import EFFECTS
from signid.model import Model, load_model, with_servos
from signid.servo.diagnose import diagnose_servos
from signid.servos import JOINT_LAWS, Servo
from signid.simulation.plant import simulate, track
from signid.types import Law, Trajectory

STATED = Servo(kp=20.0, kd=0.8, coulomb_friction=0.5, viscous_friction=0.1, armature=0.05)
GEAR = EFFECTS["gear_friction"]
STEP, EVERY, SECONDS = 5e-4, 20, 16.0  # [s] of the simulation; steps of a row; [s]
PLANTED = {
    "stribeck_friction": {"level": 2.0, "velocity": 0.5},
    "spring": {"stiffness": 4.0, "rest": 0.3},
    "backlash": {"gap": 0.05},
    "position_friction": {"amplitude": 0.45, "phase": 0.4, "frequency": 2.0},
}
WITHIN = {"stribeck_friction": 0.15, "spring": 0.03, "backlash": 0.1, "position_friction": 0.15}  # of the main number


def law(name: str, **parameters: float) -> Law:
    return Law(EFFECTS[name], (0,), parameters)


def record(path: Path, *planted: Law) -> Path:
    """A recording of the pendulum 1r, whose motion reverses often and whose commands have steps."""
    model, t = load_model("1r"), np.arange(round(SECONDS / STEP)) * STEP
    rng = np.random.default_rng(3)
    u = 0.4 * sum(np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / (1 + f) for f in (0.3, 0.7, 1.3, 2.1))
    u += np.where((t % 4) > 2.5, np.repeat(rng.uniform(-0.4, 0.4, len(t) // 1400 + 1), 1400)[: len(t)], 0.0)
    u = np.repeat(u[::EVERY], EVERY)[: len(t)]  # a command is held for a row
    still = np.zeros((len(t), 1))
    drive = (law("servo_damping", kd=STATED.kd), law("armature", inertia=STATED.armature))
    friction = (law("coulomb_friction", level=0.5), law("viscous_friction", coefficient=0.1))
    robot = Model(model.robot, model.inertials, (*drive, *friction, *planted))
    gains = np.array([STATED.kp]), np.zeros(1)
    asked = Trajectory(model.robot.joints, t, u[:, None], still, still)
    moved = simulate(robot, track(model, asked, gains=gains, feed_forward=0.0), SECONDS, step=STEP)
    q = moved.q[::EVERY, 0] + 2e-4 * rng.standard_normal(len(t[::EVERY]))
    pl.DataFrame({"t": t[::EVERY], "q_joint_1": q, "q_des_joint_1": u[::EVERY]}).write_csv(path)
    return path


def simulation() -> Model:
    return with_servos(load_model("1r"), {"joint_1": STATED})


def test_nothing_is_found_without_them(tmp_path: Path) -> None:
    found = diagnose_servos(simulation(), str(record(tmp_path / "a.csv")))
    assert found.verdict == "nothing_missing" and not found.findings


@pytest.mark.slow_cases(but="spring")
@pytest.mark.parametrize("name", PLANTED)
def test_a_law_of_the_joint_is_named_first(name: str, tmp_path: Path) -> None:
    found = diagnose_servos(simulation(), str(record(tmp_path / "a.csv", law(name, **PLANTED[name]))))
    first = found.causes[0]
    assert (found.verdict, first.effect, first.joint) == ("named", name, "joint_1")
    assert set(first.parameters) == {*JOINT_LAWS[name], *(["link_encoder"] if name == "backlash" else [])}
    if name in WITHIN:
        key = next(iter(JOINT_LAWS[name]))
        assert first.parameters[key].value == pytest.approx(PLANTED[name][key], rel=WITHIN[name])
    assert found.rollout_after.whole_rms[0] < 0.3 * found.rollout_before.whole_rms[0]
    extended = [one for one in found.model.laws_beside_drives if one.effect.name == name]
    assert len(extended) == 1, "the extended simulation has the law"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["backlash", "dead_band"])
def test_backlash_before_the_encoder_is_distinguished_from_a_dead_band(name: str, tmp_path: Path) -> None:
    gap, band = (law("backlash", gap=0.05), law("link_encoder", side=1.0)), law("dead_band", band=0.025)
    found = diagnose_servos(simulation(), str(record(tmp_path / "a.csv", *(gap if name == "backlash" else [band]))))
    first = found.causes[0]
    assert (first.effect, first.joint) == (name, "joint_1") and first.probability > 0.9
    assert not {"backlash", "dead_band"} & {rival.effect for rival in first.alternatives}
    if name == "backlash":
        assert first.parameters["gap"].value == pytest.approx(0.05, rel=0.15)  # the stops of this plant are soft
        assert first.parameters["link_encoder"].value == 1.0
        assert load_model(found.model.save(tmp_path / "model.json")).servos["joint_1"].link_encoder == 1.0


def test_a_saved_model_keeps_them(tmp_path: Path) -> None:
    planted = {**PLANTED, "encoder_offset": {"offset": 0.01}, "gear_friction": GEAR.example}
    laws = tuple(law(name, **parameters) for name, parameters in planted.items())
    model = with_servos(Model(load_model("1r").robot, load_model("1r").inertials, laws), {"joint_1": STATED})
    again = load_model(model.save(tmp_path / "model.json"))
    assert again.servos == model.servos and again.servos["joint_1"].backlash_gap == 0.05
    assert (again.servos["joint_1"].gear_external, again.servos["joint_1"].encoder_offset) == (0.4, 0.01)
    assert {one.effect.name for one in again.laws_beside_drives} == set(planted)
