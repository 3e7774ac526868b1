"""Faults with independent formulas, and Pinocchio's inverse dynamics of a recorded motion.

The fault is the recorded torque minus the torque of the bodies and of the drives.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from benchmarks.plants.bodies import Body, Drives
from benchmarks.plants.control import STEP, Track, draw_motion
from benchmarks.plants.faults import Fault

Array = NDArray[np.float64]

ROBOTS = Path(__file__).parents[1] / "robots"
ARM = Body((ROBOTS / "3r" / "robot.urdf").read_text(), ("joint_1", "joint_2", "joint_3"))
PENDULUM = Body((ROBOTS / "1r" / "robot.urdf").read_text(), ("joint_1",))
DRIVES = Drives((0.12, 0.10, 0.05), (0.6, 0.5, 0.2), (0.9, 0.8, 0.3), (0.05, -0.12, 0.04))
BARE = Drives((0.05,), (0.0,), (0.0,), (0.0,))  # of the pendulum
MOTION, DURATION, FULL = draw_motion((0.0, 0.3, 0.5), 3), 2.5, 1 / STEP
WEIGHT, INERTIA_1R = 5 * 9.81 * 0.5, 5 * 0.08417 + 5 * 0.25  # N.m, kg.m2 of the pendulum
MOVING, EXACT = 0.05, 2e-4  # rad/s away from reversals; share of the joint's rms torque


class Seen(NamedTuple):
    """A recorded motion, (N, n) each, and the torque of its bodies."""

    t: Array  # (N,) [s]
    q: Array
    v: Array
    a: Array
    load: Array
    jacobian: Array  # (N, 3, n) [m] of the last link's centre of mass


Formula = Callable[[Seen], dict[int, Array]]  # joint -> (N,) [N.m]


def plant(effect: str, joint: int | None = 1, **parameters: float | str) -> Fault:
    return Fault(effect, None if joint is None else ARM.joints[joint], parameters)


def see(track: Track, model: Any = None, turn: Array | None = None) -> tuple[Seen, Array]:
    """The motion by central differences at every step, and the recorded torque of those moments."""
    model = pin.buildModelFromXML(ARM.urdf) if model is None else model
    if turn is not None:
        model.gravity.linear = turn.T @ model.gravity.linear
    data, q = model.createData(), track.q[1:-1]
    v, a = (track.q[2:] - track.q[:-2]) / (2 * STEP), np.diff(track.q, 2, axis=0) / STEP**2
    load, jacobian, last = np.zeros_like(q), np.zeros((len(q), 3, model.nv)), model.njoints - 1
    for k, state in enumerate(zip(q, v, a, strict=True)):
        load[k] = pin.rnea(model, data, *state)
        full = np.reshape(pin.computeJointJacobian(model, data, state[0], last), (6, model.nv))
        pin.forwardKinematics(model, data, state[0])
        arm = model.inertias[last].lever
        jacobian[k] = data.oMi[last].rotation @ (full[:3] - np.cross(arm, full[3:], axis=0))
    return Seen(track.t[1:-1], q, v, a, load, jacobian), track.tau[1:-1]


def drives(x: Seen) -> Array:
    slide = np.sign(x.v) * DRIVES.coulomb_friction
    return x.a * DRIVES.armature + x.v * DRIVES.viscous_friction + slide + DRIVES.torque_offset


def sign(x: Seen, j: int = 1) -> Array:
    return np.sign(x.v[:, j])


def worst(wrong: Array, x: Seen, tau: Array) -> float:
    """The largest error away from reversals of any joint, as a share of the joint's rms torque."""
    away = np.all(np.abs(x.v) > MOVING, axis=1) & (np.abs(x.v[:, 1] + x.v[:, 2]) > MOVING)
    away &= np.convolve(~away, np.ones(9), "same") == 0  # rows whose differences reach over a reversal
    away[:400] = False  # the loop catches up with a motion that begins at speed
    assert away.sum() > 1000
    return float(np.max(np.abs(wrong[away]) / np.sqrt(np.mean(tau**2, axis=0))))


def asymmetric(x: Seen) -> dict[int, Array]:
    v = x.v[:, 1]
    return {1: np.where(v > 0, 0.3 * v + 0.4, 0.5 * v - 0.8)}


def coupled(x: Seen) -> dict[int, Array]:
    both = 0.4 * np.sign(x.v[:, 1] + x.v[:, 2])
    return {1: 0.02 * x.a[:, 2] + 0.3 * x.v[:, 2] + both, 2: 0.02 * x.a[:, 1] + 0.3 * x.v[:, 1] + both}


def drag(x: Seen) -> dict[int, Array]:
    w = np.einsum("kij,kj->ki", x.jacobian, x.v)
    torque = np.einsum("kij,ki->kj", x.jacobian, 3.0 * w * np.linalg.norm(w, axis=1)[:, None])
    return dict(enumerate(torque.T))


def contact(x: Seen) -> dict[int, Array]:
    during = (x.t >= 1.0) & (x.t <= 2.0)
    return dict(enumerate((x.jacobian.transpose(0, 2, 1) @ [4.0, -3.0, 5.0]).T * during))


def dahl(x: Seen) -> dict[int, Array]:
    """Between reversals z approaches the sign of the velocity with the distance travelled."""
    z, out = 0.0, []
    for v in x.v[:, 1]:
        z = np.sign(v) + (z - np.sign(v)) * np.exp(-abs(v) * STEP / 0.02)
        out.append(0.6 * z)
    return {1: np.array(out)}


