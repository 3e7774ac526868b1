"""The glossary in signid/README.md has the terms and units of all results, and the laws have sources."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from signid.cli import run
from signid.effects import EFFECTS

ROOT = Path(__file__).parents[1]
GLOSSARY = (ROOT / "signid" / "README.md").read_text().partition("## Glossary")[2].partition("\n## ")[0]
ROWS = [
    [cell.strip() for cell in line.strip("|").split("|")] for line in GLOSSARY.splitlines() if line.startswith("|")
][2:]
UNITS = {unit for row in ROWS for unit in re.split(r"[,;] ", row[2])}
WORDS = """standard parameters, base parameter, armature, Stribeck velocity, pseudo-inertia, held out, residual,
noise floor, R2, roll-out, finding, cause, secondary, alternative, twin, probability, torque_share, excitation, ghost,
cut-off, sure_J, uncertain, confidence, segment, empirical, physically_consistent, horizon, std"""


def units(document: Any) -> Iterator[str]:
    """Every unit that a document names."""
    if isinstance(document, dict):
        for key, value in document.items():
            yield from ([value] if isinstance(value, str) else value) if key.endswith("unit") else units(value)
    elif isinstance(document, list):
        for item in document:
            yield from units(item)


def test_rows_are_whole() -> None:
    assert len(ROWS) > 20 and all(len(row) == 4 and row[0] and row[1] for row in ROWS)
    symbols = [row[0] for row in ROWS]
    assert len(set(symbols)) == len(symbols)


@pytest.mark.parametrize("word", [" ".join(word.split()) for word in WORDS.split(",")])
def test_words_that_results_use_are_explained(word: str) -> None:
    assert any(word in f"{row[0]} {row[1]}" for row in ROWS), word


@pytest.mark.slow
def test_units_of_results_are_in_the_glossary(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    recording = str(ROOT / "robots" / "3r" / "recording.parquet")
    found = set()
    for command in ("identify", "diagnose"):
        assert run([command, "3r", recording, "--json"]) in (0, 3)
        found |= {unit.replace("kg.m^2", "kg.m2") for unit in units(json.loads(capfd.readouterr().out))}
    assert len(found) > 5 and found <= UNITS, found - UNITS


def test_laws_have_units_that_are_explained_and_a_source() -> None:
    for law in EFFECTS:
        assert len(law.source) > 30 and "," in law.source, f"{law.name}: {law.source!r} is no source"
        for key, number in law.parameters.items():
            assert number.unit in UNITS, f"{law.name}: {key} [{number.unit}]"
