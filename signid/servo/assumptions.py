"""Assumptions about drives: joints that share their numbers, priors and bounds of numbers."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

OWN = "torque_offset"  # number of a joint alone: it contains the zero error of the command

Name = tuple[str, str]  # joint, number


class Prior(NamedTuple):
    """Normal distribution of a number [SERVO_UNITS]."""

    mean: float
    std: float


class Bounds(NamedTuple):
    """Range of a number [SERVO_UNITS]."""

    low: float
    high: float


@dataclass(frozen=True)
class Assumptions:
    """Assumptions of a fit; each prior and range stands at every joint that it holds for."""

    equal: tuple[tuple[str, ...], ...] = ()  # joints whose numbers, but OWN, are one number each
    priors: Mapping[Name, Prior] = field(default_factory=dict)
    bounds: Mapping[Name, Bounds] = field(default_factory=dict)

    def peers(self, joint: str) -> tuple[str, ...]:
        """Joints that share the numbers of a joint; at least itself."""
        return next((members for members in self.equal if joint in members), (joint,))

    def with_peers(self, joints: Collection[str]) -> list[str]:
        """Joints with those that share their numbers, each once."""
        return list(dict.fromkeys(peer for joint in joints for peer in self.peers(joint)))


def unions(sets: Iterable[Sequence[str]]) -> list[tuple[str, ...]]:
    """Unions of the sets that overlap."""
    found: list[tuple[str, ...]] = []
    for members in sets:
        linked = [one for one in found if not set(one).isdisjoint(members)]
        joined = tuple(dict.fromkeys((*(name for one in linked for name in one), *members)))
        found = [one for one in found if one not in linked] + [joined]
    return found
