"""Run a command: return its exit code, or one sentence on standard error if it fails.

Ctrl-C and SIGTERM: the first signal ends searches with the best answer so far, the second ends the process.
"""

from __future__ import annotations

import os
import signal
import sys
import traceback
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from types import FrameType
from typing import Any, NoReturn

import typer
from typer.main import get_command

from ..deadline import one_thread, stop_searches
from ..errors import ON_COMMAND_LINE, SignidError, UndecidedReading
from .app import app
from .commands import catalogue, conversion, diagnosis, exporting, identification, replay, simulation, watching  # noqa: F401
from .fleet import command as fleet  # noqa: F401
from .terminal import BAD, BROKEN, DONE, FLAGGED, INTERRUPTED, open_streams, write_error

COMMAND_ORDER = (  # of commands in --help
    "demo inspect check identify diagnose validate watch payload effects convert excite export simulate replay "
    "fleet data"
).split()
app.registered_commands.sort(key=lambda command: COMMAND_ORDER.index(getattr(command.callback, "__name__", "")))
# in click, or in typer
USAGE_ERROR: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")
# by name, because numpy is imported late
NUMERICAL_ERRORS = {"LinAlgError", "OverflowError", "FloatingPointError", "IndexError", "StopIteration"}
SIGNAL_NAMES = {signal.SIGINT: "Ctrl-C", signal.SIGTERM: "SIGTERM"}


class _Interruption(KeyboardInterrupt):
    """Interruption of a command.

    CPython ends a process by the signal, ignoring the exit code, if a plain KeyboardInterrupt passes through `exec`
    of a string (as in the creation of dataclasses). A subclass avoids this.
    """


@dataclass
class _Heard:
    """Last signal received during a command, and the number of signals."""

    last: signal.Signals | None = None
    count: int = 0

    def hear(self, number: int, frame: FrameType | None) -> None:
        """End running searches; end the command if no search has an answer or a second signal arrives."""
        self.last, self.count = signal.Signals(number), self.count + 1
        if self.count > 1 or not stop_searches(SIGNAL_NAMES[self.last]):
            raise _Interruption

    def sentence(self, number: signal.Signals) -> str:
        """Explain why an interrupted command has no result."""
        when = "again, before the result was complete" if self.count > 1 else "before there was a result"
        return f"{SIGNAL_NAMES[number]} ended the command {when}; no file was written"


def main() -> NoReturn:
    """Run the command of the process arguments, handle signals, and exit with the command's code."""
    open_streams()
    heard = _Heard()
    former = {number: signal.signal(number, heard.hear) for number in SIGNAL_NAMES}
    try:
        code = run(sys.argv[1:])
        if code == INTERRUPTED and heard.last is not None:
            write_error(heard.sentence(heard.last))
            code = 128 + heard.last
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run a command and return its exit code.

    0: done; 1: internal error of signid; 2: bad input; 3: done but flagged; 130: interrupted.
    """
    debug = bool(os.environ.get("SIGNID_DEBUG"))
    given = list(arguments) or ["--help"]
    words = ON_COMMAND_LINE.set(True)
    try:
        with one_thread(), warnings.catch_warnings():
            warnings.simplefilter("default" if debug else "ignore")  # warnings of libraries are not for users
            command = get_command(app)
            return int(command.main(args=given, prog_name="signid", standalone_mode=False, obj=given) or DONE)
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except SystemExit as end:
        if end.code != 1:
            raise
        return DONE  # click's answer to a reader that closed the pipe
    except Exception as error:
        code, sentence = _explain(error, given)
        if debug:
            traceback.print_exc()
        write_error(sentence)
        return code
    finally:
        ON_COMMAND_LINE.reset(words)


def _explain(error: Exception, given: Sequence[str]) -> tuple[int, str]:
    """Exit code and sentence of an error of a command with the given arguments."""
    if isinstance(error, SignidError):
        return FLAGGED if isinstance(error, UndecidedReading) else BAD, str(error)
    if isinstance(error, USAGE_ERROR):
        context = getattr(error, "ctx", None)
        message = str(error.format_message()).rstrip(".")
        return BAD, f"{message[:1].lower()}{message[1:]}; see {context.command_path if context else 'signid'} --help"
    if isinstance(error, MemoryError):
        return (
            BAD,
            "there is not enough memory for this; ask for fewer samples or steps, or give recordings as Parquet files, "
            "which are read in pieces",
        )
    if isinstance(error, OSError):
        why = error.strerror or str(error) or type(error).__name__
        return BAD, f"cannot use {error.filename or 'a file'}: {why}; check its path and permissions"
    cause = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    if NUMERICAL_ERRORS & {kind.__name__ for kind in type(error).__mro__}:
        files = [word for word in given if os.path.isfile(word)] or given[1:2] or ["the input"]
        advice = "check inertials, lengths and options for numbers that are no physical ones, and signid check"
        return BAD, f"the numbers of {', '.join(files)} lead to a calculation without a result ({cause}); {advice}"
    return BROKEN, f"this is an internal error of signid ({cause}); please report it with the output of SIGNID_DEBUG=1"
