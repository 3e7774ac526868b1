"""Hypotheses that are taken for true."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from ...types import Array, Frozen
from ..data.column_groups import Group
from ..data.hypotheses import Key
from .posterior_odds import Odds


@dataclass(frozen=True, eq=False)
class Found(Frozen):
    """Hypotheses that are taken for true, with what they were accepted by."""

    true: tuple[Group, ...]
    log_odds: Mapping[Group, float]
    base: Array  # (n,) dispersion that no effect explains [1]
    trust: float  # of the tolerance of inertials
    first: Mapping[Key, Odds] = field(default_factory=dict)  # odds before anything was taken for true
