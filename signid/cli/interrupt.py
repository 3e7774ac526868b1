"""Ctrl-C and SIGTERM: the first signal ends searches with the best answer so far, the second ends the process."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from ..deadline import stop_searches

NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}


class Interruption(KeyboardInterrupt):
    """Interruption of a command.

    CPython ends a process by the signal, ignoring the exit code, if a plain KeyboardInterrupt passes through `exec`
    of a string (as in the creation of dataclasses). A subclass avoids this.
    """


@dataclass
class Heard:
    """Last signal received during a command, and the number of signals."""

    last: signal.Signals | None = None
    count: int = 0

    def hear(self, number: int, frame: FrameType | None) -> None:
        """End running searches; end the command if no search has an answer or a second signal arrives."""
        self.last, self.count = signal.Signals(number), self.count + 1
        if self.count > 1 or not stop_searches(NAMES[self.last]):
            raise Interruption

    def sentence(self, number: signal.Signals) -> str:
        """Explain why an interrupted command has no result."""
        when = "again, before the result was complete" if self.count > 1 else "before there was a result"
        return f"{NAMES[number]} ended the command {when}; no file was written"


@contextmanager
def signals_heard() -> Iterator[Heard]:
    """Handle both signals by the yielded object; restore the former handlers afterwards."""
    heard = Heard()
    former = {number: signal.signal(number, heard.hear) for number in NAMES}
    try:
        yield heard
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
