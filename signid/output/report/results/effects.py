"""Descriptions of effects: law, source and injection."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import getdoc
from typing import Any

from rich.console import RenderableType

from ....effects.base import ActuatorLaw, BodyLaw, Effect, RecordingLaw, TorqueLaw, TransmissionLaw
from ....effects.naming import law_syntax
from ....types import Coefficient
from ....version import __version__
from ..layout import heading, new_table, paragraph
from .documents import Document

KINDS: dict[type[Effect], str] = {
    TorqueLaw: "torque",
    BodyLaw: "bodies",
    TransmissionLaw: "transmission",
    RecordingLaw: "recording",
    ActuatorLaw: "actuator",
}


def effects_document(effects: Sequence[Effect]) -> Document:
    """Build the output of `signid effects --json`."""
    return {"schema": "signid.effects/1", "effects": [_card(effect) for effect in effects], "version": __version__}


def effects_tables(effects: Sequence[Effect]) -> list[RenderableType]:
    """Describe one effect in full, or list the notation of several."""
    if len(effects) == 1:
        return _card_lines(effects[0])
    lines: list[RenderableType] = []
    for kind, name in KINDS.items():
        mine = [paragraph(f"  {law_syntax(effect)}") for effect in effects if isinstance(effect, kind)]
        lines += [heading(f"Laws of the {name}", below=bool(lines)), *mine] if mine else []
    return [*lines, paragraph("\nValues are usual ones. signid effects NAME shows the law, its units and its source.")]


def _card(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "summary": getdoc(type(effect)),
        "acts_on": next(name for kind, name in KINDS.items() if isinstance(effect, kind)),
        "scope": effect.scope,
        "equation": effect.equation,
        "parameters": {
            key: {"unit": kind.unit, "linear": isinstance(kind, Coefficient), "usual": effect.example[key]}
            for key, kind in effect.parameters.items()
        },
        "typical": effect.typical,
        "source": effect.source,
        "twins": list(effect.twins),
        "inject": law_syntax(effect),
    }


def _card_lines(effect: Effect) -> list[RenderableType]:
    table = new_table("parameter", "usual>", "unit", "torque is")
    for key, kind in effect.parameters.items():
        linear = "linear in it" if isinstance(kind, Coefficient) else "not linear in it"
        table.add_row(key, f"{effect.example[key]:g}", kind.unit, linear)
    alike = [paragraph(f"Hard to distinguish from {', '.join(effect.twins)}.")] if effect.twins else []
    return [
        heading(effect.name, below=False),
        paragraph(str(getdoc(type(effect)))),
        heading("Law (additional motor torque, torque of a deflection, or recorded value)"),
        paragraph(effect.equation),
        *([heading("Parameters"), table] if effect.parameters else []),
        heading("Usual size"),
        paragraph(f"{effect.typical}."),
        *alike,
        heading("Source"),
        paragraph(effect.source),
        heading("Inject"),
        paragraph(f"signid simulate ROBOT -o recording.csv --inject {law_syntax(effect)}"),
    ]
