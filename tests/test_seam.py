"""Torque mode and servo mode: the same numbers as laws of a joint and as numbers of its drive do the same."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

import signid
from signid.cli import run
from signid.diagnose.data.hypotheses import propose
from signid.effects import EFFECTS
from signid.effects.naming import parse_law
from signid.errors import OptionError
from signid.model import Model, command_model, load_model, torque_model, with_servos
from signid.regression.motion import Motion
from signid.servo.simulate import simulate_servos
from signid.servos import PASSIVE_LAWS, Servo
from signid.types import Law, Trajectory

SIZES = {"armature": 0.5, "viscous_friction": 0.5, "coulomb_friction": 0.4, "torque_offset": -0.3}
DRIVE = Servo(kp=40.0, kd=1.0)


@pytest.fixture(scope="module")
def bare() -> Model:
    model = load_model("3r")
    return Model(model.robot, model.inertials, ())


def motion(model: Model) -> Motion:
    t = np.linspace(0, 1, 50)
    q, v = np.stack([np.sin(3 * t)] * 3, 1), np.stack([3 * np.cos(3 * t)] * 3, 1)
    return Motion(model.robot, t, q, v, -9 * q)


def with_law(model: Model, name: str, size: float) -> Model:
    return replace(model, laws=(*model.laws, law(name, size)))


def law(name: str, size: float) -> Law:
    return Law(EFFECTS[name], (1,), EFFECTS[name].physical([size], {}))


def commanded(seconds: float = 1.0, size: float = 0.3) -> Trajectory:
    t = np.arange(0, seconds, 0.01)
    q = np.stack([size * np.sin(6 * t)] * 3, 1)
    return Trajectory(("joint_1", "joint_2", "joint_3"), t, q, np.gradient(q, t, axis=0), np.zeros_like(q))


@pytest.mark.parametrize("name", PASSIVE_LAWS)
def test_a_number_of_a_drive_is_a_law_of_its_joint(name: str, bare: Model) -> None:
    x, size = motion(bare), SIZES[name]
    stated, drive = with_law(bare, name, size), with_servos(bare, {"joint_2": replace(DRIVE, **{name: size})})
    change = stated.inverse(x) - bare.inverse(x)
    assert np.abs(change).max() >= 0.29
    assert_allclose(drive.inverse(x), stated.inverse(x), atol=1e-12)
    both = with_servos(stated, {"joint_2": replace(DRIVE, **{name: size})})
    assert_allclose(both.inverse(x), stated.inverse(x), atol=1e-12, err_msg="stated twice, counted once")


def test_friction_by_motor_torque_has_its_own_law(bare: Model) -> None:
    """tau_m = torque of the link + 0.2 abs(tau_m) sign(v), solved for the torque of the motor."""
    x = motion(bare)
    link, motor = bare.inverse(x)[:, 1], with_servos(bare, {"joint_2": replace(DRIVE, load_friction=0.2)}).inverse(x)
    assert_allclose(motor[:, 1], link + 0.2 * np.abs(motor[:, 1]) * np.sign(x.v[:, 1]), atol=1e-12)
    assert [
        law.effect.name for law in torque_model(with_servos(bare, {"joint_2": replace(DRIVE, load_friction=0.2)})).laws
    ] == ["motor_friction"]


def test_laws_stay_where_a_drive_states_its_gain_only(bare: Model) -> None:
    model = with_law(with_law(bare, "armature", 0.5), "coulomb_friction", 0.4)
    driven = with_servos(model, {"joint_2": Servo(kp=10)})
    assert [law.effect.name for law in driven.joint_laws] == ["armature", "coulomb_friction"]
    assert_allclose(driven.inverse(motion(bare)), model.inverse(motion(bare)), atol=1e-12)
    loop, notes = command_model(driven, driven.servos)
    assert (loop.servos["joint_2"].armature, loop.servos["joint_2"].coulomb_friction, notes) == (0.5, 0.4, ())
    assert loop.laws_beside_drives == ()
    lost, notes = command_model(replace(driven, laws=(parse_law("cable_torque@2", bare.robot),)), driven.servos)
    assert notes == ("the simulation of commands leaves out cable_torque of joint_2",)


def test_commands_move_laws_and_numbers_of_drives_alike(bare: Model) -> None:
    servos = {joint: DRIVE for joint in bare.robot.joints}
    laws = replace(bare, laws=tuple(law for name, x in SIZES.items() for law in with_law(bare, name, x).laws))
    numbers = with_servos(bare, {**servos, "joint_2": replace(DRIVE, **SIZES)})
    free, one, other = (
        simulate_servos(m, commanded()).q for m in (with_servos(bare, servos), with_servos(laws, servos), numbers)
    )
    assert np.abs(one - other).max() == 0 and np.abs(one - free).max() > 1e-3


def test_applied_torque_feels_the_numbers_of_drives(
    bare: Model, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    driven = with_servos(bare, {"joint_2": replace(DRIVE, **SIZES)})
    driven.save(tmp_path / "driven.json")
    torque_model(driven).save(tmp_path / "laws.json")
    rows = []
    for name in ("driven", "laws"):
        words = f"simulate {tmp_path}/{name}.json --duration 1 --seed 3 --json -o {tmp_path}/{name}.csv"
        assert run(words.split()) == 0
        rows.append((tmp_path / f"{name}.csv").read_text())
        notes = json.loads(capsys.readouterr().out)["notes"]
        assert any("position drives of joint_2" in note for note in notes) == (name == "driven")
    assert rows[0] == rows[1]


def test_a_table_of_a_drive_states_laws_in_both_modes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A friction of 0.5 in [joint.J.servo] wins over 0.1 in [joint.J]; an identified one wins over both."""
    monkeypatch.chdir(tmp_path)
    text = "[joint.joint_2]\nviscous_friction = 0.1\n[joint.joint_2.servo]\nkp = 40.0\nkd = 1.0\n"
    Path("a.toml").write_text(text + "viscous_friction = 0.5\n")
    stated = load_model("3r", actuators="a.toml")
    assert [(law.effect.name, law.joints, law.parameters) for law in stated.laws] == [
        ("viscous_friction", (1,), {"coefficient": 0.5})
    ]
    assert run("simulate 3r --actuators a.toml --duration 1 --json -o x.csv".split()) == 0
    assert any("position drives of joint_2" in note for note in json.loads(capsys.readouterr().out)["notes"])
    identified = replace(stated, laws=(law("viscous_friction", 0.8),))
    loops = [simulate_servos(model, commanded()).model.servos["joint_2"] for model in (stated, identified)]
    assert [loop.viscous_friction for loop in loops] == [0.5, 0.8]


