"""Closed-loop simulation of a robot in PyBullet: Bullet's parser, mass matrix and steps; drives and laws as torques.

Bullet has no rotor inertia and no exact static joint friction. Both are solved here from Bullet's mass matrix and
inverse dynamics and applied as one torque per step. By default, Bullet assigns 1 kg to links without inertial, applies
the URDF's joint limits, brakes every motor, adds air drag to every link and changes inertia by merging fixed links.
This module disables all of these.
"""

from __future__ import annotations

import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pybullet

from .bodies import Body, Drives, bare, drive, tilted
from .control import COMMAND, KNOWN, STEP, Array, Reference, Track, clock, gains, misplaced, misread
from .faults import Fault, check
from .laws import Laws


class Machine:
    """One robot in its own world; call `close` after use."""

    def __init__(self, body: Body, faults: Sequence[Fault] = (), weigh: bool = True) -> None:
        """Load the rigid bodies without friction, rotors and laws.

        Args:
            body: rigid bodies.
            faults: planted faults; only bodies and gravity are used.
            weigh: use the true link masses instead of those of the URDF.

        Raises:
            ValueError: when a joint has more than one position or is missing.
        """
        self.world = pybullet.connect(pybullet.DIRECT)
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "robot.urdf"
            path.write_text(_plain(bare(body, faults)), encoding="utf-8")
            flags = pybullet.URDF_USE_INERTIA_FROM_FILE
            self.id = pybullet.loadURDF(str(path), useFixedBase=True, flags=flags, physicsClientId=self.world)
        pybullet.setTimeStep(STEP, physicsClientId=self.world)
        pybullet.setGravity(*tilted(np.array([0.0, 0.0, -9.81]), faults), physicsClientId=self.world)
        count = pybullet.getNumJoints(self.id, physicsClientId=self.world)
        infos = [pybullet.getJointInfo(self.id, i, physicsClientId=self.world) for i in range(count)]
        moving = [i for i, info in enumerate(infos) if info[2] != pybullet.JOINT_FIXED]
        at = {infos[i][1].decode(): i for i in moving}
        if set(at) != set(body.joints):
            raise ValueError(f"Bullet moves joints {', '.join(at)} instead of {', '.join(body.joints)}")
        self.joints = [at[name] for name in body.joints]
        self._order = [moving.index(i) for i in self.joints]
        self._links = {info[12].decode(): i for i, info in enumerate(infos)}
        for i in range(-1, count):
            pybullet.changeDynamics(
                self.id, i, linearDamping=0, angularDamping=0, jointDamping=0, physicsClientId=self.world
            )
        for link, factor in body.heavier.items() if weigh else ():
            self._weigh(self._links[link], factor)
        still = {"controlMode": pybullet.VELOCITY_CONTROL, "forces": [0.0] * len(at)}
        pybullet.setJointMotorControlArray(self.id, self.joints, physicsClientId=self.world, **still)
        self._tip = self._centre(infos)

    def close(self) -> None:
        """Disconnect from the world."""
        pybullet.disconnect(self.world)

    def place(self, q: Array, v: Array) -> None:
        """Set joint positions q (n,) [rad] and velocities v (n,) [rad/s]."""
        for i, x, dx in zip(self.joints, q, v, strict=True):
            pybullet.resetJointState(self.id, i, x, dx, physicsClientId=self.world)

    def read(self) -> tuple[Array, Array]:
        """Positions and velocities, (n,) each [rad, rad/s]."""
        states = pybullet.getJointStates(self.id, self.joints, physicsClientId=self.world)
        return np.array([x[0] for x in states]), np.array([x[1] for x in states])

    def step(self, torque: Array) -> None:
        """Advance one step under torque (n,) [N.m]."""
        control = {"controlMode": pybullet.TORQUE_CONTROL, "forces": torque.tolist()}
        pybullet.setJointMotorControlArray(self.id, self.joints, physicsClientId=self.world, **control)
        pybullet.stepSimulation(physicsClientId=self.world)

    def mass(self, q: Array) -> Array:
        """Mass matrix (n, n) [kg.m2] at q (n,) [rad]."""
        matrix = pybullet.calculateMassMatrix(self.id, self._sort(q), physicsClientId=self.world)
        return np.array(matrix)[np.ix_(self._order, self._order)]

    def inverse(self, q: Array, v: Array, a: Array) -> Array:
        """Inverse dynamics (n,) [N.m] at q (n,) [rad], v (n,) [rad/s], a (n,) [rad/s2]."""
        states = (self._sort(x) for x in (q, v, a))
        return np.array(pybullet.calculateInverseDynamics(self.id, *states, physicsClientId=self.world))[self._order]

    def jacobian(self, q: Array) -> Array:
        """Jacobian (3, n) [m] of the last link's centre of mass along the world's axes at q (n,) [rad]."""
        zero, position = [0.0] * len(q), self._sort(q)
        full = pybullet.calculateJacobian(
            self.id, self.joints[-1], self._tip, position, zero, zero, physicsClientId=self.world
        )
        return np.array(full[0])[:, self._order]

    def _sort(self, x: Array) -> list[float]:
        sorted_ = np.empty(len(x))
        sorted_[self._order] = x
        return list(sorted_.tolist())

    def _weigh(self, link: int, factor: float) -> None:
        mass, _, inertia = pybullet.getDynamicsInfo(self.id, link, physicsClientId=self.world)[:3]
        heavy = {"mass": mass * factor, "localInertiaDiagonal": [x * factor for x in inertia]}
        pybullet.changeDynamics(self.id, link, physicsClientId=self.world, **heavy)

    def _centre(self, infos: Sequence[tuple[object, ...]]) -> list[float]:
        """Centre of mass of the last link and all links welded to it, along the link's principal axes [m].

        Bullet's Jacobian expects points in these coordinates.
        """
        last = self.joints[-1]
        welded = {last}
        for i, info in enumerate(infos):
            if info[2] == pybullet.JOINT_FIXED and info[16] in welded:
                welded.add(i)
        masses = [pybullet.getDynamicsInfo(self.id, i, physicsClientId=self.world)[0] for i in sorted(welded)]
        states = pybullet.getLinkStates(
            self.id, sorted(welded), computeForwardKinematics=True, physicsClientId=self.world
        )
        centre = np.average([x[0] for x in states], axis=0, weights=masses)
        frame = states[sorted(welded).index(last)]
        axes = pybullet.getDynamicsInfo(self.id, last, physicsClientId=self.world)[4]
        local = pybullet.multiplyTransforms(*pybullet.invertTransform(frame[4], frame[5]), centre, [0, 0, 0, 1])[0]
        return list(pybullet.multiplyTransforms(*pybullet.invertTransform([0, 0, 0], axes), local, [0, 0, 0, 1])[0])


def _plain(urdf: str) -> str:
    """URDF without limits and drive parameters, and with zero mass for links without inertial."""
    root = ElementTree.fromstring(urdf.encode())
    for joint in root.findall("joint"):
        for part in (*joint.findall("limit"), *joint.findall("dynamics"), *joint.findall("mimic")):
            joint.remove(part)
        if joint.get("type") == "revolute":
            joint.set("type", "continuous")
        elif joint.get("type") == "prismatic":
            ElementTree.SubElement(joint, "limit", lower="1", upper="-1", effort="0", velocity="0")
    for link in root.findall("link"):
        if link.find("inertial") is None:
            massless = ElementTree.SubElement(link, "inertial")
            ElementTree.SubElement(massless, "mass", value="0")
            ElementTree.SubElement(massless, "inertia", dict.fromkeys(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), "0"))
    return ElementTree.tostring(root, encoding="unicode")


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
