"""A command opens the file of a recording once for its digest and once for its samples, and decodes it once."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest

from signid.cli import run

COUNT = """
import json, os, runpy, sys
from collections import Counter

file, report, *arguments = sys.argv[1:]
opened, decoded = 0, Counter()

def watch(event, given):
    global opened
    opened += event == "open" and isinstance(given[0], (str, os.PathLike)) and os.fspath(given[0]) == file

sys.addaudithook(watch)
from signid.recording.formats.parquet import ScannedTable

number = ScannedTable._number

def count(table, name):
    decoded[name] += 1
    return number(table, name)

ScannedTable._number = count
sys.argv = ["signid", *arguments]
try:
    runpy.run_module("signid", run_name="__main__")
finally:
    with open(report, "w") as stream:
        json.dump({"opened": opened, "decoded": decoded}, stream)
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording of a pendulum, as text and as Parquet."""
    folder = tmp_path_factory.mktemp("once")
    simulated = ["simulate", "1r", "--duration", "8", "--seed", "1", "--noise", "0.02", "-o"]
    assert run([*simulated, str(folder / "log.csv")]) == 0
    pl.read_csv(folder / "log.csv").write_parquet(folder / "log.parquet")
    return folder


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
@pytest.mark.parametrize(("name", "opened"), [("log.csv", 2), ("log.parquet", 1)])
def test_a_command_reads_a_recording_once(folder: Path, verb: str, name: str, opened: int) -> None:
    report = folder / f"{verb}_{name}.json"
    file, out = str(folder / name), str(folder / f"{verb}_{name}")
    command = [sys.executable, "-c", COUNT, file, str(report), verb, "1r", file, "-o", out]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder, env=dict(os.environ))
    found = json.loads(report.read_text(encoding="utf-8"))
    assert done.returncode == 0, done.stderr
    assert found["opened"] == opened  # polars opens Parquet files itself
    assert bool(found["decoded"]) == name.endswith("parquet") and {*found["decoded"].values()} <= {1}
