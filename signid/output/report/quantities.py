"""Numbers of results: each is described once, and its document, terminal, page, frame and notebook follow."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from math import isnan
from typing import Any, NamedTuple

from ...effects.naming import law_place
from ...errors import decimals
from ...types import Law, Robot
from .documents import Document, law_units
from .layout import figure, with_interval

FIXED_REMARKS = ("stated", "bound")  # remarks of numbers that were not estimated


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
    own = joint, law.effect.name, None if partner is None else str(partner)
    return [Quantity(key, float(x), std.get(key), units[key], *own, known.get(key)) for key, x in values.items()]


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
