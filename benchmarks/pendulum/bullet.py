"""Simulation and logging of the pendulum robots/1r in Bullet, under PD control along random motions.

Independent of signid: Bullet parses the URDF and computes the dynamics.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pybullet
from numpy.typing import NDArray

Array = NDArray[np.float64]

URDF = Path(__file__).parents[2] / "robots" / "1r" / "robot.urdf"
GRAVITY = 9.81  # [m/s2]
STEP, PERIOD = 1e-3, 0.02  # periods of simulation and control, and of the log [s]
STIFFNESS, DAMPING = 600.0, 60.0  # gains of the position loop [N.m/rad], [N.m.s/rad]: 3 Hz, well damped
HARMONICS, FUNDAMENTAL = 5, 0.1  # number of harmonics, fundamental frequency [Hz]
RANGE = np.pi / 2  # largest distance of a motion from its start [rad]
REPEATS = 5  # periods per motion
BITS, NOISE = 17, 0.02  # encoder bits per turn, torque noise over rms torque [1]


class Track(NamedTuple):
    """True position, and the torque held until the next sample."""

    t: Array  # (N,) [s]
    q: Array  # (N,) [rad]
    tau: Array  # (N,) [N.m]


class Motion(NamedTuple):
    """Fourier motion from zero: sums of sine / frequency - cosine / frequency."""

    sine: Array  # (HARMONICS,) [rad/s]
    cosine: Array  # (HARMONICS,) [rad/s]

    def at(self, t: Array) -> tuple[Array, Array]:
        """Position and velocity, (N,) each [rad, rad/s] at times (N,) [s]."""
        w = 2 * np.pi * FUNDAMENTAL * np.arange(1, HARMONICS + 1)
        s, c = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
        return s @ (self.sine / w) + (1 - c) @ (self.cosine / w), c @ self.sine + s @ self.cosine


def draw_motion(seed: int) -> Motion:
    """Draw uniform coefficients, scaled to a largest distance RANGE from the start."""
    motion = Motion(*np.random.default_rng(seed).uniform(-0.5, 0.5, (2, HARMONICS)))
    scale = RANGE / np.abs(motion.at(np.arange(0, 1 / FUNDAMENTAL, 1e-3))[0]).max()
    return Motion(scale * motion.sine, scale * motion.cosine)


class Pendulum:
    """robots/1r in Bullet without Bullet's default dampers and motor."""

    def __init__(self, step: float = STEP) -> None:
        self.step, self.client = step, {"physicsClientId": pybullet.connect(pybullet.DIRECT)}
        pybullet.setGravity(0, 0, -GRAVITY, **self.client)
        pybullet.setTimeStep(step, **self.client)
        with _silence():  # Bullet prints a warning about the massless base
            self.body = pybullet.loadURDF(
                str(URDF), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, **self.client
            )
        pybullet.setJointMotorControl2(self.body, 0, pybullet.VELOCITY_CONTROL, force=0, **self.client)
        for link in (-1, 0):
            pybullet.changeDynamics(self.body, link, linearDamping=0, angularDamping=0, jointDamping=0, **self.client)

    def close(self) -> None:
        """Disconnect from Bullet."""
        pybullet.disconnect(**self.client)

    @property
    def truth(self) -> Array:
        """True m g d and I + m d2 (2,) [N.m, kg.m2] from Bullet's inertia."""
        info = pybullet.getDynamicsInfo(self.body, 0, **self.client)
        mass, inertia, depth = info[0], info[2][1], -info[3][2]
        return np.array([mass * GRAVITY * depth, inertia + mass * depth**2])

    def swing(self, position: Array, velocity: Array, stiffness: float = STIFFNESS, damping: float = DAMPING) -> Track:
        """Follow positions (N,) [rad] and velocities (N,) [rad/s], one per step; without gains the motion is free."""
        pybullet.resetJointState(self.body, 0, position[0], velocity[0], **self.client)
        q, tau = np.zeros((2, len(position)))
        for k in range(len(position)):
            q[k], v = pybullet.getJointState(self.body, 0, **self.client)[:2]
            tau[k] = stiffness * (position[k] - q[k]) + damping * (velocity[k] - v)
            pybullet.setJointMotorControl2(self.body, 0, pybullet.TORQUE_CONTROL, force=tau[k], **self.client)
            pybullet.stepSimulation(**self.client)
        return Track(np.arange(len(q)) * self.step, q, tau)


def record(pendulum: Pendulum, seed: int) -> Track:
    """Simulate a motion; return the true track at the times of the log."""
    t = np.arange(0, REPEATS / FUNDAMENTAL, pendulum.step)
    kept = slice(0, None, round(PERIOD / pendulum.step))
    return Track(*(x[kept] for x in pendulum.swing(*draw_motion(seed).at(t))))


def log(track: Track, seed: int, bits: int = BITS, noise: float = NOISE) -> Track:
    """Quantise positions to encoder counts and add white noise to the torque."""
    count = 2 * np.pi / 2**bits
    white = noise * np.sqrt(np.mean(track.tau**2)) * np.random.default_rng(seed).standard_normal(len(track.tau))
    return Track(track.t, np.round(track.q / count) * count, track.tau + white)


@contextmanager
def _silence() -> Iterator[None]:
    stdout, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(stdout, 1)
        os.close(stdout)
        os.close(null)
