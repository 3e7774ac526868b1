"""A law's columns and torque along a motion, and where laws of an effect may stand."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any, Protocol

import numpy as np

from ..types import Array, Law, View


class Along(Protocol):
    """What a law needs of a motion: the view of some joints."""

    def at(self, joints: Sequence[int]) -> View:
        """The joints a law acts on."""
        ...

    def coupled(self, joint: int) -> list[int]:
        """The joints whose torque the motion of one may change."""
        ...


def law_columns(law: Law, motion: Along) -> tuple[tuple[int, ...], Array]:
    """The rows (joints) that a law acts on, and its columns there, (N, m, k) [torque per coefficient]."""
    effect, x = law.effect, motion.at(law.joints)
    shape = effect.shape(law.parameters)
    memory: list[Any] = [_remember(effect, x, shape)] if getattr(effect, "memory", False) else []
    columns = effect.columns(x, *memory, **shape)
    if effect.scope not in ("link", "tip"):
        return law.joints, np.stack(columns, axis=-1)
    rows = motion.coupled(law.joints[0])
    return tuple(rows), np.stack([x[:, rows] for x in columns], axis=-1)


def law_torque(law: Law, motion: Along) -> tuple[tuple[int, ...], Array]:
    """The rows (joints) that a law acts on, and what it adds to the recorded torque there, (N, m) [N.m or N]."""
    rows, columns = law_columns(law, motion)
    return rows, columns @ np.array(law.effect.coefficients(law.parameters))


def coefficient_count(law: Law) -> int:
    """How many columns the law has."""
    return len(law.effect.coefficients(dict.fromkeys(law.effect.parameters, 1.0)))


def places(effect: Any, joints: int) -> list[tuple[int, ...]]:
    """The joints, of so many, at which a law of this effect may stand."""
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


def hypotheses(effect: Any, motion: Along, joints: int) -> Iterator[Law]:
    """Every place and every shape of an effect worth trying on a motion of so many joints."""
    for place in places(effect, joints):
        for shape in effect.shapes(motion.at(place)):
            yield Law(effect, place, shape)


def _remember(effect: Any, x: View, shape: dict[str, float]) -> Array:
    """The memory run along a recorded motion, (N, m): by one call where each step is linear in the memory."""
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
