"""A law's columns along a motion."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from ..types import Array, Law, View


class Along(Protocol):
    """What a law needs of a motion: the view of some joints."""

    def at(self, joints: Sequence[int]) -> View:
        """The joints a law acts on."""
        ...


def law_columns(law: Law, motion: Along) -> tuple[tuple[int, ...], Array]:
    """The rows (joints) that a law acts on, and its columns there, (N, m, k) [torque per coefficient]."""
    effect, x = law.effect, motion.at(law.joints)
    shape = effect.shape(law.parameters)
    memory: list[Any] = [_remember(effect, x, shape)] if getattr(effect, "memory", False) else []
    columns = effect.columns(x, *memory, **shape)
    rows = law.joints if effect.scope != "link" else tuple(range(columns[0].shape[1]))
    return rows, np.stack(columns, axis=-1)


def coefficient_count(law: Law) -> int:
    """How many columns the law has."""
    return max(1, len(law.effect.linear()))


def _remember(effect: Any, x: View, shape: dict[str, float]) -> Array:
    """The memory run along a recorded motion, (N, m)."""
    z = effect.begin(x[0], **shape)
    out = np.empty_like(x.q)
    for i in range(len(out)):
        out[i] = z = effect.advance(z, x[i], **shape)
    return out
