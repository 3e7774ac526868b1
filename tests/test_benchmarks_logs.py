"""Changes of a log that must not matter, and how they are judged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import signid
from benchmarks.logs.__main__ import Numbers, Subject, compare, identified, of_torque, turned
from benchmarks.logs.changes import CHANGES, Changed
from signid.robot import robot_from_text

ROOT = Path(__file__).parents[1]
T = np.arange(0, 2, 0.01)
LOG = {"t": T, "q_1": 0.5 * np.sin(3 * T), "tau_1": np.cos(3 * T)}


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.name)
def test_a_change_leaves_columns_of_one_length(change: object) -> None:
    changed = change.make(LOG, np.random.default_rng(0))  # type: ignore[attr-defined]
    for log in changed.logs:
        assert len({len(x) for x in log.values()}) == 1 and len(log) == len(LOG)
        stamps = log.get("t", log.get("stamp"))
        assert stamps is not None and np.all(np.diff(stamps) >= -2.5e-3)


def test_a_held_log_repeats_rows_and_a_register_jumps_once_a_swing() -> None:
    by_name = {change.name: change for change in CHANGES}
    held = by_name["held, 4 times"].make(LOG, np.random.default_rng(0)).logs[0]
    assert np.mean(np.diff(held["q_1"]) == 0) == pytest.approx(0.75, abs=0.01)
    wrapped = by_name["register of 25 rad"].make(LOG, np.random.default_rng(0)).logs[0]["q_1"]
    jumps = np.abs(np.diff(wrapped)) > 20
    assert jumps.sum() >= 2 and wrapped[0] == pytest.approx(LOG["q_1"][0])


def test_a_turned_base_with_its_gravity_is_the_same_robot() -> None:
    text = signid.load_robot("3r").document
    other, gravity = turned(text, (0.4, -0.3, 1.0))
    one, two = (robot_from_text(x, "urdf", "3r") for x in (text, other))
    two.model.gravity.linear = gravity
    import pinocchio as pin

    q, v, a = np.random.default_rng(0).normal(size=(3, 3))
    torques = [pin.rnea(robot.model, robot.model.createData(), q, v, a) for robot in (one, two)]
    np.testing.assert_allclose(*torques, atol=1e-10)


def test_lost_information_is_subtracted() -> None:
    subject = Subject("x", Path("x"), {}, {"a": 1.0}, of_torque)
    before = Numbers({"a": 1.0}, {"a": 0.1})
    same = compare(subject, "c", 0, before, Numbers({"a": 1.15}, {"a": 0.1}))
    assert same.excess == pytest.approx(1.5) and (same.held, same.known) == (1, 1)
    wider = compare(subject, "c", 0, before, Numbers({"a": 1.15}, {"a": 0.2}, ("flag",)))
    assert wider.excess == 0 and wider.width == pytest.approx(2.0) and wider.flags == ("flag",)


def test_a_log_is_identified_from_its_files(tmp_path: Path) -> None:
    robot = signid.load_robot("3r")
    path = tmp_path / "3r.urdf"
    path.write_text(robot.document)
    read = signid.read_recording(ROOT / "robots" / "3r" / "recording.parquet", robot).read()
    columns = {
        "t": read.t,
        **{f"{k}_{j + 1}": x[:, j] for k, x in (("q", read.q), ("tau", read.tau)) for j in range(3)},
    }
    subject = Subject("3r", path, columns, {}, of_torque)
    plain, binary = (identified(subject, Changed((columns,), file=kind), tmp_path) for kind in ("csv", "parquet"))
    assert len(plain.value) == 25 and plain.value == pytest.approx(binary.value, rel=1e-9)
