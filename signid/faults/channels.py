"""Raw samples -> faults of single columns: drop-outs, spikes, stuck sensors, few values, clipping, lost samples.

`CHECKS` lists what is looked for in the columns of every recording, of torque and of commands alike. Thresholds were
set on public recordings of eleven arms and six servos, which stay silent unless they have the fault.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np

from ..errors import OptionError, RecordingError
from ..recording.missing import DISORDER, STANDSTILL, disorder
from ..regression.session import BAND_SAMPLES, Part, Session
from ..types import Array, Mask, Robot, Samples
from .result import REFUSE, WARN, RecordingFault

TINY = 1e-9  # [1] share of the range below which a step is rounding
VALUES = 200  # largest number of values of a torque that may be those of a sensor with few steps
# Spikes: smallest jump away and back, over the range between the quantiles OUTER and 1 - OUTER (healthy positions:
# 0.11), over the median step, and in steps of the encoder
JUMP_AWAY, USUAL_STEPS, FLICKER, OUTER = 0.12, 8.0, 5.0, 0.01
FEW_LEVELS = {"position": 2, "command": 10, "torque": VALUES}  # values of a column without spikes: it has few levels
# Smallest number of spikes, and smallest share of the samples [1]. Healthy: 0 of positions, 0.001 of commands
FEWEST_SPIKES = {"position": (3, 0.0), "command": (3, 5e-3), "torque": (5, 1e-3)}
EQUAL_SPIKES_SHARE = 0.8  # [1] smallest share of the spikes with the same value: drop-outs
# [1] smallest share of the variance that drop-outs and spikes add (real arms: 0.02 of torques); the share of a position
# from which on it is useless (real arms: 1.6e-3)
POWERS, BROKEN = {"position": (0.0, 0.0), "command": (0.0, 0.0), "torque": (0.03, 0.5)}, 5e-3
# Standstill of a position: smallest duration [s] and number of samples, and smallest duration of one that is no lost
# sample [s]
HOLD, ROWS, LONG_HOLD = 0.05, 5, 0.25
# A sensor is stuck if the position stops within one row: smallest of the steps before, and the same where the command
# stops in that row, in steps of the encoder (healthy: 4.0, 1.0); smallest last step over the largest change between
# them (healthy: 2.0); or smallest of them in steps of the encoder and over the range [1], and last one over the largest
BEFORE, ABRUPT, TOGETHER, SUDDEN, FAST, TRAVELS, LASTS = 4, 4.5, 2.5, 2.2, 10.0, 1e-3, 0.5
# Samples are lost if a jump follows: its smallest size over the largest of the five steps on either side (healthy: 1.8)
# and in steps of the encoder; steps of them that move
JUMP, JUMP_STEPS, MOVING = 2.5, 5.0, 4
STUCK_SHARE = 0.05  # [1] share of the rows from which on a stuck position makes a recording useless
LEVELS, COARSE_STEP = 100, {"rad": 0.01, "m": 1e-3}  # values, and size of their step, fewer and larger: coarse
# Few values of torque: largest number; smallest step between them over the standard deviation
MAX_TORQUE_VALUES, STEP = 8, 0.5
STRONG = 0.1  # [1] standard deviation of a torque over that of the strongest one, below which spikes are not judged
MIN_RANGE_RATIO, PLACES = 0.1, 50  # a joint moves: least range over the widest joint's [1], least number of values
# Clipping: smallest number of samples at the extreme value, their smallest share of all samples [1], and the smallest
# length of their longest run; their smallest number over that within a band below, and the width of the band [ranges]
OFTEN, CLIPPED, RUN, NEXT, BAND = 10, 2e-3, 4, 5.0, 5e-3
TRAVEL = 0.02  # [ranges] smallest travel of a joint while its torque is stuck


class Column(NamedTuple):
    """Column of one joint, in one or several stretches of consecutive rows."""

    joint: str
    signal: str  # "position", "command" or "torque"
    name: str  # subject of sentences: "the torque of joint_1", "joint_1: q"
    unit: str  # "" if unknown
    t: Sequence[Array]  # (N,) [s] of each stretch
    x: Sequence[Array]  # (N,) [unit]
    beside: Sequence[Array] = ()  # (N,) [rad or m] the position beside a torque, the command beside a position
    signed: bool = True
    weak: bool = False  # varies too little for spikes and few values to be judged

    @property
    def step(self) -> float:
        """Smallest step of the values [unit]: the resolution of an encoder; 0 if they never change."""
        return quantum(self.x)

    def fault(self, kind: str, severity: str, said: str, **measures: float) -> RecordingFault:
        """Fault of the column; what is said follows its name."""
        return RecordingFault(kind, (self.joint,), severity, measures, f"{self.name} {said}")


def quantum(stretches: Sequence[Array]) -> float:
    """Smallest step of values; 0 if they never change; stretches: (N,) [unit of the values] each."""
    steps = np.concatenate([np.abs(np.diff(x)) for x in stretches])
    moved = steps[steps > TINY * max(float(np.ptp(x)) for x in stretches)]
    return float(moved.min()) if len(moved) else 0.0


def has_values(x: Array, least: int) -> bool:
    """Whether a column has a number of different values; a sample of rows may show it; x: (N,) [any unit]."""
    return any(len(np.unique(rows)) >= least for rows in (x[:: max(1, len(x) // (8 * least))], x))


def true_runs(mask: Mask) -> list[tuple[int, int]]:
    """Start and end (exclusive) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]


