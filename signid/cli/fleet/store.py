"""Storage of sessions: each folder appears at once, with all files and a record of its inputs."""

from __future__ import annotations

import json
import os
import shutil
import tempfile
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from ...errors import OutputError
from ...output.report.write import MARK, give_usual_rights, is_abandoned
from ...toml_json import read_json

SESSIONS, RECORD = "sessions", "session.json"
SCHEMA = "signid.session/1"


class Store:
    """The sessions in a folder of results."""

    def __init__(self, folder: str | Path) -> None:
        """Create the folder if missing, and remove temporary folders that killed runs left over a day ago.

        Args:
            folder: output folder.

        Raises:
            OutputError: the folder is not writable.
        """
        self.place = Path(folder) / SESSIONS
        try:
            self.place.mkdir(parents=True, exist_ok=True)
            for left in self.place.glob(f"{MARK}*"):
                if is_abandoned(left, time.time()):
                    shutil.rmtree(left, ignore_errors=True)
        except OSError as error:
            raise self._refusal(error) from None

    def record(self, name: str) -> Mapping[str, Any]:
        """The stored record of a session; empty if there is none or a file is missing."""
        found = self.document(name, RECORD)
        whole = found.get("schema") == SCHEMA and all((self.place / name / file).is_file() for file in found["files"])
        return found if whole else {}

    def document(self, name: str, file: str) -> Mapping[str, Any]:
        """A result file of a session; empty if there is none."""
        try:
            found = read_json(self.place / name / file)
        except (OSError, ValueError):
            return {}
        return found if isinstance(found, dict) else {}

    def keep(self, name: str, record: Mapping[str, Any], files: Mapping[str, bytes]) -> None:
        """Store a session with its files, replacing an existing one completely or not at all.

        Args:
            name: name of the session.
            record: content of its record.
            files: content of each file by name.

        Raises:
            OutputError: the session cannot be written; an existing one is kept.
        """
        text = json.dumps({"schema": SCHEMA, **record}, indent=2, ensure_ascii=False) + "\n"
        new = None
        try:
            new = Path(tempfile.mkdtemp(prefix=MARK, dir=self.place))
            for file, content in {**files, RECORD: text.encode()}.items():
                (new / file).write_bytes(content)
            give_usual_rights(new)
            self._exchange(new, self.place / name)
        except OSError as error:
            raise self._refusal(error) from None
        finally:
            if new is not None:
                shutil.rmtree(new, ignore_errors=True)

    def _exchange(self, new: Path, place: Path) -> None:
        """Replace the old folder by the new one; safe against concurrent runs."""
        with tempfile.TemporaryDirectory(prefix=MARK, dir=self.place, ignore_cleanup_errors=True) as aside:
            for again in (True, True, False):
                with suppress(FileNotFoundError):
                    os.rename(place, Path(tempfile.mkdtemp(dir=aside)) / place.name)
                try:
                    return os.rename(new, place)
                except OSError:
                    if not again:
                        raise

    def _refusal(self, error: OSError) -> OutputError:
        why = error.strerror or type(error).__name__
        return OutputError(
            f"cannot write results to {self.place}: {why}; name another folder with -o, or free disk space"
        )
