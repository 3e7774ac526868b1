"""The simulator on robots of every kind, against MuJoCo, which body a law acts on, and refusals."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from plant import WIDE, law, model, released, waves, wheel
from toys import joint, link, toy

import signid
from signid.effects import EFFECTS
from signid.errors import OptionError
from signid.model import Model
from signid.regression.motion import Motion
from signid.robot import hold
from signid.simulation.plant import Simulation, simulate, track
from signid.simulation.plant.control import Tracking
from signid.types import Array, Law, Robot, Trajectory

FRICTION: Mapping[str, Any] = {"viscous_friction": (3.0, 1.0), "coulomb_friction": (4.0, 1.0), "armature": (0.1, 0.1)}
LIGHT = '<inertial><mass value="1e-9"/><inertia ixx="1e-9" ixy="0" ixz="0" iyy="1e-9" iyz="0" izz="1e-9"/></inertial>'
FREE_JOINT = '<joint name="{0}" type="{1}"><parent link="{2}"/><child link="{3}"/><axis xyz="0 0 1"/>{4}</joint>'


def free(name: str, parent: str, child: str, kind: str = "revolute", more: str = WIDE) -> str:
    return FREE_JOINT.format(name, kind, parent, child, more)


def rested(given: Model, q: Any, seconds: float = 2.0) -> Simulation:
    """The robot held at a position by a controller without a model."""
    n = len(given.robot.joints)
    still = np.zeros((2, n))
    path = Trajectory(given.robot.joints, np.array([0.0, seconds]), still + np.asarray(q, float), still, still)
    return simulate(given, track(model(given.robot), path, bandwidth=4.0, feed_forward=0.0), seconds)


def in_mujoco(
    given: Model, drive: Tracking, seconds: float, integrator: str, step: float = 1e-3
) -> tuple[Array, Array]:
    """The same robot, laws and controller in MuJoCo."""
    mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")
    from benchmarks.plants.bodies import Body, bare

    other = mujoco.MjSpec.from_string(bare(Body(given.robot.document, given.robot.joints))).compile()
    data, at = mujoco.MjData(other), [int(other.joint(joint).dofadr[0]) for joint in given.robot.joints]
    other.opt.timestep, other.opt.integrator = step, getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")
    other.opt.iterations, other.opt.tolerance = 50, 1e-12
    for off in ("LIMIT", "CONTACT", "EULERDAMP"):
        other.opt.disableflags |= getattr(mujoco.mjtDisableBit, f"mjDSBL_{off}")
    other.jnt_actfrclimited[:] = 0
    other.dof_solref[:], other.dof_solimp[:] = [2 * step, 1], [0.9999, 0.99999, 1e-4, 0.5, 2]
    for name, slot in (("viscous_friction", "damping"), ("coulomb_friction", "frictionloss"), ("armature", "armature")):
        values = [next(iter(x.parameters.values())) for x in given.laws if x.effect.name == name]
        getattr(other, f"dof_{slot}")[at] = values
    plan, q, tau = drive.plan(np.arange(0, seconds, step)), [], []
    data.qpos[at], data.qvel[at] = drive.start()
    for k in range(len(plan.torque)):
        error, slip = plan.desired[k] - data.qpos[at], plan.speed[k] - data.qvel[at]
        data.qfrc_applied[at] = plan.torque[k] + plan.stiffness * error + plan.damping * slip
        q.append(data.qpos[at].copy())
        tau.append(data.qfrc_applied[at].copy())
        mujoco.mj_step(other, data)
    return np.array(q), np.array(tau)


@pytest.mark.parametrize("name", ["3r", "ur5"])
def test_it_moves_as_in_mujoco(name: str) -> None:
    """Euler's steps are those of signid; implicit ones take the damping at their end, and differ in first order."""
    n = len(signid.load_robot(name).joints)
    laws = [
        Law(EFFECTS[key], (j,), EFFECTS[key].physical([float(x)], {}))
        for key, ends in FRICTION.items()
        for j, x in enumerate(np.linspace(*ends, n))
    ]
    given = model(name, *laws)
    drive = track(model(name, *laws[-n:]), waves(given.robot.joints, 6.0, size=0.8))
    made = simulate(given, drive, 6.0, substeps=1)
    assert (np.diff(np.sign(made.true_v), axis=0) != 0).sum() > 10, "joints reverse"
    for integrator, most, share in (("EULER", 2e-6, 1e-5), ("IMPLICITFAST", 1e-4, 2e-3)):
        q, tau = in_mujoco(given, drive, 6.0, integrator)
        assert np.abs(made.true_q - q).max() < most
        assert np.sqrt(np.mean((made.tau - tau) ** 2)) < share * np.sqrt(np.mean(tau**2))


def test_links_without_mass_move_with_the_others() -> None:
    parts = free("z", "a", "b"), joint("y", "b", "c", more=WIDE)
    bare, light = (toy(link("a"), link("b", body), link("c"), *parts) for body in ("", LIGHT))
    made = [released(model(robot), (0.1, 0.2), 0.5, torque=(1.0, 0.5)).true_q for robot in (bare, light)]
    assert np.isfinite(made[0]).all() and np.abs(made[0] - made[1]).max() < 1e-6


