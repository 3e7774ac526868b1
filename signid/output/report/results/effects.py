"""The cards of effects: what each law is, where it comes from, and how it is injected."""

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
    """What `signid effects --json` prints."""
    return {"schema": "signid.effects/1", "effects": [_card(effect) for effect in effects], "version": __version__}


def effects_tables(effects: Sequence[Effect]) -> list[RenderableType]:
    """One effect as its card, several as a list of how to write them."""
    if len(effects) == 1:
        return _card_lines(effects[0])
    lines: list[RenderableType] = []
    for kind, name in KINDS.items():
        mine = [paragraph(f"  {law_syntax(effect)}") for effect in effects if isinstance(effect, kind)]
        lines += [heading(f"Laws of the {name}", below=bool(lines)), *mine] if mine else []
    return [*lines, paragraph("\nNumbers are usual ones. signid effects NAME shows the law, its units and its source.")]


def _kind(effect: Effect) -> type[Effect]:
    return next(kind for kind in KINDS if isinstance(effect, kind))


def _card(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "summary": getdoc(type(effect)),
        "acts_on": KINDS[_kind(effect)],
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
    table = new_table("number", "usual>", "unit", "torque is")
    for key, kind in effect.parameters.items():
        linear = "linear in it" if isinstance(kind, Coefficient) else "not linear in it"
        table.add_row(key, f"{effect.example[key]:g}", kind.unit, linear)
    alike = [paragraph(f"Hard to tell from {', '.join(effect.twins)}.")] if effect.twins else []
    return [
        heading(effect.name, below=False),
        paragraph(str(getdoc(type(effect)))),
        heading("Law (what the motor gives more, a deflection's torque, or what is written down)"),
        paragraph(effect.equation),
        *([heading("Numbers"), table] if effect.parameters else []),
        heading("Usual"),
        paragraph(f"{effect.typical}."),
        *alike,
        heading("Source"),
        paragraph(effect.source),
        heading("Inject"),
        paragraph(f"signid simulate ROBOT -o recording.csv --inject {law_syntax(effect)}"),
    ]
