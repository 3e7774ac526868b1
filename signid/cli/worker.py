"""Commands one after another in one process: `python -m signid.cli.worker`, as a fleet begins it.

Each line of standard input is an order. Each answer is the length of a header in sixteen digits, the header, and the
bytes of the files that it lists.
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


def attend(orders: Iterable[bytes], answers: IO[bytes]) -> None:
    """Carry out every order, until there are no more or it is interrupted.

    Args:
        orders: JSON, a line each.
        answers: where each goes as soon as it is complete.
    """
    for line in orders:
        with TemporaryDirectory(prefix="signid-") as place:
            code, said = _carry_out(json.loads(line), place)
            files = {path.name: path.read_bytes() for path in sorted(Path(place).iterdir())}
        if code == INTERRUPTED:
            return
        sizes = [[name, len(content)] for name, content in files.items()]
        header = json.dumps({"code": code, "said": said, "files": sizes}).encode()
        answers.write(b"%016d" % len(header) + header + b"".join(files.values()))
        answers.flush()


def _carry_out(order: dict[str, Any], place: str) -> tuple[int | None, list[str]]:
    """The exit code, and what was said on standard error."""
    try:
        os.chdir(order["folder"])
    except OSError as error:
        return None, [f"the folder {order['folder']} cannot be used where the work is done: {error.strerror}"]
    told = StringIO()
    with redirect_stdout(StringIO()), redirect_stderr(told):
        code = run([*order["arguments"], "-o", str(Path(place) / order["output"])])
    return code, [line.removeprefix("signid: ") for line in told.getvalue().splitlines()]


def main() -> None:
    """Standard output is kept for answers; what libraries print there is not shown."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(INTERRUPTED))  # leaving no temporary folder behind
    with os.fdopen(os.dup(1), "wb") as answers:
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        try:
            attend(sys.stdin.buffer, answers)
        except (BrokenPipeError, KeyboardInterrupt):
            pass


if __name__ == "__main__":
    main()
