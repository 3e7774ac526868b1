"""Rigid-body dynamics along a motion by Pinocchio, over the n independent joints.

States are those of the model: configurations (N, nq) [rad, m or 1], rates (N, nv) [rad/s, rad/s2 or m/s, m/s2].
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import repeat
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..errors import RobotError
from ..types import Array, Mask, Robot
from .joints import configuration

GRAVITY_POSTURES, TORQUE_ROUNDING = 8, 1e-9  # random postures to look at; [N.m or N] rounding errors of their torque


class Sensitivity(NamedTuple):
    """Derivatives of the rigid-body torque with respect to position, velocity and acceleration, (N, n, n) each."""

    position: Array  # (N, n, n) [N.m/rad]
    velocity: Array  # (N, n, n) [N.m.s/rad]
    acceleration: Array  # (N, n, n) [kg.m2], the mass matrix


def rigid_torque(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Inverse dynamics: torque (N, n) [N.m or N] of the inertials of the description.

    q: (N, nq) [rad, m or 1]; v: (N, nv) [rad/s or m/s]; a: (N, nv) [rad/s2 or m/s2].
    """
    model, data = robot.model, robot.model.createData()
    return np.asarray(_by_row(pin.rnea, (model.nv,), model, data, q, v, a) @ robot.drive)


def _by_row(compute: Callable[..., Any], shape: tuple[int, ...], model: Any, data: Any, *states: Array) -> Array:
    """Results (N, *shape) of a function of Pinocchio for N states."""
    out = np.empty((len(states[0]), *shape))
    for row, computed in zip(out, map(compute, repeat(model), repeat(data), *states), strict=True):
        row[...] = computed
    return out


def effective_inertia(robot: Robot, q: Array) -> Array:
    """Diagonal of the joint-space mass matrix, (N, n) [kg.m2 or kg]; q: (N, nq) [rad, m or 1]."""
    mass = mass_matrices(robot.model, robot.model.createData(), q, robot.drive)
    return np.asarray(np.diagonal(mass, axis1=1, axis2=2))


def mass_matrices(model: Any, data: Any, q: Array, drive: Array) -> Array:
    """Mass matrices (N, n, n) over the independent coordinates of a pin.Model, rotors included [kg.m2 or kg].

    q: (N, nq) [rad, m or 1]; drive: (nv, n) model velocity per coordinate velocity [1].
    """
    return np.asarray(drive.T @ _symmetric(_by_row(pin.crba, (model.nv, model.nv), model, data, q)) @ drive)


def sensitivity(robot: Robot, q: Array, v: Array, a: Array) -> Sensitivity:
    """Derivatives of the rigid-body torque with respect to the motion.

    q: (N, nq) [rad, m or 1]; v: (N, nv) [rad/s or m/s]; a: (N, nv) [rad/s2 or m/s2].

    Source: Carpentier, Mansard, Analytical derivatives of rigid body dynamics algorithms, RSS 2018.
    """
    model, data, drive = robot.model, robot.model.createData(), robot.drive
    out = np.empty((3, len(q), model.nv, model.nv))
    for i, state in enumerate(zip(q, v, a, strict=True)):
        out[:, i] = np.reshape(pin.computeRNEADerivatives(model, data, *state), out[:, i].shape)
    out[2] = _symmetric(out[2])
    by_joint = np.ascontiguousarray(np.moveaxis(drive.T @ out @ drive, 3, 1))  # laws read one joint at a time
    return Sensitivity(*np.moveaxis(by_joint, 1, 3))


def body_regressor(robot: Robot, q: Array, v: Array, a: Array) -> Array:
    """Regressor (N, n, nb, 10) of the inertial parameters, in Pinocchio's order.

    q: (N, nq) [rad, m or 1]; v: (N, nv) [rad/s or m/s]; a: (N, nv) [rad/s2 or m/s2].
    """
    model, data = robot.model, robot.model.createData()
    shape = model.nv, 10 * (model.njoints - 1)
    out = _by_row(pin.computeJointTorqueRegressor, shape, model, data, q, v, a)
    plain = np.array_equal(robot.drive, np.eye(model.nv))
    return (out if plain else np.asarray(robot.drive.T @ out)).reshape(len(q), robot.drive.shape[1], -1, 10)


def gravity_torque(robot: Robot, q: Array, gravity: Sequence[float] | Array) -> Array:
    """Static torque (N, n) [N.m or N] in a gravity field; q: (N, nq) [rad, m or 1]; gravity: (3,) [m/s2]."""
    model = robot.model.copy()
    model.gravity.linear = np.asarray(gravity, float)
    data = model.createData()
    return np.asarray(_by_row(pin.computeGeneralizedGravity, (model.nv,), model, data, q) @ robot.drive)


