"""What every kind of description is read into, before joints are held and actuators are stated."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, nan
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    import pinocchio as pin


class Mimic(NamedTuple):
    """position = multiplier * position of the joint + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Axis:
    """One degree of freedom of the model: [rad, N.m] or, where prismatic, [m, N]; NaN where nothing is stated."""

    name: str
    row: int  # in the model's velocity
    prismatic: bool = False
    lower: float = -inf
    upper: float = inf
    velocity: float = inf
    effort: float = inf
    viscous: float = nan
    coulomb: float = nan
    armature: float = nan
    mimic: Mimic | None = None


@dataclass(frozen=True)
class Draft:
    """A description read and checked: its model, and its degrees of freedom in the order of the file."""

    name: str
    model: pin.Model
    axes: tuple[Axis, ...]
    links: tuple[str, ...]  # the link that each joint of the model carries
    document: str
    kind: str  # "urdf" or "mjcf"
    notes: tuple[str, ...] = ()
    still: frozenset[str] = frozenset()  # joints that never move: fixed, or held at neutral
