"""What a person sees besides the result: progress, warnings, the sentence of an error."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from ..session import Progress

DONE, BROKEN, BAD, FLAGGED, INTERRUPTED = 0, 1, 2, 3, 130  # exit codes
LONGEST = 390  # characters


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
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TimeRemainingColumn()
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def show(what: str, share: float) -> None:
            which = "" if one else what
            if which not in tasks:
                tasks[which] = bars.add_task(what, total=1.0)
            bars.update(tasks[which], completed=share, description=what)

        yield show


def tell_flags(flags: Sequence[str]) -> int:
    """Flags on standard error, and the exit code that goes with them."""
    for flag in flags:
        complain(flag)
    return FLAGGED if flags else DONE
