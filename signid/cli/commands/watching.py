"""The command `watch`."""

from __future__ import annotations

import json as codec
import sys
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import Columns, Json, Mcap, Rate, Rrd, SimulationArguments, command, option
from ..arguments import given_model
from ..terminal import DONE, FLAGGED, check_unread, write_error

if TYPE_CHECKING:
    from collections.abc import Callable

    from rich.table import Table

    from ...model import Model
    from ...types import Robot
    from ...watch import Event, Watcher

VIEW_RATE = 10.0  # [Hz] of the live view


@dataclass(frozen=True, kw_only=True)
class WatchOptions:
    """The stream, and the stretch that gives the noise."""

    follow: bool = option(False, "Read the file on as it grows, like tail -f.", "--follow", "-f")
    quiet: float = option(10.0, "Motion without contacts at the beginning, which gives the noise [s].", metavar="S")
    sensitivity: float = option(1.0, "2 halves the thresholds of contacts, 0.5 doubles them.", metavar="FACTOR")
    save: Path | None = option(None, "Write model.json with the load that was named. Default: none.", metavar="FILE")
    idle: float | None = option(
        None, "End a live stream after this time without rows [s]. Default: never.", metavar="S"
    )
    columns: Columns = None
    rate: Rate = None
    mcap: Mcap = None
    rrd: Rrd = None


@command("signid watch 3r recording.csv --json")
def watch(
    simulation: SimulationArguments,
    stream: Annotated[
        str, typer.Argument(metavar="STREAM", help="A recording, a file (--follow), - (standard input), or ros:/TOPIC.")
    ],
    watching: WatchOptions,
    json: Json = False,
) -> int:
    """Watch a robot at work: contacts, and lasting changes.

    A momentum observer compares torque with the model, usually the model.json of signid identify. Thresholds follow
    from the covariance of the model and from a first stretch of motion without contacts. Standard input and files that
    grow hold CSV with a header, or JSON objects, one per line. Events appear as lines of text above a live view in a
    terminal, else as lines of JSON. Ctrl-C ends the watch.

    --mcap and --rrd write torque, residuals, thresholds, events and the moving robot as a log.

    Raises:
        OptionError: --idle is not positive.
    """
    from ...output.report import probe_folder
    from ...watch import Note, open_watch, stream_flags
    from ..terminal import check_logs

    files = check_logs(rrd=watching.rrd, mcap=watching.mcap)
    for kind, path in {**files, "save": watching.save}.items():
        if path is not None:
            check_unread(path, [stream, watching.columns, simulation.simulation, simulation.actuators], f"--{kind}")
    model, _ = given_model(simulation)
    idle, flags = float("inf") if watching.idle is None else watching.idle, list[str]()
    if not idle > 0:
        raise OptionError(f"--idle is {idle:g}; give a positive time in seconds")
    with ExitStack() as stack:
        try:
            if watching.save is not None:
                if watching.save.suffix != ".json":
                    raise OptionError(f"--save is {watching.save}; give a name that ends in .json")
                probe_folder(watching.save.parent)
            watcher, opened = open_watch(
                model,
                stream,
                watching.quiet,
                watching.sensitivity,
                columns=watching.columns,
                rate=watching.rate,
                follow=watching.follow,
                idle=idle,
            )
            stack.callback(_save, model, watcher, watching.save)
            logs = None
            if files:
                from ...output.viewers import WatchLogs

                robot, packages = watcher.model.robot, simulation.package_dir or ()
                logs = WatchLogs(watcher.model, files, lambda event: sentence(event, robot).strip(), packages)
                stack.enter_context(logs)
            live = not json and sys.stdout.isatty()
            emit, refresh = _view(watcher, stack) if live else (_print, None)
            flags = watcher.flags
            flags += stream_flags(watcher.model, opened)
            emit([Note(0.0, flag) for flag in flags])
            for rows in opened.chunks:
                if rows is not None and len(rows.t):
                    emit(found := watcher.feed(*rows))
                    if logs is not None:
                        logs.take(watcher.blocks, found)
                if refresh is not None:
                    refresh()
            emit(found := watcher.finish())
            if logs is not None:
                logs.take(watcher.blocks, found)
            if not flags and (fault := watcher.fault()):
                flags.append(f"{'standard input' if stream == '-' else stream}: {fault}")
        except KeyboardInterrupt:
            pass
    for flag in flags:
        write_error(flag)
    return FLAGGED if flags else DONE


