"""The list of sessions: a CSV file, a row each, checked as a whole before anything is done."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path

from ...errors import ManifestError, shorten
from ...types import Input

TASKS = ("diagnose", "identify", "reduce")  # the first by default
NEEDED = ("robot", "recording")
FILES = (*NEEDED, "held_out", "reference", "columns", "actuators", "like")
COLUMNS = (*FILES, "task", "name", "time", "session")
BELONGS = {"reference": "diagnose", "like": "reduce"}  # column -> the only task that knows it
DAY = 86_400.0  # s
LONGEST = 100  # characters of a session's name
MOST = 50  # sentences


@dataclass(frozen=True)
class Entry:
    """One session: a robot, its recordings and what is asked of them. Paths are as the manifest has them."""

    line: int
    session: str  # its folder
    name: str  # of the single robot: a serial number
    robot: str  # a description, a model.json or a name
    task: str
    recordings: tuple[str, ...]
    held_out: tuple[str, ...]
    reference: tuple[str, ...]
    columns: str
    actuators: str
    like: str
    time: str
    day: float | None  # days since 1970, UTC

    def arguments(self, seed: int = 0) -> tuple[str, ...]:
        """The command of this session, without -o."""
        given = [("--held-out", x) for x in self.held_out] + [("--reference", x) for x in self.reference]
        given += [(f"--{key}", value) for key in ("columns", "actuators", "like") if (value := getattr(self, key))]
        given += [("--seed", str(seed))] if seed else []
        return (self.task, self.robot, *self.recordings, *(word for pair in given for word in pair))

    @property
    def files(self) -> tuple[str, ...]:
        """Everything that it reads besides the description."""
        beside = self.columns, self.actuators, self.like
        return tuple(x for x in (*self.recordings, *self.held_out, *self.reference, *beside) if x)


@dataclass(frozen=True)
class Manifest:
    """All sessions, and the folder that their paths are relative to."""

    entries: tuple[Entry, ...]
    folder: Path
    input: Input


def read_manifest(path: str | Path) -> Manifest:
    """The sessions that a CSV file lists.

    Columns: `robot` and `recording`, the latter one file or several with `;` between them; if wanted `held_out`,
    `reference`, `columns`, `actuators`, `task` (diagnose, identify or reduce), `like` (factors that those of a
    reduction are to add to), `name` of the single robot, `time` (ISO 8601; without a zone UTC) and `session`, the
    folder that it gets.

    Args:
        path: the file; paths in it are relative to its folder.

    Raises:
        ManifestError: a row is wrong, or several; a sentence each.
    """
    source = Path(path)
    try:
        content = source.read_bytes()
        rows = list(_rows(content.decode("utf-8-sig"), source.name))
    except OSError as error:
        raise ManifestError([f"cannot read the manifest {path}: {error.strerror}"]) from None
    except (UnicodeDecodeError, csv.Error) as error:
        raise ManifestError([f"{source.name} is no CSV file of sessions ({error}); save it as CSV, in UTF-8"]) from None
    entries, faults = list[Entry](), list[str]()
    for line, row in rows:
        try:
            entries.append(_entry(line, row))
        except ValueError as error:
            faults.append(f"{source.name}, line {line}: {error}")
    faults += [f"{source.name}, {told}" for told in _repeated(entries)]
    if not rows:
        faults.append(f"{source.name} lists no session; give each a row below the names of the columns")
    if faults:
        raise ManifestError(faults[:MOST] + [f"and {len(faults) - MOST} more such rows"] * (len(faults) > MOST))
    return Manifest(tuple(entries), source.absolute().parent, Input(str(path), sha256(content).hexdigest(), "manifest"))


def _rows(text: str, name: str) -> Iterator[tuple[int, Mapping[str, str]]]:
    """Every row that is not empty, with the number of its last line."""
    reader = csv.reader(text.splitlines(keepends=True), strict=True)
    heads = [head.strip() for head in next(reader, [])]
    for head in heads:
        if head not in COLUMNS:
            near = get_close_matches(head, COLUMNS, 1)
            advice = f"did you mean {near[0]}?" if near else f"columns are {', '.join(COLUMNS)}"
            raise ManifestError([f"{name} has a column {head!r}, which is none of a manifest; {advice}"])
    lacking = [head for head in NEEDED if head not in heads]
    if lacking or len(set(heads)) < len(heads):
        what = f"no column {' and none '.join(lacking)}" if lacking else "a column twice"
        raise ManifestError([f"{name} has {what}; its first line names the columns, each once: robot,recording,..."])
    for cells in reader:
        if any(cell.strip() for cell in cells):
            extra = {"": "more"} if len(cells) > len(heads) else {}
            yield reader.line_num, {**dict(zip(heads, (c.strip() for c in cells), strict=False)), **extra}


def _entry(line: int, row: Mapping[str, str]) -> Entry:
    """The session of a row; ValueError says what is wrong with it."""
    if "" in row:
        raise ValueError("it has more cells than the first line names columns; quote cells that hold commas")
    for head in NEEDED:
        if not row.get(head):
            raise ValueError(f"its {head} is empty; every session needs one")
    for head in FILES:
        if any(part.startswith("-") or "\0" in part for part in _split(row.get(head, ""))):
            raise ValueError(f"{head} {row[head]!r} would be taken for an option; write ./{row[head]}")
    task = row.get("task") or TASKS[0]
    if task not in TASKS:
        raise ValueError(f"the task {task!r} is none of {', '.join(TASKS)}")
    for head, only in BELONGS.items():
        if row.get(head) and task != only:
            raise ValueError(f"{head} is of no use to {task}; leave it empty, or make the task {only}")
    recordings, name = _split(row["recording"]), row.get("name") or row["robot"]
    if not recordings:
        raise ValueError(f"its recording {row['recording']!r} names no file")
    return Entry(
        line,
        _folder(row, name, recordings, task),
        name,
        row["robot"],
        task,
        recordings,
        _split(row.get("held_out", "")),
        _split(row.get("reference", "")),
        row.get("columns", ""),
        row.get("actuators", ""),
        row.get("like", ""),
        row.get("time", ""),
        _day(row.get("time", "")),
    )


def _split(cell: str) -> tuple[str, ...]:
    return tuple(part.strip() for part in cell.split(";") if part.strip())


def _day(text: str) -> float | None:
    if not text:
        return None
    try:
        moment = datetime.fromisoformat(text)
        epoch = datetime.fromisoformat("1970-01-01" + ("T00:00Z" if moment.tzinfo else ""))
    except ValueError:
        raise ValueError(f"the time {text!r} is no date; write 2026-03-31 or 2026-03-31T14:00") from None
    return (moment - epoch).total_seconds() / DAY


def _folder(row: Mapping[str, str], name: str, recordings: Sequence[str], task: str) -> str:
    """The name of a session: as it is given, or that of the robot with the time, or else with the recording."""
    given = row.get("session")
    parts = (given,) if given else (name, row.get("time") or recordings[0], "" if task == TASKS[0] else task)
    found = "_".join(re.sub(r"[^\w.]+", "-", part).strip("-._") for part in parts if part)
    if not found or len(found) > LONGEST or (given and found != given):
        raise ValueError(
            f"{given or found!r} is no name for a folder; give the session a name of letters, digits, - and _"
        )
    return found


def _repeated(entries: Sequence[Entry]) -> Iterator[str]:
    lines: dict[str, list[str]] = {}
    for entry in entries:
        lines.setdefault(entry.session.casefold(), []).append(str(entry.line))
    for name, found in lines.items():
        if len(found) > 1:
            told = f"lines {shorten(found)}: all are the session {name}"
            yield f"{told}; tell them apart by name or time, or name them in a column session"
