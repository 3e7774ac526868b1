"""The notebook runs in one namespace; what its cells show is short, escaped and true, and stored with it."""

from __future__ import annotations

import tomllib

import polars as pl
import pytest
from example import CELLS, CODE, HERE, NOTEBOOK, Ran, notebook
from test_size import HOSTS, MACHINE

import signid
from signid.types import Result

pytestmark = pytest.mark.slow


@pytest.fixture
def ran() -> Ran:
    return notebook()


def test_the_cells_show_results_and_tables(ran: Ran) -> None:
    kinds = [type(value).__name__ for value in ran.shown if value is not None]
    results = {"Robot", "Recording", "Identification", "Estimate", "Validation", "Diagnosis"}
    assert results | {"DataFrame", "tuple", "dict"} == set(kinds)
    for value in ran.shown:
        if type(value).__name__ in results:
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


def test_the_notebook_is_stored_with_what_its_cells_show(ran: Ran) -> None:
    """robots/README.md says how."""
    for each, value in zip(CELLS, ran.shown, strict=True):
        shown = [output["data"] for output in each["outputs"]]
        assert len(shown) == (value is not None) and not each["metadata"], "no messages, no times of execution"
        if isinstance(value, Result):
            assert "".join(shown[0]["text/plain"]) == repr(value) and "<table>" in "".join(shown[0]["text/html"])
    text = (HERE / "tutorial.ipynb").read_text(encoding="utf-8")
    assert len(text) < 600_000 and not MACHINE.search(text) and not HOSTS.search(text) and "<script" not in text


def test_the_notebook_is_short_and_its_cells_have_names() -> None:
    identifiers = [each["id"] for each in NOTEBOOK["cells"]]
    assert NOTEBOOK["nbformat"] == 4 and len(set(identifiers)) == len(identifiers)
    assert sum(each["cell_type"] == "markdown" for each in NOTEBOOK["cells"]) >= 6
    assert all(len(source.splitlines()) <= 5 for source in CODE), "short cells"
    assert all(name in dir(signid) for name in ("load_robot", "identify", "diagnose", "validate", "report"))
