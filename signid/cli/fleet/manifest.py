"""The manifest: a CSV file with one session per row, checked as a whole before any session runs; its input files."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from difflib import get_close_matches
from functools import cache
from hashlib import file_digest, sha256
from pathlib import Path

from ...errors import ManifestError, RecordingError, SignidError, readable, shorten
from ...model import load_model
from ...robot import load_robot, saved_model
from ...robot.joints import parse_gravity
from ...robot.load import parse_arguments
from ...types import Input

SESSION_TASKS = ("diagnose", "identify")  # default: the first
NEEDED_COLUMNS = ("robot", "recording")
FILE_OPTIONS = ("held_out", "reference", "columns", "actuators")  # options of a session that name files
SESSION_OPTIONS = (*FILE_OPTIONS, "gravity", "xacro")
MANIFEST_COLUMNS = (*NEEDED_COLUMNS, *SESSION_OPTIONS, "task", "name", "time", "session")
SECONDS_PER_DAY = 86_400.0  # s
MAX_NAME_LENGTH = 100  # maximum length of a session name [characters]
MAX_MANIFEST_BYTES = 50_000_000  # size of the file [bytes]
MAX_ERRORS = 3  # maximum number of errors listed


@dataclass(frozen=True)
class Entry:
    """One session: a robot, its recordings and a task. Paths are as in the manifest."""

    line: int
    session: str  # name of its folder
    name: str  # name of the individual robot, such as a serial number
    robot: str  # description, model.json or name
    task: str
    recordings: tuple[str, ...]
    options: tuple[tuple[str, str], ...] = ()  # column and value, for each value
    time: str = ""
    day: float | None = None  # days since 1970, UTC

    def arguments(self, seed: int = 0) -> tuple[str, ...]:
        """Arguments of this session's command, without -o."""
        options = [*self.options, ("seed", str(seed))] if seed else self.options
        return (
            self.task,
            self.robot,
            *self.recordings,
            *(word for name, value in options for word in (f"--{name.replace('_', '-')}", value)),
        )

    def given(self, *names: str) -> tuple[str, ...]:
        """Values of options."""
        return tuple(value for name, value in self.options if name in names)


@dataclass(frozen=True)
class Manifest:
    """All sessions, and the folder to which their paths are relative."""

    entries: tuple[Entry, ...]
    folder: Path
    input: Input


def read_manifest(path: str | Path) -> Manifest:
    """Read the sessions listed in a CSV file.

    Required columns: `robot` and `recording` (one file, or several separated by `;`). Optional columns: `held_out`,
    `reference`, `columns`, `actuators`, `gravity` ("X,Y,Z" in quotes), `xacro` (NAME:=VALUE, separated by `;`),
    `task` (diagnose or identify), `name` of the individual robot, `time` (ISO 8601; UTC if without zone) and `session`
    (name of the output folder).

    Args:
        path: CSV file; paths in it are relative to its folder.

    Raises:
        ManifestError: rows are invalid; one sentence per error.
    """
    source, regular = Path(path), f"it is no regular file of at most {MAX_MANIFEST_BYTES / 1e6:.0f} MB"
    if source.exists() and not (source.is_file() and source.stat().st_size <= MAX_MANIFEST_BYTES):
        raise ManifestError([f"cannot read the manifest {path}: {regular}"])
    try:
        content = source.read_bytes()
        rows = list(_rows(content.decode("utf-8-sig"), source.name))
    except OSError as error:
        raise ManifestError([f"cannot read the manifest {path}: {error.strerror}"]) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ManifestError([f"{source.name} is not a CSV file of sessions ({error}); save as CSV in UTF-8"]) from None
    entries, faults = list[Entry](), list[str]()
    for line, row in rows:
        try:
            entries.append(_entry(line, row))
        except ValueError as error:
            faults.append(f"{source.name}, line {line}: {error}")
    lines: dict[str, list[str]] = {}
    for entry in entries:
        lines.setdefault(entry.session.casefold(), []).append(str(entry.line))
    advice = "give them different names or times, or name them in a column session"
    for name, repeated in lines.items():
        if len(repeated) > 1:
            faults.append(f"{source.name}, lines {shorten(repeated)}: all have the session name {name}; {advice}")
    if not rows:
        faults.append(f"{source.name} lists no session; add one row per session below the column names")
    if faults:
        more = len(faults) - MAX_ERRORS
        raise ManifestError(faults[:MAX_ERRORS] + [f"and {more} more such rows"] * (more > 0))
    return Manifest(
        tuple(entries), source.absolute().parent, Input(readable(str(path)), sha256(content).hexdigest(), "manifest")
    )


