"""Raw samples -> faults of single channels: order of rows, drop-outs, spikes, few values, stuck sensors, clipping."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import numpy as np

from ..errors import OptionError, RecordingError
from ..recording.missing import DISORDER, STANDSTILL, disorder
from ..regression.session import PIECE, Part, Session
from ..types import Array, Mask, Robot, Samples
from .result import REFUSE, WARN, RecordingFault

LEVELS = 200  # smallest number of distinct values; with fewer, a standstill looks like quantisation
# Clipping: smallest number of samples at the extreme value, their smallest share of all samples [1], and the smallest
# length of their longest run; their smallest number over that within a band below, and the width of the band [ranges]
OFTEN, CLIPPED, RUN = 10, 2e-3, 4
NEXT, BAND = 5.0, 5e-3
TRAVEL = 0.02  # [ranges] smallest travel of a joint while its torque is stuck
# Skipping position: smallest duration [s] and number of samples of a standstill, and the smallest jump after it, over
# the largest of the five steps on either side [1]
HOLD, STEPS, JUMP = 0.05, 5, 3.0
CHANNELS = {
    "clipping": "the torque of {joint} is clipped at {value:.4g} {unit} in {count} samples; "
    "raise the limit of drive or logger, or move more slowly",
    "stuck torque": "the torque of {joint} is constant for {value:.2g} s while the joint moves; "
    "check the logger, or cut that part out",
    "skipping position": "the position of {joint} stands still and then jumps, {count} times, for up to {value:.2g} s: "
    "samples were lost; leave them empty instead of repeating the last one",
}


NEIGHBOURS = 7  # samples of the running median
# Isolated sample: smallest distance from the running median, over the usual distance (standard deviation of noise) and
# over the range from the 5th to the 95th percentile
UNUSUAL, FAR = 12.0, 0.1
SEVERAL, MOST = 5, 0.8  # drop-outs: smallest number, and smallest share of the isolated samples with the same value
# Smallest share of isolated samples; smallest share of the variance that they add to a position, to a torque as
# drop-outs, and as spikes. Measured on real arms: at most 1.6e-3 of positions, 0.02 of torques
SHARE, BROKEN, LOST, POWER = 1e-3, 5e-3, 0.03, 0.5
# Few values of torque: largest number; smallest step between them over the standard deviation; smallest standard
# deviation over that of the strongest joint
FEW, STEP, STRONG = 8, 0.5, 0.1
VALUES = 200  # largest number of values that may be those of a sensor with few steps
# Coarse position: smallest step of a revolute [rad] and of a prismatic joint [m] (hobby servos: 1.5e-3 rad); largest
# cut-off that it allows [Hz]
COARSE, CUTOFF = (6e-3, 1e-3), 2.0
WIDE, PLACES = 0.1, 50  # a joint moves: smallest range over that of the widest joint [1], smallest number of values
# Stuck position: smallest duration [s]; largest change of velocity in one sample, over the largest one elsewhere
STILL, ABRUPT = 0.25, 3.0
SAMPLE_KINDS = (
    *("order of rows", "standstill", "drop-outs", "spikes", "stuck position"),
    *("coarse position", "few torque values"),
)
MEND = "samples were lost; leave them empty instead of filling them"


def judge_samples(parts: Sequence[Part], robot: Robot, per_joint: Array) -> list[RecordingFault]:
    """Faults of the longest stretch of each recording; each kind at most once per joint.

    per_joint: (n,) [Hz] cut-off that the encoder noise of each joint allows.
    """
    found: dict[tuple[str, tuple[str, ...]], RecordingFault] = {}
    for part in parts:
        if part[0].static:
            continue
        rows, period = longest_rows(part), part[1].period
        if (share := disorder(rows.q)) > DISORDER:
            widest = float(np.ptp(rows.q, axis=0).max())
            fact = "positions jump from each sample to the next: rows are mixed up, or each is a posture at rest"
            kind, advice = "order of rows", "give rows as they were recorded, or state --rate 0 for postures"
            if widest < STANDSTILL:
                kind, fact, advice = "standstill", f"no joint moves (range {widest:.2g} rad or m)", "record a motion"
            return [RecordingFault(kind, (), REFUSE, {"share": share, "range": widest}, f"{fact}; {advice}")]
        for fault in judge_columns(rows.q, rows.tau, period, robot, part[0].signed, per_joint):
            found.setdefault((fault.kind, fault.joints), fault)
    return list(found.values())


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
        found = judge_samples(parts, session.robot, session.task.band.per_joint)
        if faults := [fault.sentence for fault in found if fault.severity == REFUSE]:
            raise RecordingError(faults[0]) from error
        raise


def judge_columns(
    q: Array, tau: Array, period: float, robot: Robot, signed: Mask, per_joint: Array
) -> Iterator[RecordingFault]:
    """Yield the faults of positions and torques.

    q: (N, n) [rad or m]; tau: (N, n) [N.m or N]; period: [s]; signed: (n,) whether torque has its sign;
    per_joint: (n,) [Hz] cut-off that encoder noise allows.
    """
    moves = np.ptp(q, axis=0) >= WIDE * np.ptp(q, axis=0).max()
    moves &= [len(np.unique(x)) > PLACES for x in q.T]
    size = np.where(np.isfinite(tau).all(axis=0), np.nan_to_num(tau).std(axis=0), 0.0)
    for j, joint in enumerate(robot.joints):
        bad = [*_outlying("position", q[:, j], joint), *_stuck_position(q[:, j], period, joint)] if moves[j] else []
        yield from bad
        if moves[j] and per_joint[j] < CUTOFF and not bad:
            yield from _coarse(q[:, j], joint, float(per_joint[j]), COARSE[int(robot.prismatic[j])])
        if moves[j] and signed[j] and size[j] > STRONG * size.max():
            yield from _outlying("torque", tau[:, j], joint)
            yield from _few_values(tau[:, j], joint)


def isolated(x: Array) -> Mask:
    """Mask (N,) of single samples far from both neighbours; x: (N,) [any unit]."""
    off = _off(x)
    low, high = np.percentile(x, (5, 95))
    usual = max(float(np.median(np.abs(off))) / 0.6745, 1e-9 * float(np.ptp(x)))
    far = np.abs(off) > max(UNUSUAL * usual, FAR * float(high - low), 1e-300)
    before, after = (np.abs(off - np.roll(off, k)) >= 0.5 * np.abs(off) for k in (1, -1))
    return np.asarray(far & before & after)


def _off(x: Array) -> Array:
    """Distance (N,) from the running median."""
    half = NEIGHBOURS // 2
    windows = np.lib.stride_tricks.sliding_window_view(np.pad(x, half, mode="reflect"), NEIGHBOURS)
    return np.asarray(x - np.median(windows, axis=1))


def _outlying(signal: str, x: Array, joint: str) -> Iterator[RecordingFault]:
    """Drop-outs to one value, or spikes."""
    if len(x) <= NEIGHBOURS or len(np.unique(x)) <= VALUES:
        return
    alone = isolated(x)
    out, position = x[alone], signal == "position"
    values, counts = np.unique(out, return_counts=True)
    power = float(np.sum(_off(x)[alone] ** 2)) / (len(x) * float(np.var(x)))
    enough = len(out) >= max(SEVERAL, SHARE * len(x))
    measures = {"count": float(len(out)), "share": len(out) / len(x), "power": power}
    severity = REFUSE if position else WARN
    if enough and counts.max() >= MOST * len(out) and power >= (BROKEN if position else LOST):
        value = float(values[np.argmax(counts)])
        fact = f"the {signal} of {joint} drops to {value:.4g} for single samples, {counts.max()} times"
        yield RecordingFault("drop-outs", (joint,), severity, {**measures, "value": value}, f"{fact}: {MEND}")
    elif enough and power >= (BROKEN if position else POWER):
        fact = f"the {signal} of {joint} has spikes: {len(out)} single samples ({100 * len(out) / len(x):.2g} %)"
        advice = "are far from their neighbours; check cable and logger, and leave those samples empty"
        yield RecordingFault("spikes", (joint,), severity, measures, f"{fact} {advice}")


def _few_values(x: Array, joint: str) -> Iterator[RecordingFault]:
    values = np.unique(x)
    step = float(np.median(np.diff(values))) if len(values) > 1 else 0.0
    if len(values) <= FEW and step >= STEP * np.std(x):
        fact = f"the torque of {joint} has only {len(values)} different values, {step:.3g} apart"
        measures = {"values": float(len(values)), "step": step}
        advice = "record it with more digits, not as a state or in coarse steps"
        yield RecordingFault("few torque values", (joint,), WARN, measures, f"{fact}; {advice}")


def _coarse(x: Array, joint: str, cutoff: float, least: float) -> Iterator[RecordingFault]:
    values = np.unique(x)
    step = float(np.diff(values).min(initial=np.inf))
    if len(values) <= min(VALUES, len(x) / 2) and step >= least:
        fact = f"the position of {joint} has only {len(values)} different values, {step:.3g} apart"
        why = f"its velocity is known only up to {cutoff:.2g} Hz"
        measures = {"values": float(len(values)), "step": step}
        advice = "record the encoder with all its bits"
        yield RecordingFault("coarse position", (joint,), WARN, measures, f"{fact}: {why}; {advice}")


def _stuck_position(x: Array, period: float, joint: str) -> Iterator[RecordingFault]:
    """Standstill that begins within one sample: no joint stops so abruptly."""
    step = np.diff(x)
    change, runs = np.abs(np.diff(step)), [(a, b) for a, b in true_runs(step == 0) if (b - a) * period >= STILL]
    edges = {k for a, b in runs for k in (a - 1, b - 1)}
    rest = np.delete(change, [k for k in edges if 0 <= k < len(change)])
    largest = float(rest.max(initial=0.0))
    for a, b in runs:
        if a > 0 and abs(step[a - 1]) > ABRUPT * largest > 0:
            seconds, speed = (b - a) * period, abs(float(step[a - 1])) / period
            fact = f"the position of {joint} stops within one sample at {speed:.2g} per second and stands still"
            advice = "the sensor is stuck: check it, or cut that part out"
            measures = {"seconds": seconds, "speed": speed}
            yield RecordingFault("stuck position", (joint,), REFUSE, measures, f"{fact} for {seconds:.2g} s: {advice}")
            return


def judge_channels(parts: Sequence[Part], robot: Robot) -> list[RecordingFault]:
    """Faults of single channels in the longest stretch of each recording; each kind at most once per joint."""
    found: dict[tuple[str, int], RecordingFault] = {}
    for part in parts:
        (recording, sampling), rows = part, longest_rows(part)
        for j, signed in enumerate(recording.signed):
            joint, unit = robot.joints[j], "N" if robot.prismatic[j] else "N.m"
            for kind, count, value in _faults(rows.q[:, j], rows.tau[:, j], sampling.period, bool(signed)):
                measures = {"count": float(count), "value": value}
                sentence = CHANNELS[kind].format(joint=joint, unit=unit, count=count, value=value)
                found.setdefault((kind, j), RecordingFault(kind, (joint,), WARN, measures, sentence))
    return list(found.values())


def longest_rows(part: Part) -> Samples:
    """Raw samples of a recording's longest stretch, or its beginning if it is long."""
    recording, sampling = part
    start, stop = max(sampling.spans, key=lambda span: span[1] - span[0])
    return recording.read(start, min(stop, start + PIECE))


