"""Command line: `python -m signid`."""

from __future__ import annotations

import os
import signal
from types import FrameType
from typing import NoReturn

SIGNAL_NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}


def main() -> NoReturn:
    """Run the command of the process arguments; a signal while modules are imported ends it with one sentence."""
    for number in SIGNAL_NAMES:
        signal.signal(number, _end_process)
    from .cli.run import main as command  # slow import

    command()


def _end_process(number: int, frame: FrameType | None) -> None:
    """End the process at once: an exception in an import would be reported as an error of a module."""
    os.write(2, f"signid: {SIGNAL_NAMES[signal.Signals(number)]} ended the command\n".encode())
    os._exit(128 + number)


if __name__ == "__main__":
    main()
