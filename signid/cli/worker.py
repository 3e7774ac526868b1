"""Worker process of a fleet: `python -m signid.cli.worker` runs commands one after another.

Each line of standard input is an order. Each answer consists of the length of a header in sixteen digits, the header,
and the bytes of the files that the header lists.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from collections.abc import Iterable
from contextlib import redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import IO, Any

from .run import run
from .terminal import INTERRUPTED


def serve(orders: Iterable[bytes], answers: IO[bytes]) -> None:
    """Run every order, a JSON object per line, until the input ends or the process is interrupted."""
    for line in orders:
        with TemporaryDirectory(prefix="signid-") as place:
            code, said = _run(json.loads(line), place)
            files = {path.name: path.read_bytes() for path in sorted(Path(place).iterdir())}
        if code == INTERRUPTED:
            return
        sizes = [[name, len(content)] for name, content in files.items()]
        header = json.dumps({"code": code, "said": said, "files": sizes}).encode()
        answers.write(b"%016d" % len(header) + header + b"".join(files.values()))
        answers.flush()


def _run(order: dict[str, Any], place: str) -> tuple[int | None, list[str]]:
    """Run an order; return its exit code and the lines of standard error."""
    try:
        os.chdir(order["folder"])
    except OSError as error:
        return None, [f"the folder {order['folder']} cannot be used on the worker: {error.strerror}"]
    errors = StringIO()
    with redirect_stdout(StringIO()), redirect_stderr(errors):
        code = run([*order["arguments"], "-o", str(Path(place) / order["output"])])
    return code, [line.removeprefix("signid: ") for line in errors.getvalue().splitlines()]


def main() -> None:
    """Serve orders from standard input; output that libraries print is discarded."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(INTERRUPTED))  # removes temporary folders
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        try:
            serve(sys.stdin.buffer, answers)
        except (BrokenPipeError, KeyboardInterrupt):
            pass


if __name__ == "__main__":
    main()
