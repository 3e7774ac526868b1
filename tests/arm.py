"""A small arm for tests of laws, its middle joint revolute or prismatic, and motions of it."""

from __future__ import annotations

from functools import cache

import numpy as np
from toys import toy

from signid.regression.motion import Motion
from signid.types import Array, Robot, Trajectory

LIMIT = '<limit lower="-3.1" upper="3.1" effort="200" velocity="6"/>'
MASSES, CENTRES = (5, 4, 3), ("0 0 0.25", "0.2 0.02 0.01", "0.2 0.02 0.01")
MOMENTS = ("0.06 0.06 0.03", "0.02 0.08 0.07", "0.02 0.08 0.07")
ORIGINS, AXES = ("0 0 0", "0 0 0.3", "0.45 0 0"), ("0 0 1", "0 1 0", "0 1 0")
CENTRE = np.array([0.2, -0.5, 0.9])


@cache
def arm(middle: str = "revolute") -> Robot:
    """Three joints j1, j2, j3: one upright, two level."""
    parts = ['<link name="base"/>']
    for k in range(3):
        xx, yy, zz = MOMENTS[k].split()
        inertia = f'<inertia ixx="{xx}" iyy="{yy}" izz="{zz}" ixy="0.002" ixz="0" iyz="0.001"/>'
        body = f'<inertial><origin xyz="{CENTRES[k]}"/><mass value="{MASSES[k]}"/>{inertia}</inertial>'
        ends = f'<parent link="{f"l{k}" if k else "base"}"/><child link="l{k + 1}"/>'
        kind = middle if k == 1 else "revolute"
        place = f'<origin xyz="{ORIGINS[k]}"/><axis xyz="{AXES[k]}"/>{LIMIT}'
        parts += [f'<link name="l{k + 1}">{body}</link>', f'<joint name="j{k + 1}" type="{kind}">{ends}{place}</joint>']
    return toy(*parts, name=' name="arm"')


def harmonics(seconds: float, seed: int, size: float = 0.8, period: float = 8.0, step: float = 1e-3) -> Trajectory:
    """Five harmonics a joint, as far from the centre as size at most, growing out of rest within a second."""
    rng, k = np.random.default_rng(seed), np.array([1, 2, 3, 5, 8])
    w, t = 2 * np.pi * k / period, np.arange(0, seconds, step)
    sine, cosine = rng.normal(size=(2, 3, 5)) / np.sqrt(k)
    full = np.linspace(0, period, 400)[:, None] * w
    scale = size / np.abs(np.sin(full) @ sine.T + np.cos(full) @ cosine.T).max(0)
    sine, cosine = sine * scale[:, None], cosine * scale[:, None]
    s, c = np.sin(t[:, None] * w), np.cos(t[:, None] * w)
    q, v, a = (
        s @ sine.T + c @ cosine.T,
        (c * w) @ sine.T - (s * w) @ cosine.T,
        -(s * w**2) @ sine.T - (c * w**2) @ cosine.T,
    )
    grow, faster, bend = (_growth(t, k)[:, None] for k in range(3))
    return Trajectory(arm().joints, t, CENTRE + grow * q, grow * v + faster * q, grow * a + 2 * faster * v + bend * q)


def _growth(t: Array, derivative: int) -> Array:
    """From 0 to 1 within a second, smooth up to the third derivative at its ends."""
    part = np.polynomial.Polynomial([0, 0, 0, 0, 35, -84, 70, -20]).deriv(derivative)
    return np.where(t < 1, part(t), 0.0 if derivative else 1.0)


@cache
def smooth_motion(middle: str = "revolute", seconds: float = 3.5) -> Motion:
    """Exact positions, velocities and accelerations through several reversals."""
    path = harmonics(seconds, seed=3)
    bare = Motion(arm(middle), path.t, path.q, path.v, path.a)
    return Motion(arm(middle), path.t, path.q, path.v, path.a, recorded=bare.load)


def turned(motion: Motion) -> Motion:
    """Reverse every direction of motion."""
    other = Motion(motion.robot, motion.t, motion.q, motion.v, motion.a, recorded=motion.recorded)
    direction: Array = -motion.direction
    object.__setattr__(other, "direction", direction)
    return other
