"""Laws of dynamics that hold for any arm: random tables of Denavit-Hartenberg parameters, random states."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pinocchio as pin
from hypothesis import given, strategies as st
from numpy.testing import assert_allclose

from signid.effects import EFFECT_NAMES, EFFECTS
from signid.effects.law import candidate_places, law_torque
from signid.regression.base_parameters import build_base
from signid.regression.motion import Motion, regressor
from signid.robot import DHLink, robot_from_text, urdf_from_dh
from signid.types import Law, Robot

LINEAR = (*EFFECT_NAMES, "asymmetric_friction", "quadratic_friction", "load_friction")
SIZES = st.floats(-0.5, 0.5)
ANGLES = st.sampled_from([0.0, np.pi / 2, -np.pi / 2, 0.3])


@st.composite
def links(draw: st.DrawFn) -> DHLink:
    points = np.array(draw(st.lists(st.tuples(SIZES, SIZES, SIZES), min_size=5, max_size=5)))
    centre, spread = points.mean(0), np.cov(points.T) + 1e-3 * np.eye(3)
    mass = draw(st.floats(0.1, 10))
    return DHLink(
        draw(ANGLES),
        draw(SIZES),
        draw(SIZES),
        prismatic=draw(st.booleans()),
        mass=mass,
        centre=tuple(centre),
        inertia=mass * (np.trace(spread) * np.eye(3) - spread),
    )


ARMS = st.lists(links(), min_size=1, max_size=4).map(
    lambda table: robot_from_text(urdf_from_dh("arm", table), "urdf", "arm")
)
SEEDS = st.integers(0, 2**32 - 1)


def states(robot: Robot, seed: int, count: int = 6) -> Motion:
    rng = np.random.default_rng(seed)
    return Motion(robot, np.arange(count) * 0.1, *rng.uniform(-2, 2, (3, count, len(robot.joints))))


def stated(robot: Robot) -> np.ndarray:
    return np.concatenate([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]])


@given(ARMS, SEEDS)
def test_base_parameters_carry_all_that_torque_shows(robot: Robot, seed: int) -> None:
    laws = [Law(EFFECTS[name], (j,)) for name in LINEAR for j in range(len(robot.joints))]
    base, full = build_base(robot, laws), regressor(states(robot, seed), laws)
    standard = np.random.default_rng(seed).standard_normal(full.shape[2])
    torque = full @ standard
    reduced = full[:, :, base.independent] @ (base.combination @ standard)
    assert_allclose(reduced, torque, atol=1e-7 * np.abs(torque).max())


@given(ARMS, SEEDS)
def test_inverse_dynamics_undoes_forward_dynamics(robot: Robot, seed: int) -> None:
    motion = states(robot, seed)
    data = robot.model.createData()
    for q, v, tau in zip(motion.q, motion.v, motion.a, strict=True):
        a = pin.aba(robot.model, data, q, v, tau)
        there = Motion(robot, np.zeros(1), q[None], v[None], np.reshape(a, (1, -1)))
        assert_allclose(there.load[0], tau, atol=1e-7 * max(1.0, np.abs(a).max()))


@given(ARMS, SEEDS)
def test_torque_does_not_know_in_which_frame_a_body_is_written(robot: Robot, seed: int) -> None:
    """The last joint's frame turned and moved along its own axis, its body expressed anew: the same torque."""
    rng, motion = np.random.default_rng(seed), states(robot, seed)
    model = robot.model.copy()
    last, joint = model.njoints - 1, model.joints[model.njoints - 1]
    prismatic = bool(robot.prismatic[-1])
    shift = pin.SE3(np.eye(3), np.array([0, 0, 0.0 if prismatic else rng.uniform(-1, 1)]))
    turn = pin.SE3(pin.utils.rotate("z", rng.uniform(-3, 3)) if prismatic else np.eye(3), np.zeros(3))
    moved = shift * turn
    model.jointPlacements[last] = model.jointPlacements[last] * moved
    model.inertias[last] = model.inertias[last].se3ActionInverse(moved)
    assert joint.nv == 1
    other = replace(robot, model=model)
    there = Motion(other, motion.t, motion.q, motion.v, motion.a)
    assert_allclose(there.load, motion.load, atol=1e-8 * max(1.0, np.abs(motion.load).max()))


@given(ARMS, SEEDS)
def test_the_regressor_is_linear_in_the_stated_parameters(robot: Robot, seed: int) -> None:
    motion = states(robot, seed)
    torque = regressor(motion) @ stated(robot)
    assert_allclose(torque, motion.load, atol=1e-8 * max(1.0, np.abs(torque).max()))


@given(ARMS, SEEDS, st.floats(0, 100))
def test_friction_never_creates_energy(robot: Robot, seed: int, size: float) -> None:
    motion = states(robot, seed)
    for effect in (effect for effect in EFFECTS if effect.dissipative):
        for place in candidate_places(effect, len(robot.joints)):
            rows, torque = law_torque(Law(effect, place, effect.example), motion)
            assert (size * np.sum(torque * motion.v[:, list(rows)], axis=1) >= 0).all()
