"""Pendulum with the friction of BAM's models M1 to M6 or the encoder of PACE, by explicit Euler; no code of signid.

Equations: Duclusaud et al., arXiv 2410.08650. Dry friction stops the joint, or acts against its motion.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import copysign, exp, sin

import numpy as np

STEP = 1e-4  # [s]
GRAVITY = 9.81 * 0.5 * 0.15  # [N.m] of the arm of `servo_loops`
INERTIA = 0.002 + 0.5 * 0.15**2  # [kg.m2]


@dataclass(frozen=True)
class Pendulum:
    """Drive and friction of one joint, as BAM names them."""

    kp: float = 8.0
    kd: float = 0.1
    armature: float = 0.004
    friction_base: float = 0.04
    friction_stribeck: float = 0.0
    load_motor: float = 0.0
    load_external: float = 0.0
    load_motor_stribeck: float = 0.0
    load_external_stribeck: float = 0.0
    motor_quad: float = 0.0
    external_quad: float = 0.0
    dtheta_stribeck: float = 0.3
    alpha: float = 1.35
    encoder: float = 0.0  # [rad] measured - true position

    def bound(self, motor: float, external: float, v: float) -> float:
        """Largest dry friction [N.m]."""
        rest = exp(-(abs(v / self.dtheta_stribeck) ** self.alpha))
        whole = self.friction_base + abs(external * self.load_external - motor * self.load_motor)
        low = self.friction_stribeck
        low += abs(external * self.load_external_stribeck - motor * self.load_motor_stribeck)
        if external * motor < 0:
            if abs(external) < abs(motor):
                low += self.external_quad * external**2
            elif abs(external) > abs(motor):
                low += self.motor_quad * motor**2
        return whole + rest * low

    def record(self, command: np.ndarray, rate: float) -> np.ndarray:
        """Measured positions at the rows of commands that are held [rad]."""
        inertia, parts = INERTIA + self.armature, round(1 / rate / STEP)
        q, v, out = float(command[0]) - self.encoder, 0.0, []
        for u in command.tolist():
            out.append(q + self.encoder)
            for _ in range(parts):
                motor, external = self.kp * (u - q - self.encoder) - self.kd * v, -GRAVITY * sin(q)
                stop = inertia / STEP * v + motor + external
                friction = min(abs(stop), self.bound(motor, external, v))
                v += STEP * (motor + external - copysign(friction, stop)) / inertia
                q += STEP * v
        return np.array(out)


def commands(seed: int, seconds: float, rate: float) -> np.ndarray:
    """Sines and steps [rad] that load, reverse and back-drive the joint."""
    rng, t = np.random.default_rng(seed), np.arange(int(seconds * rate)) / rate
    u = 0.6 * np.sin(2 * np.pi * 0.11 * t + rng.uniform(0, 6))
    for f in rng.uniform(0.2, 1.6, 4):
        u += rng.uniform(0.2, 0.5) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / f**0.5
    return np.asarray(u + np.repeat(rng.uniform(-0.3, 0.3, len(t) // 80 + 1), 80)[: len(t)])
