"""Laws and their parameters in words, as stated by the simulation and as estimated from the recordings."""

from __future__ import annotations

from math import isfinite
from typing import TYPE_CHECKING, NamedTuple

from ....effects.naming import law_name
from ....types import TWO_SIDED
from ..layout import plural
from ..numbers import UNKNOWN, figure, with_interval
from .document import changed_link, finding_numbers

if TYPE_CHECKING:
    from ....diagnose import Finding
    from ....types import Law, Robot


class NumberCells(NamedTuple):
    """One parameter of a finding, formatted for a table or a sentence."""

    key: str
    stated: str  # value in the simulation; "" if not stated
    value: str  # value estimated from the recordings
    half: str  # half-width of its 95 % interval
    unit: str


def law_words(robot: Robot, law: Law) -> str:
    """Name of a law with its joint, and with the link whose inertia it changes."""
    link, words = changed_link(robot, law), law_name(law, robot)
    if link is None:
        return words
    return f"{words if ' of ' in words else f'{words} of {robot.joints[law.joints[0]]}'} (link {link})"


def number_cells(robot: Robot, finding: Finding) -> list[NumberCells]:
    """Parameters of a finding; optional ones consistent with zero are only counted."""
    numbers = finding_numbers(robot, finding)
    optional = [key for key in numbers if key in finding.law.effect.optional and key not in finding.stated]
    hidden = [key for key in optional if _could_be_zero(**numbers[key])]
    cells = [_cells(key, **number) for key, number in numbers.items() if key not in (*hidden, "partner")]
    if hidden:
        cells.append(NumberCells(f"{plural(len(hidden), 'more parameter')}: could be zero", "", "", "", ""))
    return cells


def number_lines(robot: Robot, finding: Finding) -> tuple[str, ...]:
    """Parameters of a finding in one line each, with their meaning and their absence from the extended simulation."""
    lines = [
        f"{cells.key}: {_compared(cells)}"
        if cells.stated
        else " ".join(filter(None, [cells.key, cells.value, cells.half and f"± {cells.half}", cells.unit]))
        for cells in number_cells(robot, finding)
    ]
    absent = "" if finding.in_model else "not in the extended simulation"
    return (*lines, *filter(None, [finding.law.effect.meaning(finding.law.parameters), absent]))


def stated_words(robot: Robot, finding: Finding) -> str:
    """Comparison of the single parameter of a law with its stated value; "" if there are several or none is stated.

    Example: "coulomb_friction of joint_2: 0.300 in the simulation, 1.200 ± 0.010 N.m recorded".
    """
    cells = number_cells(robot, finding)
    if len(cells) != 1 or not cells[0].stated:
        return ""
    return f"{law_words(robot, finding.law)}: {_compared(cells[0])}"


def _compared(cells: NumberCells) -> str:
    """A stated parameter and its estimate."""
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
    """A stated parameter with the digits of its estimate, if these suffice."""
    fine = std is not None and isfinite(std) and 0 < TWO_SIDED * std < abs(stated)
    return with_interval(stated, std)[0] if fine and std is not None else figure(stated)
