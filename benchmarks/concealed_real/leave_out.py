"""Tuned constants chosen without the robot that judges them, and the figures of each robot under that choice.

One constant at a time is varied, the others stay. A robot's value of a constant is the one under which most fair cases
of the other robots are named first or flagged; the present value stays in a tie. The worst tie is the bound: of values
that are equally good for the others, the one that is worst for the robot itself. Several sets may be of one robot.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rich.table import Table

from ..summary import frame
from .summary import Share
from .trials import Constant, Setting, label, setting

SAME_ROBOT = {"rokae_sensor": "rokae", "psm_radiang": "psm"}  # robots of sets that are named otherwise
RIGHT = ("first", "flag")  # outcomes that count
Row = dict[str, Any]


@dataclass(frozen=True)
class LeftOut:
    """A robot under the present constants, and under those that the other robots choose."""

    robot: str
    chosen: Setting  # constants that the other robots set otherwise
    usual: Share  # fair cases that are named first or flagged
    left_out: Share
    worst: Share  # the same where each tie is decided against the robot

    @property
    def differences(self) -> tuple[float, float]:
        """Usual share minus that left out, and minus that of the worst tie [percentage points]."""
        usual = points(self.usual)
        return usual - points(self.left_out), usual - points(self.worst)


@dataclass(frozen=True)
class Choice:
    """Values of one constant, and the robots that decide between them."""

    constant: Constant
    named: Mapping[float, Share]  # fair cases of all robots that are named first or flagged, by value
    decided_by: Mapping[str, float]  # robots without which another value is chosen than by all, and that value


def points(share: Share) -> float:
    """Share in per cent; 0 without cases."""
    return 100 * share.some / share.of if share.of else 0.0


def robot_of(name: str) -> str:
    """Robot of a set."""
    return SAME_ROBOT.get(name, name)


def settings_of(constants: Sequence[Constant]) -> list[Setting]:
    """The present setting, then each other value of each constant alone."""
    return [(), *(setting({one.name: value}) for one in constants for value in one.others)]


def figure(rows: Sequence[Row], values: Setting, robots: Sequence[str]) -> Share:
    """Fair cases of some robots that are named first or flagged under a setting."""
    name = label(values)
    own = [row for row in rows if row["setting"] == name and row.get("fair") and robot_of(row["set"]) in robots]
    return Share(sum(row["outcome"] in RIGHT for row in own), len(own))


def choose(rows: Sequence[Row], constant: Constant, robots: Sequence[str], against: Sequence[str] = ()) -> float:
    """Value of a constant under which most fair cases of some robots are named; the present one in a tie."""

    def named(value: float) -> tuple[int, int]:
        alone = setting({constant.name: value})
        return figure(rows, alone, robots).some, -figure(rows, alone, against).some

    return max(constant.values, key=named)


def chosen_without(
    rows: Sequence[Row], constants: Sequence[Constant], robot: str, robots: Sequence[str], worst: bool = False
) -> Setting:
    """Setting that all robots but one choose, constant by constant.

    Args:
        rows: rows of all settings.
        constants: varied constants.
        robot: robot that takes no part.
        robots: all robots.
        worst: decide ties against the robot.
    """
    others = [x for x in robots if x != robot]
    return setting({one.name: choose(rows, one, others, [robot] if worst else ()) for one in constants})


def leave_out(rows: Sequence[Row], constants: Sequence[Constant], robots: Sequence[str]) -> list[LeftOut]:
    """Each robot under the present constants and under those that the others choose."""
    found = []
    for robot in robots:
        chosen, worst = (chosen_without(rows, constants, robot, robots, tie) for tie in (False, True))
        found.append(LeftOut(robot, chosen, *(figure(rows, x, [robot]) for x in ((), chosen, worst))))
    return found


def together(found: Sequence[LeftOut]) -> LeftOut:
    """All robots in one."""
    parts = ([getattr(one, key) for one in found] for key in ("usual", "left_out", "worst"))
    sums = (Share(sum(x.some for x in shares), sum(x.of for x in shares)) for shares in parts)
    return LeftOut("all", (), *sums)


def choices(rows: Sequence[Row], constants: Sequence[Constant], robots: Sequence[str]) -> Iterator[Choice]:
    """Yield for each constant what its values name, and the robots on which the choice of all depends."""
    for one in constants:
        best = choose(rows, one, robots)
        named = {x: figure(rows, setting({one.name: x}), robots) for x in one.values}
        without = {x: choose(rows, one, [y for y in robots if y != x]) for x in robots}
        yield Choice(one, named, {x: value for x, value in without.items() if value != best})


def tables(found: Sequence[LeftOut], varied: Sequence[Choice]) -> Iterator[Table]:
    """Yield the table of the robots and that of the constants."""
    names = ("robot", "chosen without it", "usual", "left out", "worst tie", "differences, points")
    table = frame("fair cases named first or flagged", names, left=2)
    for one in (*found, together(found)):
        shares = (str(x) for x in (one.usual, one.left_out, one.worst))
        table.add_row(one.robot, label(one.chosen), *shares, ", ".join(f"{x:.1f}" for x in one.differences))
    yield table
    table = frame("the same of all robots, by value; the present value first", ("constant", "values", "decided by"), 3)
    for each in varied:
        values = ", ".join(f"{x:g}: {share.some} of {share.of}" for x, share in each.named.items())
        table.add_row(each.constant.name, values, ", ".join(f"{x} ({y:g})" for x, y in each.decided_by.items()))
    yield table


def totals(found: Sequence[LeftOut]) -> dict[str, str]:
    """Figures as text."""
    every = together(found)
    return {
        "named first or flagged, constants as they are": str(every.usual),
        "the same, constants chosen without the robot": str(every.left_out),
        "the same, ties decided against the robot": str(every.worst),
        "differences in points (5)": ", ".join(f"{x:.1f}" for x in every.differences),
        "largest of one robot": ", ".join(f"{max(x):.1f}" for x in zip(*(y.differences for y in found), strict=True)),
    }
