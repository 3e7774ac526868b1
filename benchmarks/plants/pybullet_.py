"""Closed-loop simulation of a robot in PyBullet: Bullet's parser, mass matrix and steps; drives and laws as torques.

Bullet has no rotor inertia and no exact static joint friction. Both are solved here from Bullet's mass matrix and
inverse dynamics and applied as one torque per step.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .bodies import Body, Drives, drive
from .control import COMMAND, KNOWN, STEP, Reference, Track, clock, gains
from .faults import Fault, check
from .laws import Laws
from .pybullet_model import Machine
from .record import misplaced, misread

Array = NDArray[np.float64]

SWEEPS, SETTLED = 200, 1e-12  # friction solver: most sweeps, change at convergence [N.m]
AGREED = 1e-6  # tolerated difference between Bullet's step and the step from its mass matrix [rad/s]


@dataclass(frozen=True)
class Joints:
    """Linear elements of n joints, and m rows of dry friction."""

    inertia: Array  # (n, n) [kg.m2] rotors
    damping: Array  # (n, n) [N.m.s/rad]
    stiffness: Array  # (n,) [N.m/rad]
    rest: Array  # (n,) [rad]
    offset: Array  # (n,) [N.m]
    limit: Array  # (n,) [N.m] motors
    rubbing: Array  # (m, n) [1] combinations of velocities with dry friction, single joints first
    level: Array  # (m,) [N.m] dry friction


def simulate(
    body: Body,
    drives: Drives,
    motion: Reference,
    duration: float,
    rate: float,
    faults: Sequence[Fault] = (),
    start: float = 0.0,
) -> Track:
    """Simulate control along a motion, with the controller, log and torque timing of `mujoco_.simulate`.

    Args:
        body: rigid bodies.
        drives: drive parameters of n joints.
        motion: reference motion of n joints.
        duration: duration [s].
        rate: rate of the log [Hz]; 1 / STEP logs every step.
        faults: planted faults, unknown to the controller.
        start: time of the first row [s], for motion and laws.

    Raises:
        ValueError: when the log period is not a multiple of the step, or for impossible or unsupported faults.
        ArithmeticError: when Bullet's steps differ from those of its mass matrix.
    """
    for fault in faults:
        if fault.effect in ("joint_elasticity", "backlash"):
            raise ValueError(f"Bullet has no rotor before a gear and no {fault.effect}; use MuJoCo's plant")
    check(faults, body.joints)
    t, every = clock(start, duration, rate)
    desired, velocity, _ = motion.at(t)
    rotors, positions = np.array(drives.armature), desired[:: max(len(t) // 20, 1)]
    with closing(Machine(body, weigh=False)) as known:
        stiffness, damping = gains(np.mean([np.diag(known.mass(q)) + rotors for q in positions], axis=0))
        command = _feed_forward(known, rotors, motion, t) + stiffness * desired + damping * velocity
    encoder_error = misplaced(body.joints, faults)
    command -= stiffness * encoder_error
    joints = _joints(body, drives, faults)
    laws = Laws(faults, body.joints, joints.level[: len(rotors)], STEP)
    with closing(Machine(body, faults)) as machine:
        machine.place(desired[0] - encoder_error, velocity[0])
        q, v = _run(machine, joints, laws, t, command, (stiffness, damping))
    tau = command[:-1] - stiffness * q[:-1] - damping * v[1:]
    track = misread(Track(t[:-1], q[:-1], tau), body.joints, faults)
    return Track(*(x[::every] for x in track))


def _feed_forward(machine: Machine, rotors: Array, motion: Reference, t: Array) -> Array:
    """Feed-forward torque (N, n) [N.m] at times (N,) [s]."""
    coarse = t[::COMMAND]
    torque = np.array([machine.inverse(q, v, a) + rotors * a for q, v, a in zip(*motion.at(coarse), strict=True)])
    return KNOWN * np.column_stack([np.interp(t, coarse, column) for column in torque.T])


def _joints(body: Body, drives: Drives, faults: Sequence[Fault]) -> Joints:
    true, n = drive(drives, body.joints, faults), len(body.joints)
    inertia, damping = np.diag(true.armature), np.diag(true.viscous_friction)
    stiffness, moment, limit = np.zeros(n), np.zeros(n), np.full(n, np.inf)
    rubbing, level = list(np.eye(n)), list(true.coulomb_friction)
    for fault in faults:
        p = fault.numbers
        if fault.effect == "spring":
            j = body.joints.index(str(fault.joint))
            stiffness[j] += p["stiffness"]
            moment[j] += p["stiffness"] * p["rest"]
        elif fault.effect == "torque_saturation":
            limit[body.joints.index(str(fault.joint))] = p["limit"]
        elif fault.effect == "joint_coupling":
            j, k = body.joints.index(str(fault.joint)), body.joints.index(fault.partner)
            inertia[[j, k], [k, j]] += p["inertia"]
            damping[[j, k], [k, j]] += p["viscous"]
            rubbing.append(np.eye(n)[j] + np.eye(n)[k])
            level.append(p["coulomb"])
    rest = moment / np.where(stiffness, stiffness, 1)
    return Joints(
        inertia, damping, stiffness, rest, np.array(true.torque_offset), limit, np.array(rubbing), np.array(level)
    )


def _run(
    machine: Machine, joints: Joints, laws: Laws, t: Array, command: Array, loop: tuple[Array, Array]
) -> tuple[Array, Array]:
    """Positions and velocities (N, n) [rad, rad/s] under commands (N, n) [N.m] and position-loop gains."""
    n, level = command.shape[1], joints.level.copy()
    states, acceleration, friction = np.zeros((2, len(t), n)), np.zeros(n), np.zeros(len(level))
    states[:, 0] = q, v = machine.read()
    for k in range(len(t) - 1):
        mass, bias, now = machine.mass(q), machine.inverse(q, v, np.zeros(n)), v + STEP / 2 * acceleration
        push = -joints.offset - joints.stiffness * (q - joints.rest)
        if laws.any:
            torque, level[:n] = laws.at(t[k], q, now, bias + mass @ acceleration)
            push -= torque
        if laws.tip:
            jacobian = machine.jacobian(q)
            push -= jacobian.T @ laws.force(t[k], jacobian @ now)
        motor = command[k] - loop[0] * q
        free = np.abs(motor - loop[1] * v) < joints.limit
        motor = np.where(free, motor, np.clip(motor - loop[1] * v, -joints.limit, joints.limit))
        damping = joints.damping + np.diag(loop[1] * free)
        mobility = STEP * np.linalg.inv(mass + joints.inertia + STEP * damping)
        after = v + mobility @ (motor + push - bias - damping @ v)
        friction = _rub(joints.rubbing @ mobility @ joints.rubbing.T, joints.rubbing @ after, level, friction)
        after = after - mobility @ joints.rubbing.T @ friction
        acceleration = (after - v) / STEP
        machine.step(motor + push - damping @ after - joints.inertia @ acceleration - joints.rubbing.T @ friction)
        q, v = machine.read()
        if np.abs(v - after).max() > AGREED:
            raise ArithmeticError(f"Bullet's step at {t[k]:g} s differs from that of its mass matrix")
        states[:, k + 1] = q, v
        laws.advance(v)
    return states[0], states[1]


def _rub(mobility: Array, free: Array, level: Array, guess: Array) -> Array:
    """Friction (m,) [N.m] within its levels that opposes or stops sliding, by projected Gauss-Seidel.

    Args:
        mobility: mobility of one step (m, m) [rad/s per N.m].
        free: velocities after a step without friction (m,) [rad/s].
        level: dry friction (m,) [N.m].
        guess: initial value (m,) [N.m].
    """
    sliding = level * np.sign(guess)
    if np.all(level * np.sign(free - mobility @ sliding) == sliding):
        return sliding
    friction = np.clip(guess, -level, level)
    for _ in range(SWEEPS):
        change = 0.0
        for i, most in enumerate(level):
            speed = free[i] - mobility[i] @ friction
            better = min(max(friction[i] + speed / mobility[i, i], -most), most)
            change, friction[i] = max(change, abs(better - friction[i])), better
        if change < SETTLED:
            break
    return friction
