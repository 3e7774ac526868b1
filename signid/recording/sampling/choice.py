"""Choose the clock of a recording whose stamps are not uniform."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from ...robot import hold, resting
from ...types import Array, Frozen, Recording, Robot
from .clock import CHUNK, Clock
from .even import fit_even
from .evidence import TimedRows, second_is_better

MOST_ROWS, MOST_SECONDS = 20_000, 60.0  # part of a recording that is compared


@dataclass(frozen=True, eq=False)
class Choice(Frozen):
    """Clock of the rows of a recording.

    Kinds: `stamps`, times as recorded (even steps up to rounding, or any others, which are resampled); `even`, an even
    clock without the errors of the stamps; `ticks`, the same where rows are missing, counted by the stamps.
    """

    kind: str
    period: float  # [s] of the uniform grid
    jitter: float = 0.0  # [s] rms error of the stamps that the clock removes
    missing: int = 0  # dropped rows, without gaps
    times: Array | None = field(default=None, repr=False)  # (rows,) [s] of all rows of the file; None: its stamps

    @classmethod
    def stamps(cls, period: float) -> Choice:
        """The stamps as they are, with a period [s]."""
        return cls("stamps", period)


def choose_clock(
    recording: Recording, robot: Robot, clock: Clock, spans: Sequence[tuple[int, int]], dropped: NDArray[np.intp]
) -> Choice:
    """Choose between stamps that are not uniform, and an even clock with dropped rows.

    The even clock is a candidate if the stamps are near it (`fit_even`). Torques and positions of at most 60 s and
    20,000 rows then decide (`second_is_better`); where they do not, the stamps stay. Usable rows are those start..stop
    of the spans without the dropped: (d,) rows, which repeat a time.
    """
    column, rows = recording.columns["t"], len(recording)
    stamps = np.concatenate([recording.table.read(column, k, k + CHUNK)[:, 0] for k in range(0, rows, CHUNK)])
    known = ~np.isnan(stamps)
    known[dropped] = False
    even = fit_even(stamps[known], clock)
    if even is None:
        return Choice.stamps(clock.period)
    times = np.full(rows, np.nan)
    times[known] = even.times
    times[dropped] = times[np.flatnonzero(known)[np.searchsorted(np.flatnonzero(known), dropped) - 1]]
    part = _part(recording, robot, (stamps, times), known, spans)
    if not second_is_better(_moving(recording, robot), part, even.period):
        return Choice.stamps(clock.period)
    return Choice("ticks" if even.missing else "even", even.period, even.jitter, even.missing, times)


def _moving(recording: Recording, robot: Robot) -> Robot:
    """The robot with the joints held that the recording does not have."""
    return robot if robot.joints == recording.joints else hold(robot, resting(robot, but=recording.joints))


def _part(
    recording: Recording,
    robot: Robot,
    times: tuple[Array, Array],
    known: NDArray[np.bool_],
    spans: Sequence[tuple[int, int]],
) -> list[TimedRows]:
    """Rows of the longest stretches, in their order."""
    chosen, rows, seconds = [], 0, 0.0
    for start, stop in sorted(spans, key=lambda span: span[0] - span[1]):
        stop = min(stop, start + MOST_ROWS - rows)
        inside = start + np.flatnonzero(known[start:stop])
        late = int(np.searchsorted(times[0][inside], times[0][start] + MOST_SECONDS - seconds, side="right"))
        inside = inside[:late]
        if len(inside) < 2:
            break
        rows, seconds = rows + len(inside), seconds + float(np.ptp(times[0][inside]))
        chosen.append(inside)
    found, prismatic = [], robot.prismatic[[robot.index(joint) for joint in recording.joints]]
    for inside in sorted(chosen, key=lambda rows: int(rows[0])):
        first = int(inside[0])
        samples = recording.read(first, int(inside[-1]) + 1, servo=False)
        at = inside - first
        q = np.where(prismatic, samples.q[at], np.unwrap(samples.q[at], axis=0))
        tau = np.where(recording.signed, samples.tau[at], np.nan)
        found.append(TimedRows((times[0][inside], times[1][inside]), q, tau))
    return found
