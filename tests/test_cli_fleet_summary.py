"""Summary of sessions: the ranking of robots, and their page."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import pytest
from fleets import manifest, record
from test_output_report import shown

from signid.cli.fleet import run as run_module
from signid.cli.fleet.run import DONE, Answer, Order, fleet
from signid.output.report.results.fleet import fleet_page, fleet_tables


def diagnosis(causes: Mapping[str, float], level: float) -> dict[str, Any]:
    """The part of a diagnosis that the summary reads."""
    fit = {"joints": ["j1", "j2"], "held_out_rms": [1.0, 2.0 * level], "noise_floor": [0.5, 0.1]}
    findings = [
        {
            "effect": effect,
            "joint": "j2",
            "role": "cause",
            "probability": 0.99,
            "parameters": {"level": {"value": value, "std": 0.01, "unit": "N.m"}},
        }
        for effect, value in causes.items()
    ]
    after = {**fit, "held_out_rms": [0.5, None]}
    verdict = "named" if causes else "nothing_missing"
    return {"robot": "r", "joints": ["j1", "j2"], "fit": {"before": fit, "after": after}, "verdict": verdict} | {
        "findings": findings
    }


def test_robots_are_ranked_by_their_last_session(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record(tmp_path, 1)
    rows, answers = [], []
    for k in range(12):
        for day in (1, 2):
            rows.append(f"3r,day_0.parquet,unit {k},2026-01-0{day},diagnose")
            worn = {"coulomb_friction": 1.0 + k / 10} if k < 7 and day == 2 or k > 10 and day == 1 else {}
            answers.append(diagnosis(worn, 1.0 + k if worn else 0.1))

    def answer(orders: Sequence[Order], *_: object) -> Iterator[tuple[int, Answer]]:
        for k in reversed(range(len(orders))):
            yield k, Answer(DONE, (), {"diagnosis.json": json.dumps(answers[k]).encode()})

    monkeypatch.setattr(run_module, "spread", answer)
    found = fleet(manifest(tmp_path, *rows), tmp_path / "out").document()
    assert [robot["causes"] for robot in found["robots"]] == [["coulomb_friction of j2"]] * 7 + [[]] * 5
    assert [robot["name"] for robot in found["robots"]][:7] == [f"unit {k}" for k in reversed(range(7))]
    assert found["robots"][0]["mismatch"] == pytest.approx(140) and found["robots"][0]["left"] is None
    page = re.sub(r"<script>.*?</script>", "", fleet_page(found), flags=re.DOTALL)
    assert "Coulomb friction of j2: 1.60 ± 0.02 N.m" in page and "12 robots, 24 sessions" in page
    assert len(fleet_tables(found)) > 3


def test_equal_robots_need_one_line_each(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record(tmp_path, 1)
    causes = {"coulomb_friction": 1.0, "viscous_friction": 2.0, "torque_offset": 0.3}

    def answer(orders: Sequence[Order], *_: object) -> Iterator[tuple[int, Answer]]:
        for k in range(len(orders)):
            named = {**causes, "stribeck_friction": 0.5} if k == 3 else causes
            yield k, Answer(DONE, (), {"diagnosis.json": json.dumps(diagnosis(named, 1.0)).encode()})

    monkeypatch.setattr(run_module, "spread", answer)
    rows = [f"3r,day_0.parquet,r{k},,diagnose" for k in range(1, 13)]
    text = shown(fleet_tables(fleet(manifest(tmp_path, *rows), tmp_path / "out").document()), 80)
    lines = text[text.index("Robots by mismatch") :].splitlines()[2:14]
    assert [line.split()[0] for line in lines] == [f"r{k}" for k in range(1, 13)]
    assert all("Coulomb friction of" in line for line in lines)