def test_saturation_knows_the_whole_drive(bare: Model) -> None:
    idle = {"joint_1": Servo(kp=400.0, effort_limit=1.0, dead_band=2.0)}  # a vertical axis, so it stays
    assert simulate_servos(with_servos(bare, idle), commanded(size=0.02)).saturated.tolist() == [0, 0, 0], (
        "it never pushes"
    )
    strong = {"joint_1": Servo(kp=400.0, effort_limit=1.0)}
    assert simulate_servos(with_servos(bare, strong), commanded()).saturated[0] > 0.5


def test_another_friction_by_load_is_refused(bare: Model) -> None:
    law = parse_law("load_friction@2:coefficient=0.1", bare.robot)
    with pytest.raises(OptionError, match=r"cannot inject load_friction.*servo@JOINT:load_friction=0\.1"):
        simulate_servos(with_servos(bare, {"joint_2": DRIVE}), commanded(), inject=[law])


def test_two_laws_of_one_effect_at_one_joint_can_both_be_wrong(bare: Model) -> None:
    ripples = [f"torque_ripple@2:amplitude=0.5,frequency={k},phase=0" for k in (7, 11)]
    model = replace(bare, laws=tuple(parse_law(text, bare.robot) for text in ripples))
    x = motion(bare)
    found = [
        y.stated
        for y in propose(model, replace(x, recorded=bare.inverse(x), predicted=bare.inverse(x)))
        if y.stated is not None
    ]
    assert [law in found for law in model.laws] == [True, True]


def test_exports_of_torque_hold_the_numbers_of_drives(bare: Model) -> None:
    driven, x = with_servos(bare, {"joint_2": replace(DRIVE, **SIZES, load_friction=0.2)}), motion(bare)
    space: dict[str, object] = {}
    exec(signid.export(driven, "arrays").text, space)
    got = space["inverse_dynamics"](x.q, x.v, x.a)  # type: ignore[operator]
    assert_allclose(got, driven.inverse(x), atol=1e-9)
