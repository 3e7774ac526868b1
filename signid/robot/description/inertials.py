"""Notes on missing or physically impossible inertials of a description."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from ...errors import shorten

if TYPE_CHECKING:
    from .tree import Tree

_ROUNDING = 1e-6  # tolerance of the triangle inequality for rounded numbers [share of the largest moment]


def inertial_notes(tree: Tree) -> tuple[str, ...]:
    """One sentence for each kind of defect of the moving links."""
    carried = carriers(tree)
    moving = [link for link in tree.links if carried.get(link.name)]
    bodies: dict[str, float] = {}
    for link in moving:
        name = carried[link.name] or ""
        bodies[name] = bodies.get(name, 0.0) + (link.inertial.mass if link.inertial else 0.0)
    stated = {link.name: (link.inertial.mass, link.inertial.matrix) for link in moving if link.inertial}
    return massless_note(bodies) + impossible_notes(stated)


def massless_note(bodies: Mapping[str, float]) -> tuple[str, ...]:
    """At most one sentence on moving links without mass; `bodies` maps links to masses [kg]."""
    missing = [name for name, mass in bodies.items() if mass == 0]
    return _sentence(missing, "moves but carries no mass", "move but carry no mass")


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


def impossible_notes(stated: Mapping[str, tuple[float, ArrayLike]]) -> tuple[str, ...]:
    """One sentence for each condition of physical inertials that links violate.

    Args:
        stated: mass [kg] and inertia about the centre of mass, (3, 3) [kg.m2], of each link.
    """
    fault = {name: _fault(*inertial) for name, inertial in stated.items()}

    def violating(kind: str) -> list[str]:
        return [name for name, found in fault.items() if found == kind]

    return (
        *_sentence(
            violating("mass"), "has an inertia without a positive mass", "have an inertia without a positive mass"
        ),
        *_sentence(
            violating("positive"),
            "has an inertia that is not positive definite",
            "have inertias that are not positive definite",
        ),
        *_sentence(
            violating("triangle"),
            "has an inertia that violates the triangle inequality",
            "have inertias that violate the triangle inequality",
        ),
    )


def _sentence(links: list[str], singular: str, plural: str) -> tuple[str, ...]:
    if not links:
        return ()
    return (f"link {links[0]} {singular}" if len(links) == 1 else f"links {shorten(links)} {plural}",)


def carriers(tree: Tree) -> dict[str, str | None]:
    """Moving link that each link is rigidly attached to (itself if it moves); None at the base."""
    below: dict[str, list[tuple[str, bool]]] = {}
    for joint in tree.joints:
        below.setdefault(joint.parent, []).append((joint.child, joint.kind == "fixed"))
    result: dict[str, str | None] = {tree.root: None}
    stack = [tree.root]
    while stack:
        parent = stack.pop()
        for child, rigid in below.get(parent, ()):
            result[child] = result[parent] if rigid else child
            stack.append(child)
    return result
