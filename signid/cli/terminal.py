"""Output of commands: results on the terminal and in files, progress, flags, errors; early checks of destinations."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from os.path import samefile
from pathlib import Path
from threading import Event, Thread
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TextIO, TypeAlias

from ..deadline import seconds_left
from ..errors import OptionError, RobotError, one_line, readable

if TYPE_CHECKING:
    from rich.console import RenderableType

    from ..check import Check
    from ..diagnose import Diagnosis
    from ..faults import ServoAudit, UnusableRecordings
    from ..identify import Identification
    from ..model import Model
    from ..output.report import Content
    from ..output.viewers import ViewerLog
    from ..servo.diagnose import ServoDiagnosis
    from ..servo.identify import ServoIdentification
    from ..servo.validate import ServoValidation
    from ..signs import Signs
    from ..types import Array, Input, Progress, Recording, Robot
    from ..validate import Validation

DONE, BROKEN, BAD, FLAGGED, INTERRUPTED = 0, 1, 2, 3, 130  # exit codes
MAX_LINE, MAX_CUT_LINE = 390, 1200  # [characters] above which words, and clauses, are left out
LONG = 90  # length of a word that is left whole in a long line [characters]
MIN_ELAPSED_SECONDS = 1.0  # elapsed time below which no remaining time is estimated [s]
MIN_COMPLETED_SHARE = 0.03  # completed share below which no remaining time is estimated
DESCRIPTION_FILES = ("robot.urdf", "actuators.toml")  # files that are read of a folder with a robot
PROGRESS_SECONDS = 60.0  # time between lines of progress where standard error is no terminal [s]
SHOWN_LIMIT_RATIO = 5.0  # [1] largest time limit shown, over the remaining time or else that of the past
ShowProgress = Callable[[str, str, float, str], None]  # bar, stage, completed share [1], remaining time in words
Logs: TypeAlias = "tuple[ViewerLog, Mapping[str, Path]] | None"
VALIDATION_FILES = ("validation.json", "report.html")
PAYLOAD_FILES = ("payload.json", "model.json")
CHECK_FILES = ("check.json", "report.html")
DIAGNOSIS_FILES = ("diagnosis.json", "model.json", "robot.urdf", "report.html", "signed.csv", "signs.html")
IDENTIFICATION_FILES = ("identification.json", *DIAGNOSIS_FILES[1:])


def write_error(sentence: str) -> None:
    """Write one line to standard error; in a very long line, long words and middle clauses are shortened."""
    with suppress(OSError):  # a closed pipe or a full disk
        sys.stderr.write(f"signid: {_brief(one_line(readable(sentence)))}\n")
        sys.stderr.flush()


def _brief(line: str) -> str:
    """A line that is never cut inside a clause: long words lose their middle, then whole clauses are left out."""
    if len(line) <= MAX_LINE:
        return line
    line = " ".join(word if len(word) <= LONG else f"{word[: LONG - 30]}...{word[-25:]}" for word in line.split(" "))
    for mark in ("; ", ", "):
        parts = line.split(mark)
        while len(line) > MAX_CUT_LINE and len(parts) > 3:
            parts = [part for part in parts if part != "..."]
            middle = len(parts) // 2
            parts[middle : middle + 1] = ["..."]
            line = mark.join(parts)
    return line


def open_streams() -> None:
    """Replace standard streams that the caller closed, or the next files that are opened would take their place."""
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        if getattr(sys, name) is not None:
            continue
        place = os.open(os.devnull, os.O_RDWR)
        if place != number:
            os.dup2(place, number)
            os.close(place)
        setattr(sys, name, os.fdopen(number, "w" if number else "r", encoding="utf-8", closefd=False))


def show(shown: str | Sequence[RenderableType], flags: Sequence[str] = (), written: Sequence[Path] = ()) -> int:
    """Print a JSON document, or tables and the paths of written files; report flags; return the exit code."""
    from ..output.report import Screen

    if isinstance(shown, str):
        Screen().write(shown)
    else:
        Screen().print(*shown, sep="\n")
    said = {getattr(block, "plain", "") for block in shown}
    new = [flag for flag in flags if flag not in said]
    for flag in new or flags:  # those of the result again where there are no others
        write_error(flag)
    if new and (repeated := len(said.intersection(flags))):
        say = "a sentence of the result says" if repeated == 1 else f"{repeated} sentences of the result say"
        write_error(f"{say} what not to rely on")
    if written and not isinstance(shown, str):
        Screen().write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    return FLAGGED if flags else DONE


@contextmanager
def bars(quiet: bool, one: bool = False) -> Iterator[Progress | None]:
    """Show progress on standard error: bars on a terminal, one per stage or a single one; else a line a minute.

    Nothing is shown if `quiet`, or if standard error is kept in memory, as for the sessions of a fleet.
    """
    if quiet or not _is_open(sys.stderr):
        yield None
        return
    with _drawn_bars() if sys.stderr.isatty() else _minute_lines() as show_progress:
        end = time.monotonic() + seconds_left()
        begun: dict[str, tuple[float, float]] = {}

        def report(stage: str, share: float) -> None:
            which, now = "" if one else stage, time.monotonic()
            since, first = begun.setdefault(which, (now, share))
            show_progress(which, stage, share, remaining(now - since, share - first, 1 - share, end - now))

        yield report


def _is_open(stream: TextIO) -> bool:
    try:
        return stream.fileno() >= 0
    except (OSError, ValueError):
        return False


@contextmanager
def _drawn_bars() -> Iterator[ShowProgress]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    columns = TextColumn("{task.description}", markup=False), BarColumn(), TextColumn("{task.fields[left]}")
    with Progress(*columns, console=Console(stderr=True), transient=True) as bars:
        tasks: dict[str, Any] = {}

        def show_progress(which: str, stage: str, share: float, left: str) -> None:
            if which not in tasks:
                tasks[which] = bars.add_task(stage, total=1.0, left="")
            bars.update(tasks[which], completed=share, description=stage, left=left)

        yield show_progress


@contextmanager
def _minute_lines() -> Iterator[ShowProgress]:
    """Write the last known progress as a plain line once a minute, also while a stage reports nothing."""
    said, ended, start = "", Event(), time.monotonic()

    def show_progress(which: str, stage: str, share: float, left: str) -> None:
        nonlocal said
        said = ", ".join(x for x in (stage + f": {100 * share:.0f} %" * (share >= 0.005), left) if x)

    def speak() -> None:
        while not ended.wait(PROGRESS_SECONDS):
            write_error(f"{said or 'started'}, after {_duration(time.monotonic() - start)}")

    Thread(target=speak, daemon=True).start()
    try:
        yield show_progress
    finally:
        ended.set()


def remaining(elapsed: float, done: float, rest: float, limit: float) -> str:
    """Remaining time [s] of the share `rest`, after `done` in the time since the first report, within a time limit."""
    if rest <= 0:
        return ""
    guess = elapsed * rest / done if elapsed >= MIN_ELAPSED_SECONDS and done >= MIN_COMPLETED_SHARE else float("inf")
    known = [f"about {_duration(guess)}"] if guess < limit else []
    if limit < SHOWN_LIMIT_RATIO * (guess if guess < float("inf") else elapsed):
        known.append(f"at most {_duration(limit)}")
    return f"{', '.join(known)} left" if known else ""


def _duration(seconds: float) -> str:
    """Seconds below two minutes, else minutes."""
    return f"{max(seconds, 0.0):.0f} s" if seconds < 120 else f"{seconds / 60:.0f} min"


def check_folder(output: str | None, json: bool, files: Sequence[str]) -> None:
    """Check that files can be written to a folder, which is not needed if results are printed as JSON.

    Raises:
        OptionError: no folder was named.
        OutputError: the folder is not writable, or holds a file of the same name that signid did not write.
    """
    from ..output.report import check_foreign, probe_folder

    if output == "" or (output is None and not json):
        raise OptionError("no folder for the results was named; add -o DIR, or --json to print them instead")
    if output is not None:
        probe_folder(output)
        check_foreign(output, files)


def check_file(output: str | None, json: bool, read: Sequence[str | None] = ()) -> None:
    """Check that a recording can be written to a file, which is not needed if a summary is printed as JSON.

    `read` lists the files that the command reads.

    Raises:
        OptionError: no file was named, or one that is read.
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
        check_unread(output, read)


