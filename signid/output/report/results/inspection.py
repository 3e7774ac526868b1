"""Inspection of a robot and check of its recordings: JSON documents and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from rich.console import RenderableType

from ....types import Input, Robot
from ..documents import Document, description, picked, provenance
from ..layout import figure, heading, name_cell, new_table, note_lines, paragraph, plural, position_units
from .identification import base_documents

if TYPE_CHECKING:
    from ....check import Inspection

READING_STYLES = {"right": "green", "uncertain": "yellow", "wrong": "red"}
HEADS = ("joint", "#>", "type", "carries link", "lower>", "upper>", "velocity>", "effort>", "unit")
BASE_STYLES = {"identifiable": "green", "weak": "yellow", "unidentifiable": "red"}


def inspection_document(found: Inspection, inputs: Sequence[Input] = (), seed: int = 0) -> Document:
    """Build the output of `signid inspect --json`; `inputs` defaults to the robot description."""
    robot = found.robot
    return {
        "schema": "signid.inspection/1",
        "robot": robot.name,
        "joints": joint_documents(robot),
        "links": list(robot.links),
        "base_parameters": base_documents(found.base),
        **picked(found, "invisible combined"),
        "suspect": [suspect._asdict() for suspect in found.suspect],
        "flags": list(found.flags),
        "notes": list(robot.notes),
        **provenance((), inputs or [description(robot)], seed),
    }


def inspection_tables(found: Inspection) -> list[RenderableType]:
    """Joints, links, base parameters as formulas, and unidentifiable parameters."""
    robot, base = found.robot, found.base
    formulas = new_table("base parameter", "unit", rows=zip(base.expressions, base.units, strict=True))
    bodies: dict[int | None, list[str]] = {}
    for label in base.invisible:
        bodies.setdefault(label.body, []).append(label.name)
    hidden = new_table("link", "standard parameters")
    for body, names in bodies.items():
        hidden.add_row("(actuators)" if body is None else f"{body + 1}  {robot.links[body]}", ", ".join(names))
    size = f"{plural(len(robot.joints), 'joint')}, {plural(len(robot.links), 'moving link')}"
    counted = f"{base.rank} base parameters, combinations of {len(base.labels)} standard parameters"
    return [
        heading(f"{robot.name}: {size}", below=False),
        *joint_table(robot),
        heading(f"{counted} (indices: moving links)"),
        formulas,
        *([heading("Unidentifiable from any motion"), hidden] if base.invisible else []),
        paragraph(f"{plural(len(found.combined), 'standard parameter')}: identifiable only in combination."),
        *note_lines(robot.notes),
    ]


def joint_table(robot: Robot) -> list[RenderableType]:
    """Joints with their limits; a type or unit that all joints have stands once, below the table."""
    joints = joint_documents(robot)
    equal = {key: joints[0][key] for key in ("type", "unit") if len({joint[key] for joint in joints}) == 1}
    common = ["type", "unit"] if len(equal) == 2 and len(joints) > 1 else []
    table = new_table(*(head for head in HEADS if head not in common))
    for joint in joints:
        name, number, kind, link, *limits, unit = joint.values()
        cells = dict(zip(HEADS, (name, str(number), kind, name_cell(link), *map(figure, limits), unit), strict=True))
        table.add_row(*(cell for head, cell in cells.items() if head not in common))
    effort = "N" if equal.get("type") == "prismatic" else "N.m"
    said = f"All joints are {equal.get('type')}: limits in {equal.get('unit')}, {equal.get('unit')}/s and {effort}."
    return [table, *([paragraph(said)] if common else [])]


def joint_documents(robot: Robot) -> list[Document]:
    """Actuated joints; limits in `unit`, `unit`/s and N.m or N, infinite if not stated."""
    bounded = np.isfinite(robot.upper - robot.lower)
    return [
        {
            "name": name,
            "number": robot.numbers[j],
            "type": "prismatic" if robot.prismatic[j] else "revolute" if bounded[j] else "continuous",
            "link": _link(robot, j),
            "lower": float(robot.lower[j]),
            "upper": float(robot.upper[j]),
            "velocity_limit": float(robot.velocity_limit[j]),
            "effort_limit": float(robot.effort_limit[j]),
            "unit": unit,
        }
        for j, (name, unit) in enumerate(zip(robot.joints, position_units(robot), strict=True))
    ]


def _link(robot: Robot, j: int) -> str:
    """Name of the link that the joint moves; a joint's own link precedes links of mimic joints."""
    rows = np.flatnonzero(robot.drive[:, j])
    bodies = zip(list(robot.model.names)[1:], list(robot.model.joints)[1:], robot.links, strict=True)
    moved = [
        (name != robot.joints[j], link)
        for name, joint, link in bodies
        if np.any((rows >= joint.idx_v) & (rows < joint.idx_v + joint.nv))
    ]
    return min(moved, key=lambda entry: entry[0])[1] if moved else ""
