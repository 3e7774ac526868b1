"""Input files of a session, and the key that identifies its result."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cache
from hashlib import file_digest, sha256
from pathlib import Path

from ...errors import RecordingError, RobotError
from ...model import load_model
from ...robot import load_robot
from ...types import Input
from ...version import __version__
from .manifest import TASKS, Entry


def check_robot(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the robot description of a session and the actuators file beside it.

    Args:
        entry: session.
        folder: folder of the manifest.

    Raises:
        RobotError: the description cannot be used.
    """
    beside = folder / entry.robot
    actuators = str(folder / entry.actuators) if entry.actuators else None
    source = str(beside) if beside.exists() else entry.robot
    return _described(source, entry.robot, actuators, entry.task == TASKS[0])


def read_inputs(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the files that a session reads besides the description, with their digests.

    Args:
        entry: session.
        folder: folder of the manifest.

    Raises:
        RecordingError: a file cannot be read.
    """
    return tuple(Input(name, _digest(folder / name, name)) for name in entry.files)


def key(arguments: Sequence[str], inputs: Sequence[Input]) -> str:
    """Hash of the command, the content of its files and the version of signid.

    Args:
        arguments: arguments of the command.
        inputs: files that it reads.
    """
    read = sorted({(file.path, file.sha256) for file in inputs})
    return sha256(json.dumps([__version__, [*arguments], read]).encode()).hexdigest()


@cache
def _described(source: str, name: str, actuators: str | None, simulation: bool) -> tuple[Input, ...]:
    saved = source.endswith(".json") and simulation
    robot = load_model(source).robot if saved else load_robot(source, actuators=actuators)
    if saved and actuators is not None:
        raise RobotError(f"{name} states its actuators itself; leave actuators empty")
    path = Path(source) if saved else Path(robot.path)
    digest = _digest(path, name) if saved else robot.sha256
    found = [Input(name, digest, "description")]
    stated = path.with_name("actuators.toml")
    if not saved and actuators is None and stated.is_file():
        found.append(Input(f"actuators of {name}", _digest(stated, stated.name)))
    return tuple(found)


def _digest(path: Path, name: str) -> str:
    try:
        with path.open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot read {name}: {error.strerror or type(error).__name__}") from None
