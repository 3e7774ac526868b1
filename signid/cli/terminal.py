"""Terminal output: results and written files, progress bars, flags and errors; and early checks of destinations."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..deadline import seconds_left
from ..errors import OptionError

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..types import Array, Progress

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


def show(shown: str | Sequence[RenderableType], flags: Sequence[str] = (), written: Sequence[Path] = ()) -> int:
    """Print a JSON document, or tables and the paths of written files; report flags; return the exit code."""
    from ..output.report import Screen

    if isinstance(shown, str):
        Screen().write(shown)
    else:
        Screen().print(*shown, sep="\n")
    for flag in flags:
        write_error(flag)
    if written and not isinstance(shown, str):
        Screen().write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    return FLAGGED if flags else DONE


@contextmanager
def bars(quiet: bool, one: bool = False) -> Iterator[Progress | None]:
    """Show progress bars on standard error if it is a terminal: one per stage, or a single one for all."""
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

        def report(stage: str, share: float) -> None:
            which, now = "" if one else stage, time.monotonic()
            if which not in tasks:
                tasks[which], begun[which] = bars.add_task(stage, total=1.0, left=""), (now, share)
            left = remaining(now - begun[which][0], share - begun[which][1], 1 - share, end - now)
            bars.update(tasks[which], completed=share, description=stage, left=left)

        yield report


def remaining(elapsed: float, done: float, rest: float, limit: float) -> str:
    """Remaining time [s] of the share `rest`, after `done` in the time since the first report, within a time limit."""
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


def check_folder(output: str | None, json: bool) -> None:
    """Check that results can be written to a folder, which is not needed if they are printed as JSON.

    Raises:
        OptionError: no folder was named.
    """
    from ..output.report import probe_folder

    if output == "" or (output is None and not json):
        raise OptionError("no folder for the results was named; add -o DIR, or --json to print them instead")
    if output is not None:
        probe_folder(output)


def check_file(output: str | None, json: bool) -> None:
    """Check that a recording can be written to a file, which is not needed if a summary is printed as JSON.

    Raises:
        OptionError: no file was named.
    """
    from ..output.report import probe_folder
    from ..recording.formats import find_format

    if output == "" or (output is None and not json):
        raise OptionError("no file for the result was named; add -o FILE, or --json to print a summary instead")
    if output is not None:
        form = find_format(Path(output))
        if not form.writes:
            form.encode({}, output)
        probe_folder(Path(output).parent)


def write_columns(output: str | None, columns: Mapping[str, Array]) -> Sequence[Path]:
    """Write columns to a file, if one was named; it appears when complete.

    columns: (N,) each, by name [units of the columns of these names].
    """
    from ..output.report import write_files
    from ..recording.formats import find_format

    if output is None:
        return []
    path = Path(output)
    return write_files(path.parent, {path.name: find_format(path).encode(columns, path.name)})
