"""Results of the recordings of 3r, made once per test run: those of its notebook, and without the signs of torque."""

from __future__ import annotations

import ast
import contextlib
import json
import shutil
import tempfile
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import signid
from signid.identify import Identification

HERE = Path(__file__).parents[1] / "robots" / "3r"
RECORDING, HELD_OUT = HERE / "recording.parquet", HERE / "held_out.parquet"
NOTEBOOK = json.loads((HERE / "tutorial.ipynb").read_text(encoding="utf-8"))
CELLS = [cell for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]
CODE = ["".join(cell["source"]) for cell in CELLS]


class Ran(NamedTuple):
    """Variables after the last cell, the value that each cell shows, and the files that were written."""

    names: dict[str, Any]
    shown: list[Any]
    files: set[str]


@cache
def notebook() -> Ran:
    """The notebook, executed in one namespace: `recording`, `held_out`, `result`, `model` and `found`."""
    names: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        for path in (RECORDING, HELD_OUT):
            shutil.copy(path, place)
        shown = [_cell(source, names) for source in CODE]
        return Ran(names, shown, {path.name for path in Path(place).iterdir()})


def _cell(source: str, names: dict[str, Any]) -> Any:
    """Execute a cell; the value of a last expression, as notebooks show it."""
    *body, last = ast.parse(source).body
    shows = isinstance(last, ast.Expr) and not source.rstrip().endswith(";")
    exec(compile(ast.Module(body if shows else [*body, last], []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names) if shows else None  # type: ignore[attr-defined]


@cache
def unsigned() -> Identification:
    """Identification without the signs of torque."""
    return signid.identify("3r", signid.read_recording(RECORDING, "3r", unsigned=True), held_out=HELD_OUT)
