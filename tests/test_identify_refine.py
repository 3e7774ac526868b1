"""Identification refined by roll-outs: what is written, and what is refused."""

from __future__ import annotations

import json
import os
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.errors import OptionError
from signid.identify import Identification
from signid.output.report import to_json
from signid.output.report.results.identification import identification_document
from signid.regression.session import Options

EFFECTS = ("viscous_friction", "coulomb_friction", "torque_offset")


def recorded() -> Path:
    if not (data := os.environ.get("SIGNID_DATA")):
        pytest.skip("SIGNID_DATA is not set; real recordings are not in the repository")
    return Path(data) / "emps_janot" / "emps_train.csv.gz"


@cache
def emps() -> Identification:
    robot = signid.load_robot("emps")
    return signid.identify(robot, [recorded()], options=Options(effects=EFFECTS), refine=())


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
