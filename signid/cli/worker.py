"""Commands that a process of a fleet runs one after another."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Sequence
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from multiprocessing import parent_process
from pathlib import Path
from threading import Thread

from .run import run


def prepare(place: str) -> None:
    """Prepare a process: temporary files in a folder of its own, no output, an end when the caller ends."""
    tempfile.tempdir = place
    silent = os.open(os.devnull, os.O_WRONLY)
    for stream in (1,) if os.environ.get("SIGNID_DEBUG") else (1, 2):
        os.dup2(silent, stream)
    Thread(target=_end_with_caller, args=(place,), daemon=True).start()


def _end_with_caller(place: str) -> None:
    caller = parent_process()
    if caller is not None:
        caller.join()
    shutil.rmtree(place, ignore_errors=True)
    os._exit(1)


def perform(arguments: Sequence[str], folder: str) -> tuple[int | None, list[str], dict[str, bytes]]:
    """Run a command without its -o in a folder; its exit code, the lines of standard error and the files it wrote."""
    try:
        os.chdir(folder)
    except OSError as error:
        return None, [f"the folder {folder} cannot be used on the worker: {error.strerror}"], {}
    errors = StringIO()
    with tempfile.TemporaryDirectory(prefix="signid-") as place:
        with redirect_stdout(StringIO()), redirect_stderr(errors):
            code = run([*arguments, "-o", place])
        files = {path.name: path.read_bytes() for path in sorted(Path(place).iterdir())}
    return code, [line.removeprefix("signid: ") for line in errors.getvalue().splitlines()], files
