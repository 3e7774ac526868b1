"""Notes on what a URDF shows and the model lacks: loops of closed linkages, and mass of links that are only drawn."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from typing import Any

from ...errors import shorten
from .document import children

_LOOP = re.compile(r"loop|closure|closing|four[_-]?bar|4[_-]?bar|linkage|crank|coupler", re.IGNORECASE)
_FOLLOWS = re.compile(r"[_-]mimic(?![a-z])", re.IGNORECASE)  # in the name of a joint that follows another one
_MISSING = "a URDF file is a tree, so the loops are missing, and forces through them are not modelled"


def left_out_notes(robot: Any, massless: Collection[str]) -> Iterator[str]:
    """At most one sentence for each kind of content that the model lacks.

    `robot` is the <robot> element; `massless` are the links whose moving body has no mass.
    """
    drawn = [link.get("name") for link in children(robot, "link") if link.get("name") in massless and _drawn(link)]
    if drawn:
        theirs = "the shape of link" if len(drawn) == 1 else "the shapes of links"
        gives = "gives" if len(drawn) == 1 else "give"
        yield f"{theirs} {shorten(drawn)} {gives} no mass and no inertia; add an <inertial> there"
    names = [*_named(robot, "joint"), *_named(robot, "link")]
    if names:
        be = "is part of a closed linkage by its name" if len(names) == 1 else "are parts of closed linkages by name"
        yield f"{shorten(names)} {be}; {_MISSING}"
    closing = [str(joint.get("name")) for part in children(robot, "gazebo") for joint in children(part, "joint")]
    if closing:
        yield f"left out, because only a <gazebo> element states them: joints {shorten(closing)}; {_MISSING}"


def _named(robot: Any, tag: str) -> list[str]:
    """Joints, or links, whose names show a closed linkage; a joint *_mimic with a <mimic> follows another one here."""
    follow = {part.get("name") for part in children(robot, tag) if children(part, "mimic")}
    names = [part.get("name") or "" for part in children(robot, tag)]
    shown = [name for name in names if _LOOP.search(name) or (_FOLLOWS.search(name) and name not in follow)]
    return [f"{tag} {name}" for name in shown if tag == "joint" or not _FOLLOWS.search(name)]


def _drawn(link: Any) -> bool:
    """Whether a link has a shape, and no inertial."""
    return bool(children(link, "visual") or children(link, "collision")) and not children(link, "inertial")
