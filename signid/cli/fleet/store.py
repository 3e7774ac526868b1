"""Storage of sessions: their inputs with a key, and folders that appear at once, with all files and a record."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Mapping
from contextlib import suppress
from functools import cache
from hashlib import file_digest, sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any

from ...errors import OutputError, RecordingError, RobotError
from ...model import load_model
from ...output.report.write import MARK, is_abandoned, probe_folder
from ...robot import load_robot, saved_model
from ...robot.load import parse_arguments
from ...toml_json import read_json
from ...types import Input
from .manifest import TASKS, Entry

SESSIONS, RECORD = "sessions", "session.json"
SCHEMA = "signid.session/1"


class Store:
    """The sessions in a folder of results."""

    def __init__(self, folder: str | Path) -> None:
        """Create the folder if missing, and remove temporary folders that killed runs left over a day ago."""
        self.place = Path(folder) / SESSIONS
        probe_folder(self.place)
        self.place.mkdir(parents=True, exist_ok=True)
        for left in self.place.glob(f"{MARK}*"):
            if is_abandoned(left, time.time()):
                shutil.rmtree(left, ignore_errors=True)

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        """Remove the folder of sessions, and the one of results, where they are empty."""
        for folder in (self.place, self.place.parent):
            with suppress(OSError):
                folder.rmdir()

    def record(self, name: str, wanted: Mapping[str, Any] = MappingProxyType({})) -> Mapping[str, Any]:
        """The stored record of a session; empty if there is none, or if it or a file is not as signid wrote it.

        It is empty too if it is not the `wanted` one: of the same command, files and version.
        """
        found, files = self.document(name, RECORD), self._listed(name)
        digests, said = found.get("digests"), found.get("said")
        texts = isinstance(said, list) and all(isinstance(one, str) for one in said)
        if files and texts and isinstance(digests, dict) and isinstance(found.get("code"), int):
            with suppress(RecordingError):
                whole = all(digests.get(file) == _digest(self.place / name / file, file) for file in files)
                return found if whole and found.items() >= wanted.items() else {}
        return {}

    def _listed(self, name: str) -> list[str]:
        """Files in the record of a session; none if it is not a record of signid."""
        found = self.document(name, RECORD)
        files = found.get("files") if found.get("schema") == SCHEMA else None
        return [str(file) for file in files] if isinstance(files, list) else []

    def document(self, name: str, file: str) -> Mapping[str, Any]:
        """A result file of a session; empty if there is none."""
        try:
            found = read_json(self.place / name / file)
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def check(self, names: Iterable[str]) -> None:
        """Check that the folders of these sessions hold nothing that signid did not write.

        Raises:
            OutputError: one does.
        """
        for name in names:
            place, known = self.place / name, self._listed(name)
            inside = place.is_dir() and not place.is_symlink()
            foreign = sorted(place.iterdir()) if inside else [place] if os.path.lexists(place) else []
            if known and inside:
                foreign = [path for path in foreign if path.name not in (*known, RECORD) or not path.is_file()]
            if foreign:
                what = f"{foreign[0]} was not written by signid"
                raise OutputError(f"{what}; name another folder with -o, or another session")

    def keep(self, name: str, record: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Store a session with its record and files, replacing an existing one completely or not at all.

        Raises:
            OutputError: they cannot be written.
        """
        digests = {file: sha256(content).hexdigest() for file, content in sorted(files.items())}
        whole = {"schema": SCHEMA, "session": name, **record, "files": [*digests], "digests": digests}
        text = json.dumps(whole, indent=2, ensure_ascii=False) + "\n"
        try:
            with tempfile.TemporaryDirectory(prefix=MARK, dir=self.place, ignore_cleanup_errors=True) as aside:
                new, place = Path(aside) / "new", self.place / name
                new.mkdir()
                for file, content in {**files, RECORD: text.encode()}.items():
                    (new / file).write_bytes(content)
                self.check([name])
                with suppress(FileNotFoundError):
                    place.rename(new.with_name("old"))
                try:
                    new.rename(place)
                except OSError:
                    if not place.is_dir():  # else another run has just stored the session
                        raise
        except OSError as error:
            if isinstance(error, OutputError):
                raise
            why = f"{error.strerror or type(error).__name__}; name another folder with -o, or free disk space"
            raise OutputError(f"cannot write results to {self.place}: {why}") from None


def check_robot(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the robot description of a session and the actuators file beside it; check that it can be used."""
    beside = folder / entry.robot
    actuators = str(folder / entry.actuators) if entry.actuators else None
    source = str(beside) if beside.exists() else entry.robot
    return _described(source, entry.robot, actuators, entry.task == TASKS[0], entry.xacro)


def read_inputs(entry: Entry, folder: Path) -> tuple[Input, ...]:
    """List the files that a session reads besides the description, with their digests."""
    return tuple(Input(name, _digest(folder / name, name)) for name in entry.files)


@cache
def _described(
    source: str, name: str, actuators: str | None, simulation: bool, xacro: tuple[str, ...]
) -> tuple[Input, ...]:
    saved = saved_model(source) if simulation else None
    arguments = parse_arguments(xacro)
    robot = load_model(source).robot if saved else load_robot(source, actuators=actuators, xacro=arguments)
    if saved and xacro:
        raise RobotError(f"{name} is no xacro file: it holds the expanded description; leave xacro empty")
    if saved and actuators is not None:
        raise RobotError(f"{name} states its actuators itself; leave actuators empty")
    path = saved or Path(robot.path)
    digest = _digest(path, name) if saved else robot.sha256
    found = [Input(name, digest, "description")]
    stated = path.with_name("actuators.toml")
    if not saved and actuators is None and stated.is_file():
        found.append(Input(f"actuators of {name}", _digest(stated, stated.name)))
    return tuple(found)


def _digest(path: Path, name: str) -> str:
    if path.exists() and not path.is_file():
        raise RecordingError(f"cannot read {name}: it is no regular file")
    try:
        with path.open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()
    except OSError as error:
        raise RecordingError(f"cannot read {name}: {error.strerror or type(error).__name__}") from None
