"""Recordings of the 3R arm that are long enough to be cut, and a comparison of the factors made of them."""

from __future__ import annotations

import numpy as np

from signid.regression.factors import Factors
from signid.regression.motion import Motion
from signid.types import Array, Robot

RATE = 200.0  # Hz
MINUTE, LONG = 60.0, 400.0  # s; nine windows and more


def states(seed: int, seconds: float = MINUTE) -> tuple[Array, Array, Array, Array]:
    """Time and a sum of sines for three joints, with its derivatives: (N,), (N, 3), (N, 3), (N, 3)."""
    rng, t = np.random.default_rng(seed), np.arange(0, seconds, 1 / RATE)
    w = 2 * np.pi * np.array([0.13, 0.31, 0.57])
    size, phase = rng.uniform(0.1, 0.5, (3, 3)), rng.uniform(0, 6, (3, 3))
    angle = np.multiply.outer(t, w)[:, :, None] + phase
    q, v, a = size * np.sin(angle), w[:, None] * size * np.cos(angle), -(w**2)[:, None] * size * np.sin(angle)
    return t, q.sum(1), v.sum(1), a.sum(1)


def without(columns: dict[str, Array], *names: str) -> dict[str, Array]:
    return {name: column for name, column in columns.items() if name not in names}


def desired(columns: dict[str, Array]) -> dict[str, Array]:
    return {**without(columns, "dq", "ddq"), "q_des": states(0)[1]}


def columns(robot: Robot, seed: int, seconds: float = LONG) -> dict[str, Array]:
    """The arm with friction and noise; a gap in the middle, so that there are two stretches."""
    t, q, v, a = states(seed, seconds)
    noise = np.random.default_rng(seed + 50).standard_normal((2, *q.shape))
    torque = Motion(robot, t, q, v, a).load + 0.1 * a + 0.5 * v + 0.8 * np.sign(v) + 0.05 * noise[0]
    return {"t": t + np.where(t < 0.45 * seconds, 0, 1.0), "q": q + 1e-5 * noise[1], "tau": torque}


def numbers(factors: Factors) -> list[Array]:
    joints = [[*each.grams, each.counts, each.whole, np.array([each.total, each.rows])] for each in factors.joints]
    sizes = [factors.lower, factors.upper, factors.velocity, factors.acceleration, np.array(factors.rows)]
    return sum(joints, sizes)


def assert_close(ours: Factors, theirs: Factors, share: float) -> None:
    """Equal to a share of the largest number in each array."""
    for a, b in zip(numbers(ours), numbers(theirs), strict=True):
        assert np.abs(a - b).max() <= share * np.abs(b).max()
