"""Models built from effects, and open-loop simulations of them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from toys import toy

import signid
from signid.effects import EFFECTS
from signid.model import Model, stated_inertials
from signid.simulation.plant import Simulation, Torques, simulate
from signid.types import Law, Robot, Trajectory

WIDE = '<limit lower="-100" upper="100" effort="1000" velocity="100"/>'


def law(effect: str, *joints: int, **parameters: float) -> Law:
    return Law(EFFECTS[effect], joints, parameters or EFFECTS[effect].example)


def model(robot: str | Robot, *laws: Law) -> Model:
    """The bodies of a robot and these laws, no other."""
    described = signid.load_robot(robot) if isinstance(robot, str) else robot
    return Model(described, stated_inertials(described), laws)


def released(given: Model, q: Any, seconds: float, v: Any = 0.0, torque: Any = 0.0, **more: Any) -> Simulation:
    """Simulation under a constant torque from q and v on."""
    n = len(given.robot.joints)
    q, v, torque = (np.broadcast_to(np.asarray(x, float), (n,)) for x in (q, v, torque))
    return simulate(given, Torques(np.array([0.0, 1.0]), np.tile(torque, (2, 1)), q, v), seconds, **more)


def wheel(kind: str = "revolute", inertia: float = 0.5, more: str = WIDE) -> Robot:
    """A body that gravity does not move: it turns about an upright axis, or slides along a level one."""
    body = f'<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="{inertia}"/></inertial>'
    axis = "1 0 0" if kind == "prismatic" else "0 0 1"
    ends = f'<parent link="a"/><child link="b"/><axis xyz="{axis}"/>'
    return toy(
        '<link name="a"/>', f'<link name="b">{body}</link>', f'<joint name="z" type="{kind}">{ends}{more}</joint>'
    )


def waves(joints: Sequence[str], seconds: float, size: float = 0.5, seed: int = 1, step: float = 1e-3) -> Trajectory:
    """Three sines a joint about somewhere, from the first sample on at full speed."""
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, step)
    w = 2 * np.pi * rng.uniform(0.2, 0.6, (3, len(joints)))
    phase, centre = rng.uniform(0, 6, w.shape), rng.uniform(-0.5, 0.5, len(joints))
    angle = w * t[:, None, None] + phase
    q, v, a = np.sin(angle).sum(1), (w * np.cos(angle)).sum(1), -(w**2 * np.sin(angle)).sum(1)
    return Trajectory(tuple(joints), t, centre + size / 3 * q, size / 3 * v, size / 3 * a)


def pitch(signal: np.ndarray, step: float) -> float:
    """The frequency [rad/s] at which a signal is strongest."""
    x, count = (signal - signal.mean()) * np.hanning(len(signal)), 16 * len(signal)
    return float(2 * np.pi * np.fft.rfftfreq(count, step)[np.abs(np.fft.rfft(x, count)).argmax()])
