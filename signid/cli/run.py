"""A command from start to end: its exit code, and one sentence where it cannot be carried out."""

from __future__ import annotations

import os
import sys
import traceback
import warnings
from collections.abc import Sequence
from typing import Any, NoReturn

import typer
from typer.main import get_command

from ..errors import SignidError
from ..threads import one_thread
from .app import app

from .demo import command as demo  # noqa: F401  # isort: skip (help lists commands in this order)
from .commands import identification as identification  # isort: skip
from .commands import diagnosis as diagnosis  # isort: skip
from .commands import validation as validation  # isort: skip
from .commands import payload as payload  # isort: skip
from .commands import (
    catalogue as catalogue,
    convert as convert,
    excitation as excitation,
    exports as exports,
    simulation as simulation,
)

from .commands import replay as replay  # isort: skip
from .commands import factors as factors  # isort: skip
from .fleet import command as fleet  # noqa: F401  # isort: skip
from .commands import data as data  # isort: skip
from .interrupt import signals_heard
from .terminal import BAD, BROKEN, DONE, INTERRUPTED, complain

USAGE: Any = next(
    kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"
)  # in click, or in typer


def main() -> NoReturn:
    """Run the command that the arguments of the process ask for, hearing signals meanwhile, and exit with its code."""
    with signals_heard() as heard:
        code = run(sys.argv[1:])
        if code == INTERRUPTED and heard.last is not None:
            complain(heard.sentence(heard.last))
            code = 128 + heard.last
    sys.exit(code)


def run(arguments: Sequence[str]) -> int:
    """Run a command; the exit code: 0 done, 1 a fault of signid, 2 bad input, 3 done but flagged, 130 interrupted."""
    debug = bool(os.environ.get("SIGNID_DEBUG"))
    try:
        with one_thread(), warnings.catch_warnings():
            warnings.simplefilter("default" if debug else "ignore")  # what libraries say is not for the user
            command = get_command(app)
            given = list(arguments) or ["--help"]
            return int(command.main(args=given, prog_name="signid", standalone_mode=False, obj=given) or DONE)
    except (KeyboardInterrupt, typer.Abort):
        return INTERRUPTED
    except Exception as error:
        code, sentence = _judge(error)
        if debug:
            traceback.print_exc()
        complain(sentence)
        return code


def _judge(error: Exception) -> tuple[int, str]:
    """Exit code and sentence of an error."""
    if isinstance(error, SignidError):
        return BAD, str(error)
    if isinstance(error, USAGE):
        context = getattr(error, "ctx", None)
        told = str(error.format_message()).rstrip(".")
        return BAD, f"{told[:1].lower()}{told[1:]}; see {context.command_path if context else 'signid'} --help"
    if isinstance(error, MemoryError):
        return (
            BAD,
            "there is not enough memory for this; ask for fewer samples or steps, or give recordings as Parquet files, "
            "which are read piece by piece",
        )
    if isinstance(error, OSError):
        why = error.strerror or str(error) or type(error).__name__
        return BAD, f"cannot use {error.filename or 'a file'}: {why}; check its path and permissions"
    told = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return BROKEN, f"this is a fault of signid ({told}); please report it with what SIGNID_DEBUG=1 prints"
