"""Common result of the description readers, before joints are held and actuators are read, and notes on inertials."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import inf, nan
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ...errors import shorten

if TYPE_CHECKING:
    import pinocchio as pin

_ROUNDING = 1e-6  # tolerance of the triangle inequality for rounded numbers [share of the largest moment]
_IMPOSSIBLE = {  # condition -> text for one link and for several that violate it
    "mass": ("has an inertia without a positive mass", "have an inertia without a positive mass"),
    "positive": ("has an inertia that is not positive definite", "have inertias that are not positive definite"),
    "triangle": (
        "has an inertia that violates the triangle inequality",
        "have inertias that violate the triangle inequality",
    ),
}


class Mimic(NamedTuple):
    """position = multiplier * position of the joint + offset."""

    joint: str
    multiplier: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Axis:
    """One degree of freedom of the model, in [rad, N.m], or [m, N] if prismatic; NaN where not stated."""

    name: str
    row: int = -1  # index in the velocity of the model, -1 before that is built
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


def massless_note(bodies: Mapping[str, float]) -> tuple[str, ...]:
    """At most one sentence on moving links without mass; `bodies` maps links to masses [kg]."""
    missing = [name for name, mass in bodies.items() if mass == 0]
    return _sentence(missing, "moves but carries no mass", "move but carry no mass")


def impossible_notes(stated: Mapping[str, tuple[float, ArrayLike]]) -> tuple[str, ...]:
    """One sentence for each condition of physical inertials that links violate.

    `stated` maps links to their mass [kg] and inertia about the centre of mass, (3, 3) [kg.m2].
    """
    faults = {name: _fault(*inertial) for name, inertial in stated.items()}
    links = {kind: [name for name, fault in faults.items() if fault == kind] for kind in _IMPOSSIBLE}
    return tuple(note for kind, texts in _IMPOSSIBLE.items() for note in _sentence(links[kind], *texts))


def _fault(mass: float, inertia: ArrayLike) -> str:
    """Violated condition ("mass", "positive", "triangle" or "") of a mass [kg] and its central inertia [kg.m2]."""
    if mass < 0:
        return "mass"
    principal = np.linalg.eigvalsh(np.asarray(inertia, float))
    if mass == 0:
        return "mass" if np.abs(principal).max() > 0 else ""
    if principal[0] <= 0:
        return "positive"
    return "triangle" if principal[2] * (1 - _ROUNDING) > principal[0] + principal[1] else ""


def _sentence(links: list[str], singular: str, plural: str) -> tuple[str, ...]:
    if not links:
        return ()
    return (f"link {links[0]} {singular}" if len(links) == 1 else f"links {shorten(links)} {plural}",)