def outliers(column: Column) -> Iterator[RecordingFault]:
    """Drop-outs to one value, or spikes: single samples that jump away and back at once."""
    x, steps = np.concatenate(column.x), [np.diff(part) for part in column.x]
    (least, share), broken = FEWEST_SPIKES[column.signal], POWERS[column.signal]
    back = [np.minimum(np.abs(d[1:]), np.abs(d[:-1])) * (d[1:] * d[:-1] < 0) for d in steps]
    size = np.concatenate([np.pad(b, 1)[: len(part)] for b, part in zip(back, column.x, strict=True)])
    usual, fewest = USUAL_STEPS * float(np.median(np.abs(np.concatenate(steps)))), max(least, share * len(x))
    if column.weak or np.count_nonzero(size > usual) < fewest or not has_values(x, FEW_LEVELS[column.signal] + 1):
        return
    low, high = np.quantile(x, [OUTER, 1 - OUTER])
    far = max(JUMP_AWAY * float(high - low), usual, FLICKER * column.step, 1e-300)
    out = x[size > far]
    if len(out) < fewest:
        return
    values, counts = np.unique(out, return_counts=True)
    power = float(np.sum(size[size > far] ** 2)) / (len(x) * float(np.var(x)))
    measures = {"count": float(len(out)), "share": len(out) / len(x), "power": power}
    severity = REFUSE if column.signal == "position" and power >= BROKEN else WARN
    if counts.max() >= EQUAL_SPIKES_SHARE * len(out) and power >= broken[0]:
        value = float(values[np.argmax(counts)])
        said = f"drops to {value:.4g} for single samples, {counts.max()} times: samples were lost"
        said += "; leave them empty instead of filling them"
        yield column.fault("drop-outs", severity, said, **measures, value=value)
    elif power >= broken[1]:
        said = f"has spikes: {len(out)} single samples ({100 * len(out) / len(x):.2g} %) are far from their neighbours"
        said += "; check cable and logger, and leave those samples empty"
        yield column.fault("spikes", severity, said, **measures)