def shows_gravity(robot: Robot, gravity: Array) -> bool:
    """Whether a field of gravity: (3,) [m/s2] makes torque in some posture."""
    positions = np.random.default_rng(0).uniform(-np.pi, np.pi, (GRAVITY_POSTURES, len(robot.joints)))
    return bool(np.any(np.abs(gravity_torque(robot, configuration(robot, positions), gravity)) > TORQUE_ROUNDING))


def tip_jacobian(robot: Robot, q: Array) -> Array:
    """Jacobian (N, 3, n) [m/rad or 1] of the last link's centre of mass in the world; q: (N, nq) [rad, m or 1]."""
    model, data, tip = robot.model, robot.model.createData(), own_body(robot, len(robot.joints) - 1) + 1
    rows = [point_jacobian(model, data, state, tip, model.inertias[tip].lever) for state in q]
    return np.asarray(np.array(rows).reshape(len(q), 3, model.nv) @ robot.drive)


def point_jacobian(model: Any, data: Any, q: Array, joint: int, point: Array) -> Array:
    """Jacobian (3, nv) [m/rad or 1] of a point on the body of a joint of a pin.Model, in the world's axes.

    q: (nq,) [rad, m or 1]; point: (3,) position in the frame of the joint [m].
    """
    pin.computeJointJacobians(model, data, q)
    jacobian = np.reshape(pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED), (6, model.nv))
    arm = data.oMi[joint].rotation @ point
    return np.asarray(jacobian[:3] - pin.skew(arm) @ jacobian[3:])


def moved_bodies(robot: Robot) -> Mask:
    """Whether each joint moves each body, (n, nb); torques of joints without a common body are decoupled."""
    out = np.zeros((len(robot.joints), robot.model.njoints - 1), dtype=bool)
    for body, ways in enumerate(list(robot.model.supports)[1:]):
        for joint in (robot.model.joints[i] for i in list(ways)[1:]):
            out[:, body] |= robot.drive[joint.idx_v : joint.idx_v + joint.nv].any(axis=0)
    return out


def check_masses(robot: Robot) -> None:
    """Check that no body has a negative mass, with the links that are fixed to it.

    Raises:
        RobotError: the mass of a body is negative.
    """
    for link, body in zip(robot.links, list(robot.model.inertias)[1:], strict=True):
        if body.mass < 0:
            raise RobotError(
                f"link {link} of {robot.name}, with the links fixed to it, has a mass of {body.mass:.4g} kg; "
                "correct the masses in the description"
            )


def own_body(robot: Robot, joint: int) -> int:
    """0-based index of the body of a joint; without the bodies of joints that mimic it."""
    return joint_of_row(robot.model, own_row(robot, joint)) - 1


def own_row(robot: Robot, joint: int) -> int:
    """Row of a joint in the velocity of the model; rows of joints that mimic it may precede it."""
    model, name, column = robot.model, robot.joints[joint], robot.drive[:, joint]
    if model.existJointName(name):
        return int(model.joints[model.getJointId(name)].idx_v)
    return int(np.flatnonzero(column == 1)[0])  # part of a composite joint of Pinocchio


def joint_of_row(model: Any, row: int) -> int:
    """Index of the joint of a pin.Model that contains a row of its velocity."""
    return next(i for i, j in enumerate(list(model.joints)[1:], 1) if j.idx_v <= row < j.idx_v + j.nv)


def _symmetric(mass: Array) -> Array:
    """Symmetric matrices (..., nv, nv) from upper triangles."""
    below = np.tri(mass.shape[-1], k=-1, dtype=bool)
    return np.where(below, mass.swapaxes(-1, -2), mass)


def standard_parameters(robot: Robot, inertials: Array) -> dict[str, dict[str, Any]]:
    """Mass, first moment and inertia of each link about the frame of its joint.

    inertials: (nb, 10) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    return {
        link: {"mass": float(x[0]), "first_moment": x[1:4].tolist(), "inertia": x[4:].tolist()}
        for link, x in zip(robot.links, inertials, strict=True)
    }


def joint_inertia(robot: Robot, upper: Array) -> Array:
    """Mass matrix (n, n) of the joints [kg.m2 or kg].

    upper: (nv, nv) of the model, of which the upper triangle counts [kg.m2 or kg], as `crba` computes it.
    """
    mass = _symmetric(np.reshape(upper, (robot.model.nv, robot.model.nv)))
    return np.asarray(robot.drive.T @ mass @ robot.drive)
