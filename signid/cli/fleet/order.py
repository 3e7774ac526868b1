"""What a process is asked to do, and what it answers."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from ...version import __version__

DONE, FLAGGED = 0, 3  # exit codes of commands that leave results


class Order(NamedTuple):
    """One command of signid, to be run in a folder; its results go into a folder of its own, and come back."""

    arguments: tuple[str, ...]  # without -o
    folder: str  # that paths are relative to
    output: str = ""  # name of the only result, where the command writes a file rather than a folder
    version: str = __version__


class Answer(NamedTuple):
    """How a command ended."""

    code: int | None  # None: its process died, or never began
    said: tuple[str, ...]  # sentences, as on standard error
    files: Mapping[str, bytes]

    @property
    def done(self) -> bool:
        """Whether there are results."""
        return self.code in (DONE, FLAGGED)