def test_a_joint_that_is_held_moves_with_its_link() -> None:
    whole = signid.load_robot("3r")
    held = hold(whole, {"joint_1": 0.3, "joint_3": 0.4})
    stiff = law("viscous_friction", 0, coefficient=1e9), law("viscous_friction", 2, coefficient=1e9)
    one = released(model(held), -1.2, 0.5)
    three = released(model(whole, *stiff), (0.3, -1.2, 0.4), 0.5)
    assert one.joints == ("joint_2",) and np.ptp(one.true_q) > 0.1
    assert np.allclose(one.true_q[:, 0], three.true_q[:, 1], rtol=0, atol=1e-5)


@pytest.mark.parametrize("kind", ["revolute", "continuous"])
def test_a_wheel_turns_on_and_on(kind: str) -> None:
    more = '<limit effort="10" velocity="50"/>' if kind == "continuous" else WIDE
    made = released(model(wheel(kind, inertia=0.5, more=more)), 0.0, 2.0, v=20.0, torque=1.0)
    assert np.allclose(made.true_q[-1], 20 * 1.999 + 1.999**2, rtol=1e-3)
    assert made.true_q[-1] > 2 * np.pi


def test_a_carriage_slides_as_newton_says() -> None:
    given = model("emps", law("coulomb_friction", 0, level=20.0))
    made = released(given, 0.0, 0.5, torque=50.0)
    assert np.allclose(made.true_a, 30 / 95.1089, rtol=1e-9)
    assert np.ptp(released(given, 0.0, 0.5, torque=19.9).true_q) == 0


def test_payload_and_tilt_have_the_right_weight() -> None:
    point = {"mass": 1.0, "first_moment_x": 0.1, "first_moment_y": 0.0, "first_moment_z": -0.2}
    heavier = rested(model("1r", law("payload", 0, **point)), np.pi / 2)
    q = heavier.true_q[-1, 0]
    expected = 9.81 * ((5 * 0.5 + 0.2) * np.sin(q) - 0.1 * np.cos(q))
    assert heavier.tau[-1, 0] == pytest.approx(expected, rel=1e-4)
    tilted = rested(model("1r", law("base_tilt", 0, x=0.02, y=0.03)), 0.0)
    q = tilted.true_q[-1, 0]
    assert tilted.tau[-1, 0] == pytest.approx(5 * 0.5 * 9.81 * np.cos(0.02) * np.sin(q + 0.03), rel=1e-3)


def test_robots_that_cannot_be_simulated_get_a_sentence() -> None:
    soft = law("joint_elasticity", 0)
    massless = toy(link("a"), link("b", ""), free("z", "a", "b"))
    far = {"mass": 1.0, "first_moment_x": 0.2, "first_moment_y": 0.0, "first_moment_z": 0.0}
    cases: list[tuple[Model, dict[str, Any], str]] = [
        (model("1r", soft), {}, "needs the inertia of the motor"),
        (model("1r", law("armature", 0), soft, law("backlash", 0)), {}, "two transmission laws"),
        (model(massless), {}, "mass"),
        (model("3r", law("link_inertia", 2, **far)), {}, "mass matrix is not positive"),
        (model("1r"), {"integrator": "euler"}, "rk4"),
        (model("1r"), {"step": -1.0}, "at least one step"),
        (model("1r"), {"torque": 1e9}, "diverged"),
    ]
    for given, more, says in cases:
        with pytest.raises(OptionError, match=says):
            released(given, 0.0, 0.1, **more)
    with pytest.raises(OptionError, match="moves no mass"):
        track(model(massless), waves(("z",), 0.1))


def followed() -> Robot:
    """Joint y follows z, and Pinocchio puts it first."""
    more = f'{WIDE}<mimic joint="z" multiplier="3"/>'
    return toy(*map(link, "abc"), free("z", "a", "b"), free("y", "a", "c", more=more))


def test_a_rotor_turns_with_its_joint_not_with_a_mimic_joint() -> None:
    made = released(model(followed(), law("armature", 0, inertia=0.1)), 0.0, 0.1, torque=2.0)
    assert np.allclose(made.true_a, 2.0 / (1 + 3**2 + 0.1), rtol=1e-9)


def test_held_links_beyond_the_last_joint_do_not_move_its_centre_of_mass() -> None:
    robot = hold(signid.load_robot("3r"), {"joint_3": 0.4})
    given = model(robot, Law(EFFECTS["fluid_drag"], (0, 1), {"coefficient": 6.0}))
    made = released(given, (0.3, -1.0), 0.1, v=2.0)
    motion = Motion(robot, made.t, made.true_q, made.true_v, made.true_a)
    assert np.abs(given.inverse(motion)).max() < 1e-9, "nothing drives it"


def test_a_joint_may_range_beyond_half_a_turn_only() -> None:
    more = '<limit lower="4" upper="6" effort="9" velocity="9"/>'
    made = released(model(toy(link("a"), link("b"), joint("z", "a", "b", more=more))), 5.0, 0.1, torque=0.5)
    assert np.allclose(made.true_a, 0.5, rtol=1e-9)
