"""Laws that depend on time count from the start of a recording whose time stamps begin far from 0."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from signid.cli import run

pytestmark = pytest.mark.slow

EPOCH = 1_700_000_000
RECORD = (
    "simulate 3r --duration 20 --inject friction_drift@2:change=2,time_constant=5 --inject coulomb_friction@2:level=1 "
    "--noise 0.01 --encoder-bits 17 -o early.csv"
)


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the same recording with time stamps from 0, and since 1970."""
    folder = tmp_path_factory.mktemp("epoch")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        assert run(RECORD.split()) == 0
        head, *rows = Path("early.csv").read_text().splitlines()
        moved = (f"{float(t) + EPOCH:.9f},{rest}" for t, _, rest in (row.partition(",") for row in rows))
        Path("late.csv").write_text("\n".join([head, *moved]) + "\n")
        for name in ("early", "late"):
            assert run(f"diagnose 3r {name}.csv -o {name}".split()) in (0, 3)
    return folder


def found(folder: Path, name: str) -> Any:
    return json.loads((folder / name / "diagnosis.json").read_text())


def test_friction_drift_is_found_with_the_same_numbers(place: Path) -> None:
    early, late = (found(place, name) for name in ("early", "late"))
    assert {"friction_drift", "coulomb_friction"} == {one["effect"] for one in early["findings"]}
    for one, other in zip(early["findings"], late["findings"], strict=True):
        assert (one["effect"], one["joint"], one["role"]) == (other["effect"], other["joint"], other["role"])
        assert one["probability"] == pytest.approx(other["probability"], abs=1e-6)
        for key, number in one["parameters"].items():
            assert number["value"] == pytest.approx(other["parameters"][key]["value"], rel=1e-5), key
            assert number["std"] == pytest.approx(other["parameters"][key]["std"], rel=1e-2), key
    for part in ("before", "after"):
        assert early["fit"][part]["held_out_rms"] == pytest.approx(late["fit"][part]["held_out_rms"], rel=1e-2)


def test_a_model_with_drift_predicts_both(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(place)
    shown = {}
    for name in ("early", "late"):
        assert run(f"validate early/model.json {name}.csv -o {name}".split()) in (0, 3)
        shown[name] = json.loads(Path(name, "validation.json").read_text())["models"][0]
    early, late = shown["early"], shown["late"]
    assert early["fit"]["held_out_rms"] == pytest.approx(late["fit"]["held_out_rms"], rel=1e-2)
    assert early["rollout"]["rms"] == pytest.approx(late["rollout"]["rms"], rel=2e-2)
