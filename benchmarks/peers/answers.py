"""Protocol of the peers in their own Python: a folder per input line, a line of JSON per answer."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any


def answer_each(package: str, run: Callable[[Path], dict[str, Any]]) -> None:
    """Print the version of a package, then the answer for each input folder until the input ends."""
    answers, sys.stdout = sys.stdout, sys.stderr  # output of the library must not mix with the answers
    print(json.dumps({"version": version(package)}), file=answers, flush=True)
    for line in sys.stdin:
        try:
            answer = run(Path(line.strip()))
        except Exception as error:  # one job must not end the others
            answer = {"failed": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)
