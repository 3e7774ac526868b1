"""Trunk of a robot with a floating base in MJCF: the base link with its mass, on a free joint."""

from __future__ import annotations

from typing import Any

from ...errors import RobotError
from ...model import Model
from ...robot.description.document import children, parse
from ...types import Robot
from .bodies import LEAST, Principal, principal


def trunk_of(robot: Robot) -> tuple[str, Principal]:
    """Name of the base link, and its body with all links that are fixed to it.

    Raises:
        RobotError: the base has no mass, or its inertia is not physically consistent.
    """
    name, body = _name(robot), principal(robot.model.inertias[0].toDynamicParameters())
    if body is None or body.mass <= LEAST:
        what = "has no mass" if body is not None else "has an inertia that no body can have"
        raise RobotError(
            f"the base of {robot.name} {what}, so it cannot float; state its inertial in the description, or export "
            f"with a fixed base"
        )
    return name, body


def trunk_notes(model: Model) -> list[str]:
    """Notes on a floating trunk."""
    notes = ["the trunk floats on a free joint, with the mass that the description states"]
    if model.covariance is not None:
        notes.append(
            "a fixed base does not identify all inertials that a floating one feels; those are of the description"
        )
    return notes


def _name(robot: Robot) -> str:
    """Name of the base link; "trunk" if the description has none or it is taken."""
    name = "trunk"
    if robot.kind == "urdf":
        root: Any = parse(robot.document)
        below = {node.get("link") for joint in children(root, "joint") for node in children(joint, "child")}
        name = next((str(x.get("name")) for x in children(root, "link") if x.get("name") not in below), name)
    while name in (*robot.links, "world", ""):
        name += "_"
    return name