LAWS: dict[str, tuple[Fault, Formula]] = {
    fault.effect: (fault, formula)
    for fault, formula in (
        (plant("viscous_friction", coefficient=0.5), lambda x: {1: 0.5 * x.v[:, 1]}),
        (plant("coulomb_friction", level=0.7), lambda x: {1: 0.7 * sign(x)}),
        (
            plant(
                "asymmetric_friction",
                viscous_positive=0.3,
                viscous_negative=0.5,
                coulomb_positive=0.4,
                coulomb_negative=0.8,
            ),
            asymmetric,
        ),
        (
            plant("stribeck_friction", level=0.6, velocity=0.2),
            lambda x: {1: 0.6 * np.exp(-((x.v[:, 1] / 0.2) ** 2)) * sign(x)},
        ),
        (plant("quadratic_friction", coefficient=0.4), lambda x: {1: 0.4 * x.v[:, 1] * np.abs(x.v[:, 1])}),
        (plant("load_friction", coefficient=0.1), lambda x: {1: 0.1 * np.abs(x.load[:, 1]) * sign(x)}),
        (plant("presliding_friction", level=0.6, distance=0.02), dahl),
        (
            plant("position_friction", amplitude=0.3, frequency=4.0, phase=0.3),
            lambda x: {1: 0.3 * np.sin(4 * x.q[:, 1] + 0.3) * sign(x)},
        ),
        (
            plant("friction_drift", change=-0.4, time_constant=2.0),
            lambda x: {1: -0.4 * (1 - np.exp(-x.t / 2)) * sign(x)},
        ),
        (plant("armature", inertia=0.5), lambda x: {1: 0.5 * x.a[:, 1]}),
        (plant("torque_offset", offset=0.3), lambda x: {1: np.full(len(x.t), 0.3)}),
        (plant("spring", stiffness=2.0, rest=0.1), lambda x: {1: 2 * (x.q[:, 1] - 0.1)}),
        (plant("cable_torque", cubic=3.0, centre=0.2), lambda x: {1: 3 * (x.q[:, 1] - 0.2) ** 3}),
        (plant("counterbalance", amplitude=1.0, phase=0.3), lambda x: {1: np.sin(x.q[:, 1] + 0.3)}),
        (
            plant("torque_ripple", amplitude=0.4, frequency=20.0, phase=0.5),
            lambda x: {1: 0.4 * np.sin(20 * x.q[:, 1] + 0.5)},
        ),
        (plant("joint_coupling", partner="joint_3", inertia=0.02, viscous=0.3, coulomb=0.4), coupled),
        (plant("external_contact", None, force_x=4.0, force_y=-3.0, force_z=5.0, start=1.0, end=2.0), contact),
        (plant("fluid_drag", None, coefficient=3.0), drag),
        (
            plant("tustin_friction", level=0.6, velocity=0.2),
            lambda x: {1: 0.6 * np.exp(-np.abs(x.v[:, 1]) / 0.2) * sign(x)},
        ),
        (
            plant("double_ripple", amplitude=0.3, second=0.2, frequency=8.0, phase=0.1),
            lambda x: {1: 0.3 * np.sin(8 * x.q[:, 1] + 0.1) + 0.2 * np.sin(16 * x.q[:, 1] + 1)},
        ),
        (plant("root_friction", coefficient=0.4), lambda x: {1: 0.4 * np.sqrt(np.abs(x.v[:, 1])) * sign(x)}),
        (plant("friction_step", change=0.3, time=1.5), lambda x: {1: 0.3 * (x.t >= 1.5) * sign(x)}),
        (
            plant("triangular_friction", amplitude=0.3, frequency=2.0),
            lambda x: {1: 0.3 * (1 + 2 / np.pi * np.arcsin(np.sin(2 * x.q[:, 1]))) * sign(x)},
        ),
        (
            plant("soft_stop", stiffness=5.0, centre=0.5, free=0.3),
            lambda x: {1: 5 * np.sign(x.q[:, 1] - 0.5) * np.maximum(np.abs(x.q[:, 1] - 0.5) - 0.3, 0)},
        ),
        (plant("root_load_friction", coefficient=0.2), lambda x: {1: 0.2 * np.sqrt(np.abs(x.load[:, 1])) * sign(x)}),
        (
            plant("torque_in_time", amplitude=0.3, frequency=0.9, phase=0.2),
            lambda x: {1: 0.3 * np.sin(2 * np.pi * 0.9 * x.t + 0.2)},
        ),
        (plant("velocity_wave", amplitude=0.3, velocity=0.5), lambda x: {1: 0.3 * np.cos(x.v[:, 1] / 0.5)}),
        (
            plant("skewed_friction", coefficient=0.3, centre=0.4),
            lambda x: {1: 0.3 * (x.q[:, 1] - 0.4) * x.v[:, 1]},
        ),
        (plant("load_wave", amplitude=0.1, torque=2.0), lambda x: {1: 0.1 * np.cos(x.load[:, 1] / 2)}),
        (
            plant("crossed_torque", partner="joint_3", amplitude=0.3, frequency=3.0),
            lambda x: {1: 0.3 * np.sin(3 * x.q[:, 1]) * np.cos(3 * x.q[:, 2])},
        ),
    )
}

CARRIED = {"mass": 0.5, "first_moment_x": 0.05, "first_moment_y": 0.02, "first_moment_z": 0.03}
