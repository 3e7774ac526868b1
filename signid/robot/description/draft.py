"""Common result of the description readers, before joints are held and actuators are read."""

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
    """One degree of freedom of the model, in [rad, N.m], or [m, N] if prismatic; NaN where not stated."""

    name: str
    row: int  # index in the velocity of the model
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
    """Checked description: the model and its degrees of freedom in the order of the file."""

    name: str
    model: pin.Model
    axes: tuple[Axis, ...]
    links: tuple[str, ...]  # link that each joint of the model moves
    document: str
    kind: str  # "urdf" or "mjcf"
    notes: tuple[str, ...] = ()
    still: frozenset[str] = frozenset()  # immobile joints: fixed, or held at neutral
