"""Position drives as they are simulated in MuJoCo, without code of signid."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..plants.control import Array

NATIVE = {"dead_band": 0.0, "profile_speed": np.inf, "load_friction": 0.0, "droop": 0.0, "backlash": 0.0}


@dataclass(frozen=True)
class Drive:
    """True numbers of the drive of one joint [N.m, rad, s]."""

    law: str = "effort"  # effort, duty, torque_speed
    kp: float = 10.0
    kd: float = 0.3
    delay: float = 0.01
    effort_limit: float = np.inf
    speed_limit: float = np.inf
    dead_band: float = 0.0
    profile_speed: float = np.inf
    coulomb_friction: float = 0.05
    viscous_friction: float = 0.03
    load_friction: float = 0.0
    armature: float = 0.01
    torque_offset: float = 0.0
    droop: float = 0.0
    backlash: float = 0.0  # [rad] play between motor and link; the encoder is on the link

    @property
    def native(self) -> bool:
        """Whether an actuator of MuJoCo has this law."""
        return self.law != "torque_speed" and all(getattr(self, name) == value for name, value in NATIVE.items())


@dataclass(frozen=True)
class Truth:
    """The recorded robot: drives by joint, and a point mass at its last link."""

    drives: dict[str, Drive] = field(default_factory=dict)
    payload: float = 0.0  # [kg]
    payload_at: tuple[float, float, float] = (0.0, 0.0, 0.0)  # [m] in the frame of the last link


def column(drives: list[Drive], name: str) -> Array:
    """One number of all drives, (n,)."""
    return np.array([getattr(drive, name) for drive in drives], dtype=float)


class Torque:
    """Torque of the drives at one instant: written for vectors of n joints."""

    def __init__(self, drives: list[Drive]) -> None:
        get = lambda name: column(drives, name)  # noqa: E731
        self.kp, self.kd, self.limit, self.band = get("kp"), get("kd"), get("effort_limit"), get("dead_band")
        self.droop, self.profile, self.top = get("droop"), get("profile_speed"), get("speed_limit")
        self.duty = np.array([drive.law == "duty" for drive in drives])
        self.line = np.array([drive.law == "torque_speed" for drive in drives])
        self.reference: Array | None = None

    def __call__(self, command: Array, q: Array, v: Array, step: float) -> Array:
        """Motor torque (n,) [N.m] for a command in force, measured by the drive at (q, v)."""
        if self.reference is None:
            self.reference = q.copy()
        move = self.profile * step
        self.reference = self.reference + np.clip(command - self.reference, -move, move)
        error = self.reference - q
        error = np.sign(error) * np.maximum(np.abs(error) - self.band, 0.0)
        spring, damper = self.kp * error, -self.kd * v
        whole = spring + damper
        with np.errstate(invalid="ignore"):
            line = self.limit * np.clip(1.0 - np.abs(v) / self.top, 0.0, None)
        limit = np.where(self.line & (whole * v > 0), line, self.limit)
        torque = np.where(self.duty, np.clip(spring, -self.limit, self.limit) + damper, np.clip(whole, -limit, limit))
        return np.asarray(torque / (1.0 + self.droop * np.abs(torque)))
