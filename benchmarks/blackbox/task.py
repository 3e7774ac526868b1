"""The data of a set, and what a method hands in."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import signid
from signid.errors import SignidError
from signid.identify import Identification
from signid.model import Model, stated_inertials, stated_laws
from signid.types import Recording, Robot

from ..concealed_real.sets import RealSet, columns_of, read, rebuilt
from .rows import Array, Table, one_rate, table


class UnavailableError(SignidError):
    """A method cannot be run here; the sentence says why."""


@dataclass(frozen=True)
class Answer:
    """Residual of a method on the rows of C."""

    residual: Array  # (M, n) [N.m or N]; NaN where a row does not count
    seconds: float  # processor time of its fit
    note: str = ""


@dataclass(frozen=True)
class Fitted:
    """A model and the band of its fit."""

    model: Model
    cutoff: float  # [Hz] of rows
    position_cutoff: float  # [Hz]
    period: float  # [s] of sampling
    seconds: float  # processor time


@dataclass(frozen=True)
class Task:
    """Parts A and B to learn from, C to judge by, and least squares on A and B, which fixes the band."""

    name: str
    robot: Robot  # as described
    a: tuple[Recording, ...]
    b: Recording
    c: Recording
    fitted: Fitted  # least squares

    @property
    def least_squares(self) -> Model:
        """The model of least squares."""
        return self.fitted.model

    @property
    def cutoff(self) -> float:
        """Of all rows [Hz], chosen from A and B."""
        return self.fitted.cutoff

    @property
    def joints(self) -> tuple[str, ...]:
        """The joints that move."""
        return self.least_squares.robot.joints

    @property
    def described(self) -> Model:
        """The description with the friction that it states."""
        robot = self.robot
        return Model(robot, stated_inertials(robot), stated_laws(robot))

    @cached_property
    def learned(self) -> list[Table]:
        """Rows of A and B with the residual of least squares."""
        return [table(self.least_squares, x, self.cutoff) for x in together(self)]

    @cached_property
    def judged(self) -> Table:
        """Rows of C with the residual of least squares."""
        return table(self.least_squares, self.c, self.cutoff)


Method = Callable[[Task], Answer]


def build(one: RealSet, fit: Callable[[Robot, Sequence[Recording]], Fitted]) -> Task:
    """Read the parts of a set and fit least squares.

    Args:
        one: the set.
        fit: robot, recordings -> least squares.
    """
    robot = one.robot()
    a = tuple(read(one, robot, part) for part in one.a)
    b, c = read(one, robot, one.b), read(one, robot, one.c)
    return Task(one.name, robot, a, b, c, fit(robot, one_rate(robot, [*a, b])))


def together(task: Task) -> list[Recording]:
    """A and B at one sampling rate.

    Args:
        task: the data.
    """
    return one_rate(task.robot, [*task.a, task.b])


def identified(robot: Robot, recordings: Sequence[Recording], **options: object) -> Identification:
    """Identify from all rows of some recordings.

    `identify` needs a recording to judge by. It gets the last of them without its first sample, not C: the fit that it
    reports is not used.

    Args:
        robot: as described.
        recordings: to learn from.
        options: of `signid.identify`.
    """
    columns = columns_of(recordings[-1])
    last = rebuilt(robot, columns_of(recordings[-1], start=float(columns["t"][1])))
    return signid.identify(robot, recordings, held_out=[last], **options)  # type: ignore[arg-type]
