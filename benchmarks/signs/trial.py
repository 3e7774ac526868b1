"""One identification without signs beside the same one with them."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

import signid
from signid.identify import Identification
from signid.recording import read_recording
from signid.recording.source import Source
from signid.regression.prepare import prepare
from signid.regression.rows import read_rows
from signid.regression.session import Options, Session
from signid.types import BaseMap, Estimate, Law, Recording, Robot

from ..arms import base_parameters
from ..plants.bodies import Drives
from .row import Row, Target
from .truth import Array, Truth, judge, measured

LONG, TURNS = 0.5, 7  # s altogether, and turns at most, that are given to a run whose time counts
Value = Callable[[BaseMap, tuple[Law, ...]], Array]  # true base parameters


class Known(NamedTuple):
    """What the recordings tell with their signs."""

    session: Session
    estimate: Estimate
    seconds: float  # that identification takes with signs

    def size(self, value: Array) -> float:
        """How much torque (b,) [units of base] make along the recordings, in standard deviations of its noise."""
        return float(np.sqrt(max(value @ self.estimate.information @ value, 0.0)))

    def held_out_rms(self, value: Array) -> tuple[float, ...]:
        """(n,) [N.m or N] on signed torque that was not learned from, of (b,) [units of base]."""
        task, parts = self.session.task, self.session.held_out
        seen = [task.seen(j) for j in range(len(task.robot.joints))]
        rests = [
            rows.torque - np.column_stack([own @ value[k] for own, k in zip(rows.columns, seen, strict=True)])
            for part in parts
            for rows in read_rows(task, *part)
        ]
        return tuple(np.sqrt(np.mean(np.concatenate(rests) ** 2, axis=0)).tolist())


@dataclass(frozen=True, eq=False)
class Puzzle:
    """Recordings whose signs are thrown away, and what is true of them."""

    group: str
    case: str
    robot: Robot
    sources: tuple[Source, ...]  # to learn from, with their signs
    judges: tuple[Source, ...] = ()  # held out; without any, the end of the only recording
    options: Options = field(default_factory=Options)
    value: Value | None = None  # the truth, where it is known
    truths: tuple[Truth, ...] | None = None  # of all recordings; measured torque where it is not known better
    error: Callable[[BaseMap, Array], float] | None = None  # of base parameters, in the units of the case
    signed: tuple[int, ...] = ()  # joints whose torque keeps its sign, where sources are columns

    def read(self, unsigned: bool) -> tuple[list[Recording], list[Recording]]:
        """The recordings to learn from, and those to judge by."""
        learn, judge = ([self._open(source, unsigned) for source in some] for some in (self.sources, self.judges))
        return learn, judge

    def _open(self, source: Source, unsigned: bool) -> Recording:
        if unsigned and self.signed and isinstance(source, Mapping):
            return read_recording(forget(source, self.signed), self.robot)
        return read_recording(source, self.robot, unsigned=unsigned)

    @cached_property
    def truth(self) -> tuple[Truth, ...]:
        """Of every recording."""
        if self.truths is not None:
            return self.truths
        rows = [recording.read() for some in self.read(unsigned=False) for recording in some]
        return tuple(measured(x.t, x.q, x.tau) for x in rows)

    @cached_property
    def known(self) -> Known:
        """What the recordings tell with their signs."""
        learn, judge = self.read(unsigned=False)
        found, seconds = identify(self, learn, judge)
        return Known(prepare(self.robot, learn, judge, self.options), found.estimate, seconds)


def forget(columns: Mapping[str, ArrayLike], signed: Collection[int]) -> dict[str, ArrayLike]:
    """Columns of which only some joints keep the sign of their torque.

    Args:
        columns: (N,) each, tau_1 and so on among them [N.m or N].
        signed: the joints, from 0.
    """
    hidden = {key for key in columns if key.startswith("tau_") and int(key[4:]) - 1 not in signed}
    return {f"abs_{key}" if key in hidden else key: np.abs(x) if key in hidden else x for key, x in columns.items()}


def attempt(puzzle: Puzzle, method: str = "exact", target: Target | None = None) -> Row:
    """A puzzle solved, and judged."""
    found, seconds = identify(puzzle, *puzzle.read(unsigned=True), method)
    return tell(puzzle, method, found, seconds, target or Target())


def identify(
    puzzle: Puzzle, learn: list[Recording], judges: list[Recording], signs: str = "exact"
) -> tuple[Identification, float]:
    """Base parameters by least squares, and the seconds that they take: of short runs, the shortest of some."""
    took: list[float] = []
    while not took or (sum(took) < LONG and len(took) < TURNS):
        start = time.process_time()
        found = signid.identify(puzzle.robot, learn, held_out=judges, options=puzzle.options, signs=signs, method="wls")
        took.append(time.process_time() - start)
    return found, min(took)


def tell(puzzle: Puzzle, method: str, found: Identification, seconds: float, target: Target) -> Row:
    """What was found, against what is true and against what the signs would have told."""
    signs, value = found.signs, found.estimate.value
    assert signs is not None, "torque was recorded without signs"
    known, score, base = puzzle.known, judge(signs, puzzle.truth), found.base
    off = known.size(value - known.estimate.value)
    all_three = (value, signs.value, known.estimate.value)
    away = errors = [np.nan] * 3
    if puzzle.value is not None:
        true = puzzle.value(base, found.model.laws)
        away = [known.size(x - true) for x in all_three]
    if puzzle.error is not None:
        errors = [puzzle.error(base, x) for x in all_three]
    return Row(
        group=puzzle.group,
        case=puzzle.case,
        method=signs.method,
        segments=score.segments,
        right=score.right,
        mixed=score.mixed,
        samples=score.samples,
        small=score.small,
        parameters=base.rank,
        off=off / known.size(known.estimate.value),
        ratio=away[0] / away[2],
        error=errors[0],
        error_search=errors[1],
        error_known=errors[2],
        held_out=known.held_out_rms(value),
        held_out_known=known.held_out_rms(known.estimate.value),
        seconds=seconds - known.seconds,
        whole=seconds,
        optimal=signs.proof.optimal,
        gap=signs.proof.gap,
        nodes=signs.proof.nodes,
        flags=signs.flags,
        judged=score.judged,
        target=target,
    )


def planted(robot: Robot, drives: Drives | None = None) -> Value:
    """True base parameters: the description's inertials, and drives as the plant has them, none if not told.

    Args:
        robot: whose description is true.
        drives: n joints.
    """
    given = drives or Drives.none(len(robot.joints))
    return lambda base, laws: base_parameters(robot, base, laws, given)
