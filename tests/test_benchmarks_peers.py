"""Comparison with peers: signid's results on short recordings, and evaluation of a peer's report."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")

from benchmarks.peers.ask import Peer  # noqa: E402
from benchmarks.peers.job import ENCODER, TORQUE, Arm, Case, cases, describe, hand_over, motion, record  # noqa: E402
from benchmarks.peers.results import (  # noqa: E402
    PeerResult,
    Result,
    Row,
    compare,
    diagnose,
    tables,  # noqa: E402
)
from benchmarks.plants.mujoco_ import STEP, simulate  # noqa: E402

TRAIN, TEST = 12.0, 10.0  # s
CLEAN, PAYLOAD, GAIN = "clean", "payload 1.5 kg", "torque gain 0.9, one joint"


@pytest.fixture(scope="module")
def arm() -> Arm:
    """The UR10."""
    return Arm.ur10()


@pytest.fixture(scope="module")
def known(arm: Arm) -> Mapping[str, Case]:
    """Cases by name."""
    return {case.name: case for case in cases(arm)}


@pytest.fixture(scope="module")
def results(arm: Arm, known: Mapping[str, Case], tmp_path_factory: pytest.TempPathFactory) -> Mapping[str, Result]:
    """Results of signid for three cases."""
    folder = tmp_path_factory.mktemp("arm")
    describe(arm, folder)
    names = (CLEAN, PAYLOAD, GAIN)
    return {
        name: diagnose(known[name], folder, *(record(arm, known[name], k, (TRAIN, TEST)[k]) for k in (0, 1)))
        for name in names
    }


def test_there_are_nine_faults_and_a_healthy_robot(arm: Arm, known: Mapping[str, Case]) -> None:
    faulty = [case for case in known.values() if case.effect and not case.declared]
    assert len(faulty) == 9 and next(iter(known)) == CLEAN and not known[CLEAN].faults
    assert all(case.words for case in faulty)
    assert sum(len(case.faults) == len(arm.body.joints) for case in faulty) == 3  # friction of all joints


def test_recordings_differ_by_the_fault_alone(arm: Arm, known: Mapping[str, Case]) -> None:
    clean, again, other = (record(arm, known[name], 0, 1.0) for name in (CLEAN, CLEAN, GAIN))
    assert all(np.array_equal(a, b) for a, b in zip(clean, again, strict=True))
    assert np.array_equal(clean.q, other.q)
    off = np.flatnonzero(np.abs(clean.tau - other.tau).max(axis=0) > 0)
    assert off.tolist() == [1]
    assert np.all(record(arm, known["sign lost"], 0, 1.0).tau >= 0)
    assert ENCODER < 1e-3 < TORQUE


def test_the_healthy_robot_is_clean(results: Mapping[str, Result]) -> None:
    row = results[CLEAN]
    assert row.right and row.outcome == "clean" and row.verdict == "nothing_missing" and not row.findings


@pytest.mark.parametrize(("name", "effect", "joint", "share"), [
    (PAYLOAD, "payload", "wrist_3_joint", 0.01), (GAIN, "torque_gain", "shoulder_lift_joint", 0.02)
])  # fmt: skip
def test_a_fault_is_named(results: Mapping[str, Result], name: str, effect: str, joint: str, share: float) -> None:
    row = results[name]
    first = row.findings[0]
    assert row.right and (first.effect, first.joint, first.right, row.joints) == (effect, joint, True, 1)
    assert first.truth is not None and first.value == pytest.approx(first.truth, rel=share)
    assert first.std is not None and first.std > 0 and first.probability > 0.5
    assert row.after < 0.5 * row.before and row.seconds > 0


def test_the_job_contains_all_inputs_of_the_peers(arm: Arm, known: Mapping[str, Case], tmp_path: Path) -> None:
    one, other = (record(arm, known[CLEAN], seed, 2.0) for seed in (0, 1))
    hand_over(arm, one, other, 1.0, tmp_path)
    job = dict(np.load(tmp_path / "job.npz"))
    assert np.array_equal(job["q"], one.q) and np.array_equal(job["test_tau"], other.tau)
    assert len(job["loop_command"]) == 1.0 / job["step"] + 1
    moved = simulate(arm.body, arm.drives, motion(arm, 0), 2.0, 1 / STEP)
    v = np.diff(moved.q[:4001], axis=0) / STEP  # after each step
    torque = job["loop_command"][:-1] - job["loop_stiffness"] * moved.q[:4000] - job["loop_damper"] * v
    assert np.abs(torque - moved.tau[:4000]).max() < 1e-6  # the loop is the plant's


def test_a_report_is_compared_with_that_of_the_healthy_robot() -> None:
    case = Case("offset", "encoder_offset", (), ("encoder",))
    healthy = {
        "rmse": 1.0,
        "joints": {"a": 1.0, "b": 1.0},
        "insights": ["Condition number 12.3 is fine.", "3 are poor: x, y."],
    }
    answer = {
        "rmse": 2.0,
        "joints": {"a": 1.1, "b": 1.3},
        "insights": ["Condition number 99 is fine.", "4 are poor: z."],
    }
    assert compare(case, answer, healthy) == PeerResult(answer, (), ("b",), 2.0, False)
    blunt = {**answer, "insights": [*answer["insights"], "The encoder of b reads too much."]}
    assert compare(case, blunt, healthy).named and len(compare(case, blunt, healthy).new) == 1
    bound = {"cost": 2.0, "insights": ["Parameter a (1) is at its lower bound (1)."]}
    assert compare(case, bound, {"cost": 1.0, "insights": ["Parameter b (2) is at its lower bound (2)."]}).new == ()
    assert compare(case, {"failed": "no"}, healthy) == PeerResult({"failed": "no"})


def test_without_peers_the_tables_say_so(
    known: Mapping[str, Case], results: Mapping[str, Result], tmp_path: Path
) -> None:
    peer = Peer("figaroh_peer.py report", [], tmp_path)
    assert peer.ask(tmp_path) is None and peer.version == ""
    peer.close()
    console = Console(width=160, record=True, quiet=False)
    rows = [Row(known[name], results[name], PeerResult(None), PeerResult(None)) for name in results]
    with console.capture() as shown:
        console.print(*tables(rows, ("", "")))
    assert shown.get().count("not installed") == 2 * (1 + len(rows)) and "payload, wrist_3_joint" in shown.get()
