"""Identification without signs compared with that from the signed recording."""

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
from signid.regression.rows import read_rows
from signid.regression.session import Options, Session, prepare
from signid.types import BaseMap, Estimate, Law, Recording, Robot

from ..arms import base_parameters
from ..plants.bodies import Drives
from .row import Row, Target
from .truth import Array, Truth, evaluate, measured

LONG, TURNS = 0.5, 7  # a timed run is repeated up to this total time [s] and this number of turns
Value = Callable[[BaseMap, tuple[Law, ...]], Array]  # true base parameters


class Known(NamedTuple):
    """Identification from the signed recordings."""

    session: Session
    estimate: Estimate
    seconds: float  # time of identification with signs

    def size(self, value: Array) -> float:
        """Torque of parameters (b,) [units of base] along the recordings, in standard deviations of the noise."""
        return float(np.sqrt(max(value @ self.estimate.information @ value, 0.0)))

    def held_out_rms(self, value: Array) -> tuple[float, ...]:
        """Rms residual (n,) [N.m or N] on held-out signed torque for parameters (b,) [units of base]."""
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
    """Recordings with removed signs, and their truth."""

    group: str
    case: str
    robot: Robot
    sources: tuple[Source, ...]  # training recordings with signs
    held_out: tuple[Source, ...] = ()  # held-out recordings; without any, the end of the only recording
    options: Options = field(default_factory=Options)
    value: Value | None = None  # true base parameters, if known
    truths: tuple[Truth, ...] | None = None  # truth of all recordings; by default measured torque
    error: Callable[[BaseMap, Array], float] | None = None  # error of base parameters in the units of the case
    signed: tuple[int, ...] = ()  # joints with signed torque, if sources are columns

    def read(self, unsigned: bool) -> tuple[list[Recording], list[Recording]]:
        """Read training and held-out recordings."""
        train, held_out = ([self._open(source, unsigned) for source in some] for some in (self.sources, self.held_out))
        return train, held_out

    def _open(self, source: Source, unsigned: bool) -> Recording:
        if unsigned and self.signed and isinstance(source, Mapping):
            return read_recording(forget(source, self.signed), self.robot)
        return read_recording(source, self.robot, unsigned=unsigned)

    @cached_property
    def truth(self) -> tuple[Truth, ...]:
        """Truth of every recording."""
        if self.truths is not None:
            return self.truths
        rows = [recording.read() for some in self.read(unsigned=False) for recording in some]
        return tuple(measured(x.t, x.q, x.tau) for x in rows)

    @cached_property
    def known(self) -> Known:
        """Identification from the signed recordings."""
        train, held_out = self.read(unsigned=False)
        found, seconds = identify(self, train, held_out)
        return Known(prepare(self.robot, train, held_out, self.options), found.estimate, seconds)


def forget(columns: Mapping[str, ArrayLike], signed: Collection[int]) -> dict[str, ArrayLike]:
    """Remove the torque signs of all joints except some.

    Args:
        columns: columns (N,) each, with tau_1 and so on [N.m or N].
        signed: indices of the signed joints, 0-based.
    """
    hidden = {key for key in columns if key.startswith("tau_") and int(key[4:]) - 1 not in signed}
    return {f"abs_{key}" if key in hidden else key: np.abs(x) if key in hidden else x for key, x in columns.items()}


def attempt(puzzle: Puzzle, method: str = "exact", target: Target | None = None) -> Row:
    """Solve a puzzle and evaluate the result."""
    found, seconds = identify(puzzle, *puzzle.read(unsigned=True), method)
    return build_row(puzzle, method, found, seconds, target or Target())


def identify(
    puzzle: Puzzle, train: list[Recording], held_out: list[Recording], signs: str = "exact"
) -> tuple[Identification, float]:
    """Identify by least squares; return the time [s], for short runs the shortest of several."""
    times: list[float] = []
    while not times or (sum(times) < LONG and len(times) < TURNS):
        start = time.process_time()
        found = signid.identify(
            puzzle.robot, train, held_out=held_out, options=puzzle.options, signs=signs, method="wls"
        )
        times.append(time.process_time() - start)
    return found, min(times)


def build_row(puzzle: Puzzle, method: str, found: Identification, seconds: float, target: Target) -> Row:
    """Compare a result with the truth and with the signed identification."""
    signs, value = found.signs, found.estimate.value
    assert signs is not None, "torque was recorded without signs"
    known, score, base = puzzle.known, evaluate(signs, puzzle.truth), found.base
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
    """True base parameters: inertials of the description and drives of the plant (default: none).

    Args:
        robot: robot with a true description.
        drives: drive parameters of n joints.
    """
    true = drives or Drives.none(len(robot.joints))
    return lambda base, laws: base_parameters(robot, base, laws, true)
