"""What a person sees besides the result: progress, warnings, the sentence of an error."""

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
LONGEST = 390  # characters
BRIEF, LITTLE = 1.0, 0.03  # [s] and share done, less says nothing about the time that is left
NEAR = 5.0  # times the time that is left: a time limit beyond is not shown


def complain(sentence: str) -> None:
    """One line on standard error, its middle left out where names make it endless."""
    line = " ".join(sentence.split())
    if len(line) > LONGEST:
        line = f"{line[: LONGEST - 150]} ... {line[-145:]}"
    sys.stderr.write(f"signid: {line}\n")


@contextmanager
def bars(quiet: bool, one: bool = False) -> Iterator[Progress | None]:
    """Bars on standard error, if a person looks at it: one for each thing that is done, or a single one for all."""
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

        def show(what: str, share: float) -> None:
            which, now = "" if one else what, time.monotonic()
            if which not in tasks:
                tasks[which], begun[which] = bars.add_task(what, total=1.0, left=""), (now, share)
            left = remaining(now - begun[which][0], share - begun[which][1], 1 - share, end - now)
            bars.update(tasks[which], completed=share, description=what, left=left)

        yield show


def remaining(elapsed: float, done: float, rest: float, limit: float) -> str:
    """The time that is left: as the share done so far suggests, and at most until the time limit.

    Args:
        elapsed: since the first report [s].
        done: share that was done since then [1].
        rest: share that is to be done [1].
        limit: until the time limit; infinite where there is none [s].
    """
    if rest <= 0:
        return ""
    guess = elapsed * rest / done if elapsed >= BRIEF and done >= LITTLE else float("inf")
    known = [f"about {_spell(guess)}"] if guess < limit else []
    if limit < float("inf") and (not known or limit < NEAR * guess):
        known.append(f"at most {_spell(limit)}")
    return f"{', '.join(known)} left" if known else ""


def _spell(seconds: float) -> str:
    """Seconds below two minutes, else minutes."""
    return f"{max(seconds, 0.0):.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def tell_flags(flags: Sequence[str]) -> int:
    """Flags on standard error, and the exit code that goes with them."""
    for flag in flags:
        complain(flag)
    return FLAGGED if flags else DONE
