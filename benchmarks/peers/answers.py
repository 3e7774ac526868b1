"""What all peers do in their own Python: a folder on each line that comes in, a line of JSON that goes out."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Any


def answer_each(package: str, told: Callable[[Path], dict[str, Any]]) -> None:
    """The version of a package, then what is told of each folder, until there is nothing more to ask."""
    answers, sys.stdout = sys.stdout, sys.stderr  # what the library prints is no answer
    print(json.dumps({"version": version(package)}), file=answers, flush=True)
    for line in sys.stdin:
        try:
            answer = told(Path(line.strip()))
        except Exception as error:  # one job must not end the others
            answer = {"failed": f"{type(error).__name__}: {error}"}
        print(json.dumps(answer), file=answers, flush=True)
