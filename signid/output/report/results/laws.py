"""Laws: their descriptions, and their parameters in JSON documents and words, as stated and as estimated."""

from __future__ import annotations

from collections.abc import Sequence
from inspect import getdoc
from math import isfinite
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import RenderableType

from ....effects.base import ActuatorLaw, BodyLaw, Effect, RecordingLaw, TorqueLaw, TransmissionLaw
from ....effects.drive import DriveLaw
from ....effects.naming import law_name, law_place, law_syntax
from ....robot.dynamics import own_body
from ....types import TWO_SIDED, Coefficient, Law, Robot
from ....version import __version__
from ..documents import Document, picked
from ..layout import UNKNOWN_TEXT, figure, heading, new_table, paragraph, plural, with_interval
from ..quantities import Quantity, effect_document, law_numbers

if TYPE_CHECKING:
    from ....diagnose import Finding


EFFECT_KINDS: dict[type[Effect], str] = {
    TorqueLaw: "torque",
    BodyLaw: "bodies",
    TransmissionLaw: "transmission",
    RecordingLaw: "recording",
    ActuatorLaw: "actuator",
    DriveLaw: "position drive",
}


class NumberCells(NamedTuple):
    """One parameter of a finding, formatted for a table or a sentence."""

    key: str
    stated: str  # value in the simulation; "" if not stated
    value: str  # value estimated from the recordings
    half: str  # half-width of its 95 % interval
    unit: str

    @property
    def interval(self) -> str:
        """Value, half-width and unit, as far as they are known."""
        return " ".join(filter(None, [self.value, self.half and f"± {self.half}", self.unit]))

    @property
    def compared(self) -> str:
        """A stated parameter and its estimate."""
        if self.value == UNKNOWN_TEXT:
            return f"{self.stated} {self.unit}".rstrip() + f" in the simulation, {UNKNOWN_TEXT} from the recordings"
        return f"{self.stated} in the simulation, {self.interval} recorded"


def law_document(robot: Robot, law: Law) -> Document:
    """Effect, joint and parameters of a stated law, without standard deviations."""
    found = effect_document(law.effect.name, law_place(law, robot)[0], law_numbers(robot, law, {}))
    for number in found["parameters"].values():
        del number["std"]
    return found


def changed_link(robot: Robot, law: Law) -> str | None:
    """The link whose inertia a law changes; None for other laws."""
    if not isinstance(law.effect, BodyLaw) or law.effect.scope not in ("link", "tip"):
        return None
    return robot.links[own_body(robot, law.joints[0])]


def law_words(robot: Robot, law: Law) -> str:
    """Name of a law with its joint, and with the link whose inertia it changes."""
    link, words = changed_link(robot, law), law_name(law, robot)
    if link is None:
        return words
    return f"{words if ' of ' in words else f'{words} of {robot.joints[law.joints[0]]}'} (link {link})"


def finding_numbers(robot: Robot, finding: Finding) -> list[Quantity]:
    """Parameters of the law of a finding, with the values stated by the simulation."""
    return law_numbers(robot, finding.law, finding.std, finding.stated)


def number_cells(robot: Robot, finding: Finding) -> list[NumberCells]:
    """Parameters of a finding; optional ones consistent with zero are only counted."""
    shown, origin, hidden = list[NumberCells](), finding.where.origin, 0
    for x in finding_numbers(robot, finding):
        if origin and x.name in ("start", "end"):
            x = x._replace(value=x.value - origin, unit="s since the start")
        optional = x.name in finding.law.effect.optional and x.stated is None
        if optional and x.std is not None and abs(x.value) < TWO_SIDED * x.std:
            hidden += 1
        else:
            shown.append(_cells(x))
    if hidden:
        shown.append(NumberCells(f"{plural(hidden, 'more parameter')}: could be zero", "", "", "", ""))
    return shown


def number_lines(robot: Robot, finding: Finding) -> tuple[str, ...]:
    """Parameters of a finding in one line each, with their meaning and their absence from the extended simulation."""
    cells = number_cells(robot, finding)
    lines = [f"{x.key}: {x.compared}" if x.stated else f"{x.key} {x.interval}".rstrip() for x in cells]
    absent = "" if finding.in_model else f"not in the extended simulation: {finding.refused}".removesuffix(": ")
    return (*lines, *filter(None, [finding.law.effect.meaning(finding.law.parameters), absent]))


def _cells(x: Quantity) -> NumberCells:
    before, unit = "" if x.stated is None else _as_fine(x.stated, x.std), "" if x.unit == "1" else x.unit
    value, half = x.interval("")
    half, unit = ("", unit if before else "") if value == UNKNOWN_TEXT else (half, unit)
    return NumberCells(x.name, before, value, half, unit)


def _as_fine(stated: float, std: float | None) -> str:
    """A stated parameter with the digits of its estimate, if these suffice."""
    fine = std is not None and isfinite(std) and 0 < TWO_SIDED * std < abs(stated)
    return with_interval(stated, std)[0] if fine and std is not None else figure(stated)


def effects_document(effects: Sequence[Effect]) -> Document:
    """Build the output of `signid effects --json`."""
    return {"schema": "signid.effects/1", "effects": [_card(effect) for effect in effects], "version": __version__}


def effects_tables(effects: Sequence[Effect]) -> list[RenderableType]:
    """Describe one effect in full, or list the notation of several."""
    if len(effects) == 1:
        return _card_lines(effects[0])
    lines: list[RenderableType] = []
    for kind, name in EFFECT_KINDS.items():
        mine = [paragraph(f"  {law_syntax(effect)}") for effect in effects if isinstance(effect, kind)]
        lines += [heading(f"Laws of the {name}", below=bool(lines)), *mine] if mine else []
    return [*lines, paragraph("\nValues are usual ones. signid effects NAME shows the law, its units and its source.")]


def _card(effect: Effect) -> dict[str, Any]:
    return {
        "name": effect.name,
        "summary": getdoc(type(effect)),
        "acts_on": next(name for kind, name in EFFECT_KINDS.items() if isinstance(effect, kind)),
        **picked(effect, "scope equation"),
        "parameters": {
            key: {"unit": kind.unit, "linear": isinstance(kind, Coefficient), "usual": effect.example[key]}
            for key, kind in effect.parameters.items()
        },
        **picked(effect, "typical source twins"),
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
        heading("Law (additional motor torque, torque of a deflection, recorded value, or signal of a drive)"),
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
