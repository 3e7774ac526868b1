"""Payload: JSON document and terminal table."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import RenderableType

from ....payload import Payload
from ....types import INERTIAL, Input
from ..layout import heading, new_table, note_lines, paragraph
from ..numbers import with_interval
from .documents import Document, description, provenance


def payload_document(found: Payload, inputs: Sequence[Input] = ()) -> Document:
    """Build the output of `signid payload --json`; `inputs` besides the recordings default to the description."""
    parts = {"mass": (found.mass, "kg"), "centre": (found.centre, "m"), "inertia": (found.inertia, "kg.m^2")}
    return {
        "schema": "signid.payload/1",
        "robot": found.robot.name,
        "link": found.link,
        **{key: {"value": value, "std": std, "unit": unit} for key, ((value, std), unit) in parts.items()},
        "effect": {"effect": found.law.effect.name, "parameters": dict(found.law.parameters)},
        "physically_consistent": True,
        "moved": found.moved,
        "misfit": found.misfit,
        "cutoff": {"torque": found.cutoff, "unit": "Hz"},
        "flags": list(found.flags),
        "notes": list(found.notes),
        **provenance(found.inputs, inputs or [description(found.robot)], found.seed),
    }


def payload_tables(found: Payload) -> list[RenderableType]:
    """Mass, centre of mass and inertia with their intervals."""
    table = new_table("payload", "value>", "± (95 %)>", "unit")
    table.add_row("mass", *with_interval(*found.mass), "kg")
    for axis, value, std in zip("xyz", *found.centre, strict=True):
        table.add_row(f"centre of mass {axis}", *with_interval(float(value), float(std)), "m")
    for name, value, std in zip(INERTIAL[4:], *found.inertia, strict=True):
        table.add_row(f"{name} about its centre", *with_interval(float(value), float(std)), "kg.m2")
    change = f"this changed the difference of base parameters by at most {found.moved:.1f} standard deviations"
    sentence = f"The inertia is physically consistent; {change}. Cut-off {found.cutoff:.3g} Hz."
    return [
        heading(f"{found.robot.name}: payload of {found.link}, in its joint frame", below=False),
        table,
        paragraph(sentence),
        *note_lines(found.notes),
    ]
