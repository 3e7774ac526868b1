"""Payload of the last link: JSON document and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from rich.console import RenderableType

from ....types import INERTIAL, Input
from ..documents import Document, description, ending, picked
from ..layout import heading, note_lines, paragraph
from ..quantities import Quantity, spaced
from ..sections import Cells, Plain, Section, terminal

if TYPE_CHECKING:
    from ....payload import Payload


def payload_document(found: Payload, inputs: Sequence[Input] = ()) -> Document:
    """Build the output of `signid payload --json`; `inputs` besides the recordings default to the description."""
    parts: dict[str, Any] = {}
    if found.found:
        parts = {"mass": (found.mass, "kg"), "centre": (found.centre, "m"), "inertia": (found.inertia, "kg.m^2")}
    effect = {"effect": found.law.effect.name, "parameters": dict(found.law.parameters)} if found.found else None
    moments = [{"t": m.t, "std": m.std, "unit": "s", "picked_up": m.picked_up} for m in found.moments]
    return {
        "schema": "signid.payload/1",
        "robot": found.robot.name,
        "link": found.link,
        "found": found.found,
        **{key: {"value": value, "std": std, "unit": unit} for key, ((value, std), unit) in parts.items()},
        "effect": effect,
        "moments": moments,
        "physically_consistent": found.found,
        **picked(found, "moved misfit"),
        "cutoff": {"torque": found.cutoff, "unit": "Hz"},
        **ending(found, found.inputs, inputs or [description(found.robot)], found.seed),
    }


def payload_numbers(found: Payload) -> list[Quantity]:
    """Numbers of the load and its moments, from which tables and frames follow."""
    centre = zip((f"centre_{axis}" for axis in "xyz"), *found.centre, ["m"] * 3, strict=True)
    load = [("mass", *found.mass, "kg"), *centre, *zip(INERTIAL[4:], *found.inertia, ["kg.m2"] * 6, strict=True)]
    moments = [("picked_up" if each.picked_up else "put_down", each.t, each.std, "s") for each in found.moments]
    numbers = [*(load if found.found else []), *moments]
    return [Quantity(name, float(value), float(std), unit) for name, value, std, unit in numbers]


def _title(name: str) -> str:
    if name in INERTIAL:
        return f"{name} about its centre"
    return spaced(name).replace("centre", "centre of mass") + (" at" if name in ("picked_up", "put_down") else "")


def payload_tables(found: Payload) -> list[RenderableType]:
    """Mass, centre of mass and inertia with their intervals; moments, or the notes alone without a load."""
    head = heading(f"{found.robot.name}: payload of {found.link}, in its joint frame", below=False)
    if not found.found:
        return [head, paragraph("No load was found."), *note_lines(found.notes)]
    rows = [(_title(x.name), *x.interval("-"), x.unit) for x in payload_numbers(found)]
    change = f"this changed the difference of base parameters by at most {found.moved:.1f} standard deviations"
    sentence = f"The inertia is physically consistent; {change}. Cut-off {found.cutoff:.3g} Hz."
    section = Section("", (Cells(("payload", "value>", "± (95 %)>", "unit"), rows), Plain(sentence)))
    return [head, *terminal([section], found.notes)]