def check_unread(output: str | Path, read: Sequence[str | None], option: str = "-o") -> None:
    """Check that a file to write is none of those that the command reads; of a folder it reads the description.

    Raises:
        OptionError: it is one of them; the sentence names the option `option`.
        OutputError: it is a device, pipe or socket.
    """
    from ..output.report import check_regular

    check_regular(output)
    paths = [Path(name) / file for name in read if name for file in ("", *DESCRIPTION_FILES)]
    paths += [Path(name).with_name("actuators.toml") for name in read if name and Path(name).name]
    if any(_same(path, Path(output)) for path in paths):
        raise OptionError(f"{output} is read by this command; give another name with {option}")


def _same(path: Path, other: Path) -> bool:
    try:
        return path.exists() and other.exists() and samefile(path, other)
    except (OSError, ValueError):  # a name that no file has
        return False


def deliver(
    result: Any,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    files: Mapping[str, Content] = MappingProxyType({}),
    *,
    logs: Logs = None,
    columns: Mapping[str, Array] | None = None,
    **given: Any,
) -> int:
    """Write and print a result; return the exit code: NAME.json and files into a folder, or columns into a file.

    `logs`: log for viewers, and its paths by kind. `given`: as of `document`; tables do without the seed.
    columns: (N,) each, by name [units of the columns of these names].
    """
    from ..output.report import document, tables, to_json, write_files
    from ..recording.formats import find_format

    content = document(result, inputs, **given)
    text, name = to_json(content), content["schema"].removeprefix("signid.").removesuffix("/1")
    written = list[Path]()
    if output is not None and columns is not None:
        path = Path(output)
        written += write_files(path.parent, {path.name: find_format(path).encode(columns, path.name)}, named=True)
    elif output is not None:
        written += write_files(output, {f"{name}.json": text, **files})
    written += write_logs(*logs) if logs else []
    given.pop("seed", None)
    return show(text if json else tables(result, **given), getattr(result, "flags", ()), written)


