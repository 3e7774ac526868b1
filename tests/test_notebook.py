"""The notebook runs in one namespace, and what its cells show is short, escaped and true."""

from __future__ import annotations

import ast
import json
import shutil
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import plotly.graph_objects as go
import polars as pl
import pytest

import signid

HERE = Path(__file__).parents[1] / "robots" / "3r"
NOTEBOOK = json.loads((HERE / "tutorial.ipynb").read_text(encoding="utf-8"))
CODE = ["".join(cell["source"]) for cell in NOTEBOOK["cells"] if cell["cell_type"] == "code"]


class Ran(NamedTuple):
    """Variables after the last cell, the value that each cell shows, and the files that were written."""

    names: dict[str, Any]
    shown: list[Any]
    files: set[str]


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    place = tmp_path_factory.mktemp("notebook")
    for name in ("recording", "held_out"):
        shutil.copy(HERE / f"{name}.parquet", place)
    names: dict[str, Any] = {}
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(place)
        shown = [cell(source, names) for source in CODE]
    return Ran(names, shown, {path.name for path in place.iterdir()})


def cell(source: str, names: dict[str, Any]) -> Any:
    """Execute a cell; the value of a last expression, as notebooks show it."""
    *body, last = ast.parse(source).body
    shows = isinstance(last, ast.Expr) and not source.rstrip().endswith(";")
    exec(compile(ast.Module(body if shows else [*body, last], []), "cell", "exec"), names)
    return eval(compile(ast.Expression(last.value), "cell", "eval"), names) if shows else None  # type: ignore[attr-defined]


def test_the_cells_show_results_tables_and_figures(ran: Ran) -> None:
    kinds = [type(value).__name__ for value in ran.shown if value is not None]
    assert {"Robot", "Identification", "Validation", "Diagnosis", "DataFrame", "Figure"} == set(kinds)
    for value in ran.shown:
        if isinstance(value, go.Figure):
            assert len(value.data) and value.layout.height > 200
        elif not isinstance(value, pl.DataFrame | None):
            assert len(repr(value).splitlines()) <= 40 and "<table>" in value._repr_html_()


def test_the_numbers_of_the_notebook_are_true(ran: Ran) -> None:
    truth = tomllib.loads((HERE / "truth.toml").read_text())["joint"]
    friction = next(value for value in ran.shown if isinstance(value, pl.DataFrame))
    assert friction["joint"].to_list() == list(truth)
    for joint, level, std in friction.select("joint", "value", "std").iter_rows():
        assert abs(level - truth[joint]["coulomb_friction"]) < 4 * std
    assert ran.names["found"].verdict == "named"


def test_the_notebook_writes_its_files(ran: Ran) -> None:
    assert ran.files == {"recording.parquet", "held_out.parquet", "model.json", "extended.json", "report.html"}


def test_the_notebook_is_stored_without_outputs() -> None:
    assert NOTEBOOK["nbformat"] == 4 and all(not each.get("outputs") for each in NOTEBOOK["cells"])
    identifiers = [each["id"] for each in NOTEBOOK["cells"]]
    assert len(set(identifiers)) == len(identifiers)
    assert sum(each["cell_type"] == "markdown" for each in NOTEBOOK["cells"]) >= 6
    assert all(len(source.splitlines()) <= 5 for source in CODE), "short cells"
    assert all(name in dir(signid) for name in ("load_robot", "identify", "diagnose", "validate", "report"))