def stuck_position(column: Column) -> Iterator[RecordingFault]:
    """A position that stops within one row, or that repeats for a while and then jumps, as no joint does."""
    step, stuck, lost, rows = column.step, list[tuple[float, float]](), list[float](), 0
    for k, (t, x) in enumerate(zip(column.t, column.x, strict=True)):
        d, sent = np.diff(x), np.diff(column.beside[k]) != 0 if column.beside else np.zeros(len(x) - 1, dtype=bool)
        for a, b in true_runs(d == 0):
            if a < BEFORE or b - a < ROWS or t[b] - t[a] < HOLD:
                continue
            last, seconds = d[a - BEFORE : a], float(t[b] - t[a])
            together = bool(sent[a - BEFORE : a].all()) and not sent[a:b].any()  # a joint follows its command later
            size, bend = np.abs(last), max(float(np.abs(np.diff(last)).max()), step)
            sudden = size.min() > ABRUPT * step and size[-1] > SUDDEN * bend
            sudden |= size.min() > max(FAST * step, TRAVELS * float(np.ptp(x))) and size[-1] >= LASTS * size.max()
            sudden |= together and size.min() > TOGETHER * step
            sides = [np.abs(d[max(a - ROWS, 0) : a]), np.abs(d[b + 1 : b + 1 + ROWS])]
            moves = all(len(side) == ROWS and np.count_nonzero(side) >= MOVING for side in sides)
            if seconds >= LONG_HOLD and not column.weak and sudden:
                stuck, rows = [*stuck, (seconds, abs(float(last[-1] / (t[a] - t[a - 1]))))], rows + b - a
            elif moves and abs(d[b]) > max(JUMP * float(np.max(sides)), JUMP_STEPS * step):
                lost.append(seconds)
    if stuck:
        seconds, speed = max(stuck)
        said = f"stands still for {seconds:.3g} s after it stops within one row, at {speed:.2g} per second"
        said += ": the sensor is stuck, or the log; leave these rows out"
        severity = REFUSE if rows >= STUCK_SHARE * sum(map(len, column.x)) else WARN
        yield column.fault("stuck position", severity, said, seconds=seconds, speed=speed)
    if lost:
        times = "once" if len(lost) == 1 else f"{len(lost)} times"
        said = f"stands still and then jumps, {times}, for up to {max(lost):.2g} s: samples were lost"
        said += "; leave them empty instead of repeating the last one"
        yield column.fault("skipping position", WARN, said, count=float(len(lost)), value=max(lost))


def coarse_position(column: Column) -> Iterator[RecordingFault]:
    """A position with few values, far apart."""
    x = np.concatenate(column.x)
    if has_values(x, LEVELS):
        return
    levels, step = len(np.unique(x)), column.step
    if step > COARSE_STEP.get(column.unit, np.inf):
        said = f"has only {levels} different values, {step:.3g} {column.unit} apart: speeds and small errors are lost"
        said += "; record the position with all bits of the encoder"
        yield column.fault("coarse position", WARN, said, values=float(levels), step=step)


def few_values(column: Column) -> Iterator[RecordingFault]:
    """A torque with a handful of values."""
    x = np.concatenate(column.x)
    if column.weak or has_values(x, MAX_TORQUE_VALUES + 1):
        return
    values = np.unique(x)
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    if step >= STEP * np.std(x):
        said = f"has only {len(values)} different values, {step:.3g} apart"
        said += "; record it with more digits, not as a state or in coarse steps"
        yield column.fault("few torque values", WARN, said, values=float(len(values)), step=step)


def clipping(column: Column) -> Iterator[RecordingFault]:
    """A torque that is clipped at its limit, or that is constant while the joint moves."""
    for t, tau, q in zip(column.t, column.x, column.beside, strict=True):
        if not np.all(np.isfinite(tau)) or not has_values(tau, VALUES):
            continue
        sides = [(_clipped(side * tau, q), float(np.max(side * tau))) for side in (1.0, -1.0)[: 1 + column.signed]]
        for count, value in sides:
            if count:
                said = f"is clipped at {value:.4g} {column.unit} in {count} samples"
                said += "; raise the limit of drive or logger, or move more slowly"
                yield column.fault("clipping", WARN, said, count=float(count), value=value)
        runs = [(a, b) for a, b in true_runs(np.diff(tau) == 0) if t[b] - t[a] >= LONG_HOLD]
        stuck = [b - a + 1 for a, b in runs if np.ptp(q[a : b + 1]) > TRAVEL * np.ptp(q)]
        if stuck and not any(count for count, _ in sides):
            seconds = max(stuck) * float(np.median(np.diff(t)))
            said = f"is constant for {seconds:.2g} s while the joint moves; check the logger, or cut that part out"
            yield column.fault("stuck torque", WARN, said, count=float(max(stuck)), value=seconds)


def _clipped(y: Array, q: Array) -> int:
    """Number of samples at the largest value if it is clipped: many are there and few just below; else 0."""
    at = y >= y.max() - TINY * np.ptp(y)
    if np.count_nonzero(at) < max(OFTEN, CLIPPED * len(y)):
        return 0
    levels = np.unique(y)[-2:]
    band = max(BAND * np.ptp(y), 1.5 * (levels[1] - levels[0]))
    below = np.sum((y > y.max() - band) & ~at)
    runs = true_runs(at)
    moving = np.mean(np.diff(q, prepend=q[0])[at] != 0)
    many = at.sum() >= NEXT * below and moving > 0.3
    return int(at.sum()) if many and len(runs) > 1 and max(b - a for a, b in runs) >= RUN else 0