def deliver_identification(
    result: Identification | ServoIdentification,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    more: Mapping[str, Content] = MappingProxyType({}),
) -> int:
    """Write and print an identification, with more files; return the exit code; `command` reproduces it."""
    from ..identify import Identification
    from ..output.export import with_known_numbers
    from ..output.report import page, to_json

    files: dict[str, Content] = {}
    if output is not None:
        if isinstance(result, Identification):
            model, known, left = result.best, result.best, list[str]()
            bodies = (result.parameters.bodies() if result.refined is None else result.refined.inertials).copy()
            acts = (result.base.combination != 0).any(axis=0)
            seen = {label.body for s, label in zip(acts, result.base.labels, strict=True) if s}
            bodies[[body not in seen for body in range(len(bodies))]] = float("nan")  # without effect on torque
            described, notes = _urdf(known, bodies)
            more = _recording_files(result.signs, result.recordings, result.robot)
        else:
            model, (known, left) = result.model, with_known_numbers(result.model, gain=False)
            described, notes = _urdf(known, known.inertials)
        unknown = "robot.urdf leaves out the numbers that are not identifiable, unless they were stated before"
        result = replace(result, notes=(*result.notes, *notes, *([unknown] if left else [])))
        shown = {**described, "report.html": page(result, inputs, command), **more}
        files = {"model.json": to_json(model.document()), **shown}
    return deliver(result, inputs, output, json, files)


def deliver_diagnosis(
    result: Diagnosis | ServoDiagnosis,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    logs: Logs = None,
) -> int:
    """Write and print a diagnosis; return the exit code; `command` is the shell line that reproduces it."""
    diagnosis, files = (result, {}) if output is None else diagnosis_files(result, inputs, command)
    return deliver(diagnosis, inputs, output, json, files, logs=logs)


