"""What is wrong with a recording, and what is worth knowing about it, a sentence each."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...types import Array, Recording, Robot
from .accumulate import Tally
from .clock import likely_unit

FEWEST = 20  # samples
REPEATED = 0.01  # share of the rows that may repeat a time
FAR, RANGES = 6.5, 2.0  # rad (more than a turn) and ranges of motion: positions that far outside may be degrees
SPIN, RACE = 60.0, 50.0  # rad, rad/s: beyond both, a joint without limits seems to be in degrees
DEGREE = np.pi / 180
MILLISECONDS, CRAWL = 0.5, 0.05  # s, rad/s: whole steps this long and motion this slow are milliseconds
HUGE = 1e9  # rad, m, N.m or N: no robot's
STILL = 1e-9  # rad or m
BRIDGE = "signid convert --drop-missing bridges short holes"


class Facts(NamedTuple):
    """What the pass over a recording found."""

    name: str
    recording: Recording
    robot: Robot
    tally: Tally
    missing: Mapping[str, int]  # values, by column
    incomplete: int  # rows
    repeated: int  # rows

    @property
    def speed(self) -> Array:
        """(n,) [rad/s or m/s] root mean square."""
        return np.asarray(np.sqrt(self.tally.total.motion / max(1, self.tally.total.velocities)))

    @property
    def moves(self) -> Array:
        """(n,) [1] whether a joint moved at all."""
        return np.asarray(self.tally.total.upper - self.tally.total.lower > STILL)

    @property
    def revolute(self) -> tuple[bool, ...]:
        """(n,) of each joint."""
        return tuple(not self.robot.prismatic[self.robot.index(joint)] for joint in self.recording.joints)

    @property
    def limits(self) -> tuple[Array, Array]:
        """(n,) each [rad or m]; infinite where the description states none or one that leaves no room."""
        place = [self.robot.index(joint) for joint in self.recording.joints]
        lower, upper = self.robot.lower[place], self.robot.upper[place]
        return np.where(lower < upper, lower, -np.inf), np.where(lower < upper, upper, np.inf)


def refuse(facts: Facts) -> None:
    """Stop at what makes a recording unusable.

    Raises:
        RecordingError: with one sentence about the first thing found.
    """
    for fault in _faults(facts):
        raise RecordingError(f"{facts.name}: {fault}")


def _faults(facts: Facts) -> Iterator[str]:
    rows, clock = len(facts.recording), facts.tally.clock
    for column, count in facts.missing.items():
        if count == rows:
            yield f"column {column!r} holds no value at all; fill it or leave it out"
    if facts.repeated > REPEATED * rows:
        share = f"{facts.repeated} of {rows} samples repeat the time of the sample before"
        yield f"{share}; write the time with more digits, or once for each sample"
    used = facts.tally.total.samples
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
    yield from _no_robots(facts)


def _degrees(facts: Facts) -> Iterator[str]:
    total, (lower, upper) = facts.tally.total, facts.limits
    names = facts.recording.columns["q"]
    for j in np.flatnonzero(facts.revolute):
        low, high = total.lower[j], total.upper[j]
        reach, advice = f"column {names[j]!r} goes from {low:.4g} to {high:.4g}", "convert it to radians"
        if np.isfinite(lower[j]) and np.isfinite(upper[j]):
            fits = low * DEGREE > lower[j] - 0.1 and high * DEGREE < upper[j] + 0.1
            beyond = max(high - upper[j], lower[j] - low)
            too_fast = facts.speed[j] > facts.robot.velocity_limit[facts.robot.index(facts.recording.joints[j])]
            if fits and beyond > FAR and (too_fast or beyond > RANGES * (upper[j] - lower[j])):
                yield f"{reach}, limits are {lower[j]:.4g} to {upper[j]:.4g} rad: it is in degrees; {advice}"
        elif high - low > SPIN and facts.speed[j] > RACE:
            yield f"{reach} at {facts.speed[j]:.4g} each second: it seems to be in degrees; {advice}"


def _dead_torques(facts: Facts) -> Iterator[str]:
    total = facts.tally.total
    for j, column in enumerate(facts.recording.columns["tau"]):
        if not column or total.least[j] != total.most[j]:
            continue
        joint = facts.recording.joints[j]
        if total.most[j] == 0:
            yield f"column {column!r} is zero throughout; record the torque of {joint}, or leave the column out"
        elif facts.moves[j]:
            yield f"column {column!r} is constant although {joint} moves; record its torque, or leave the column out"


def _no_robots(facts: Facts) -> Iterator[str]:
    total, columns = facts.tally.total, facts.recording.columns
    sizes = np.maximum(np.abs(total.lower), np.abs(total.upper)), np.sqrt(total.power / total.samples)
    for key, size in zip(("q", "tau"), sizes, strict=True):
        for column, reached in zip(columns[key], size, strict=True):
            if column and not reached < HUGE:
                yield f"column {column!r} reaches {reached:.3g}, which no robot does; check the column and its unit"


def notes(facts: Facts) -> Iterator[str]:
    """What the user should know of a recording that can be used, a sentence each."""
    tally, rows = facts.tally, len(facts.recording)
    if tally.gaps.count:
        longest = f"the longest {tally.gaps.longest:.3g} s at t = {tally.gaps.at:.6g} s"
        yield f"{_count(tally.gaps.count, 'gap')} in time split the recording, {longest}"
    if any(facts.missing.values()):
        where = ", ".join(f"{count} in {name}" for name, count in facts.missing.items() if count)
        left_out = f"{_count(facts.incomplete, 'sample')} of {rows} left out"
        yield f"values are missing ({where}); {left_out}" + (f"; {BRIDGE}" if facts.incomplete else "")
    if facts.repeated:
        yield f"{_count(facts.repeated, 'sample')} dropped whose time repeats that of the sample before"
    if not tally.uniform:
        least, most = tally.total.shortest * 1e3, tally.total.longest * 1e3
        told = f"time steps vary from {least:.4g} to {most:.4g} ms"
        yield f"{told}: resampled every {tally.clock.period * 1e3:.6g} ms by cubic interpolation"
    if tally.short:
        yield f"{_count(tally.short, 'stretch', 'es')} shorter than 8 samples or 0.5 s left out"
    yield from _joint_notes(facts)


def _joint_notes(facts: Facts) -> Iterator[str]:
    recording, (lower, upper) = facts.recording, facts.limits
    total = facts.tally.total
    wraps = {int(j) for turns in facts.tally.turns for j in np.flatnonzero(turns)}
    for j, joint in enumerate(recording.joints):
        column, unit = recording.columns["q"][j], "rad" if facts.revolute[j] else "m"
        beyond = max(total.upper[j] - upper[j], lower[j] - total.lower[j])
        if not facts.moves[j]:
            yield f"column {column} is constant: {joint} did not move"
        elif not recording.columns["tau"][j]:
            yield f"{joint} moves but has no torque column: only the torques of other joints tell of it"
        if beyond > 0:
            yield f"{joint} goes {beyond:.3g} {unit} beyond the limits of its description"
        if j in wraps:
            yield f"column {column} wraps around by whole turns: unwrapped"


def _count(number: int, word: str, plural: str = "s") -> str:
    return f"{number} {word}{plural if number != 1 else ''}"
