"""A command opens the file of a recording once for its digest and once for its samples, and decodes it once."""

from __future__ import annotations

import json
import subprocess
import sys

import polars as pl
import pytest

from signid.cli import run

COUNT = """
import json, os, sys
from collections import Counter

opened, decoded, report = Counter(), Counter(), {}
sys.addaudithook(
    lambda event, given: opened.update([os.path.basename(given[0])])
    if event == "open" and isinstance(given[0], (str, os.PathLike)) else None
)
from signid.cli import run
from signid.recording.formats.parquet import ScannedTable

number = ScannedTable._number

def count(table, name):
    decoded[name] += 1
    return number(table, name)

ScannedTable._number = count
for verb in ("identify", "diagnose"):
    for file in ("log.csv", "log.parquet"):
        opened.clear(), decoded.clear()
        code = run([verb, "1r", file, "-o", f"{verb}_{file}"])
        report[f"{verb} {file}"] = {"code": code, "opened": opened[file], "decoded": dict(decoded)}
with open("report.json", "w") as stream:
    json.dump(report, stream)
"""


@pytest.fixture(scope="module")
def counted(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, object]]:
    """Files that commands on a recording of a pendulum, as text and as Parquet, opened and decoded in one process."""
    folder = tmp_path_factory.mktemp("once")
    simulated = ["simulate", "1r", "--duration", "8", "--seed", "1", "--noise", "0.02", "-o"]
    assert run([*simulated, str(folder / "log.csv")]) == 0
    pl.read_csv(folder / "log.csv").write_parquet(folder / "log.parquet")
    subprocess.run([sys.executable, "-c", COUNT], capture_output=True, cwd=folder, check=True)
    found: dict[str, dict[str, object]] = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    return found


@pytest.mark.parametrize("verb", ["identify", "diagnose"])
@pytest.mark.parametrize(("name", "opened"), [("log.csv", 2), ("log.parquet", 1)])  # polars opens Parquet files itself
def test_a_command_reads_a_recording_once(
    counted: dict[str, dict[str, object]], verb: str, name: str, opened: int
) -> None:
    found = counted[f"{verb} {name}"]
    assert (found["code"], found["opened"]) == (0, opened)
    decoded = found["decoded"]
    assert isinstance(decoded, dict)
    assert bool(decoded) == name.endswith("parquet") and {*decoded.values()} <= {1}
