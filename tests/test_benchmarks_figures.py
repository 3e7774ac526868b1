"""The table of accuracy is written from JSON: rows replaced, appended, kept; command and commit beside each."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from benchmarks import figures
from benchmarks.summary import origin

PAGE = """# a page

## Accuracy

| quantity | result | command, commit |
|---|---|---|
| nominal 95 % intervals hold the truth (MuJoCo, 5 % noise) | 90 % | |
| another | 3 of 4 | `python -m benchmarks.signs`, 320144e |

## Limits

| a | 1 |
"""
ORIGIN = {"command": "python -m benchmarks.coverage", "commit": "a5737d5"}
COVERAGE = {
    "origin": ORIGIN,
    "rows": [
        {"robot": "3r", "noise": "white", "coverage": 94.61},
        {"robot": "3r", "noise": "white, 3 Hz", "coverage": 93.0},
        {"robot": "ur10", "noise": "white", "coverage": 94.1},
    ],
}
TOTALS = {"named first or flagged (85 %)": "74 % (67 of 91)"}
LEFT_OUT = {
    "named first or flagged, constants as they are": "79 % (82 of 104)",
    "the same, constants chosen without the robot": "78 % (81 of 104)",
    "the same, ties decided against the robot": "77 % (80 of 104)",
}


def test_rows_are_replaced_appended_and_kept() -> None:
    documents = {"coverage": COVERAGE, "concealed_real": {"origin": ORIGIN, "totals": TOTALS}}
    written = figures.filled(PAGE, figures.rows(documents))
    before, after = PAGE.split("\n"), written.split("\n")
    assert len(after) == len(before) + 1 and after[:6] == before[:6] and after[7] == before[7]
    assert "| 94.6 % (3r), 94.1 % (ur10) | `python -m benchmarks.coverage`, a5737d5 |" in after[6]
    assert "| 67 of 91 |" in after[8] and after[9:] == before[8:]
    assert figures.filled(written, figures.rows(documents)) == written
    assert figures.filled(PAGE, []) == PAGE


def test_cells_of_the_other_benchmarks() -> None:
    targets = [
        {"words": "exact, 3 joints and more, 2%: effect and joint first", "share": 59 / 71, "of": 71},
        {"words": "exact, 3 joints and more, 5%: effect and joint first", "share": None, "of": 0},
        {"words": "hard, 3 joints and more, 2%: effect and joint first", "share": 1.0, "of": 3},
    ]
    assert figures.concealed({"targets": targets}) == "59 of 71, 0 of 0"
    assert figures.leave_out({"totals": LEFT_OUT}) == "82 of 104; 81 of 104, 80 of 104 if ties are decided against it"
    tested = [("pNARX", 5.17), ("ARX", 12.6), ("signid, refined", 8.32), ("signid identify", 8.85), ("other", None)]
    rows = [{"method": method, "test": test} for method, test in tested]
    assert figures.public({"rows": rows}) == "signid, refined: 8.32 mm; signid identify: 8.85 mm; pNARX: 5.17 mm"


def test_figures_without_command_or_commit_are_listed() -> None:
    assert list(figures.unsourced_rows(PAGE)) == ["nominal 95 % intervals hold the truth (MuJoCo, 5 % noise)"]
    sections = (
        "one\n`python -m benchmarks.x` at ac2d62c\n| a | 1 |",
        "two\n`python -m x 1000000`\n| b | 2 |",
        "three\n",
    )
    assert list(figures.unsourced("\n".join(("# b", *(f"## {section}" for section in sections))))) == ["two"]


def test_both_pages_have_a_command_and_a_commit_for_each_figure() -> None:
    assert not list(figures.unsourced_rows((figures.ROOT / "README.md").read_text("utf-8")))
    assert not list(figures.unsourced((figures.ROOT / "benchmarks" / "README.md").read_text("utf-8")))


def test_check_fails_until_the_page_is_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "coverage.json").write_text(json.dumps(COVERAGE))
    page = tmp_path / "page.md"
    page.write_text(PAGE)

    def run(*more: str) -> Any:
        monkeypatch.setattr(sys, "argv", ["figures", "--json-dir", str(tmp_path), "--readme", str(page), *more])
        return figures.main()

    assert run("--check") == 1 and page.read_text() == PAGE
    assert run() == 0 and run("--check") == 0
    (tmp_path / "coverage.json").write_text(json.dumps({**COVERAGE, "rows": COVERAGE["rows"][:1]}))
    assert run("--check") == 1


def test_the_origin_leaves_out_files() -> None:
    found = origin("coverage", ["--json", "a.json", "--quick", "--cache=b", "--robot", "3r"])
    assert found["command"] == "python -m benchmarks.coverage --quick --robot 3r" and found["commit"]