class ColumnCheck(NamedTuple):
    """Check of single columns."""

    kinds: tuple[str, ...]  # of the faults that it finds
    signals: tuple[str, ...]  # columns that it judges
    find: Callable[[Column], Iterator[RecordingFault]]


CHECKS = (
    ColumnCheck(("drop-outs", "spikes"), ("position", "command", "torque"), outliers),
    ColumnCheck(("stuck position", "skipping position"), ("position",), stuck_position),
    ColumnCheck(("coarse position",), ("position",), coarse_position),
    ColumnCheck(("few torque values",), ("torque",), few_values),
    ColumnCheck(("clipping", "stuck torque"), ("torque",), clipping),
)
COLUMN_KINDS = tuple(kind for check in CHECKS for kind in check.kinds)
# kinds that rule out a comparison with the model if they are severe
SAMPLE_KINDS = ("order of rows", "standstill", *COLUMN_KINDS[:3], "coarse position", "few torque values")


def judge_columns(columns: Sequence[Column]) -> Iterator[RecordingFault]:
    """Faults of columns by all checks that apply to them."""
    for column in columns:
        for check in CHECKS:
            if column.signal in check.signals:
                yield from check.find(column)


def judge_samples(parts: Sequence[Part], robot: Robot) -> list[RecordingFault]:
    """Faults of the longest stretch of each recording; each kind at most once per joint."""
    faults: dict[tuple[str, tuple[str, ...]], RecordingFault] = {}
    for part in parts:
        if part[0].static:
            continue
        rows = longest_rows(part)
        if (share := disorder(rows.q)) > DISORDER:
            widest = float(np.ptp(rows.q, axis=0).max())
            fact = "positions jump from each sample to the next: rows are mixed up, or each is a posture at rest"
            kind, advice = "order of rows", "give rows as they were recorded, or state --rate 0 for postures"
            if widest < STANDSTILL:
                kind, fact, advice = "standstill", f"no joint moves (range {widest:.2g} rad or m)", "record a motion"
            return [RecordingFault(kind, (), REFUSE, {"share": share, "range": widest}, f"{fact}; {advice}")]
        for fault in judge_columns(list(torque_columns(rows, part[0].signed, robot))):
            faults.setdefault((fault.kind, fault.joints), fault)
    return list(faults.values())


def torque_columns(rows: Samples, signed: Mask, robot: Robot) -> Iterator[Column]:
    """Positions and torques of a recording of torque; signed: (n,) whether torque has its sign."""
    q, tau = rows.q, rows.tau
    moves = np.ptp(q, axis=0) >= MIN_RANGE_RATIO * np.ptp(q, axis=0).max()
    moves &= [has_values(x, PLACES + 1) for x in q.T]
    size = np.where(np.isfinite(tau).all(axis=0), np.nan_to_num(tau).std(axis=0), 0.0)
    strong = moves & signed & (size > STRONG * size.max())
    for j, joint in enumerate(robot.joints):
        length, torque = ("m", "N") if robot.prismatic[j] else ("rad", "N.m")
        position, weak = f"the position of {joint}", not moves[j]
        yield Column(joint, "position", position, length, [rows.t], [q[:, j]], weak=weak)
        about, flags = f"the torque of {joint}", (bool(signed[j]), not strong[j])
        yield Column(joint, "torque", about, torque, [rows.t], [tau[:, j]], [q[:, j]], *flags)


def longest_rows(part: Part) -> Samples:
    """Raw samples of a recording's longest stretch, or its beginning if it is long."""
    recording, sampling = part
    start, stop = max(sampling.spans, key=lambda span: span[1] - span[0])
    return recording.read(start, min(stop, start + BAND_SAMPLES))


@contextmanager
def naming_faults(session: Session) -> Iterator[None]:
    """Name a fault of the samples instead of its consequence, if recordings cannot be used.

    Raises:
        RecordingError: the recordings cannot be used; the sentence says why.
    """
    try:
        yield
    except (RecordingError, OptionError) as error:
        parts = tuple(dict((*session.train, *session.held_out)).items())
        found = judge_samples(parts, session.robot)
        if faults := [fault.sentence for fault in found if fault.severity == REFUSE]:
            raise RecordingError(faults[0]) from error
        raise
