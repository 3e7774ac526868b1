"""Laws of position drives: their cards and equations, and one closed loop in simulations of torque and of commands."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest
from printed import known

from signid.cli import run
from signid.effects import DRIVE_EFFECTS, EFFECTS
from signid.effects.base import Effect
from signid.effects.drive import COMMAND_STAGES, STAGES, DriveLaw, DriveState
from signid.effects.naming import law_syntax
from signid.errors import OptionError
from signid.model import Model, load_model, with_servos
from signid.servo.simulate import simulate_servos
from signid.servos import LOOP_NUMBERS, SERVO_UNITS, Servo
from signid.simulation.plant import Torques, simulate, track
from signid.types import Array, Law, Trajectory

DRIVES = list(DRIVE_EFFECTS)
ALONE = [law for law in DRIVES if law.name != "link_encoder"]  # which acts beside backlash
STEP, SECONDS = 2e-4, 3.0  # [s]
# values at which each law changes the loop of the pendulum visibly
LOOP = {
    "servo_gain": {"kp": 60.0},
    "register_gain": {"kp": 160.0},
    "servo_damping": {"kd": 4.0},
    "error_damping": {"kd": 9.0},
    "command_delay": {"delay": 0.04},
    "effort_limit": {"limit": 9.0},
    "duty_limit": {"limit": 9.0},
    "speed_limit": {"speed": 2.5, "effort_limit": 25.0},
    "dead_band": {"band": 0.05},
    "profile_limit": {"speed": 0.8},
    "voltage_droop": {"coefficient": 0.05},
}

JOINT = {
    "stribeck_friction": {"level": 3.0, "velocity": 0.4},
    "position_friction": {"amplitude": 0.9, "phase": 0.4, "frequency": 2.0},
    "spring": {"stiffness": 12.0, "rest": 0.3},
    "backlash": {"gap": 0.05},
}


def ids(law: Effect) -> str:
    return law.name


def pendulum() -> Model:
    return with_servos(load_model("1r"), {"joint_1": Servo(kp=80.0, kd=6.0)})


def asked() -> Trajectory:
    t = np.arange(round(SECONDS / STEP)) * STEP
    late = np.maximum(t - 0.5, 0)  # both begin at rest
    q = 0.7 * np.sin(2.3 * late) ** 3 + 0.1 * np.sin(11 * late) ** 2
    v = np.gradient(q, STEP)
    return Trajectory(("joint_1",), t, q[:, None], v[:, None], np.gradient(v, STEP)[:, None])


def by_torque(laws: tuple[Law, ...]) -> Array:
    """Positions (K,) of the pendulum in the plant that records torque, with its controller as the drive."""
    bare = Model(pendulum().robot, pendulum().inertials, ())
    damping = () if any(law.effect.name.endswith("damping") for law in laws) else (drive("servo_damping", kd=6.0),)
    gains = np.array([80.0]), np.array([6.0])
    controller = track(bare, asked(), gains=gains, feed_forward=0.0)
    return simulate(Model(bare.robot, bare.inertials, (*damping, *laws)), controller, SECONDS, step=STEP).true_q[:, 0]


def by_commands(laws: tuple[Law, ...]) -> Array:
    """The same in the compiled loop of position drives, at instants of 1 ms."""
    return simulate_servos(pendulum(), asked(), inject=laws).q[:, 0]


def drive(name: str, **parameters: float) -> Law:
    return Law(EFFECTS[name], (0,), parameters)


@pytest.mark.parametrize("law", DRIVES, ids=ids)
def test_the_card_is_complete(law: DriveLaw) -> None:
    assert EFFECTS[law.name] is law and law.stage in STAGES and law.scope == "joint"
    assert law.equation and law.typical and type(law).__doc__ and set(law.example) == set(law.parameters)
    assert len(law.source) > 30 and "," in law.source
    assert set(law.numbers) == set(law.parameters) and set(law.numbers.values()) <= {*LOOP_NUMBERS, "kp_register"}
    for key, number in law.numbers.items():
        assert law.parameters[key].unit == SERVO_UNITS.get(number, "1"), key
    assert bool(law.fault) == bool(law.variable), "a law that a diagnosis names says what its mismatch depends on"
    packed = law.packed(Servo(), law.example)
    assert [getattr(packed, number) for number in law.numbers.values()] == list(law.example.values())


@pytest.mark.parametrize("law", [law for law in DRIVES if law.stage not in COMMAND_STAGES], ids=ids)
def test_the_equation_is_what_the_code_does(law: DriveLaw) -> None:
    random = np.random.default_rng(0)
    q, v, command, reference, torque = random.normal(size=(5, 400)) * [[0.02], [9.0], [0.02], [9.0], [30.0]]
    x = DriveState(q, v, command, reference, command - q, torque)
    names = known(law) | vars(x)
    np.testing.assert_allclose(eval(law.equation, names), law.acts(x, **law.example), rtol=1e-12, atol=1e-12)


@pytest.fixture(scope="module")
def usual() -> tuple[Array, Array]:
    """Positions without any of the laws, by torque and by commands."""
    return by_torque(()), by_commands(())


@pytest.fixture(scope="module")
def rubbing() -> tuple[tuple[Law, ...], Array]:
    """Friction and inertia of a drive, and the positions with them."""
    base = (drive("coulomb_friction", level=1.0), drive("armature", inertia=0.3))
    return base, by_torque(base)


@pytest.mark.slow_cases(but="servo_gain|effort_limit|command_delay|dead_band")
@pytest.mark.parametrize("law", ALONE, ids=ids)
def test_both_modes_simulate_one_loop(law: DriveLaw, usual: tuple[Array, Array]) -> None:
    laws = (drive(law.name, **LOOP[law.name]),)
    fine, (plain, ideal) = by_torque(laws), usual
    every = round(1e-3 / STEP)
    here = min(len(ideal), len(plain[::every]))
    assert np.abs(plain[::every][:here] - ideal[:here]).max() < 2e-3
    far = np.abs(fine[::every][:here] - by_commands(laws)[:here]).max()
    change = np.abs(fine - plain).max()
    assert change > 0.01 and far < max(3e-3, 0.06 * change), (far, change)


@pytest.mark.slow_cases("backlash|stribeck")
@pytest.mark.parametrize("name", JOINT)
def test_laws_of_the_joint_act_in_both_modes(name: str, rubbing: tuple[tuple[Law, ...], Array]) -> None:
    law, model, (base, plain) = drive(name, **JOINT[name]), pendulum(), rubbing
    fine = by_torque((*base, law))
    loop = simulate_servos(model, asked(), inject=(*base, law)).q[:, 0]
    every = round(1e-3 / STEP)
    here = min(len(loop), len(fine[::every]))
    late = slice(1300, here)  # a gap begins on another side
    change, far = np.abs(fine - plain).max(), np.abs(fine[::every][late] - loop[late]).max()
    assert change > 0.004 and far < max(2e-3, 0.15 * change), (far, change)


@pytest.mark.slow
def test_an_encoder_on_the_link_is_one_loop_in_both_modes() -> None:
    laws = (
        drive("coulomb_friction", level=1.0),
        drive("armature", inertia=0.3),
        drive("backlash", gap=0.05),
        drive("link_encoder", side=1.0),
    )
    damping = drive("servo_damping", kd=6.0)
    bare = Model(pendulum().robot, pendulum().inertials, ())
    controller = track(bare, asked(), gains=(np.array([80.0]), np.array([6.0])), feed_forward=0.0)
    fine = simulate(Model(bare.robot, bare.inertials, (damping, *laws)), controller, SECONDS, step=STEP).q[:, 0]
    loop = simulate_servos(pendulum(), asked(), inject=laws).q[:, 0]
    here = slice(1300, min(len(loop), len(fine[::5])))
    assert np.abs(fine[::5][here] - loop[here]).max() < 0.008


def test_laws_of_drives_need_commands() -> None:
    torques = Torques(np.array([0.0, 1.0]), np.zeros((2, 1)), np.zeros(1), np.zeros(1))
    model = Model(pendulum().robot, pendulum().inertials, (drive("effort_limit", limit=3.0),))
    with pytest.raises(OptionError, match="effort_limit acts on commanded positions; give a motion in place"):
        simulate(model, torques, 0.1)


@pytest.mark.slow_cases("servo")
@pytest.mark.parametrize("mode", [(), ("--servo",)], ids=["torque", "servo"])
def test_every_law_of_drives_can_be_injected(
    mode: tuple[str, ...], capfd: pytest.CaptureFixture[str], tmp_path: object
) -> None:
    model = f"{tmp_path}/model.json"
    with_servos(load_model("3r"), {"joint_2": Servo(kp=300.0, kd=20.0)}).save(model)
    for law in DRIVES:
        text = law_syntax(law).replace("@JOINT", "@joint_2")
        assert run(["simulate", model, "--json", "--duration", "0.5", "--inject", text, *mode]) == 0, text
        found = json.loads(capfd.readouterr().out)
        assert re.search(law.name, json.dumps(found))


def test_they_are_listed_and_shown(capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["effects", "--json"]) == 0
    listed = {one["name"]: one for one in json.loads(capfd.readouterr().out)["effects"]}
    assert {law.name for law in DRIVES} < set(listed) and listed["servo_gain"]["acts_on"] == "position drive"
    assert run(["effects", "dead_band"]) == 0
    card = " ".join(capfd.readouterr().out.split())
    assert "error - clip(error, -band, band)" in card and "Slotine" in card
