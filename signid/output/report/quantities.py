"""Numbers of results and laws: each is described once, and documents, tables, pages and frames follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from inspect import getdoc
from math import isfinite, isnan
from typing import TYPE_CHECKING, Any, NamedTuple

from rich.console import RenderableType

from ...effects.base import ActuatorLaw, BodyLaw, Effect, RecordingLaw, TorqueLaw, TransmissionLaw
from ...effects.drive import DriveLaw
from ...effects.naming import law_name, law_place, law_syntax
from ...errors import decimals
from ...robot.dynamics import own_body
from ...types import TWO_SIDED, Coefficient, Law, Robot
from ...version import __version__
from .documents import Document, law_units, picked
from .layout import UNKNOWN_TEXT, figure, heading, new_table, paragraph, plural, with_interval

if TYPE_CHECKING:
    from ...diagnose import Finding

FIXED_REMARKS = ("stated", "bound")  # remarks of numbers that were not estimated
EFFECT_KINDS: dict[type[Effect], str] = {
    TorqueLaw: "torque",
    BodyLaw: "bodies",
    TransmissionLaw: "transmission",
    RecordingLaw: "recording",
    ActuatorLaw: "actuator",
    DriveLaw: "position drive",
}


class Quantity(NamedTuple):
    """A number of a result, from which all outputs are written."""

    name: str  # key in documents and frames
    value: float  # NaN: not identifiable
    std: float | None  # None: unknown, or not estimated
    unit: str
    joint: str | None = None  # None: the whole robot
    law: str = ""  # effect, or law of a drive
    partner: str | None = None  # second joint of a law of two
    stated: float | None = None  # [unit] in the description or the given simulation
    below: float | None = None  # [unit] bound of a number that is not identifiable
    above: float | None = None  # [unit] the same
    remark: str = ""  # words behind its value in tables
    more: Mapping[str, Any] = {}  # further entries of its document
    words: str = ""  # sentence that states a number of the whole result; "": its name and value
    card: tuple[str, str, str] | None = None  # title, figure and remark at the head of the page; None: name and value

    @property
    def known(self) -> bool:
        """Whether it has a value."""
        return not isnan(self.value)

    @property
    def place(self) -> str:
        """Joint, or the robot."""
        return self.joint or "(robot)"

    def document(self) -> Document:
        """Value, standard deviation and unit; stated value, bounds and further entries where there are any."""
        value = self.value if self.known else None
        optional = {key: x for key in ("stated", "below", "above") if (x := getattr(self, key)) is not None}
        return {"value": value, "std": self.std, "unit": self.unit, **optional, **self.more}

    def row(self, columns: Iterable[str]) -> tuple[Any, ...]:
        """Row of a frame; its column `parameter` has the name. A number without a name stands for none."""
        value, unit = self.value if self.known else None, self.unit or None
        found = {**self._asdict(), "parameter": self.name or None, "value": value, "unit": unit}
        return tuple(found[column] for column in columns)

    def displayed(self) -> Quantity:
        """The number as tables show it: times in ms, shares without unit."""
        if self.unit != "s":
            return self._replace(unit="") if self.unit == "1" else self
        sizes = {key: x for key in ("value", "std", "below", "above") if (x := getattr(self, key)) is not None}
        return self._replace(unit="ms", **{key: 1e3 * x for key, x in sizes.items()})

    def interval(self, beside: str) -> tuple[str, str]:
        """Value, and the half-width of its 95 % interval; `beside`: in its place where the deviation is unknown."""
        return (figure(self.value), beside) if self.std is None else with_interval(self.value, self.std)

    @property
    def sentence(self) -> str:
        """A number of the whole result in words."""
        return self.words or f"{spaced(self.name).capitalize()}: {self.titled[1]}."

    @property
    def titled(self) -> tuple[str, str, str]:
        """Title, figure and remark of its card."""
        shown = self.displayed()
        return self.card or (spaced(self.name), f"{shown.text} {shown.unit}".rstrip(), "")

    @property
    def text(self) -> str:
        """Value with its 95 % interval, as far as they are known."""
        return " ± ".join(x for x in self.interval("-") if x != "-") if self.std else figure(self.value)

    @property
    def cell(self) -> str:
        """Text of a table: value with interval or remark, in parentheses without either, or the bound."""
        if not self.known:
            bounds = (("<", self.below), (">", self.above))
            return next((f"{sign} {decimals(x, 2)}" for sign, x in bounds if x is not None), "-")
        if self.remark in FIXED_REMARKS:
            return f"{figure(self.value)} ({self.remark})"
        if not self.std:
            return f"({self.text})"
        return f"{self.text} ({self.remark})" if self.remark else self.text


def spaced(name: str) -> str:
    """A name without underscores."""
    return name.replace("_", " ")


def parameters(numbers: Sequence[Quantity]) -> Document:
    """Documents of the parameters of a law, by key; the partner of a law of two joints is the first."""
    partner = numbers[0].partner if numbers else None
    first = {"partner": {"value": partner, "std": None, "unit": ""}} if partner else {}
    return {**first, **{x.name: x.document() for x in numbers}}


def law_numbers(
    robot: Robot, law: Law, std: Mapping[str, float | None], stated: Mapping[str, float] | None = None
) -> list[Quantity]:
    """Parameters of a law with standard deviations and stated values, from which all outputs follow."""
    units, (joint, values) = law_units(robot, law), law_place(law, robot)
    partner, known = values.pop("partner", None), stated or {}
    place = joint, law.effect.name, None if partner is None else str(partner)
    return [Quantity(key, float(x), std.get(key), units[key], *place, known.get(key)) for key, x in values.items()]


def effect_document(effect: str, joint: str | None, numbers: Sequence[Quantity]) -> Document:
    """Entry of `effects` in a document: a law with its parameters."""
    return {"effect": effect, "joint": joint, "parameters": parameters(numbers)}


def grid(
    numbers: Sequence[Quantity], title: Callable[[Quantity], str], places: Iterable[str] = ()
) -> tuple[list[str], list[list[str]]]:
    """Heads and rows of a table with a row per place and a column per title, the unit behind it.

    places: of the rows, in the place of those of the numbers.
    """
    columns: dict[str, dict[str, Quantity]] = {}
    for x in numbers:
        columns.setdefault(title(x), {})[x.place] = x
    units = [" or ".join(filter(None, dict.fromkeys(x.unit for x in column.values()))) for column in columns.values()]
    heads = [f"{name}[{unit}]>" if unit else f"{name.rstrip()}>" for name, unit in zip(columns, units, strict=True)]
    rows = places or dict.fromkeys(x.place for x in numbers)
    return heads, [[column[at].cell if at in column else "" for column in columns.values()] for at in rows]


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
    document = effect_document(law.effect.name, law_place(law, robot)[0], law_numbers(robot, law, {}))
    for number in document["parameters"].values():
        del number["std"]
    return document


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
            before, unit = "", "" if x.unit == "1" else x.unit
            if x.stated is not None:  # with the digits of its estimate, if these suffice
                fine = x.std is not None and isfinite(x.std) and 0 < TWO_SIDED * x.std < abs(x.stated)
                before = with_interval(x.stated, x.std)[0] if fine and x.std is not None else figure(x.stated)
            value, half = x.interval("")
            half, unit = ("", unit if before else "") if value == UNKNOWN_TEXT else (half, unit)
            shown.append(NumberCells(x.name, before, value, half, unit))
    if hidden:
        shown.append(NumberCells(f"{plural(hidden, 'more parameter')}: could be zero", "", "", "", ""))
    return shown


def number_lines(robot: Robot, finding: Finding) -> tuple[str, ...]:
    """Parameters of a finding in one line each, with their meaning and their absence from the extended simulation."""
    cells = number_cells(robot, finding)
    lines = [f"{x.key}: {x.compared}" if x.stated else f"{x.key} {x.interval}".rstrip() for x in cells]
    absent = "" if finding.in_model else f"not in the extended simulation: {finding.refused}".removesuffix(": ")
    return (*lines, *filter(None, [finding.law.effect.meaning(finding.law.parameters), absent]))


def effects_document(effects: Sequence[Effect]) -> Document:
    """Build the output of `signid effects --json`."""
    described = [
        {
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
        for effect in effects
    ]
    return {"schema": "signid.effects/1", "effects": described, "version": __version__}


def effects_tables(effects: Sequence[Effect]) -> list[RenderableType]:
    """Describe one effect in full, or list the notation of several."""
    if len(effects) == 1:
        single = effects[0]
        table = new_table("parameter", "usual>", "unit", "torque is")
        for key, parameter in single.parameters.items():
            linear = "linear in it" if isinstance(parameter, Coefficient) else "not linear in it"
            table.add_row(key, f"{single.example[key]:g}", parameter.unit, linear)
        alike = [paragraph(f"Hard to distinguish from {', '.join(single.twins)}.")] if single.twins else []
        return [
            heading(single.name, below=False),
            paragraph(str(getdoc(type(single)))),
            heading("Law (additional motor torque, torque of a deflection, recorded value, or signal of a drive)"),
            paragraph(single.equation),
            *([heading("Parameters"), table] if single.parameters else []),
            heading("Usual size"),
            paragraph(f"{single.typical}."),
            *alike,
            heading("Source"),
            paragraph(single.source),
            heading("Inject"),
            paragraph(f"signid simulate ROBOT -o recording.csv --inject {law_syntax(single)}"),
        ]
    lines: list[RenderableType] = []
    for kind, name in EFFECT_KINDS.items():
        mine = [paragraph(f"  {law_syntax(effect)}") for effect in effects if isinstance(effect, kind)]
        lines += [heading(f"Laws of the {name}", below=bool(lines)), *mine] if mine else []
    return [*lines, paragraph("\nValues are usual ones. signid effects NAME shows the law, its units and its source.")]
