"""Fourier motions and the torque they take by independent formulas, for tests of estimation."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
import pinocchio as pin

from signid.recording import read_recording
from signid.robot import configuration
from signid.types import Array, Recording, Robot

FRICTION = {"viscous_friction": 1.5, "coulomb_friction": 2.0, "torque_offset": 0.3, "armature": 0.2}


@dataclass(frozen=True)
class Trial:
    """t (N,); q, v, a, torque (N, n) of a robot along a periodic motion."""

    robot: Robot
    t: Array
    q: Array
    v: Array
    a: Array
    torque: Array
    extra: dict[str, Array] = field(default_factory=dict)

    def recording(self, **changes: Array) -> Recording:
        """In memory, with some columns replaced or added."""
        return read_recording({"t": self.t, "q": self.q, "tau": self.torque, **changes}, self.robot)

    def noisy(self) -> Recording:
        """In memory, with white noise of 0.05 N.m on the torque."""
        noise = np.random.default_rng(0).standard_normal(self.torque.shape)
        return self.recording(tau=self.torque + 0.05 * noise)


def fourier(n: int, t: Array, seed: int, base: float = 0.1, size: float = 0.8) -> tuple[Array, Array, Array]:
    """Sums of five harmonics."""
    rng = np.random.default_rng(seed)
    q, v, a = np.zeros((3, len(t), n))
    for k in range(1, 6):
        w = 2 * np.pi * base * k
        amplitude, phase = rng.normal(size=n) * size / k, rng.uniform(0, 2 * np.pi, n)
        angle = w * t[:, None] + phase
        q += amplitude * np.sin(angle)
        v += amplitude * w * np.cos(angle)
        a -= amplitude * w**2 * np.sin(angle)
    return q, v, a


def trial(robot: Robot, seed: int = 0, seconds: float = 20.0, rate: float = 200.0, rest: tuple[int, ...] = ()) -> Trial:
    """A motion with the torque that bodies and the four usual laws take; joints in `rest` stand still."""
    t, n = np.arange(0, seconds, 1 / rate), len(robot.joints)
    q, v, a = fourier(n, t, seed)
    for j in rest:
        q[:, j], v[:, j], a[:, j] = 0.2, 0, 0
    model, data, drive = robot.model, robot.model.createData(), robot.drive
    states = zip(configuration(robot, q), v @ drive.T, a @ drive.T, strict=True)
    rigid = np.array([pin.rnea(model, data, *state) for state in states]) @ drive
    f = FRICTION
    laws = f["viscous_friction"] * v + f["coulomb_friction"] * np.sign(v) + f["torque_offset"] + f["armature"] * a
    return Trial(robot, t, q, v, a, rigid + laws)


def truth(robot: Robot) -> Array:
    """Standard parameters of a trial, bodies first, then the four laws at every joint."""
    bodies = np.concatenate([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]])
    return np.append(bodies, np.repeat(list(FRICTION.values()), len(robot.joints)))
