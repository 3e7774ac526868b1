"""A peer in an environment of its own, asked one job after the other."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from subprocess import DEVNULL, PIPE, Popen
from typing import Any


class Peer:
    """A program that answers each line on its input, the name of a folder, with a line of JSON."""

    def __init__(self, script: str, pythons: Sequence[str], folder: Path) -> None:
        """Start it with the first of some Pythons that has what it needs; without any, nobody answers.

        Args:
            script: a file beside this one.
            pythons: paths.
            folder: where it may leave what it likes.
        """
        self.version, self._process = "", None
        for python in pythons:
            path = [str(Path(python).absolute()), str((Path(__file__).parent / script).absolute())]
            process = Popen(path, stdin=PIPE, stdout=PIPE, stderr=DEVNULL, text=True, cwd=folder, encoding="utf-8")
            first = process.stdout.readline() if process.stdout else ""
            if first:
                self.version, self._process = str(json.loads(first)["version"]), process
                break
            process.communicate()

    def ask(self, folder: Path) -> dict[str, Any] | None:
        """What it says of a job; None where nobody answers."""
        process = self._process
        if process is None or process.stdin is None or process.stdout is None:
            return None
        print(folder, file=process.stdin, flush=True)
        line = process.stdout.readline()
        return dict(json.loads(line)) if line else {"failed": "it ended without an answer"}

    def close(self) -> None:
        """End it."""
        if self._process is not None:
            self._process.communicate()
            self._process = None
