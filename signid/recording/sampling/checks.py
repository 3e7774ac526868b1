"""Errors and notes about the samples of a recording, one sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...types import Array, Recording, Robot
from .accumulate import Accumulator
from .choice import Choice
from .clock import likely_unit, time_origin

FEWEST = 20  # minimum number of usable samples
REPEATED = 0.01  # accepted share of rows with a repeated time
FAR, RANGES = 6.5, 2.0  # [rad], [ranges of motion] beyond the limits from which positions may be degrees
SPIN, RACE = 60.0, 50.0  # [rad], [rad/s] beyond both, a joint without limits may be in degrees
DEGREE = np.pi / 180
MILLISECONDS, CRAWL = 0.5, 0.05  # [s], [rad/s] integer time steps this long with slower motion are milliseconds
HUGE = 1e9  # [rad, m, N.m or N] implausible magnitude for any robot
STILL = 1e-9  # [rad or m] smaller ranges count as no motion
RADIANS = 'convert it to radians, or write [units] q = "deg", on two lines, into a column map (--columns)'
BRIDGE = "signid convert --drop-missing bridges short gaps"


class Facts(NamedTuple):
    """Results of the pass over a recording."""

    recording: Recording
    robot: Robot
    accumulated: Accumulator
    missing: Mapping[str, int]  # values, by column
    incomplete: int  # rows
    repeated: int  # rows
    choice: Choice  # clock of the rows
    dead: Sequence[str]  # columns of velocities and accelerations that are zero throughout

    @property
    def speed(self) -> Array:
        """Rms velocity (n,) [rad/s or m/s]."""
        return np.asarray(np.sqrt(self.accumulated.total.motion / max(1, self.accumulated.total.velocities)))

    @property
    def moves(self) -> Array:
        """Whether each joint moved, (n,)."""
        return np.asarray(self.accumulated.total.upper - self.accumulated.total.lower > STILL)

    @property
    def place(self) -> list[int]:
        """Index of each joint in the robot."""
        return [self.robot.index(joint) for joint in self.recording.joints]

    @property
    def limits(self) -> tuple[Array, Array]:
        """Lower and upper limits, (n,) each [rad or m]; infinite where the description has no valid limits."""
        lower, upper = self.robot.lower[self.place], self.robot.upper[self.place]
        return np.where(lower < upper, lower, -np.inf), np.where(lower < upper, upper, np.inf)


def faults(facts: Facts) -> Iterator[str]:
    """Reasons why a recording is unusable."""
    rows, clock = len(facts.recording), facts.accumulated.clock
    for column, count in facts.missing.items():
        if count == rows:
            yield f"column {column!r} has no values; fill it or remove it"
    if facts.repeated > REPEATED * rows:
        share = f"{facts.repeated} of {rows} samples repeat the time of the sample before"
        yield f"{share}; write the time with more digits, or once for each sample"
    used = facts.accumulated.total.samples
    if used < FEWEST:
        least = f"at least {FEWEST} are needed, in stretches of half a second or more without a gap or a missing value"
        worst = max(facts.missing, key=lambda column: facts.missing[column], default="")
        lack = f", {facts.missing[worst]} lack {worst} ({BRIDGE})" if facts.missing.get(worst) else ""
        yield f"too short: only {used} of {rows} samples can be used{lack}; {least}"
    if not facts.moves.any():
        constant = ", ".join(facts.recording.columns["q"])
        yield f"no joint moves: position is constant in {constant}; record the robot in motion"
    yield from _degrees(facts)
    if clock.period >= MILLISECONDS and clock.step >= 1 and facts.speed.max() < CRAWL:
        unit = likely_unit(clock.period)
        yield f"time steps by {clock.period:g}, which is too slow for seconds; it looks like {unit}: convert it"
    yield from _dead_torques(facts)
    yield from _implausible(facts)


def _degrees(facts: Facts) -> Iterator[str]:
    total, (lower, upper) = facts.accumulated.total, facts.limits
    names, fastest = facts.recording.columns["q"], facts.robot.velocity_limit[facts.place]
    for j in np.flatnonzero(~facts.robot.prismatic[facts.place]):
        low, high = total.lower[j], total.upper[j]
        reach, advice = f"column {names[j]!r} goes from {low:.4g} to {high:.4g}", RADIANS
        if np.isfinite(lower[j]) and np.isfinite(upper[j]):
            fits = low * DEGREE > lower[j] - 0.1 and high * DEGREE < upper[j] + 0.1
            beyond = max(high - upper[j], lower[j] - low)
            if fits and beyond > FAR and (facts.speed[j] > fastest[j] or beyond > RANGES * (upper[j] - lower[j])):
                yield f"{reach}, limits are {lower[j]:.4g} to {upper[j]:.4g} rad: it is in degrees; {advice}"
        elif high - low > SPIN and facts.speed[j] > RACE:
            yield f"{reach} at {facts.speed[j]:.4g} each second: it seems to be in degrees; {advice}"


def _dead_torques(facts: Facts) -> Iterator[str]:
    total = facts.accumulated.total
    for j, column in enumerate(facts.recording.columns["tau"]):
        if not column or total.least[j] != total.most[j]:
            continue
        joint = facts.recording.joints[j]
        if total.most[j] == 0:
            yield f"column {column!r} is zero throughout; record the torque of {joint}, or remove the column"
        elif facts.moves[j]:
            yield f"column {column!r} is constant although {joint} moves; record its torque, or remove the column"


def _implausible(facts: Facts) -> Iterator[str]:
    total, columns = facts.accumulated.total, facts.recording.columns
    sizes = np.maximum(np.abs(total.lower), np.abs(total.upper)), np.sqrt(total.power / total.samples)
    for key, size in zip(("q", "tau"), sizes, strict=True):
        for column, reached in zip(columns[key], size, strict=True):
            if column and not reached < HUGE:
                yield f"column {column!r} reaches {reached:.3g}, an implausible value; check the column and its unit"


def notes(facts: Facts) -> Iterator[str]:
    """Notes on a usable recording, one sentence each."""
    accumulated, rows = facts.accumulated, len(facts.recording)
    if accumulated.gaps:
        length, at = accumulated.longest_gap
        origin = time_origin(facts.recording)
        longest = f"the longest {length:.3g} s at t = {at - origin:.6g} s"
        since = " since the start" if origin else ""
        yield f"{_count(accumulated.gaps, 'gap')} in time split the recording, {longest}{since}"
    if any(facts.missing.values()):
        where = ", ".join(f"{count} in {name}" for name, count in facts.missing.items() if count)
        omitted = f"{_count(facts.incomplete, 'sample')} of {rows} omitted"
        yield f"values are missing ({where}); {omitted}" + (f"; {BRIDGE}" if facts.incomplete else "")
    if facts.repeated:
        yield f"{_count(facts.repeated, 'sample')} dropped: same time as the previous sample"
    if facts.choice.times is not None:
        yield _even(facts.choice)
    elif not accumulated.uniform:
        least, most = accumulated.total.shortest * 1e3, accumulated.total.longest * 1e3
        fact = f"time steps vary from {least:.4g} to {most:.4g} ms"
        yield f"{fact}: resampled every {accumulated.clock.period * 1e3:.6g} ms by cubic interpolation"
    if accumulated.short:
        yield f"{_count(accumulated.short, 'stretch', 'es')} shorter than 8 samples or 0.5 s omitted"
    yield from _joint_notes(facts)
    yield from _dead_derivatives(facts)


def _even(choice: Choice) -> str:
    """The clock that takes the place of the stamps."""
    jitter, period = choice.jitter * 1e3, choice.period * 1e3
    fact = f"stamps of time jitter by {jitter:.2g} ms rms around an even clock of {period:.5g} ms"
    lost = (
        f", {_count(choice.missing, 'row')} {'is' if choice.missing == 1 else 'are'} missing" if choice.missing else ""
    )
    return f"{fact}; the even clock is used{lost}"


def _joint_notes(facts: Facts) -> Iterator[str]:
    recording, (lower, upper) = facts.recording, facts.limits
    total = facts.accumulated.total
    wraps = {int(j) for turns in facts.accumulated.turns for j in np.flatnonzero(turns)}
    spans = facts.accumulated.spans
    for j, joint in enumerate(recording.joints):
        column, unit = recording.columns["q"][j], "m" if facts.robot.prismatic[facts.place[j]] else "rad"
        beyond = max(total.upper[j] - upper[j], lower[j] - total.lower[j])
        if not facts.moves[j]:
            yield f"column {column} is constant: {joint} did not move"
        elif not recording.columns["tau"][j]:
            yield f"{joint} moves but has no torque column: only the torques of other joints depend on its parameters"
        if beyond > 0:
            yield f"{joint} goes {beyond:.3g} {unit} beyond the limits of its description"
        if j in wraps:
            by = "full turns" if abs(spans[j] - 2 * np.pi) < 1e-9 else f"{spans[j]:.5g} {unit}"
            yield f"column {column} wraps around by {by}: unwrapped"


def _dead_derivatives(facts: Facts) -> Iterator[str]:
    """Recorded velocities and accelerations that are zero while their joints move."""
    for key, word in (("dq", "velocities"), ("ddq", "accelerations")):
        columns = zip(facts.recording.columns.get(key, ()), facts.moves, strict=False)
        if dead := [name for name, moves in columns if moves and name in facts.dead]:
            yield f"{', '.join(dead)}: zero throughout although the joints move; {word} are computed from positions"


def _count(number: int, word: str, plural: str = "s") -> str:
    return f"{number} {word}{plural if number != 1 else ''}"
