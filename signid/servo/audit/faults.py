"""Faults of logs: repeated, wrapped and stuck positions, spikes, copies of commands, saturation, noise."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...types import Array, Mask
from .tracks import Grid, Part

TINY = 1e-9  # [1] share of the range of motion below which a step is rounding
JUMP = 3.0  # steps of the encoder that count as motion between two rows
FULL = 0.98  # duty that counts as saturated
TOP, APART, RUN = 0.93, 0.4, 3  # speed at its limit [1]; difference from the commanded one [1]; rows
FASTEST = 0.999  # quantile of the speed that is its limit
WRAPPED = 0.05  # tolerance of a full turn [1]
OUTLIER = 20.0  # jumps over the 99.9 % quantile of the others that are no motion
COPY, SHIFTS = 1e-6, range(-3, 4)  # [1] of the range of motion; rows
ALTERNATES = -0.5  # largest correlation of successive second differences of white noise, which have -2/3
SPIKE, USUAL = 0.12, 8.0  # size of a spike over the range [1] and over the median step [1]; healthy logs: below .11
OUTER = 0.01  # [1] quantile at both ends that the range leaves out
FEW_LEVELS = 10  # values of a command that jumps between levels, whose short pulses are no spikes
STILL, SWEEP = 1.0, 0.5  # [s] and [range] of motion of the command during which a position that repeats is stuck
BASE, LATEST = 0.03, 0.15  # [s] over which a speed is computed; largest delay of a speed after the error
TO_STD = 1.4826 / np.sqrt(6.0)  # of the median size of the second differences of white noise


def quantum(parts: Sequence[Part]) -> float:
    """Smallest step of the position [rad or m]."""
    steps = np.concatenate([np.abs(np.diff(part.q)) for part in parts])
    size = max(float(np.ptp(part.q)) for part in parts)
    moved = steps[steps > TINY * size]
    return float(moved.min()) if len(moved) else 0.0


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
    usual = float(np.quantile(near, FASTEST)) if len(near) else 0.0
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


def spikes(parts: Sequence[Part], key: str) -> tuple[int, float]:
    """Number of rows that jump away and back at once, and the largest such jump [rad or m]; key: "q" or "command"."""
    x = np.concatenate([getattr(part, key) for part in parts])
    low, high = np.quantile(x, [OUTER, 1 - OUTER])
    steps = [np.diff(getattr(part, key)) for part in parts]
    limit = max(SPIKE * float(high - low), USUAL * float(np.median(np.abs(np.concatenate(steps)))))
    back = [np.minimum(np.abs(d[1:]), np.abs(d[:-1])) * (d[1:] * d[:-1] < 0) for d in steps]
    sizes = np.concatenate(back)
    levels = key == "command" and len(np.unique(x)) <= FEW_LEVELS
    found = sizes[sizes > max(limit, TINY)]
    return (0, 0.0) if levels or not len(found) else (len(found), float(found.max()))


def stuck(parts: Sequence[Part], span: float) -> tuple[float, float]:
    """Duration [s] and motion of the command over its range [1] of the stretch in which q repeats most; span: range."""
    longest = (0.0, 0.0)
    for part in parts:
        edges = np.flatnonzero(np.concatenate([[True], np.diff(part.q) != 0, [True]]))
        for low, high in zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True):
            seconds, command = float(part.t[high - 1] - part.t[low]), part.command[low:high]
            if seconds > STILL and np.ptp(command) > SWEEP * span:
                longest = max(longest, (seconds, float(np.abs(np.diff(command)).sum()) / span), key=lambda x: x[1])
    return longest


def driven_by_error(grids: Sequence[Grid]) -> float:
    """Largest correlation [1] of the speed with the error q_des - q shortly before, which saturated drives have too."""
    period = grids[0].period
    k, best = max(1, round(BASE / period)), 0.0
    long = [grid for grid in grids if len(grid.q) > 4 * k + LATEST / period + 2]
    for late in range(round(LATEST / period) + 1) if long else ():
        speed = np.concatenate([(grid.q[2 * k :] - grid.q[: -2 * k])[late:] for grid in long])
        errors = [(grid.command - grid.q)[k : len(grid.q) - k] for grid in long]
        error = np.concatenate([each[: len(each) - late] for each in errors])
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
    speeds = [(_speed(grid.q, grid.period), _speed(grid.command, grid.period)) for grid in grids]
    top = float(np.quantile(np.abs(np.concatenate([v for v, _ in speeds])), FASTEST))
    if top <= 0:
        return 0.0
    found = rows = 0
    for v, wanted in speeds:
        high = (np.abs(v) >= TOP * top) & (np.abs(wanted - v) >= APART * top)
        found += sum(run for run in _runs(np.asarray(high)) if run >= RUN)
        rows += len(v)
    return found / rows


def _runs(mask: Mask) -> list[int]:
    edges = np.flatnonzero(np.diff(np.concatenate([[0], mask.astype(int), [0]])))
    return list((edges[1::2] - edges[::2]).tolist())


def _speed(x: Array, period: float) -> Array:
    """Speed over about 60 ms, (N - k,) [1/s]."""
    k = max(2, min(len(x) - 1, round(0.06 / period)))
    return (x[k:] - x[:-k]) / (k * period)


def rms_speed(grids: Sequence[Grid]) -> float:
    """Rms of the speed over about 60 ms [rad/s or m/s]."""
    return float(np.sqrt(np.mean(np.concatenate([_speed(grid.q, grid.period) for grid in grids]) ** 2)))


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