def _faults(q: Array, tau: Array, period: float, signed: bool) -> Iterator[tuple[str, int, float]]:
    """Kind, number of samples or skips, and clipped value [N.m or N] or longest duration [s] of each fault."""
    if np.all(np.isfinite(tau)) and len(np.unique(tau)) >= LEVELS:
        sides = [(_clipped(side * tau, q), side) for side in (1.0, -1.0)[: 1 + signed]]
        yield from (("clipping", count, float(np.max(side * tau))) for count, side in sides if count)
        rests = [(a, b) for a, b in true_runs(np.diff(tau) == 0) if (b - a) * period >= STILL]
        stuck = max((b - a + 1 for a, b in rests if np.ptp(q[a : b + 1]) > TRAVEL * np.ptp(q)), default=0)
        if stuck and not any(count for count, _ in sides):
            yield "stuck torque", stuck, stuck * period
    if skips := _skips(q, period):
        yield "skipping position", len(skips), max(skips) * period


def _clipped(y: Array, q: Array) -> int:
    """Number of samples at the largest value if it is clipped: many are there and few just below; else 0."""
    at = y >= y.max() - 1e-9 * np.ptp(y)
    levels = np.unique(y)[-2:]
    band = max(BAND * np.ptp(y), 1.5 * (levels[1] - levels[0]))
    below = np.sum((y > y.max() - band) & ~at)
    runs = true_runs(at)
    moving = np.mean(np.diff(q, prepend=q[0])[at] != 0)
    many = at.sum() >= max(OFTEN, CLIPPED * len(y), NEXT * below) and moving > 0.3
    return int(at.sum()) if many and len(runs) > 1 and max(b - a for a, b in runs) >= RUN else 0


def _skips(q: Array, period: float) -> list[int]:
    """Length in samples of each standstill of a position that a jump follows."""
    step, found = np.diff(q), []
    for a, b in true_runs(step == 0):
        before, after = np.abs(step[max(a - STEPS, 0) : a]), np.abs(step[b + 1 : b + 1 + STEPS])
        if b - a < max(STEPS, HOLD / period) or len(before) < STEPS or len(after) < STEPS:
            continue
        usual = max(before.max(), after.max())
        if before.min() > 0 and after.min() > 0 and abs(step[b]) > JUMP * usual:
            found.append(b - a)
    return found


def true_runs(mask: Mask) -> list[tuple[int, int]]:
    """Start and end (exclusive) of every run of True."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in edges.reshape(-1, 2)]
