"""Refinement by roll-outs: JSON block and terminal table."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rich.console import RenderableType

from ..layout import figure, heading, new_table, paragraph
from .documents import Document

if TYPE_CHECKING:
    from ....identify import Identification
    from ....model import Model


def refinement_document(result: Identification) -> Document | None:
    """Build the block `refinement` of identification.json; None if it was not asked for."""
    found = result.refinement
    if found is None:
        return None
    joints = result.robot.joints
    return {
        "kept": found.kept,
        "windows": list(found.lengths),
        "before": [float(x) for x in found.before],
        "after": [float(x) for x in found.after],
        "unit": list(found.unit),
        "effects": [
            {
                "effect": law.effect.name,
                "joint": joints[law.joints[0]] if len(law.joints) == 1 else None,
                "parameters": {key: float(value) for key, value in law.parameters.items()},
            }
            for law in result.best.laws
        ],
    }


def refinement_tables(result: Identification) -> list[RenderableType]:
    """Numbers of the laws in model.json, if roll-outs refined them."""
    found, model = result.refinement, result.refined
    if found is None or model is None:
        return []
    table = new_table("joint", "law", "parameter", "value>", "unit")
    for row in _rows(model):
        table.add_row(*row)
    return [heading("Refined by roll-outs: laws of model.json"), table, paragraph(f"{found.sentence}.".capitalize())]


def _rows(model: Model) -> list[list[str]]:
    prismatic, joints = model.robot.prismatic, model.robot.joints
    rows = []
    for law in model.laws:
        j = law.joints[0]
        for key, value in law.parameters.items():
            unit = law.effect.parameters[key].unit_at(bool(prismatic[j]))
            rows.append([joints[j], law.effect.name.replace("_", " "), key, figure(float(value)), unit])
    return rows
