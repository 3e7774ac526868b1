"""The audit of public servo recordings is silent where they are healthy, and finds faults that are put into them."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from servo_logs import DATA, FAULTS, PUBLIC, Columns, drive, read_public, recording

from signid.cli.run import run
from signid.faults.commands import audit_servos
from signid.recording import read_bare


@pytest.mark.slow_cases("so101")
@PUBLIC
@pytest.mark.parametrize(
    "folder", ["so101_servo", "bam_xl330", "bam_sts3250", "mauicv_servo", "go2_dls", "acromonk_dfki"]
)
def test_healthy_public_recordings_are_silent_alone_and_together(folder: str) -> None:
    files = sorted((DATA / folder).glob("*.csv.gz"))
    read = [replace(recording(read_public(f"{folder}/{file.name}")[1]), path=file.name) for file in files]
    if folder != "go2_dls":
        assert not audit_servos(read).flags
    for one in read[:12] if folder != "acromonk_dfki" else ():
        found = audit_servos(one)
        assert not found.flags or not found.joints, one.path  # drops: the drive is off nearly all the time


@PUBLIC
def test_an_arm_with_limp_joints_and_late_reads() -> None:
    found = audit_servos(recording(read_public("openarm_yizhi/collect_joint_3.csv.gz")[1]))
    text = "; ".join(found.flags)
    for words in ("1, 4, 5, 6, 7: q does not follow", "of the time steps differ", "3: 14%"):
        assert words in text
    copy = audit_servos(recording(read_public("openarm_yizhi/compensate_joint_2.csv.gz")[1]))
    assert any("q_des equals q" in flag for flag in copy.flags)


@PUBLIC
def test_lags_of_public_recordings() -> None:
    """Lags of the Go2's thighs by a fit with its dynamics: 84 to 88 ms (methods of servo mode, section 3)."""
    found = audit_servos(recording(read_public("go2_dls/held_base_first.csv.gz")[1]))
    thighs = [one for one in found.joints if "thigh" in one.joint]
    assert all(0.065 < one.lag < 0.1 and one.residual < 0.02 for one in thighs)
    assert all(one.command_period == pytest.approx(0.025, abs=1e-3) for one in found.joints)


@pytest.mark.slow_cases("go2|degrees|held|leading|copied|late|following")
@PUBLIC
@pytest.mark.parametrize("name", ["so101_servo/reaching_points.csv.gz", "go2_dls/held_base_first.csv.gz"])
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_faults_put_into_public_recordings(fault: Callable[[Columns, str], Columns], name: str) -> None:
    joints, columns = read_public(name)
    joint = joints[0]
    flags = audit_servos(recording(fault(columns, joint))).flags
    assert len(flags) == 1 and FAULTS[fault] in flags[0] and flags[0].startswith(joint), flags


def test_wrapped_duties_are_noticed() -> None:
    columns = drive()
    duty = np.clip(5 * (columns["q_des_a"] - columns["q_a"]), -1, 1)
    raw = np.rint(885 * duty) % 65536
    found, _ = read_bare({**columns, "raw": raw}, columns={"pwm_a": {"column": "raw", "scale": 1 / 885}})
    servo = found.read().servo
    assert servo is not None and servo.pwm is not None
    np.testing.assert_allclose(servo.pwm[:, 0], duty, atol=1e-3)
    scaled = audit_servos(read_bare({**columns, "pwm_a": raw / 885})[0])
    assert any("pwm_a" in flag and "16 bits" in flag for flag in scaled.flags)


def test_a_dataset_of_lerobot_needs_no_units(tmp_path: Path) -> None:
    own = drive(rate=50.0, seconds=20)
    folder = tmp_path / "set"
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    names = {"observation.state": {"names": ["elbow.pos"]}, "action": {"names": ["elbow.pos"]}}
    (folder / "meta" / "info.json").write_text(json.dumps({"fps": 50, "features": names}))
    n = len(own["t"])
    pl.DataFrame(
        {
            "observation.state": np.degrees(own["q_a"])[:, None].tolist(),
            "action": np.degrees(own["q_des_a"])[:, None].tolist(),
            "timestamp": own["t"],
            "frame_index": np.arange(n) % (n // 2),
            "episode_index": np.arange(n) // (n // 2),
        }
    ).write_parquet(folder / "data" / "chunk-000" / "file-000.parquet")
    found, units = read_bare(folder)
    assert found.joints == ("elbow",) and units == {"elbow": ""}
    [one] = audit_servos(found, units).joints
    assert one.lag == pytest.approx(0.102, abs=0.006) and not one.flags and one.unit == ""
    assert run(["check", str(folder)]) == 0
