"""Identification without signs beside that from the signed recording: true signs, evaluation, rows and targets."""

from __future__ import annotations

import time
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import butter, sosfiltfilt

import signid
from signid.identify import Identification
from signid.recording import read_recording
from signid.recording.source import Source
from signid.regression.rows import read_rows
from signid.regression.session import Options, Session, prepare
from signid.signs.result import Signs, Trace
from signid.types import Array, BaseMap, Estimate, Law, Recording, Robot

from ..arms import base_parameters
from ..plants.bodies import Drives

ORDER, CORNER = 4, 8.0  # order and corner [Hz] of the low-pass for the truth of single samples
REST, LASTING = 0.02, 0.2  # speed of a joint at rest [rad/s or m/s], averaging time [s]


@dataclass(frozen=True, eq=False)
class Truth:
    """Signed torque of one recording: N samples of n joints."""

    t: Array  # (N,) [s]
    torque: Array  # (N, n) [N.m or N] the truth of segments
    smooth: Array  # (N, n) [N.m or N] the truth of single samples
    moving: NDArray[np.bool_] | None = None  # (N,) evaluated samples; None: all


class SegmentScore(NamedTuple):
    """Evaluation of a segment: confidence, agreement with the true majority, presence of both signs."""

    confidence: float
    right: bool
    mixed: bool


class Score(NamedTuple):
    """Evaluation of recovered signs."""

    judged: tuple[SegmentScore, ...]
    samples: float  # share of right samples of unsigned joints while the robot moves
    small: float  # the same for samples below the threshold; nan without any

    @property
    def segments(self) -> int:
        """Number of segments."""
        return len(self.judged)

    @property
    def right(self) -> int:
        """Number of segments with the true sign."""
        return sum(one.right for one in self.judged)

    @property
    def mixed(self) -> int:
        """Number of segments with both signs."""
        return sum(one.mixed for one in self.judged)


def measured(t: Array, q: Array, torque: Array, corner: float = CORNER) -> Truth:
    """Truth of a noisy signed recording; low-passed torque gives the signs of single samples.

    Samples with the whole robot at rest are excluded, because static friction holds any torque.

    Args:
        t: times (N,) [s].
        q: positions (N, n) [rad or m].
        torque: signed torque (N, n) [N.m or N].
        corner: corner of the forward-backward filter [Hz].
    """
    rate = 1 / float(np.median(np.diff(t)))
    smooth = sosfiltfilt(butter(ORDER, corner, fs=rate, output="sos"), torque, axis=0)
    half, at = max(1, round(LASTING / 2 * rate)), np.arange(len(t))
    later, before = np.minimum(at + half, len(t) - 1), np.maximum(at - half, 0)
    speed = np.abs(q[later] - q[before]).max(1) / (t[later] - t[before])
    return Truth(t, torque, np.asarray(smooth), speed > REST)


def evaluate(signs: Signs, truths: Sequence[Truth]) -> Score:
    """Compare the signs of segments and samples with the true ones."""
    small, right = [], []
    for trace, truth in zip(signs.traces, truths, strict=True):
        for joint in signs.hidden:
            moving = _moving(trace, truth)
            same = _same(trace, truth, joint)[moving]
            right.append(same)
            small.append(same[trace.magnitude[moving, joint] < signs.threshold[joint]])
    below = np.concatenate(small)
    return Score(
        tuple(_scores(signs, truths)),
        float(np.concatenate(right).mean()),
        float(below.mean()) if len(below) else float("nan"),
    )


def _moving(trace: Trace, truth: Truth) -> NDArray[np.bool_]:
    """Mask of evaluated samples (N,)."""
    if truth.moving is None:
        return np.ones(len(trace.t), dtype=bool)
    return np.asarray(truth.moving[np.searchsorted(truth.t, trace.t).clip(0, len(truth.t) - 1)])