def _rows(text: str, name: str) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Yield the non-empty rows, with the number of their last line."""
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    heads = [head.strip() for head in next(reader, [])]
    for head in heads:
        if head not in MANIFEST_COLUMNS:
            near = get_close_matches(head, MANIFEST_COLUMNS, 1)
            advice = f"did you mean {near[0]}?" if near else f"columns are {', '.join(MANIFEST_COLUMNS)}"
            raise ManifestError([f"{name} has an unknown column {head!r}; {advice}"])
    lacking = [head for head in NEEDED_COLUMNS if head not in heads]
    if lacking or len(set(heads)) < len(heads):
        what = f"no column {' and none '.join(lacking)}" if lacking else "a column twice"
        raise ManifestError([f"{name} has {what}; its first line names the columns, each once: robot,recording,..."])
    for cells in reader:
        if any(cell.strip() for cell in cells):
            extra = {"": "more"} if len(cells) > len(heads) else {}
            yield reader.line_num, {**dict(zip(heads, (c.strip() for c in cells), strict=False)), **extra}


def _entry(line: int, row: Mapping[str, str]) -> Entry:
    """The session of a row; ValueError if the row is invalid."""
    if "" in row:
        raise ValueError("it has more cells than there are columns; quote cells that contain commas")
    for head in NEEDED_COLUMNS:
        if not row.get(head):
            raise ValueError(f"the cell {head} is empty; every session needs it")
    for head in (*NEEDED_COLUMNS, *FILE_OPTIONS):
        if any(part.startswith("-") or "\0" in part for part in _split(row.get(head, ""))):
            raise ValueError(f"{head} {row[head]!r} would be read as an option; write ./{row[head]}")
    task = row.get("task") or SESSION_TASKS[0]
    if task not in SESSION_TASKS:
        raise ValueError(f"the task {task!r} is unknown; use one of {', '.join(SESSION_TASKS)}")
    if row.get("reference") and task != "diagnose":
        raise ValueError(f"reference is not used by {task}; leave it empty, or set the task to diagnose")
    recordings, name, time = _split(row["recording"]), row.get("name") or row["robot"], row.get("time", "")
    if not recordings:
        raise ValueError(f"the recording {row['recording']!r} names no file; name at least one")
    parse_arguments(_split(row.get("xacro", "")))
    if row.get("gravity"):
        parse_gravity(row["gravity"])
    options = tuple((head, value) for head in SESSION_OPTIONS for value in _split(row.get(head, "")))
    stated = row.get("session")
    parts = (stated,) if stated else (name, row.get("time") or recordings[0], "" if task == SESSION_TASKS[0] else task)
    session = "_".join(re.sub(r"[^\w.]+", "-", part).strip("-._") for part in parts if part)
    if not session or len(session) > MAX_NAME_LENGTH or (stated and session != stated):
        raise ValueError(
            f"{stated or session!r} is not a valid folder name; name the session with letters, digits, - and _"
        )
    if not time:
        day = None
    else:
        try:
            moment = datetime.fromisoformat(time)
            epoch = datetime.fromisoformat("1970-01-01" + ("T00:00Z" if moment.tzinfo else ""))
        except ValueError:
            raise ValueError(f"the time {time!r} is not a date; write 2026-03-31 or 2026-03-31T14:00") from None
        day = (moment - epoch).total_seconds() / SECONDS_PER_DAY
    return Entry(line, session, name, row["robot"], task, recordings, options, time, day)


def _split(cell: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in cell.split(";") if part.strip())


def describe_robots(listed: Manifest) -> list[tuple[Input, ...]]:
    """List the files that describe the robot of each session; check that all robots can be used.

    Raises:
        ManifestError: some cannot.
    """
    described, faults = list[tuple[Input, ...]](), list[str]()
    for entry in listed.entries:
        beside, actuators = listed.folder / entry.robot, [listed.folder / name for name in entry.given("actuators")]
        source, simulation = str(beside) if beside.exists() else entry.robot, entry.task == SESSION_TASKS[0]
        try:
            described.append(_described(source, entry.robot, (*actuators, None)[0], simulation, entry.given("xacro")))
        except SignidError as error:
            faults.append(f"{Path(listed.input.path).name}, line {entry.line}: {error}")
    if faults:
        raise ManifestError(faults)
    return described


def read_inputs(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the files that a session reads besides the description, with their digests.

    Raises:
        RecordingError: one cannot be read.
    """
    return tuple(Input(name, digest(folder / name, name)) for name in (*entry.recordings, *entry.given(*FILE_OPTIONS)))


@cache
def _described(
    source: str, name: str, actuators: Path | None, simulation: bool, xacro: tuple[str, ...]
) -> tuple[Input, ...]:
    saved = saved_model(source) if simulation else None
    if saved:
        load_model(source, actuators)
        return (Input(name, digest(saved, name), "description"),)
    robot = load_robot(source, actuators=actuators, xacro=parse_arguments(xacro))
    described = Input(name, robot.sha256, "description")
    stated = Path(robot.path).with_name("actuators.toml")
    if actuators is None and stated.is_file():
        return described, Input(f"actuators of {name}", digest(stated, stated.name))
    return (described,)


def digest(path: Path, name: str) -> str:
    """SHA-256 of a regular file.

    Raises:
        RecordingError: it is no regular file, or cannot be read.
    """
    if path.exists() and not path.is_file():
        raise RecordingError(f"cannot read {name}: it is no regular file")
    try:
        with path.open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot read {name}: {error.strerror or type(error).__name__}") from None
