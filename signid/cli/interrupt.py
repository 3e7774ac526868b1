"""Ctrl-C and SIGTERM: the first ends searches with the best answer so far, the second ends the process."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from types import FrameType

from ..deadline import stop_searches

NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}


class Interruption(KeyboardInterrupt):
    """The end of a command.

    A KeyboardInterrupt itself that passes through `exec` of a text, as where dataclasses are made, lets CPython end the
    process by the signal, whatever exit code was asked for.
    """


@dataclass
class Heard:
    """Signals of a command: the last of them, and how many there were."""

    last: signal.Signals | None = None
    count: int = 0

    def hear(self, number: int, frame: FrameType | None) -> None:
        """End the searches under way, or the command where none has an answer or this is not the first signal.

        Raises:
            Interruption: the command ends.
        """
        self.last, self.count = signal.Signals(number), self.count + 1
        if self.count > 1 or not stop_searches(NAMES[self.last]):
            raise Interruption

    def sentence(self, number: signal.Signals) -> str:
        """The reason why a command that a signal ended has no result."""
        when = "again, before the result was complete" if self.count > 1 else "before there was a result"
        return f"{NAMES[number]} ended the command {when}; no file of it was written"


@contextmanager
def signals_heard() -> Iterator[Heard]:
    """Both signals are handled by the yielded object; the former handlers return afterwards."""
    heard = Heard()
    former = {number: signal.signal(number, heard.hear) for number in NAMES}
    try:
        yield heard
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
