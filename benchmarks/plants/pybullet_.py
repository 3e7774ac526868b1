"""The same robot in PyBullet: Bullet's own parser, mass matrix and steps; drives and laws as torques at the joints.

Bullet has no rotors and no dry friction of joints that holds exactly. Both are solved for here from Bullet's mass
matrix and inverse dynamics; what they ask for is one torque a step, and Bullet moves the robot under it.
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

SWEEPS, SETTLED = 200, 1e-12  # of the friction solve, and the change that ends it [N.m]
AGREED = 1e-6  # rad/s by which Bullet's step may differ from what its mass matrix said


@dataclass(frozen=True)
class Joints:
    """What is linear at the joints; n of them, m rows of dry friction."""

    inertia: Array  # (n, n) [kg.m2] of rotors
    damping: Array  # (n, n) [N.m.s/rad]
    stiffness: Array  # (n,) [N.m/rad]
    rest: Array  # (n,) [rad]
    offset: Array  # (n,) [N.m]
    limit: Array  # (n,) [N.m] of the motors
    rubbing: Array  # (m, n) [1] whose sums of velocities rub, the joints themselves first
    level: Array  # (m,) [N.m]


def simulate(
    body: Body,
    drives: Drives,
    motion: Reference,
    duration: float,
    rate: float,
    faults: Sequence[Fault] = (),
    start: float = 0.0,
) -> Track:
    """The robot along a motion, controlled and logged as `mujoco_.simulate` has it, moments of torque included.

    Args:
        body: rigid bodies.
        drives: n joints.
        motion: n joints.
        duration: [s].
        rate: of the log [Hz]; 1 / STEP shows every step.
        faults: what is wrong; the controller knows nothing of it.
        start: the session's time at the first row [s], for motion and laws alike.

    Raises:
        ValueError: for a log between the steps, and for faults that cannot be, or that Bullet cannot do.
        ArithmeticError: when Bullet's steps are not what its mass matrix says.
    """
    for fault in faults:
        if fault.effect in ("joint_elasticity", "backlash"):
            raise ValueError(f"Bullet has no rotor before a gear, so no {fault.effect}; MuJoCo's plant has it")
    check(faults, body.joints)
    t, every = clock(start, duration, rate)
    desired, velocity, _ = motion.at(t)
    rotors, positions = np.array(drives.armature), desired[:: max(len(t) // 20, 1)]
    with closing(Machine(body, weigh=False)) as known:
        stiffness, damping = gains(np.mean([np.diag(known.mass(q)) + rotors for q in positions], axis=0))
        command = _feed_forward(known, rotors, motion, t) + stiffness * desired + damping * velocity
    astray = misplaced(body.joints, faults)
    command -= stiffness * astray
    joints = _joints(body, drives, faults)
    laws = Laws(faults, body.joints, joints.level[: len(rotors)], STEP)
    with closing(Machine(body, faults)) as machine:
        machine.place(desired[0] - astray, velocity[0])
        q, v = _run(machine, joints, laws, t, command, (stiffness, damping))
    tau = command[:-1] - stiffness * q[:-1] - damping * v[1:]
    track = misread(Track(t[:-1], q[:-1], tau), body.joints, faults)
    return Track(*(x[::every] for x in track))


def _feed_forward(machine: Machine, rotors: Array, motion: Reference, t: Array) -> Array:
    """(N, n) [N.m] at times (N,) [s]."""
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
    """Positions and velocities (N, n) [rad, rad/s] under commands (N, n) [N.m] and a loop's stiffness and damping."""
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
            raise ArithmeticError(f"Bullet's step at {t[k]:g} s is not what its mass matrix says")
        states[:, k + 1] = q, v
        laws.advance(v)
    return states[0], states[1]


def _rub(mobility: Array, free: Array, level: Array, guess: Array) -> Array:
    """Friction (m,) [N.m] within its levels that opposes what rubs, or stops it: projected Gauss-Seidel.

    Args:
        mobility: (m, m) [rad/s per N.m] of a step.
        free: (m,) [rad/s] after the step without friction.
        level: (m,) [N.m].
        guess: (m,) [N.m] where to begin.
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
