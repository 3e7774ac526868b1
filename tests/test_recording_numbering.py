"""Columns numbered ambiguously are refused or flagged; other columns stay as they are."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.cli import run
from signid.errors import RecordingError

T = np.arange(1200) / 100.0


def numbered(numbers: Sequence[int]) -> dict[str, np.ndarray]:
    """Positions and torques of joints by number."""
    q = {f"q_{k}": np.sin((1 + 0.1 * k) * T) for k in numbers}
    return {"t": T, **q, **{f"tau_{k}": np.cos((1 + 0.2 * k) * T) for k in numbers}}


@pytest.mark.parametrize("robot", ["tiago", "tiago_no_hand"])
def test_an_arm_is_not_taken_for_casters(robot: str) -> None:
    known = signid.load_robot(robot)
    with pytest.raises(RecordingError, match="wheel_right_joint, .*arm_1_joint to arm_7_joint may be meant") as caught:
        signid.read_recording(numbered(range(1, 8)), known)
    line = re.search(r"joints = \{.*\}", str(caught.value))
    assert line is not None and len(str(caught.value)) <= 390
    found = signid.read_recording(numbered(range(1, 8)), known, columns=tomllib.loads(line[0]))
    assert found.joints == tuple(f"arm_{k}_joint" for k in range(1, 8)) and not found.flags


def test_the_command_ends_with_2_and_shows_the_line(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    columns = numbered(range(1, 8))
    rows = "\n".join(",".join(f"{x:.6f}" for x in row) for row in zip(*columns.values(), strict=True))
    path = tmp_path / "r.csv"
    path.write_text(f"{','.join(columns)}\n{rows}\n")
    assert run(["identify", "tiago", str(path), "-o", str(tmp_path / "out")]) == 2
    err = capfd.readouterr().err
    assert 'arm_7_joint = "7"' in err and len(err.splitlines()) == 1
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("robot", "numbers", "says"),
    [
        ("baxter", range(1, 8), "right_s0 to right_w2 may be meant"),
        ("talos", range(1, 8), "arm_left_1_joint to arm_left_7_joint may be meant"),
        ("tiago", range(1, 3), "head_1_joint to head_2_joint may be meant"),
    ],
)
def test_uncertain_numbers_are_flagged(robot: str, numbers: range, says: str) -> None:
    (flag,) = signid.read_recording(numbered(numbers), signid.load_robot(robot)).flags
    assert says in flag and "(columns=)" in flag and len(flag) <= 390


def test_uncertain_columns_are_flags_of_the_result() -> None:
    known = signid.load_robot("tiago", joints=["1", "2", "4", "5"])
    recording = signid.read_recording(numbered([1, 2]), known)
    assert recording.flags
    for verb in (signid.check, signid.identify):
        assert verb(known, [recording]).flags[:2].count(recording.flags[0]) == 1  # type: ignore[operator]


@pytest.mark.parametrize(
    ("robot", "numbers"),
    [
        ("panda", range(1, 8)),  # names that have the numbers
        ("panda", range(1, 9)),  # all joints
        ("tiago_no_hand", range(1, 13)),
        ("tiago", range(6, 13)),  # one chain of arm joints
        ("ur10", range(1, 4)),
        ("go2", range(1, 7)),  # two legs: no chain is as long
        ("kinova", range(1, 4)),
        ("3r", range(1, 3)),
    ],
)
def test_unambiguous_numbers_stay_as_they_are(robot: str, numbers: range) -> None:
    known = signid.load_robot(robot)
    found = signid.read_recording(numbered(numbers), known)
    assert found.joints == tuple(known.joints[k - 1] for k in numbers) and not found.flags


def test_chosen_joints_are_not_questioned() -> None:
    known = signid.load_robot("tiago", joints=[str(k) for k in range(1, 8)])
    assert not signid.read_recording(numbered(range(1, 8)), known).flags
