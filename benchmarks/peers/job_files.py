"""Job files for all tools: description, drives, both recordings and the controller for closed-loop simulation."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..concealed.session import actuators_file
from ..plants.bodies import bare
from ..plants.control import COMMAND, KNOWN, STEP, Track, clock, gains
from ..plants.mujoco_model import build, inverse, mean_inertia
from ..regressor.job import RATE, Array
from .faults import Arm, motion

STATED = ("armature", "viscous_friction", "coulomb_friction")


class Loop(NamedTuple):
    """Controller of n motors: torque is command - stiffness q - damper v."""

    command: Array  # (N, n) [N.m] at every step
    stiffness: Array  # (n,) [N.m/rad]
    damper: Array  # (n,) [N.m.s/rad]
    q: Array  # (n,) [rad] at the start
    v: Array  # (n,) [rad/s] at the start


def describe(arm: Arm, folder: Path) -> None:
    """Write robot.urdf and actuators.toml."""
    (folder / "robot.urdf").write_text(bare(arm.body), encoding="utf-8")
    (folder / "actuators.toml").write_text(actuators_file(arm.drives, arm.body.joints), encoding="utf-8")


def hand_over(arm: Arm, train: Track, test: Track, looped: float, folder: Path) -> None:
    """Write job.npz: both recordings, drives, and `looped` [s] of the control loop along the first motion."""
    loop = _follow(arm, 0, float(train.t[-1]) + 1 / RATE, looped)
    drives = (np.array(getattr(arm.drives, key)) for key in STATED)
    np.savez(
        folder / "job.npz",
        joints=np.array(arm.body.joints),
        step=STEP,
        **dict(zip(("armature", "damping", "frictionloss"), drives, strict=True)),
        **{f"test_{key}": x for key, x in test._asdict().items()},
        **{f"loop_{key}": x for key, x in loop._asdict().items()},
        **train._asdict(),
    )


def _follow(arm: Arm, seed: int, duration: float, looped: float) -> Loop:
    """First `looped` [s] of the plant's controller without knowledge of faults, for a motion of a duration [s]."""
    t, _ = clock(0.0, duration, RATE)
    reference = motion(arm, seed)
    q, v, _ = reference.at(t)
    model, joints, coarse = build(arm.body, arm.drives, frictionless=True), arm.body.joints, t[::COMMAND]
    stiffness, damper = gains(mean_inertia(model, joints, q[:: max(len(t) // 20, 1)]))
    known = KNOWN * inverse(model, joints, *reference.at(coarse))
    forward = np.column_stack([np.interp(t, coarse, x) for x in known.T])
    command = forward + stiffness * q + damper * v
    return Loop(command[: round(looped / STEP) + 1], stiffness, damper, q[0], v[0])
