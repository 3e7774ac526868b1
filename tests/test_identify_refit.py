"""Models that are fitted again: to all rows once held-out errors are known, or by roll-outs."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from swing import csv, swing

import signid
from signid.cli import run
from signid.errors import OptionError
from signid.identify import Identification
from signid.output.report import to_json
from signid.output.report.results.identification import identification_document
from signid.regression.session import Options

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def robot() -> signid.Robot:
    return signid.load_robot("3r")


def read(name: str, robot: signid.Robot) -> signid.Recording:
    return signid.read_recording(ROOT / "robots" / "3r" / f"{name}.parquet", robot)


def test_held_out_rows_are_learned_from_after_the_fit_is_measured(robot: signid.Robot) -> None:
    first, other = read("recording", robot), read("held_out", robot)
    split, refit = (signid.identify(robot, [first], held_out=[other], refit=yes) for yes in (None, True))
    assert (split.fit.refit, refit.fit.refit) == (False, True)
    for name in ("train_rms", "held_out_rms", "held_out_r2"):
        assert np.array_equal(getattr(split.fit, name), getattr(refit.fit, name)), name
    assert np.array_equal(refit.judged.inertials, split.model.inertials)
    whole = signid.identify(robot, [first, other], refit=True)  # the last is held out; the same rows in the end
    assert np.all(np.abs(whole.estimate.value - refit.estimate.value) < 0.1 * refit.estimate.std)
    assert np.median(refit.estimate.std / split.estimate.std) < 0.9, "more rows, narrower intervals"


@pytest.mark.slow
def test_another_load_is_not_learned_from(robot: signid.Robot, tmp_path: Path) -> None:
    words = "simulate 3r --noise 0.02 --encoder-bits 17 --duration 12"
    assert run([*words.split(), "-o", str(tmp_path / "bare.csv")]) == 0
    assert run([*words.split(), "--seed", "1", "--inject", "payload:mass=0.6", "-o", str(tmp_path / "load.csv")]) == 0
    paths = (str(tmp_path / name) for name in ("bare.csv", "load.csv"))
    bare, load = (signid.read_recording(path, robot) for path in paths)
    found = signid.identify(robot, [bare, load])
    assert not found.fit.refit and found.judged is found.model
    assert any(
        "not fitted again to the held-out rows: its errors there are more than 2 times" in n for n in found.notes
    )


def test_the_command_says_it_in_json_and_can_leave_it_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "swing.csv"
    path.write_text(csv(swing()))
    for words, refit in (([], True), (["--no-refit"], False)):
        assert run(["identify", "1r", str(path), "--json", *words]) in (0, 3)
        assert json.loads(capsys.readouterr().out)["fit"]["refit"] is refit


EFFECTS = ("viscous_friction", "coulomb_friction", "torque_offset")


def recorded() -> Path:
    if not (data := os.environ.get("SIGNID_DATA")):
        pytest.skip("SIGNID_DATA is not set; real recordings are not in the repository")
    return Path(data) / "emps_janot" / "emps_train.csv.gz"


@cache
def emps() -> Identification:
    robot = signid.load_robot("emps")
    return signid.identify(robot, [recorded()], options=Options(effects=EFFECTS), refine=())


@pytest.mark.slow
def test_numbers_of_a_real_drive_are_refined() -> None:
    found = emps()
    assert found.refinement is not None and found.refinement.kept and found.refined is found.best
    assert found.refinement.after[0] < 0.8 * found.refinement.before[0]
    assert found.model is not found.best and len(found.best.laws) == 3


def test_the_document_states_the_refinement() -> None:
    shown = json.loads(to_json(identification_document(emps())))["refinement"]
    assert shown["kept"] and shown["windows"] == [2.5, 5.0] and shown["unit"] == ["m"]
    assert {law["effect"] for law in shown["effects"]} == set(EFFECTS)


def test_an_identification_without_it_is_unchanged() -> None:
    robot = signid.load_robot("emps")
    found = signid.identify(robot, [recorded()], options=Options(effects=EFFECTS))
    assert found.refinement is None and found.best is found.model
    assert np.array_equal(found.base_value, emps().base_value)
    assert "refinement" not in identification_document(found)


def test_laws_of_several_joints_are_not_chosen_by_roll_outs() -> None:
    robot = signid.load_robot("3r")
    with pytest.raises(OptionError, match="roll-outs choose laws of robots with one joint, and 3r has 3"):
        signid.identify(robot, ["robots/3r/recording.parquet"], refine=("spring",))