def _same(trace: Trace, truth: Truth, joint: int) -> NDArray[np.bool_]:
    """Mask of samples with their true sign (N,); zero true torque matches both signs."""
    true = np.interp(trace.t, truth.t, truth.smooth[:, joint])
    return np.asarray(trace.signs[:, joint] * true >= 0)


def majority(truth: Truth, joint: int, start: float, end: float) -> tuple[int, bool]:
    """Sign with most of the torque's energy between two times [s], and whether both signs occur."""
    at = (truth.t >= start) & (truth.t <= end)
    torque, smooth = truth.torque[at, joint], truth.smooth[at, joint]
    sign = 1 if np.sum(torque * np.abs(torque)) >= 0 else -1
    return sign, bool(np.any(smooth * sign < 0))


def _scores(signs: Signs, truths: Sequence[Truth]) -> Iterator[SegmentScore]:
    for segment in signs.segments:
        sign, mixed = majority(truths[segment.part], segment.joint, segment.start, segment.end)
        yield SegmentScore(segment.confidence, segment.sign == sign, mixed)


class TargetResult(NamedTuple):
    """Text of a target and whether it is met; None for information only."""

    sentence: str
    met: bool | None


@dataclass(frozen=True)
class Target:
    """Targets of a row; None: no target."""

    segments: float | None = None  # least share with the true sign
    samples: float | None = None  # least share with the true sign
    off: float | None = None  # at most
    ratio: float | None = None  # at most
    error: float | None = None  # at most
    seconds: float | None = None  # at most


@dataclass(frozen=True)
class Row:
    """Signs and parameters recovered from unsigned recordings."""

    group: str  # "1R", "Panda"
    case: str
    method: str  # exact or tree
    segments: int
    right: int
    mixed: int  # segments with both signs
    samples: float  # share of samples with their true sign
    small: float  # the same for samples below the threshold
    parameters: int
    off: float  # torque distance from the signed estimate over that estimate's size [1]
    ratio: float  # distance from the truth over that of the signed estimate [1], nan without truth
    error: float  # distance from the truth in the units of the case, nan without truth
    error_search: float  # the same for the parameters of the sign search
    error_known: float  # the same for the signed estimate
    held_out: tuple[float, ...]  # rms residual on held-out signed torque (n,) [N.m or N]
    held_out_known: tuple[float, ...]  # the same for the signed estimate (n,) [N.m or N]
    seconds: float  # time in addition to the signed identification
    whole: float  # time of the whole identification [s]
    optimal: bool
    gap: float
    nodes: int
    flags: tuple[str, ...]
    judged: tuple[SegmentScore, ...]
    target: Target = Target()

    @property
    def perfect(self) -> bool:
        """Whether all segments have their true sign."""
        return self.right == self.segments

    @property
    def worse(self) -> float:
        """Largest ratio over joints of held-out errors without signs to those with signs."""
        pairs = zip(self.held_out, self.held_out_known, strict=True)
        return max((mine / max(known, 1e-300) for mine, known in pairs), default=float("nan"))

    @property
    def misses(self) -> tuple[str, ...]:
        """Missed parts of the target."""
        want, share = self.target, self.right / max(self.segments, 1)
        least = {"segments": (share, want.segments), "samples": (self.samples, want.samples)}
        names = ("off", "ratio", "error", "seconds")
        most = {name: (getattr(self, name), getattr(want, name)) for name in names}
        below = [f"{k} {x:.5g} < {w:g}" for k, (x, w) in least.items() if w is not None and not x >= w]
        return (*below, *(f"{k} {x:.3g} > {w:g}" for k, (x, w) in most.items() if w is not None and not x <= w))

    @property
    def holds(self) -> bool:
        """Whether the target is met."""
        return not self.misses


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
    """Remove the torque signs of columns tau_1 and so on (N,) [N.m or N], except those of some joints."""
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
    """True base parameters: inertials of the description and drives of the plant (default: none)."""
    true = drives or Drives.none(len(robot.joints))
    return lambda base, laws: base_parameters(robot, base, laws, true)
