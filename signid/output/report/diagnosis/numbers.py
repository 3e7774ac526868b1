"""Laws and their numbers in words: what the simulation states, and what the recordings show."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from ....effects.naming import law_name
from ....types import TWO_SIDED
from ..layout import plural
from ..numbers import figure, with_interval
from .document import finding_numbers, mended_link

if TYPE_CHECKING:
    from ....diagnose import Finding
    from ....types import Law, Robot

UNKNOWN = "not identifiable"


class NumberCells(NamedTuple):
    """One number of a finding, for a table or a sentence; empty where there is nothing to say."""

    key: str
    stated: str  # in the simulation
    value: str  # by the recordings, the total
    half: str  # width of its 95 % interval
    unit: str


def law_words(robot: Robot, law: Law) -> str:
    """A law by its effect and joint; one that changes the body of a link also by that link."""
    link, words = mended_link(robot, law), law_name(law, robot)
    if link is None:
        return words
    return f"{words if ' of ' in words else f'{words} of {robot.joints[law.joints[0]]}'} (link {link})"


def number_cells(robot: Robot, finding: Finding) -> list[NumberCells]:
    """The numbers of a finding; optional ones that could be zero are only counted."""
    numbers = finding_numbers(robot, finding)
    optional = [key for key in numbers if key in finding.law.effect.optional and key not in finding.stated]
    hidden = [key for key in optional if _could_be_zero(**numbers[key])]
    cells = [_cells(key, **number) for key, number in numbers.items() if key not in (*hidden, "partner")]
    if hidden:
        cells.append(NumberCells(f"{plural(len(hidden), 'more number')}: could be zero", "", "", "", ""))
    return cells


def number_lines(robot: Robot, finding: Finding) -> tuple[str, ...]:
    """The same, a line each, then what the numbers mean, and whether the extended simulation goes without them."""
    lines = [
        f"{cells.key}: {_compared(cells)}"
        if cells.stated
        else " ".join(filter(None, [cells.key, cells.value, cells.half and f"± {cells.half}", cells.unit]))
        for cells in number_cells(robot, finding)
    ]
    absent = "" if finding.in_model else "not in the extended simulation"
    return (*lines, *filter(None, [finding.law.effect.meaning(finding.law.parameters), absent]))


def stated_words(robot: Robot, finding: Finding) -> str:
    """The only number of a law in the simulation and in the recordings; empty where there are more, or none is stated.

    "coulomb_friction of joint_2: 0.300 in the simulation, 1.200 ± 0.010 N.m recorded"
    """
    cells = number_cells(robot, finding)
    if len(cells) != 1 or not cells[0].stated:
        return ""
    return f"{law_words(robot, finding.law)}: {_compared(cells[0])}"


def _compared(cells: NumberCells) -> str:
    """A number that the simulation states beside the recorded one."""
    if cells.value == UNKNOWN:
        return f"{cells.stated} {cells.unit}".rstrip() + f" in the simulation, {UNKNOWN} from the recordings"
    recorded = " ".join(filter(None, [cells.value, cells.half and f"± {cells.half}", cells.unit]))
    return f"{cells.stated} in the simulation, {recorded} recorded"


def _could_be_zero(value: float, std: float | None, unit: str) -> bool:
    return std is not None and abs(value) < TWO_SIDED * std


def _cells(key: str, value: float, std: float | None, unit: str, stated: float | None = None) -> NumberCells:
    before, unit = "" if stated is None else _as_fine(stated, std), "" if unit == "1" else unit
    if std is None:
        return NumberCells(key, before, figure(value), "", unit)
    if not (isfinite(std) and isfinite(value)):
        return NumberCells(key, before, UNKNOWN, "", unit if before else "")
    return NumberCells(key, before, *with_interval(value, std), unit)


def _as_fine(stated: float, std: float | None) -> str:
    """A stated number with the digits of the recorded one, where those show it."""
    fine = std is not None and isfinite(std) and 0 < TWO_SIDED * std < abs(stated)
    return with_interval(stated, std)[0] if fine and std is not None else figure(stated)
