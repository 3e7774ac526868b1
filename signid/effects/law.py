"""Columns and torque of a law along a motion, and candidate places of an effect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Protocol

import numpy as np

from ..types import Array, Effect, Law, View
from .base import TorqueLaw


class Along(Protocol):
    """Interface of a motion: views of joints."""

    def at(self, joints: Sequence[int]) -> View:
        """View of some joints."""
        ...

    def coupled(self, joint: int) -> list[int]:
        """Joints whose torque depends on the motion of `joint`."""
        ...


def law_columns(law: Law, motion: Along) -> tuple[tuple[int, ...], Array]:
    """Rows (joints) of a law and its columns there, (N, m, k) [torque per coefficient]."""
    effect, x = law.effect, motion.at(law.joints)
    shape = effect.shape(law.parameters)
    state = [_states(effect, x, shape)] if isinstance(effect, TorqueLaw) and effect.memory else []
    columns = effect.columns(x, *state, **shape)
    if effect.scope not in ("link", "tip"):
        return law.joints, np.stack(columns, axis=-1)
    rows = motion.coupled(law.joints[0])
    return tuple(rows), np.stack([x[:, rows] for x in columns], axis=-1)


def law_torque(law: Law, motion: Along) -> tuple[tuple[int, ...], Array]:
    """Rows (joints) of a law and its contribution to the recorded torque there, (N, m) [N.m or N]."""
    rows, columns = law_columns(law, motion)
    return rows, columns @ np.array(law.effect.coefficients(law.parameters))


def coefficient_count(law: Law) -> int:
    """Number of columns of a law."""
    return len(law.effect.coefficients(dict.fromkeys(law.effect.parameters, 1.0)))


def candidate_places(effect: Effect, joints: int) -> list[tuple[int, ...]]:
    """Candidate places (tuples of joints) of an effect on a robot of `joints` joints."""
    one: list[tuple[int, ...]] = [(j,) for j in range(joints)]
    every = tuple(range(joints))
    options: dict[str, list[tuple[int, ...]]] = {
        "joint": one,
        "link": one,
        "tip": one[-1:],
        "pair": list(combinations(every, 2)),
        "robot": [every],
        "any": list(dict.fromkeys([every, *one])),
    }
    return options[effect.scope]


def hypotheses(effect: Effect, motion: Along, joints: int) -> Iterator[Law]:
    """Candidate laws of an effect: all places and shapes for a motion of `joints` joints."""
    for place in candidate_places(effect, joints):
        for shape in effect.shapes(motion.at(place)):
            yield Law(effect, place, shape)


def _states(effect: TorqueLaw, x: View, shape: dict[str, float]) -> Array:
    """States (N, m) of a law along a recorded motion; steps affine in the state take one vectorised call."""
    z = effect.begin(x[0], **shape)
    zero, half, one = (effect.advance(np.full_like(x.q, c), x, **shape) for c in (0.0, 0.5, 1.0))
    out = np.empty_like(x.q)
    if np.allclose(half, (zero + one) / 2, rtol=0, atol=1e-12):
        for j, pairs in enumerate(zip((one - zero).T.tolist(), zero.T.tolist(), strict=True)):
            now = float(z[j])
            out[:, j] = [now := keep * now + add for keep, add in zip(*pairs, strict=True)]
        return out
    for i in range(len(out)):
        out[i] = z = effect.advance(z, x[i], **shape)
    return out
