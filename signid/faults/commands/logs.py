"""Checks of the log of one joint with commands; one sentence each: the fact, what follows, what to do.

Limits were set on public recordings of six servos (SO-101, XL330, STS3250, a hobby servo, Go2, OpenArm), which stay
silent unless they have the fault.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import pi

import numpy as np

from ...types import Array, Recording
from ..channels import TINY, Column, judge_columns, true_runs
from ..result import JointAudit
from .response import MAX_SHIFT, Grid, Part, Response, RowClock, best_shift, joined

JUMP = 3.0  # steps of the encoder that count as motion between two rows
FULL = 0.98  # duty that counts as saturated
TOP, MIN_SPEED_ERROR, RUN = 0.93, 0.4, 3  # speed at its limit [1]; difference from the commanded one [1]; rows
SPEED_QUANTILE = 0.999  # quantile of the speed that is its limit
WRAPPED = 0.05  # tolerance of a full turn [1]
OUTLIER = 20.0  # jumps over the 99.9 % quantile of the others that are no motion
COPY, SHIFTS = 1e-6, range(-3, 4)  # [1] of the range of motion; rows
STUCK_SECONDS, SWEEP = 1.0, 0.5  # [s], [range] of motion of the command during which a position that repeats is stuck
ALTERNATES = -0.5  # largest correlation of successive second differences of white noise, which have -2/3
BASE, MAX_SPEED_DELAY = 0.03, 0.15  # [s] over which a speed is computed; largest delay of a speed after the error
TO_STD = 1.4826 / np.sqrt(6.0)  # of the median size of the second differences of white noise


def held_share(parts: Sequence[Part], step: float) -> float:
    """Share of moving rows [1] that repeat the position before, between two rows that move on; step: of the encoder."""
    held = moving = 0
    for part in parts:
        d = np.diff(part.q)
        jump = np.abs(d) >= JUMP * step
        at = np.flatnonzero(jump)
        moving += len(at)
        between = np.diff(at) - 1
        same = (np.sign(d[at[1:]]) == np.sign(d[at[:-1]])) & (between > 0)
        for k in np.flatnonzero(same).tolist():
            run = d[at[k] + 1 : at[k + 1]]
            held += len(run) if not run.any() else 0
    return held / (held + moving) if moving >= 10 else np.nan


def jumps(parts: Sequence[Part]) -> tuple[int, float]:
    """Number of jumps of the position that are no motion, and their median size [rad or m]."""
    steps = np.concatenate([np.abs(np.diff(part.q)) for part in parts])
    size = max(float(part.q.max()) for part in parts) - min(float(part.q.min()) for part in parts)
    near = steps[steps <= size / 2]
    usual = float(np.quantile(near, SPEED_QUANTILE)) if len(near) else 0.0
    far = steps[(steps > size / 2) & (steps > OUTLIER * max(usual, TINY * size))]
    return len(far), float(np.median(far)) if len(far) else 0.0


def turn_of(size: float, unit: str) -> float:
    """Full turn that a jump of a size is, 0 if it is none; size: [unit], which is "" where it is unknown."""
    turns = {"rad": (2 * np.pi,), "m": ()}.get(unit, (2 * np.pi, 360.0))
    return next((float(turn) for turn in turns if abs(size / turn - 1) < WRAPPED), 0.0)


def unwrapped(part: Part, turn: float) -> Part:
    """A part whose position and command do not jump by full turns [unit of the position]."""
    q, command = (np.unwrap(x, period=turn) for x in (part.q, part.command))
    away = turn * np.round(float(np.median(q - command)) / turn)
    return part._replace(q=q - away, command=command)


def copied(parts: Sequence[Part]) -> int | None:
    """Rows by which the command equals the position later (negative: earlier), None if it does not."""
    for shift in sorted(SHIFTS, key=abs):
        same = total = 0
        for part in parts:
            n = len(part.q) - abs(shift)
            q = part.q[max(0, shift) :][:n]
            command = part.command[max(0, -shift) :][:n]
            moved = np.diff(q, prepend=q[0]) != 0
            same += int(np.sum(np.abs(q - command)[moved] <= COPY * max(np.ptp(part.q), 1e-12)))
            total += int(moved.sum())
        if total >= 10 and same > 0.95 * total:
            return shift
    return None


def stuck(parts: Sequence[Part], span: float) -> tuple[float, float]:
    """Duration [s] and motion of the command over its range [1] of the stretch in which q repeats most; span: range."""
    longest = (0.0, 0.0)
    for part in parts:
        for a, b in true_runs(np.diff(part.q) == 0):
            seconds, command = float(part.t[b] - part.t[a]), part.command[a : b + 1]
            if seconds > STUCK_SECONDS and np.ptp(command) > SWEEP * span:
                longest = max(longest, (seconds, float(np.abs(np.diff(command)).sum()) / span), key=lambda x: x[1])
    return longest


def driven_by_error(grids: Sequence[Grid]) -> float:
    """Largest correlation [1] of the speed with the error q_des - q shortly before, which saturated drives have too."""
    period = grids[0].period
    k, best = max(1, round(BASE / period)), 0.0
    long = [grid for grid in grids if len(grid.q) > 4 * k + MAX_SPEED_DELAY / period + 2]
    for late in range(round(MAX_SPEED_DELAY / period) + 1) if long else ():
        speed = np.concatenate([(grid.q[2 * k :] - grid.q[: -2 * k])[late:] for grid in long])
        errors = [(grid.command - grid.q)[k : len(grid.q) - k] for grid in long]
        error = np.concatenate([piece[: len(piece) - late] for piece in errors])
        size = float(np.std(speed) * np.std(error))
        if size > 0:
            best = max(best, float(np.mean((speed - speed.mean()) * (error - error.mean()))) / size)
    return best


def saturated_share(parts: Sequence[Part], grids: Sequence[Grid]) -> float:
    """Share of rows [1] at full duty where it is recorded, else at the largest speed while the error changes."""
    duties = [part.pwm for part in parts if part.pwm is not None]
    if duties:
        duty = np.concatenate(duties)
        known = np.isfinite(duty)
        return float(np.mean(np.abs(duty[known]) >= FULL)) if known.any() else np.nan
    speeds = [(speed_over(grid.q, grid.period), speed_over(grid.command, grid.period)) for grid in grids]
    top = float(np.quantile(np.abs(np.concatenate([v for v, _ in speeds])), SPEED_QUANTILE))
    if top <= 0:
        return 0.0
    saturated = rows = 0
    for v, wanted in speeds:
        high = (np.abs(v) >= TOP * top) & (np.abs(wanted - v) >= MIN_SPEED_ERROR * top)
        saturated += sum(stop - start for start, stop in true_runs(np.asarray(high)) if stop - start >= RUN)
        rows += len(v)
    return saturated / rows


def speed_over(x: Array, period: float) -> Array:
    """Speed over about 60 ms, (N - k,) [rad/s or m/s]; x: (N,) [rad or m]."""
    k = max(2, min(len(x) - 1, round(0.06 / period)))
    return (x[k:] - x[:-k]) / (k * period)


def command_noise(grids: Sequence[Grid]) -> float:
    """Standard deviation of white noise of the command [rad or m]; 0 if there is none."""
    second = [np.diff(grid.command, 2) for grid in grids if len(grid.command) > 4]
    power = sum(float(s @ s) for s in second)
    if not power:
        return 0.0
    usual = np.concatenate(second)
    limit = 6 * float(np.median(np.abs(usual)))
    small = [np.clip(s, -limit, limit) for s in second]
    power = sum(float(s @ s) for s in small)
    alike = sum(float(s[1:] @ s[:-1]) for s in small) / power if power else 0.0
    return float(TO_STD * np.median(np.abs(usual))) if alike < ALTERNATES else 0.0


def command_period(parts: Sequence[Part]) -> float:
    """Median time between changes of the command while it moves [s]."""
    steps = []
    for part in parts:
        at = np.flatnonzero(np.diff(part.command) != 0) + 1
        steps.append(np.diff(part.t[at]))
    every = np.concatenate(steps)
    return float(np.median(every)) if len(every) else np.nan


Course = tuple[Array, Array, Array, Array]  # command, late by the shift, its direction, time over the duration, q: (N,)


def course(parts: Sequence[Part], grids: Sequence[Grid], shift: float) -> Course:
    """Rows of all parts of one joint; shift of the command [s]."""
    late = [grid.command[np.maximum(np.arange(len(grid.q)) - round(shift / grid.period), 0)] for grid in grids]
    t = np.concatenate([p.t[0] + g.period * np.arange(len(g.q)) for p, g in zip(parts, grids, strict=True)])
    way = np.concatenate([np.sign(np.gradient(x)) for x in late])
    return np.concatenate(late), way, (t - t.mean()) / max(float(np.ptp(t)), TINY), joined(grids, "q")


def _left(columns: Sequence[Array], y: Array) -> tuple[float, float]:
    """Last coefficient and mean square residual of y (N,) by least squares."""
    x = np.column_stack(columns)
    value = np.linalg.lstsq(x, y, rcond=None)[0]
    return float(value[-1]), float(np.mean((y - x @ value) ** 2))


OTHER, SHRINKS, HALVES = 0.6, 0.5, (0.3, 3.0)  # [1] time unlike motion; residual; drift of each half over that of all
# [range], [rad or m] size of a drift; of healthy logs at most 0.07 in both halves. Residual of a clear drift [1], for
# which the range does not count (healthy: 0.2); share of the motion that the command explains beside the drift [1]
DRIFTS, LEAST_DRIFT, DRIFT_RESIDUAL, DRIFTLESS = 0.1, 0.05, 0.1, 0.9


def drift(rows: Course, span: float) -> float:
    """Motion of the zero of q over a recording [rad or m], 0 if it is none; span: range of the command.

    A drift is not like the motion, explains most of what the command leaves, and has its share in both halves.
    """
    command, way, t, q = rows
    z = (command - command.mean()) / span
    columns = [np.ones_like(z), z, z**2, z**3, way]
    (size, after), before = _left([*columns, t], q), _left(columns, q)[1]
    least = LEAST_DRIFT if after < DRIFT_RESIDUAL * before else max(DRIFTS * span, LEAST_DRIFT)
    like = _left(columns, t)[1] < OTHER * float(np.var(t)) or after > (1 - DRIFTLESS) * float(np.var(q - size * t))
    if like or after > SHRINKS * before or abs(size) < least:
        return 0.0
    halves = [_left([x[side] for x in (*columns, t)], q[side])[0] / size for side in (t < 0, t >= 0)]
    return size if all(HALVES[0] < share < HALVES[1] for share in halves) else 0.0


LOADED, LINEAR = 2.0, 0.1  # [1] residual of a load over that of a scale; of a scale, over the error
GRAVITY, MIN_PENDULUM_LENGTH = 9.81, 0.03  # [m/s2]; [m] below which no robot has its load (healthy: 0.067)
WINDOW, STEPS, AHEAD = 0.06, 0.06, 0.5  # [s]; [range] of a step; [1] motion before it over that after it


def scaled(rows: Course, unit: str, bandwidth: float) -> float:
    """Motion per command [1] if the error grows with q as of a factor, and not as of a load; else 1.

    A load that holds a drive back by a share of its command makes it slow: its stiffness over the inertia of a pendulum
    is at most gravity over its length. bandwidth: [Hz].
    """
    command, way, _, q = rows
    error, loads = command - q, [np.sin(q), np.cos(q)] if unit == "rad" else [np.ones_like(q)]
    factor, left = _left([way, q], error)
    if left > LINEAR * float(np.mean(error**2)) or factor <= -1:
        return 1.0
    scale = 1 / (1 + factor)
    fast = unit == "rad" and (2 * pi * bandwidth) ** 2 * abs(1 - scale) * MIN_PENDULUM_LENGTH > GRAVITY
    return scale if fast or _left([*loads, way], error)[1] >= LOADED * left else 1.0


def ahead(grids: Sequence[Grid], span: float) -> float:
    """Median step of a command that q follows before it is made [rad or m], 0 if it does not; span: range."""
    steps = list[tuple[float, float, float]]()
    for grid in grids:
        k, step = max(1, round(WINDOW / grid.period)), np.diff(grid.command)
        at = np.flatnonzero(step) + 1
        at = at[(at >= k) & (at < len(grid.q) - k)]
        way, q = np.sign(step[at - 1]), grid.q
        steps += zip(way * (q[at] - q[at - k]), way * (q[at + k] - q[at]), np.abs(step[at - 1]), strict=True)
    if not steps:
        return 0.0
    before, after, size = np.median(np.array(steps), axis=0).tolist()
    return size if size > STEPS * span and before > AHEAD * after > 0 else 0.0


MIN_ENCODER_STEPS = 10.0  # steps of the encoder below which a command says nothing
STUCK = 0.05  # motion over the range of the command
FOLLOWS, AGAINST, CERTAIN = 0.5, 0.9, 0.95  # correlations
CURVED, BOTH = 0.25, 0.05  # 1 - correlation with the magnitude or square, over that without; share on both sides of 0
LEAD, MIN_COMMAND_DELAY, EXACT = 1.0, 0.12, 0.06  # [rows], [s], residual below which the delay is no dry friction
STIFF = 0.3  # difference of the scale from one, beyond which droop may look like a lead
SCALES, DEGREES = (0.1, 1.5), 0.1  # motion per command; tolerance of 180 / pi
ZERO, ZERO_LEAST, SCALE_TOLERANCE, QUIET = 0.25, 0.15, 0.15, 0.2  # [range], [rad], |scale - 1|, residual
MIN_LOAD_RANGE, LOAD, STEADY = 1.2, 0.037, 0.5  # [rad]; rms of cos x over x**2 about its mean [1/rad2]; share of it [1]
HELD = 0.08  # share of moving rows
DRIVEN = 0.7  # correlation of speed and error from which on a joint follows although q and q_des differ
GAIN, CLEAN = 0.3, 0.03  # difference of the scale from one, and residual below which it is no friction
SWEEPS = 2.0  # [range] motion of the command while q repeats; healthy logs: at most 1
FREE, FREE_STEPS = 0.1, 60.0  # [rad or m] and [steps of the encoder] of motion without a command
NOISE = 0.02  # [range]
UNEVEN, REPEATED = 0.1, 0.01  # shares of rows


def judge_still(audit: JointAudit, parts: Sequence[Part]) -> Iterator[str]:
    """Flags of one joint whose command hardly moves, or less than a few steps of its encoder."""
    moved = _moved(parts)
    least = FREE if audit.unit in ("rad", "m") else 0.0
    if audit.range == 0 and moved > max(least, FREE_STEPS * audit.quantum):
        fact = f"{audit.joint}: q moves by {_length(moved, audit)} although q_des never changes"
        yield f"{fact}; check that q_des is the command, or mark the rows with the drive off (on_J)"
    yield from (fault.sentence for fault in judge_columns(_columns(audit, parts, weak=True)))


def _moved(parts: Sequence[Part]) -> float:
    return max(float(part.q.max()) for part in parts) - min(float(part.q.min()) for part in parts)


def judge_joint(
    audit: JointAudit, response: Response | None, parts: Sequence[Part], grids: Sequence[Grid]
) -> Iterator[str]:
    """Flags of one joint; grids: its parts on a uniform grid, without full turns."""
    if (shift := copied(parts)) is not None:
        way = "later" if shift > 0 else "earlier"
        rows = f", {abs(shift)} row{'s' if abs(shift) > 1 else ''} {way}" if shift else ""
        advice = "it is no command; record what is sent to the drive"
        yield f"{audit.joint}: q_des equals q{rows}: {advice}"
        return
    if _moved(parts) < STUCK * audit.range:
        fact = f"{audit.joint}: q does not follow q_des, it moves by less than {STUCK:.0%} of it"
        yield f"{fact}; check that the drive is on, or record when it is off (on_J)"
        return
    if response is not None and (curve := _curve(response, grids)):
        yield f"{audit.joint}: {curve}; record both with their signs"
    elif response is not None and abs(response.correlation) < FOLLOWS and driven_by_error(grids) < DRIVEN:
        fact = f"{audit.joint}: q does not follow q_des (correlation {response.correlation:.2f} at the best shift)"
        yield f"{fact}; q and q_des are of different joints, motions or clocks, or q is damaged: check the columns"
    elif response is not None:
        ends = [(float(x.min()), float(x.max())) for x in (joined(grids, "q"), joined(grids, "command"))]
        apart = ends[0][0] >= 0 >= ends[1][1] or ends[1][0] >= 0 >= ends[0][1]
        yield from _response(audit, response, grids[0].period, float(np.std(joined(parts, "q"))), apart)
    if response is not None and response.correlation > FOLLOWS:
        yield from _unlike(audit, response, parts, grids)
    yield from _log(audit, parts)
    noisy = audit.command_noise > NOISE * audit.range
    faults = judge_columns(_columns(audit, parts)[: 1 if noisy else 2])
    outlying = ("spikes", "drop-outs", "skipping position") if jumps(parts)[0] else ()
    kept = [fault for fault in faults if fault.kind not in outlying]
    yield from (fault.sentence for fault in kept)
    seconds, sweeps = stuck(parts, audit.range)
    still = any(fault.kind == "stuck position" for fault in kept)
    if sweeps > SWEEPS and not still and not noisy and not abs(audit.shift) > MAX_SHIFT:
        fact = f"{audit.joint}: q stays the same for {seconds:.3g} s while q_des moves"
        yield f"{fact}: the sensor is stuck, or the drive is off; leave these rows out or mark them (on_J)"


def _unlike(audit: JointAudit, response: Response, parts: Sequence[Part], grids: Sequence[Grid]) -> Iterator[str]:
    """A flag of a position or command that is like the other one, but for a drift, a factor or coarse levels."""
    rows = course(parts, grids, max(response.shift, 0.0) if np.isfinite(response.shift) else 0.0)
    if moved := drift(rows, audit.range):
        fact = f"{audit.joint}: the zero of q drifts by {_length(moved, audit)} against q_des over the recording"
        yield f"{fact}: the encoder slips or loses counts; check it, or use short stretches"
    if response.correlation <= AGAINST:
        return
    plain = audit.residual < CLEAN or not SCALES[0] < response.scale < SCALES[1]  # said already
    if not plain and abs((factor := scaled(rows, audit.unit, audit.bandwidth)) - 1) > GAIN:
        fact = f"{audit.joint}: q is {factor:.3g} of q_des, at every angle"
        yield f"{fact}, which no load explains; check units, gear ratio and scale of both columns"
    if levels := ahead(grids, audit.range):
        fact = f"{audit.joint}: q follows steps of q_des of {_length(levels, audit)} before they are made"
        yield f"{fact}: q_des is rounded; record the command that is sent, with all its digits"


def _curve(response: Response, grids: Sequence[Grid]) -> str:
    """Name the one of q and q_des that is the magnitude or square of the other; "" if none is."""
    ends = [(float(x.min()), float(x.max())) for x in (joined(grids, "q"), joined(grids, "command"))]
    straight, best, said = 1 - abs(response.correlation), CERTAIN, ""
    pairs = (("q", "q_des", ends, grids), ("q_des", "q", ends[::-1], [Grid(x.period, x.command, x.q) for x in grids]))
    for one, other, ((low, _), (least, most)), unit in pairs:
        if straight < 1 - CERTAIN or low < 0 or not least < -BOTH * (most - least) < 0 < BOTH * (most - least) < most:
            continue
        for name, change in (("magnitude", np.abs), ("square", np.square)):
            r = best_shift([grid._replace(command=change(grid.command)) for grid in unit]).correlation
            if r > best and 1 - r < CURVED * straight:
                best, said = r, f"{one} is never negative and like the {name} of {other} (correlation {r:.3f})"
    return said


def _response(audit: JointAudit, response: Response, period: float, spread: float, apart: bool) -> Iterator[str]:
    """Flags of the answer to the command.

    spread: standard deviation of the position [rad or m]; apart: position and command have no sign in common.
    """
    joint = audit.joint
    if response.correlation < -FOLLOWS:
        fact = f"{joint} moves against its command (correlation {response.correlation:.2f})"
        other = "" if response.correlation < -AGAINST else ", or the two are of different times or motions"
        lost = ", or is a magnitude or a square" if apart else ""
        yield f"{fact}: q or q_des has the wrong sign{lost}{other}; negate one of them in a column map (--columns)"
        return
    if response.shift < -LEAD * period and response.correlation > CERTAIN and abs(response.scale - 1) < STIFF:
        fact = f"{joint}: q leads q_des by {-1e3 * response.shift:.0f} ms"
        yield f"{fact}, which no drive can do; the two are from different clocks or rows: correct the log"
    if response.shift > MAX_SHIFT:
        fact = f"{joint} answers {1e3 * response.shift:.0f} ms after its command"
        yield f"{fact}, later than a drive; q_des is from earlier rows than q, or from another clock: correct the log"
    if response.delay > max(MIN_COMMAND_DELAY, 3 * period) and response.residual < EXACT:
        fact = f"{joint} begins to answer {1e3 * response.delay:.0f} ms after its command"
        yield f"{fact}: a slow bus, or q_des is from earlier rows than q; check the log"
    if response.correlation > CERTAIN and not SCALES[0] <= response.scale <= SCALES[1]:
        near = next((k for k in (180 / pi, pi / 180) if abs(response.scale / k - 1) < DEGREES), None)
        why = "one is in degrees and the other in rad" if near else "they have different units or gear ratios"
        yield f"{joint}: q moves by {response.scale:.3g} of q_des: {why}; state the units in a column map (--columns)"
    elif audit.residual < CLEAN and min(abs(response.gain - 1), abs(response.scale - 1)) > GAIN:
        fact = f"{joint}: q moves by {response.gain:.3g} of q_des throughout"
        weak = ", unless a load holds a weak drive back" if response.gain < 1 else ""
        yield f"{fact}, which friction does not explain; check units, gear ratio and scale of both columns{weak}"
    elif _shifted(audit, response, spread):
        fact = f"{joint} stays {_length(abs(audit.zero), audit)} {'below' if audit.zero > 0 else 'above'} its command"
        yield f"{fact} over its whole motion: the zeros of q and q_des differ, or a load pulls at it"


def _shifted(audit: JointAudit, response: Response, spread: float) -> bool:
    gain = response.gain if np.isfinite(response.gain) else response.scale
    least = ZERO_LEAST if audit.unit in ("rad", "m") else 0.0
    if abs(audit.zero) > max(least, audit.range) and abs(gain - 1) < STIFF:
        return True
    if abs(gain - 1) >= SCALE_TOLERANCE or not audit.residual < QUIET:
        return False
    if abs(audit.zero) > max(least, ZERO * audit.range):
        return True
    varies = LOAD * audit.range**2 * abs(audit.zero)  # the torque of a load is a cosine of the angle
    steady = audit.range > MIN_LOAD_RANGE and audit.residual * spread < STEADY * varies
    return audit.unit == "rad" and abs(audit.zero) > least and steady


def _log(audit: JointAudit, parts: Sequence[Part]) -> Iterator[str]:
    joint = audit.joint
    count, size = jumps(parts)
    if count:
        turn = turn_of(size, audit.unit)
        why = "the encoder wraps around" if turn else "the position wraps around, or rows are damaged"
        times = "once" if count == 1 else f"{count} times"
        yield f"{joint}: q jumps {times} by {_length(size, audit)} from row to row: {why}; unwrap it"
    if audit.held > HELD:
        fact = f"{joint}: {audit.held:.0%} of the moving rows repeat the position before"
        yield f"{fact}; q is read less often than rows are written, so lag and delay are too long by part of a row"
    if audit.command_noise > NOISE * audit.range:
        fact = f"{joint}: q_des has noise of {_length(audit.command_noise, audit)}"
        yield f"{fact}, {audit.command_noise / audit.range:.0%} of its range; record the command that is sent"


def _columns(audit: JointAudit, parts: Sequence[Part], weak: bool = False) -> list[Column]:
    """Position and command of one joint."""
    t, q, command = ([getattr(part, key) for part in parts] for key in ("t", "q", "command"))
    position = Column(audit.joint, "position", f"{audit.joint}: q", audit.unit, t, q, command, weak=weak)
    return [position, Column(audit.joint, "command", f"{audit.joint}: q_des", audit.unit, t, command, weak=weak)]


def judge_stamps(recordings: Sequence[Recording], clocks: Sequence[RowClock]) -> Iterator[str]:
    """Flags of the time stamps of recordings."""
    for recording, clock in zip(recordings, clocks, strict=True):
        name = recording.path or "the recording"
        if clock.back:
            yield f"{name}: time goes back in {clock.back} rows; sort the rows, or record with one clock"
        if clock.repeated > REPEATED * len(recording):
            yield f"{name}: {clock.repeated} rows repeat the time of the row before; write the time with more digits"
        if clock.uneven > UNEVEN:
            fact = f"{name}: {clock.uneven:.0%} of the time steps differ by half from their median"
            yield f"{fact}, {1e3 * clock.period:.3g} ms; log at a steady rate, or delay is known to a step only"


def _length(value: float, audit: JointAudit) -> str:
    return f"{value:.3g} {audit.unit}".rstrip()
