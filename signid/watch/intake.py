"""Rows of a stream -> stretches of usable rows -> blocks of a few milliseconds.

Gaps, jumps, repeated stamps and missing numbers are noted. Blocks lie between edges with position, velocity and torque.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..errors import OptionError, RecordingError
from ..recording.sampling.clock import likely_unit
from ..types import Array, Indices, Mask, Robot

MIN_STAMP_PERIOD = 1e-6  # [s] period below which a stamp counts as repeated; no log is faster
MAX_STREAM_PERIOD, MAX_SECONDS_PERIOD = 0.03, 0.25  # [s] of a stream that is not too slow; of t in seconds
NOTED_GAP = 0.1  # [s] time without rows that is noted; slower streams: `NOTED_GAP_PERIODS`
NOTED_GAP_PERIODS = 8.0  # [1] the same, in sampling periods
RESET_GAP_STEPS, MIN_RESET_GAP = 3.5, 0.008  # [usual steps], [s] without rows after which the state is reset
MAX_HELD_TIME = 1.0  # [s] for which rows that repeat the last one are left out; a robot stands still for longer
USUAL_STEP_PERCENTILE, FIRST_STEPS = 90, 20  # [%] of the first steps that are no longer than the usual one
JUMP_SPEED_RATIO = 3.0  # [1] speed over the velocity limit that is a jump of the position, not a motion
JUMP_SPEED = 100.0  # [rad/s or m/s] the same for a joint without a limit
MAX_ROW_MAGNITUDE = 1e9  # [SI units] magnitude of a position, velocity or torque; beyond it a row is damaged; heuristic
NOTE_INTERVAL = 10.0  # [s] time after which a note of the same kind is repeated
WATCH_SCHEMA = "signid.watch/1"
LINE_DIGITS = 6  # significant digits of a number in a line
DECIMALS = 6  # of a time [s]
VELOCITY_HALF_WINDOW = 0.008  # [s] half of the window of the velocity: a local line; the delay of the observer
MIN_BLOCK_TIME = 0.002  # [s] shortest block
PERIOD_ROWS = 20  # rows that give the sampling period


class StreamRows(NamedTuple):
    """Consecutive rows of n joints."""

    t: Array  # (N,) [s]
    q: Array  # (N, n) [rad or m]
    tau: Array  # (N, n) [N.m or N]
    dq: Array | None = None  # (N, n) [rad/s or m/s]

    def at(self, which: slice | Mask) -> StreamRows:
        """Some of the rows."""
        return StreamRows(self.t[which], self.q[which], self.tau[which], None if self.dq is None else self.dq[which])

    def then(self, rows: StreamRows) -> StreamRows:
        """These rows and further ones; without dq where either lacks it."""
        dq = None if self.dq is None or rows.dq is None else np.concatenate([self.dq, rows.dq])
        t, q, tau = (np.concatenate(pair) for pair in zip(self[:3], rows[:3], strict=True))
        return StreamRows(t, q, tau, dq)


def given_rows(t: Array, q: Array, tau: Array, dq: Array | None, joints: int) -> StreamRows:
    """Rows as they were given; masked values are missing.

    t: (N,) [s]; q: (N, joints) [rad or m]; tau: (N, joints) [N.m or N]; dq: (N, joints) [rad/s or m/s].

    Raises:
        OptionError: an array holds no real numbers, or has another shape than (N,), and (N, joints) of the others.
    """
    found = list[Array]()
    for name, given in (("t", t), ("q", q), ("tau", tau), *(() if dq is None else (("dq", dq),))):
        try:
            values = np.ma.filled(np.ma.asarray(given).astype(np.float64, casting="same_kind"), np.nan)
        except (TypeError, ValueError):
            raise OptionError(f"{name} of the rows holds no real numbers; give arrays of floats") from None
        shape = (len(found[0]), joints) if found else (len(values) if values.ndim else 1,)
        if values.shape != shape:
            raise OptionError(f"{name} of the rows has shape {values.shape}; expected {shape} by t and the joints")
        found.append(values)
    return StreamRows(*found)


class StreamPiece(NamedTuple):
    """Rows that follow those before, or, if `fresh`, begin a new stretch."""

    rows: StreamRows
    fresh: bool


class Intake:
    """State of the stream between chunks: its last row, and the notes that were given."""

    def __init__(self, robot: Robot) -> None:
        limit = np.where(np.isfinite(robot.velocity_limit) & (robot.velocity_limit > 0), robot.velocity_limit, np.inf)
        self.limit = np.where(np.isfinite(limit), JUMP_SPEED_RATIO * limit, JUMP_SPEED)
        self.joints = robot.joints
        self.period = self.usual = np.nan
        self.steps: list[float] = []
        self.held = False  # whether rows since the last one repeated it
        self.last: StreamRows | None = None
        self.noted: dict[str, float] = {}

    def take(self, rows: StreamRows) -> tuple[list[StreamPiece], list[Note]]:
        """Cut rows at gaps and jumps, and leave unusable rows out.

        Raises:
            RecordingError: t is not in seconds.
        """
        notes: list[Note] = []
        known = np.isfinite(rows.t)
        for signal in (rows.q, rows.tau, *(() if rows.dq is None else (rows.dq,))):
            known &= (np.abs(signal) < MAX_ROW_MAGNITUDE).all(axis=1)  # False for NaN
        if not known.all():
            when = self.last.t[-1] if self.last is not None else 0.0
            notes += self._note("missing", float(when), "rows without a number in t, q or tau are left out")
            rows = rows.at(known)
        if not len(rows.t):
            return [], notes
        first = self.last is None
        before = rows.at(slice(0, 1)) if self.last is None else self.last
        step = np.diff(rows.t, prepend=before.t)
        again = (step >= 0) & (step < MIN_STAMP_PERIOD)
        again[:1] &= not first
        if again.any():
            notes += self._note("repeated", float(rows.t[again][0]), "rows with a repeated stamp are left out")
            rows = rows.at(~again)
        rows = self._new(rows, first)
        if not len(rows.t):
            return [], notes
        step = np.diff(rows.t, prepend=before.t)
        if np.isnan(self.period):
            self.steps += step[step > 0].tolist()
        if np.isnan(self.period) and len(self.steps) >= FIRST_STEPS:
            self.usual = float(np.percentile(self.steps, USUAL_STEP_PERCENTILE))
            self.period = mean_step(np.array(self.steps))
            if self.period >= MAX_SECONDS_PERIOD:
                unit = likely_unit(self.period)
                fact = f"t steps by {self.period:.3g}, which cannot be seconds of a robot that is watched"
                raise RecordingError(f"{fact}: it looks like {unit}; convert it, or state its unit in a column map")
            if self.period > MAX_STREAM_PERIOD:
                slow = f"rows come at {1 / self.period:.3g} Hz, too slowly for contacts and fast motion"
                notes += self._note("slow", float(rows.t[-1]), f"{slow}; give 50 Hz or more")
        cuts, more = self._cuts(rows, before, step)
        self.last, self.held = rows.at(slice(-1, None)), False
        edges = sorted({0, *cuts.tolist(), len(rows.t)})
        fresh = [first or 0 in cuts, *[True] * len(edges)]
        ends = zip(edges, edges[1:], fresh, strict=False)
        return [StreamPiece(rows.at(slice(a, b)), new) for a, b, new in ends], [*notes, *more]

    def _new(self, rows: StreamRows, first: bool) -> StreamRows:
        """Rows without those that only hold the last one, as some logs do where packets are lost."""
        if not len(rows.t):
            return rows
        last = rows.at(slice(0, 1)) if self.last is None else self.last
        values = np.concatenate([np.column_stack([one.q, one.tau]) for one in (last, rows)])
        same = (np.diff(values, axis=0) == 0).all(axis=1)
        same[:1] &= not first
        at = np.maximum.accumulate(np.where(same, -1, np.arange(len(same))))
        since = rows.t - np.where(at < 0, last.t[0], rows.t[np.maximum(at, 0)])
        self.held |= bool(same.any())
        return rows.at(~(same & (since < MAX_HELD_TIME))) if same.any() else rows

    def _cuts(self, rows: StreamRows, before: StreamRows, step: Array) -> tuple[Indices, list[Note]]:
        """Indices of rows that begin a new stretch."""
        most = NOTED_GAP if np.isnan(self.period) else max(NOTED_GAP, NOTED_GAP_PERIODS * self.period)
        moved = np.abs(np.diff(rows.q, axis=0, prepend=before.q))
        late, back = step > most, step < 0
        lost = step > (most if np.isnan(self.period) else min(most, max(MIN_RESET_GAP, RESET_GAP_STEPS * self.usual)))
        near = np.maximum(np.abs(step), 0.0 if np.isnan(self.period) else self.period)[:, None]
        jumped = (moved > self.limit * near + 1e-12) & ~(late | back)[:, None]
        notes: list[Note] = []
        for k in np.flatnonzero(late | back | jumped.any(axis=1)).tolist():
            t = float(rows.t[k])
            if late[k] and self.held:
                continue
            if late[k]:
                notes += self._note("gap", t, f"the stream stopped for {step[k]:.3g} s; the observer starts again")
            elif back[k]:
                notes += self._note("back", t, f"stamps jump back by {-step[k]:.3g} s; the observer starts again")
            else:
                joint = self.joints[int(np.argmax(jumped[k]))]
                notes += self._note("jump", t, f"the position of {joint} jumps; the observer starts again")
        return np.flatnonzero(lost | back | jumped.any(axis=1)), notes

    def _note(self, kind: str, t: float, sentence: str) -> list[Note]:
        if abs(t - self.noted.get(kind, -np.inf)) < NOTE_INTERVAL:
            return []
        self.noted[kind] = t
        return [Note(t, sentence)]


def mean_step(steps: Array) -> float:
    """Sampling period [s]: the mean step but for gaps, also where rows arrive in bursts; steps: (k,) [s]."""
    return float(np.mean(steps[steps <= RESET_GAP_STEPS * np.percentile(steps, USUAL_STEP_PERCENTILE)]))


@dataclass(frozen=True)
class Event:
    """Something that the watch found at a time of the stream."""

    kind: ClassVar[str] = ""
    t: float  # [s] stamp of the last row that was needed

    def document(self) -> dict[str, Any]:
        """JSON object of the event, one line of the output."""
        own = {key: _plain(key, value) for key, value in vars(self).items()}
        return {"schema": WATCH_SCHEMA, "event": self.kind, **own}


@dataclass(frozen=True)
class Note(Event):
    """A fact about the stream or the watch, as a sentence."""

    kind = "note"
    sentence: str


@dataclass(frozen=True)
class Contact(Event):
    """An external force: one event when it begins, with `end` None, and one when it ends."""

    kind = "contact"
    joints: tuple[str, ...]  # joints whose residual exceeds its threshold
    link: str  # furthest loaded link
    torque: Mapping[str, float]  # [N.m or N] external torque of each joint; at the end, of the largest moment
    direction: tuple[float, float, float] | None  # of the force, in the world [1]; None with fewer than 3 joints
    start: float  # [s]
    end: float | None = None  # [s]
    cause: str | None = None  # the change that explains it, if it was no contact
    corrects: float | None = None  # [s] t of the event that this one replaces


@dataclass(frozen=True)
class LastingChange(Event):
    """A lasting change of the robot: an additive law at a joint, or an unknown one."""

    kind = "change"
    law: str  # effect, or "unknown"
    joint: str
    parameters: Mapping[str, float]  # numbers by key of the effect, in its units
    std: Mapping[str, float]  # standard deviations of the numbers
    probability: float  # posterior probability of the law against the others
    sentence: str
    alternatives: Mapping[str, float] = field(default_factory=dict)  # "law of joint" -> probability
    corrects: float | None = None  # [s] t of the event that this one replaces, with the numbers of more motion


def _plain(key: str, value: Any) -> Any:
    """Numbers with few digits; containers as JSON has them."""
    if isinstance(value, Mapping):
        return {name: _plain("", x) for name, x in value.items()}
    if isinstance(value, tuple):
        return [_plain("", x) for x in value]
    if isinstance(value, float):
        return round(value, DECIMALS) if key in ("t", "start", "end", "corrects") else float(f"{value:.{LINE_DIGITS}g}")
    return value


class Blocks(NamedTuple):
    """K blocks between K + 1 edges."""

    t: Array  # (K+1,) [s]
    q: Array  # (K+1, n) [rad or m]
    v: Array  # (K+1, n) [rad/s or m/s]
    tau: Array  # (K+1, n) [N.m or N], through the filter of the velocity
    late: float  # [s] between the last edge and the last row that it needs

    @property
    def step(self) -> Array:
        """Durations (K, 1) [s]."""
        return np.asarray(np.diff(self.t)[:, None])


class Cutter:
    """Rows of the current stretch that later edges need."""

    def __init__(self) -> None:
        self.rows: StreamRows | None = None
        self.at, self.half, self.every = 0, 0, 0

    def restart(self) -> None:
        """Begin a new stretch."""
        self.rows, self.at = None, self.half

    def cut(self, rows: StreamRows) -> Blocks | None:
        """Append rows; the blocks that are complete, or None."""
        self.rows = rows = rows if self.rows is None else self.rows.then(rows)
        if not self.half:
            if len(rows.t) < PERIOD_ROWS:
                return None
            period = mean_step(np.diff(rows.t))
            self.half, self.every = max(1, round(VELOCITY_HALF_WINDOW / period)), max(1, round(MIN_BLOCK_TIME / period))
            self.at = self.half
        edges = np.arange(self.at, len(rows.t) - self.half, self.every)
        if len(edges) < 2:
            return None
        found = _blocks(rows, edges, self.half)
        self.rows, self.at = rows.at(slice(edges[-1] - self.half, None)), self.half
        return found


def _blocks(rows: StreamRows, edges: Indices, half: int) -> Blocks:
    """Edges with the velocity of a local line; position, torque and time through the filter that this line is.

    The slope of a line through samples is a weighted mean of the velocities between them, for any stamps; torque has
    the same weights, so that both have the same acceleration in them, also where rows were lost.
    """
    around = edges[:, None] + np.arange(-half, half + 1)
    times = rows.t[around] - rows.t[edges][:, None]
    slope = times - times.mean(axis=1, keepdims=True)
    slope /= np.sum(slope**2, axis=1, keepdims=True)
    between = (np.cumsum(slope[:, ::-1], axis=1)[:, ::-1][:, 1:] * np.diff(times, axis=1)) / 2
    weight = np.zeros_like(slope)
    weight[:, 1:] += between
    weight[:, :-1] += between
    moved = rows.q[around] - rows.q[edges][:, None]
    mean = ("kw,kwn->kn", weight)
    v = np.einsum("kw,kwn->kn", slope, moved) if rows.dq is None else np.einsum(*mean, rows.dq[around])
    q, tau = rows.q[edges] + np.einsum(*mean, moved), np.einsum(*mean, rows.tau[around])
    t = rows.t[edges] + np.sum(weight * times, axis=1)
    return Blocks(t, q, v, tau, float(rows.t[edges[-1] + half] - t[-1]))
