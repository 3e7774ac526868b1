"""Communication with a peer in its own environment."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any


class Peer:
    """Process that answers each input line, the name of a folder, with a line of JSON."""

    def __init__(self, script: str, pythons: Sequence[str], folder: Path) -> None:
        """Start a script and its argument with the first suitable Python; without one, `ask` returns None."""
        self.version, self._process = "", None
        name, *words = script.split()
        for python in pythons:
            path = [str(Path(python).absolute()), str((Path(__file__).parent / name).absolute()), *words]
            process = Popen(path, stdin=PIPE, stdout=PIPE, stderr=DEVNULL, text=True, cwd=folder, encoding="utf-8")
            first = process.stdout.readline() if process.stdout else ""
            if first:
                self.version, self._process = str(json.loads(first)["version"]), process
                break
            process.communicate()

    def ask(self, folder: Path) -> dict[str, Any] | None:
        """Answer for a job; None without a running process."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            return None
        print(folder, file=process.stdin, flush=True)
        line = process.stdout.readline()
        return dict(json.loads(line)) if line else {"failed": "the process ended without an answer"}

    def close(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.communicate()
            self._process = None
