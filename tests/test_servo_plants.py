"""Drives in MuJoCo agree with signid's closed loop, lie in their intervals, and their faults are named."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from benchmarks.servo.coverage import Case, cases, intervals
from benchmarks.servo.drive import Drive, Torque, Truth
from benchmarks.servo.plant import build, record
from benchmarks.servo.robots import Bench, benches, motion
from benchmarks.servo_faults.faults import FAULTS, injected
from benchmarks.servo_faults.trial import run_trial, simulation, stated
from signid.servo.plant import grids_of_arrays, roll_out


@pytest.fixture
def pendulum(tmp_path: Path) -> Bench:
    (found,) = benches(tmp_path, ("pendulum",))
    return found


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


def test_torque_of_a_drive() -> None:
    drives = [Drive(kp=10, kd=1, effort_limit=2), Drive(law="duty", kp=10, kd=1, effort_limit=2), Drive(kp=10, kd=0)]
    torque = Torque(drives)
    got = torque(np.array([1.0, 1.0, 0.1]), np.zeros(3), np.array([1.0, 1.0, 0.0]), 1e-3)
    assert got == pytest.approx([2.0, 1.0, 1.0])
    banded = Torque([Drive(kp=10, kd=0, dead_band=0.02), Drive(kp=10, kd=0, droop=1.0)])
    assert banded(np.full(2, 0.1), np.zeros(2), np.zeros(2), 1e-3) == pytest.approx([0.8, 0.5])


def test_commands_act_after_the_delay(pendulum: Bench) -> None:
    drive = replace(pendulum.drives["joint"], delay=0.05, coulomb_friction=2.0)
    command = np.full((60, 1), 0.2)
    command[20:] = 0.8
    q = record(pendulum.urdf, Truth({"joint": drive}), command, 100.0, 1)["q_joint"]
    assert np.ptp(q[15:25]) < 4e-3 < np.ptp(q[25:35])


def test_faults_change_the_recorded_robot_only(pendulum: Bench) -> None:
    for fault in FAULTS:
        truth, joint = injected(pendulum, fault, {"joint": 3.0}, np.random.default_rng(0))
        assert joint == "joint" and (truth.payload or truth.drives["joint"] != pendulum.drives["joint"])
        assert build(pendulum.urdf, truth, 1e-3)[1] == ["joint"] or truth.drives["joint"].backlash


@pytest.mark.parametrize("name", ["", "gain_up", "delay", "effort", "dead_band"])
def test_trials_are_judged(name: str, pendulum: Bench, tmp_path: Path) -> None:
    fault = next((fault for fault in FAULTS if fault.name == name), None)
    found = run_trial(pendulum, fault, 1, tmp_path)
    assert found.right and not found.sure and found.verdict == ("named" if name else "nothing_missing")


@pytest.mark.parametrize("case", [*cases([6], ["pendulum"]), *cases([2], ["arm"])], ids=lambda case: case.plant)
def test_numbers_of_other_plants_lie_in_their_intervals(case: Case, tmp_path: Path) -> None:
    rows, _, rms = intervals(case, tmp_path)
    assert {row.number for row in rows} >= {"kp", "damping", "armature", "delay"} and rms < 2e-3
    assert max(abs(row.score) for row in rows) < 4.0
    assert all(row.std < 0.02 * row.truth for row in rows if row.number != "delay")