def diagnosis_files(
    result: Diagnosis | ServoDiagnosis, inputs: Sequence[Input], command: str
) -> tuple[Diagnosis | ServoDiagnosis, dict[str, Content]]:
    """Return the diagnosis with notes on the limits of file formats, and its files besides diagnosis.json."""
    from ..diagnose import Diagnosis
    from ..output.export import export
    from ..output.report import page, to_json

    described: dict[str, Content] = {}
    signed: dict[str, Content] = {}
    if isinstance(result, Diagnosis):
        try:
            made = export(result.model, "urdf")
            described = {"robot.urdf": _marked(made.text)}
            notes = [f"robot.urdf: {note}" for note in (*made.flags, *made.notes)]  # on content that it cannot hold
        except RobotError as error:
            notes = [f"robot.urdf is not written: {error}"]
        result = replace(result, notes=(*result.notes, *notes))
        signed = _recording_files(result.signs, result.recordings, result.robot)
    model = to_json(result.model.document())
    return result, {"model.json": model, **described, "report.html": page(result, inputs, command), **signed}


def deliver_report(
    result: Validation | ServoValidation | Check | ServoAudit | UnusableRecordings,
    inputs: Sequence[Input],
    output: str | None,
    json: bool,
    command: str,
    **given: Any,
) -> int:
    """Write and print a validation or a check; return the exit code; `given`: seed of a check, robot of an audit."""
    from ..output.report import page

    files = {} if output is None else {"report.html": page(result, inputs, command, **given)}
    return deliver(result, inputs, output, json, files, **given)


def check_logs(**files: str | None) -> dict[str, Path]:
    """Check that logs for viewers can be written; return their paths by kind, "rrd" or "mcap".

    Raises:
        OptionError: a name does not end as its kind does, or a library is missing.
        OutputError: a folder cannot be written.
    """
    asked = {kind: Path(file) for kind, file in files.items() if file is not None}
    if not asked:
        return asked
    from ..output.report import check_regular, probe_folder
    from ..output.viewers import check_library

    for kind, path in asked.items():
        if path.suffix.lower() != f".{kind}" or path.is_dir():
            raise OptionError(f"--{kind} {files[kind]!r} is not the name of a log; use a name that ends in .{kind}")
        check_library(kind)
        probe_folder(path.parent, f"--{kind}")
        check_regular(path)
    return asked


def write_logs(log: ViewerLog, paths: Mapping[str, Path]) -> list[Path]:
    """Write logs for viewers to paths by kind."""
    from ..output.report import write_files

    made = {kind: log.rrd() if kind == "rrd" else log.mcap() for kind in paths}
    return [
        written
        for kind, path in paths.items()
        for written in write_files(path.parent, {path.name: made[kind]}, f"--{kind}", named=True)
    ]


def _recording_files(signs: Signs | None, recordings: Sequence[Recording], robot: Robot) -> dict[str, Content]:
    """Readings, signed.csv (signed_2.csv, ...) of each recording with recovered signs, and a page about the signs."""
    from ..output.report.results.signs import signed_csv, signs_page
    from ..recording.source import reading_path

    read = {reading_path(each.path).name: each.reading.text for each in recordings if each.reading and each.path}
    if signs is None:
        return {**read}
    part = {trace.path: k for k, trace in enumerate(signs.traces)}
    used = [recording for recording in recordings if recording.path in part]
    tables = [signed_csv(recording, signs, part[recording.path]) for recording in used]
    names = ["signed.csv", *(f"signed_{k + 2}.csv" for k in range(len(tables) - 1))]
    units = ["N" if prismatic else "N.m" for prismatic in robot.prismatic]
    return {**dict(zip(names, tables, strict=True)), "signs.html": signs_page(signs, units), **read}


def _urdf(model: Model, bodies: Array) -> tuple[dict[str, Content], tuple[str, ...]]:
    """The robot's URDF with the identified parameters; if it cannot be written, a note with the reason."""
    from ..output.export import urdf_with
    from ..output.export.bodies import FRICTION_LAWS, summed

    if model.robot.kind != "urdf":
        why = f"the robot comes from {model.robot.kind.upper()}"
    else:
        try:
            friction = (summed(model, effect).clip(min=0.0) for effect in FRICTION_LAWS)
            return {"robot.urdf": _marked(urdf_with(model.robot, bodies, *friction))}, ()
        except RobotError as error:
            why = str(error)
    return {}, (f"robot.urdf is not written: {why}",)


def _marked(text: str) -> str:
    """The text of a URDF with a comment by which `write_files` recognises its own file."""
    from ..output.export import with_comment
    from ..output.report import WRITTEN

    return text if WRITTEN in text else with_comment(text, [WRITTEN])
