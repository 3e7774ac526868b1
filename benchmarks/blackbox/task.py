"""Data of a set, and the answer of a method."""

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
    """A method cannot run here; the message states the reason."""


@dataclass(frozen=True)
class Answer:
    """Residual of a method on the rows of C."""

    residual: Array  # (M, n) [N.m or N]; NaN in excluded rows
    seconds: float  # processor time of its fit
    note: str = ""


@dataclass(frozen=True)
class Fitted:
    """A fitted model and its cut-offs."""

    model: Model
    cutoff: float  # [Hz] rows
    position_cutoff: float  # [Hz] positions
    period: float  # [s] sampling
    seconds: float  # processor time


@dataclass(frozen=True)
class Task:
    """Training parts A and B, held-out part C, and least squares on A and B, which fixes the cut-off."""

    name: str
    robot: Robot  # robot of the description
    a: tuple[Recording, ...]
    b: Recording
    c: Recording
    fitted: Fitted  # least squares

    @property
    def least_squares(self) -> Model:
        """Model of least squares."""
        return self.fitted.model

    @property
    def cutoff(self) -> float:
        """Cut-off of all rows [Hz], chosen from A and B."""
        return self.fitted.cutoff

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the moving joints."""
        return self.least_squares.robot.joints

    @property
    def described(self) -> Model:
        """Model of the description with its friction."""
        robot = self.robot
        return Model(robot, stated_inertials(robot), stated_laws(robot))

    @cached_property
    def training(self) -> list[Table]:
        """Rows of A and B with the residual of least squares."""
        return [table(self.least_squares, x, self.cutoff) for x in together(self)]

    @cached_property
    def held_out(self) -> Table:
        """Rows of C with the residual of least squares."""
        return table(self.least_squares, self.c, self.cutoff)


Method = Callable[[Task], Answer]


def build(one: RealSet, fit: Callable[[Robot, Sequence[Recording]], Fitted]) -> Task:
    """Read the parts of a set and fit by least squares.

    Args:
        one: set of recordings.
        fit: robot, recordings -> least squares.
    """
    robot = one.robot()
    a = tuple(read(one, robot, part) for part in one.a)
    b, c = read(one, robot, one.b), read(one, robot, one.c)
    return Task(one.name, robot, a, b, c, fit(robot, one_rate(robot, [*a, b])))


def together(task: Task) -> list[Recording]:
    """A and B at one sampling rate.

    Args:
        task: data of the set.
    """
    return one_rate(task.robot, [*task.a, task.b])


def identified(robot: Robot, recordings: Sequence[Recording], **options: object) -> Identification:
    """Identify from all rows of the recordings.

    `identify` needs a held-out recording. It gets the last training recording without its first sample; the reported
    fit is not used.

    Args:
        robot: robot of the description.
        recordings: training recordings.
        options: arguments of `signid.identify`.
    """
    columns = columns_of(recordings[-1])
    last = rebuilt(robot, columns_of(recordings[-1], start=float(columns["t"][1])))
    return signid.identify(robot, recordings, held_out=[last], **options)  # type: ignore[arg-type]
