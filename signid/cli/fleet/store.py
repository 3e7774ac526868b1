"""Stored sessions: a folder each, whose session.json appears last and lists its inputs and files with digests."""

from __future__ import annotations

import json
from collections.abc import Mapping
from functools import cache
from hashlib import file_digest, sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...errors import RecordingError
from ...model import load_model
from ...output.report.write import write_files
from ...robot import load_robot, saved_model
from ...robot.load import parse_arguments
from ...toml_json import read_json
from ...types import Input
from ..terminal import DONE, FLAGGED
from .manifest import READ, TASKS, Entry

RECORD = "session.json"
SCHEMA = "signid.session/2"


def read_session(place: Path, wanted: Mapping[str, Any] = MappingProxyType({})) -> Mapping[str, Any]:
    """The session.json of a folder; empty if it or a listed file is not as signid wrote it, or not as `wanted`.

    Args:
        place: folder of the session.
        wanted: arguments, inputs and version that the session must have.
    """
    try:
        found = read_json(place / RECORD)
        files, said = dict(found["files"]), list(found["said"])
        whole = files and files == {name: _digest(place / name, name) for name in files}
        sound = found["code"] in (DONE, FLAGGED) and all(isinstance(sentence, str) for sentence in said)
        return found if whole and sound and found.items() >= wanted.items() else {}
    except (OSError, ValueError, TypeError, KeyError):
        return {}


def write_session(place: Path, record: Mapping[str, Any], files: Mapping[str, bytes]) -> Mapping[str, Any]:
    """Write the files of a session and return its session.json, which appears last; files of an earlier one go.

    Raises:
        OutputError: they cannot be written, or would replace files that signid did not write.
    """
    earlier = read_session(place).get("files", {})
    digests = {name: sha256(content).hexdigest() for name, content in sorted(files.items())}
    written = {"schema": SCHEMA, "session": place.name, **record, "files": digests}
    write_files(place, {RECORD: json.dumps(written, indent=2, ensure_ascii=False) + "\n", **files})
    for path in place.iterdir():
        if path.name in earlier and path.name not in files:
            path.unlink()
    return written


def check_robot(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the robot description of a session and the actuators file beside it; check that it can be used."""
    beside = folder / entry.robot
    actuators = [str(folder / name) for name in entry.given("actuators")]
    source = str(beside) if beside.exists() else entry.robot
    simulation = entry.task == TASKS[0]
    return _described(source, entry.robot, actuators[0] if actuators else None, simulation, entry.given("xacro"))


def read_inputs(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the files that a session reads besides the description, with their digests."""
    return tuple(Input(name, _digest(folder / name, name)) for name in (*entry.recordings, *entry.given(*READ)))


@cache
def _described(
    source: str, name: str, actuators: str | None, simulation: bool, xacro: tuple[str, ...]
) -> tuple[Input, ...]:
    saved = saved_model(source) if simulation else None
    if saved:
        load_model(source, actuators)
        return (Input(name, _digest(saved, name), "description"),)
    robot = load_robot(source, actuators=actuators, xacro=parse_arguments(xacro))
    described = Input(name, robot.sha256, "description")
    stated = Path(robot.path).with_name("actuators.toml")
    if actuators is None and stated.is_file():
        return described, Input(f"actuators of {name}", _digest(stated, stated.name))
    return (described,)


def _digest(path: Path, name: str) -> str:
    if path.exists() and not path.is_file():
        raise RecordingError(f"cannot read {name}: it is no regular file")
    try:
        with path.open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot read {name}: {error.strerror or type(error).__name__}") from None
