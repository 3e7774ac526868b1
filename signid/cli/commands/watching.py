"""The command `watch`."""

from __future__ import annotations

import json as codec
import sys
from collections import deque
from contextlib import ExitStack
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import command, option
from ..arguments import given_model
from ..options import Columns, Json, Mcap, Rrd, SimulationArguments
from ..terminal import DONE, FLAGGED, check_unread, write_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.table import Table

    from ...watch import Event, Watcher

LINES = 12  # events that the live view shows
RATE = 10.0  # [Hz] of the live view


@dataclass(frozen=True, kw_only=True)
class WatchOptions:
    """The stream, and the stretch that gives the noise."""

    follow: bool = option(False, "Read the file on as it grows, like tail -f.", "--follow", "-f")
    quiet: float = option(10.0, "Motion without contacts at the beginning, which gives the noise [s].", metavar="S")
    idle: float | None = option(
        None, "End a live stream after this time without rows [s]. Default: never.", metavar="S"
    )
    columns: Columns = None
    mcap: Mcap = None
    rrd: Rrd = None
    publish: bool = option(
        False, "Publish external torque, events and contacts on ROS 2 topics /signid/...", "--publish"
    )


@command("signid watch 3r recording.csv --json")
def watch(
    simulation: SimulationArguments,
    stream: Annotated[
        str,
        typer.Argument(metavar="STREAM", help="A recording, a file (--follow), - (standard input), or ros:/TOPIC."),
    ],
    watching: WatchOptions,
    json: Json = False,
) -> int:
    """Watch a robot at work: contacts, and lasting changes.

    A momentum observer compares torque with the model, usually the model.json of signid identify. Thresholds follow
    from the covariance of the model and from a first stretch of motion without contacts. Standard input and files that
    grow hold CSV with a header, or JSON objects, one per line. Events appear as lines of JSON, in a terminal as a live
    view. Ctrl-C ends the watch.

    --mcap and --rrd write torque, residuals, thresholds, events and the moving robot as a log.
    """
    from ...output.viewers import WatchLogs, check_ros
    from ...watch import open_watch, stream_flags
    from ..files import check_logs

    files = check_logs(rrd=watching.rrd, mcap=watching.mcap)
    for kind, path in files.items():
        check_unread(path, [stream, watching.columns, simulation.simulation, simulation.actuators], f"--{kind}")
    if watching.publish:
        check_ros()
    model, _ = given_model(simulation)
    idle, flags = _idle(watching.idle), tuple[str, ...]()
    with ExitStack() as stack:
        try:
            watcher, opened = open_watch(
                model, stream, watching.quiet, columns=watching.columns, follow=watching.follow, idle=idle
            )
            logs = None
            if files or watching.publish:
                folders = simulation.package_dir or ()
                logs = stack.enter_context(WatchLogs(watcher.model, files, watching.publish, _sentence, folders))
            for flag in (flags := stream_flags(watcher.model, opened)):
                write_error(flag)
            live = not json and sys.stdout.isatty()
            emit, refresh = _view(watcher, stack) if live else (_print, None)
            for rows in opened.chunks:
                if rows is not None and len(rows.t):
                    emit(found := watcher.feed(*rows))
                    if logs is not None:
                        logs.take(watcher.blocks, found)
                if refresh is not None:
                    refresh()
            emit(found := watcher.finish())
            if logs is not None:
                logs.take((), found)
            if not flags and (fault := watcher.fault()):
                flags = (*flags, fault)
                write_error(f"{'standard input' if stream == '-' else stream}: {fault}")
        except KeyboardInterrupt:
            pass
    return FLAGGED if flags else DONE


def _idle(seconds: float | None) -> float:
    if seconds is not None and not seconds > 0:
        raise OptionError(f"--idle is {seconds:g}; give a positive time in seconds")
    return float("inf") if seconds is None else seconds


def _print(events: list[Event]) -> None:
    from ...output.report import Screen

    if events:
        lines = (codec.dumps(event.document(), ensure_ascii=False, allow_nan=False) for event in events)
        Screen().write("".join(f"{line}\n" for line in lines))


def _view(watcher: Watcher, stack: ExitStack) -> tuple[Callable[[list[Event]], None], Callable[[], None]]:
    """Live view on the terminal: functions that take events, and that refresh it."""
    import time

    from rich.live import Live

    from ...output.report import Screen

    seen: deque[str] = deque(maxlen=LINES)
    live = stack.enter_context(Live(_table(watcher, seen), console=Screen(), auto_refresh=False))
    last = [0.0]

    def emit(events: list[Event]) -> None:
        seen.extend(_sentence(event) for event in events)
        if events:
            live.update(_table(watcher, seen), refresh=True)

    def refresh() -> None:
        if time.monotonic() - last[0] > 1 / RATE:
            last[0] = time.monotonic()
            live.update(_table(watcher, seen), refresh=True)

    return emit, refresh


def _table(watcher: Watcher, seen: deque[str]) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    title, lines = f"{watcher.model.robot.name} at {watcher.t:.2f} s", "\n".join(seen)
    table = Table(box=SIMPLE_HEAD, title=title, caption=lines, caption_justify="left", expand=True)
    for k, name in enumerate(("joint", "residual", "threshold", "")):
        table.add_column(name, justify="left" if k in (0, 3) else "right")
    robot = watcher.model.robot
    for j, name in enumerate(robot.joints):
        r, most = float(watcher.residual[j]), float(watcher.threshold[j])
        share = min(abs(r) / most, 1.0) if most > 0 else 0.0
        unit = "N" if robot.prismatic[j] else "N.m"
        table.add_row(name, f"{r:.3f} {unit}", f"{most:.3f}" if most > 0 else "-", "#" * round(20 * share))
    return table


def _sentence(event: Event) -> str:
    from ...watch import Contact, LastingChange, Note

    if isinstance(event, Contact):
        most = max(event.torque.values(), key=abs, default=0.0)
        when = f"{event.start:.3f} s" if event.end is None else f"{event.start:.3f} to {event.end:.3f} s"
        return f"contact at {event.link} ({', '.join(event.joints)}), {most:.3g} N.m, {when} {event.cause}"
    if isinstance(event, LastingChange):
        return f"{event.t:.2f} s: {event.sentence} (probability {event.probability:.3f})"
    return f"{event.t:.2f} s: {event.sentence}" if isinstance(event, Note) else ""
