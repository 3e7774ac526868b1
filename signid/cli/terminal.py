"""Terminal output besides the result: progress bars, flags and errors."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from ..deadline import seconds_left

if TYPE_CHECKING:
    from ..types import Progress

DONE, BROKEN, BAD, FLAGGED, INTERRUPTED = 0, 1, 2, 3, 130  # exit codes
LONGEST = 390  # length of a line on standard error [characters]
BRIEF = 1.0  # elapsed time below which no remaining time is estimated [s]
LITTLE = 0.03  # completed share below which no remaining time is estimated
NEAR = 5.0  # a time limit beyond this multiple of the estimated remaining time is not shown


def write_error(sentence: str) -> None:
    """Write one line to standard error; shorten the middle of a very long line."""
    line = " ".join(sentence.split())
    if len(line) > LONGEST:
        line = f"{line[: LONGEST - 150]} ... {line[-145:]}"
    sys.stderr.write(f"signid: {line}\n")


@contextmanager
def bars(quiet: bool, one: bool = False) -> Iterator[Progress | None]:
    """Show progress bars on standard error if it is a terminal.

    Args:
        quiet: show none.
        one: a single bar for all stages, instead of one per stage.
    """
    if quiet or not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[left]}")
    end = time.monotonic() + seconds_left()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}
        begun: dict[str, tuple[float, float]] = {}

        def show(stage: str, share: float) -> None:
            which, now = "" if one else stage, time.monotonic()
            if which not in tasks:
                tasks[which], begun[which] = bars.add_task(stage, total=1.0, left=""), (now, share)
            left = remaining(now - begun[which][0], share - begun[which][1], 1 - share, end - now)
            bars.update(tasks[which], completed=share, description=stage, left=left)

        yield show


def remaining(elapsed: float, done: float, rest: float, limit: float) -> str:
    """Remaining time, extrapolated from the completed share and bounded by the time limit.

    Args:
        elapsed: time since the first report [s].
        done: share completed since then [1].
        rest: remaining share [1].
        limit: time until the time limit, or infinity [s].
    """
    if rest <= 0:
        return ""
    guess = elapsed * rest / done if elapsed >= BRIEF and done >= LITTLE else float("inf")
    known = [f"about {_duration(guess)}"] if guess < limit else []
    if limit < float("inf") and (not known or limit < NEAR * guess):
        known.append(f"at most {_duration(limit)}")
    return f"{', '.join(known)} left" if known else ""


def _duration(seconds: float) -> str:
    """Seconds below two minutes, else minutes."""
    return f"{max(seconds, 0.0):.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def write_flags(flags: Sequence[str]) -> int:
    """Write flags to standard error; return the exit code."""
    for flag in flags:
        write_error(flag)
    return FLAGGED if flags else DONE