def _print(events: list[Event]) -> None:
    from ...output.report import Screen

    if events:
        lines = (codec.dumps(event.document(), ensure_ascii=False, allow_nan=False) for event in events)
        Screen().write("".join(f"{line}\n" for line in lines))


def _save(model: Model, watcher: Watcher, file: Path | None) -> None:
    """Write the model with the load that the watch named."""
    if file is None:
        return
    if watcher.load is None:
        write_error(f"no load was named, so {file} is not written")
    elif watcher.model.robot.joints != model.robot.joints:
        missing = sorted(set(model.robot.joints) - set(watcher.model.robot.joints))
        write_error(f"the stream lacks {', '.join(missing)}, so the load has no place in the model; hold these joints")
    else:
        from ...payload import with_payload

        write_error(f"wrote {with_payload(model, *watcher.load).save(file)}, with the load that was named")


def _view(watcher: Watcher, stack: ExitStack) -> tuple[Callable[[list[Event]], None], Callable[[], None]]:
    """Live view on the terminal, below a line for each event: functions that take events, and that refresh it."""
    import time

    from rich.live import Live

    from ...output.report import Screen

    live = stack.enter_context(Live(_table(watcher), console=Screen(), auto_refresh=False))
    last = [0.0]

    def emit(events: list[Event]) -> None:
        for event in events:
            live.console.print(sentence(event, watcher.model.robot), highlight=False, markup=False)

    def refresh() -> None:
        if time.monotonic() - last[0] > 1 / VIEW_RATE:
            last[0] = time.monotonic()
            live.update(_table(watcher), refresh=True)

    return emit, refresh


def _table(watcher: Watcher) -> Table:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(box=SIMPLE_HEAD, title=f"{watcher.model.robot.name} at {watcher.t:.2f} s", expand=True)
    for k, name in enumerate(("joint", "residual", "threshold", "")):
        table.add_column(name, justify="left" if k in (0, 3) else "right")
    robot = watcher.model.robot
    for j, name in enumerate(robot.joints):
        r, most = float(watcher.residual[j]), float(watcher.threshold[j])
        share = min(float(watcher.ratio[j]), 1.0)
        unit = "N" if robot.prismatic[j] else "N.m"
        table.add_row(name, f"{r:.3f} {unit}", f"{most:.3f}" if most > 0 else "-", "#" * round(20 * share))
    return table


def sentence(event: Event, robot: Robot) -> str:
    """Line on an event, for a terminal."""
    from ...watch import Contact, LastingChange, Note

    if isinstance(event, Contact):
        units = {name: "N" if linear else "N.m" for name, linear in zip(robot.joints, robot.prismatic, strict=True)}
        sizes = ", ".join(f"{name} {event.torque.get(name, 0.0):+.3g} {units[name]}" for name in event.joints)
        if event.end is None:
            return f"{event.start:9.3f} s  contact at {event.link}: {sizes}"
        ended = f"{event.end:9.3f} s  end of the contact of {event.start:.3f} s at {event.link}: {sizes}"
        return f"{ended}; it was none, but {event.cause}" if event.cause else ended
    if isinstance(event, LastingChange):
        lead = "with more motion: " if event.corrects is not None else ""
        others = ", ".join(f"{name} {p:.2g}" for name, p in event.alternatives.items() if event.law not in name)
        beside = f"; else {others}" if others else ""
        return f"{event.t:9.3f} s  {lead}{event.sentence} (probability {event.probability:.3f}{beside})"
    return f"{event.t:9.3f} s  {event.sentence}" if isinstance(event, Note) else ""
