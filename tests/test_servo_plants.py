"""Drives in MuJoCo agree with signid's closed loop, lie in their intervals, and their faults are named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.servo.coverage import Case, cases, intervals
from benchmarks.servo.drive import Truth
from benchmarks.servo.plant import record
from benchmarks.servo.robots import Bench, benches, motion
from benchmarks.servo_faults.trial import FAULTS, run_trial, simulation, stated
from signid.servo.plant import grids_of_arrays, roll_out


@pytest.fixture
def pendulum(tmp_path: Path) -> Bench:
    (found,) = benches(tmp_path, ("pendulum",))
    return found


@pytest.mark.slow_cases("change5|change3|change4")
@pytest.mark.parametrize(
    "change",
    [
        {},
        {"law": "duty", "effort_limit": 2.0},
        {"law": "torque_speed", "effort_limit": 3.0, "speed_limit": 8.0},
        {"dead_band": 0.02},
        {"load_friction": 0.2},
        {"droop": 0.2},
    ],
)
def test_mujoco_and_signid_agree_on_a_drive(change: dict[str, object], pendulum: Bench) -> None:
    drive = replace(pendulum.drives["joint"], **change)  # type: ignore[arg-type]
    command = motion(pendulum, 1, 6.0, 100.0)
    columns = record(pendulum.urdf, Truth({"joint": drive}), command, 100.0, 1)
    (grid,) = grids_of_arrays(["joint"], columns["t"], columns["q_joint"], columns["q_des_joint"])
    q = roll_out(simulation(pendulum), {"joint": stated(drive)}, grid)
    assert np.sqrt(np.mean((q - grid.q)[100:] ** 2)) < 8e-3  # the speed at the start is not measured


def test_dry_friction_beyond_the_stated_one_is_not_called_stribeck_friction(pendulum: Bench, tmp_path: Path) -> None:
    (fault,) = (fault for fault in FAULTS if fault.name == "coulomb")
    outcome = run_trial(pendulum, fault, 100, tmp_path)
    assert outcome.first == "coulomb_friction" and outcome.probability > 0.9


@pytest.mark.slow
@pytest.mark.parametrize("case", [*cases([6], ["pendulum"]), *cases([2], ["arm"])], ids=lambda case: case.plant)
def test_numbers_of_other_plants_lie_in_their_intervals(case: Case, tmp_path: Path) -> None:
    rows, _, rms = intervals(case, tmp_path)
    assert {row.number for row in rows} >= {"kp", "damping", "armature", "delay"} and rms < 2e-3
    assert max(abs(row.score) for row in rows) < 4.0
    assert all(row.std < 0.02 * row.truth for row in rows if row.number != "delay")
