"""Parts of the blind benchmark: sizes of faults, hidden answers and evaluation of diagnoses."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")

import signid  # noqa: E402
from benchmarks.concealed import faults, session  # noqa: E402
from benchmarks.concealed.cases import ABSENT, FAMILIES, SIZES, SUITES, Case, cases, quick, sample  # noqa: E402
from benchmarks.concealed.evaluate import EACH, TOGETHER, Evaluation, error, evaluate  # noqa: E402
from benchmarks.concealed.faults import LAWS, SPREAD, scaled  # noqa: E402
from benchmarks.concealed.scene import PERIOD, ROBOTS, Scene, described, draw, mistaken, rms  # noqa: E402
from benchmarks.concealed.summary import confusion, reliability, targets  # noqa: E402
from benchmarks.plants.faults import EFFECTS, FOREIGN, Fault  # noqa: E402
from benchmarks.plants.mujoco_ import simulate  # noqa: E402

USUAL = ("1r", "3r", "ur5", "panda", "kinova", "xarm7")
JOINTS = ["joint_1", "joint_2", "joint_3"]


@pytest.fixture(scope="module")
def scene() -> Scene:
    """Scene of the arm along one motion."""
    return Scene(described("3r"), (draw(ROBOTS["3r"], np.random.default_rng(3)),))


def test_every_law_has_a_case_and_every_robot_a_healthy_session() -> None:
    found = cases(SUITES, USUAL, SIZES, range(3))
    assert {effect for case in found for effect in case.effects} == set(EFFECTS) | set(FOREIGN) == set(LAWS)
    assert len({case.name for case in found}) == len({case.number for case in found}) == len(found)
    healthy = [case for case in found if case.suite == "none"]
    assert len(healthy) >= 60 and sum(case.hard for case in healthy) == len(healthy) / 2
    assert len(FAMILIES) >= 8 and len(ABSENT) >= 5 and set(FAMILIES) | set(ABSENT) == set(FOREIGN)
    assert set(EACH) | set(TOGETHER) | {"counterbalance", "link_inertia", "torque_sign", "channel_swap"} == set(EFFECTS)
    assert sample(found, 20, 1) == sample(found, 20, 1) != sample(found, 20, 2)
    assert len(quick()) == 25 and {case.suite for case in quick()} == {"exact", "hard", "none", "foreign", "absent"}
    assert {case.plant for case in cases(["exact"], ["3r"], SIZES, [0], "bullet")} == {"bullet"}


@pytest.mark.parametrize("effect", sorted(set(LAWS) - {"backlash", "torque_sign", "channel_swap"}))
def test_a_fault_reaches_its_size(effect: str, scene: Scene) -> None:
    fault, found = faults.plant(effect, "joint_2", 0.05, scene, np.random.default_rng(5))
    asked = 0.05 * (faults.PUSH if effect == "external_contact" else 1)
    assert found == pytest.approx(asked, rel=0.02)
    assert faults.measure(scene, fault) == pytest.approx(found)


@pytest.mark.parametrize(
    "effect",
    ("spring", "armature", "base_tilt", "link_inertia", "torque_lag", "joint_coupling", "joint_elasticity", "backlash"),
)
def test_the_simulated_fault_reaches_its_size(effect: str, scene: Scene) -> None:
    fault, _ = faults.plant(effect, "joint_2", 0.05, scene, np.random.default_rng(6))
    track = simulate(scene.body, scene.rotors, scene.motions[0], PERIOD, 500, [fault])
    v = np.gradient(track.q, track.t, axis=0)
    left = (track.tau - scene.inverse(track.q, v, np.gradient(v, track.t, axis=0)))[100:]
    shown = rms(left) / scene.scale
    whole = np.sqrt(np.sum(rms(left) ** 2) / np.sum(rms(scene.bodies) ** 2))
    found = whole if effect in SPREAD else shown.max() if effect == "joint_coupling" else shown[1]
    assert found == pytest.approx(0.05, rel=0.35 if effect == "joint_elasticity" else 0.2)  # a soft gear rings


def test_doubling_elasticity_halves_the_stiffness() -> None:
    fault = scaled(Fault("joint_elasticity", "joint_1", {"stiffness": 100.0}), 2.0)
    assert fault.numbers["stiffness"] == 50
    assert scaled(Fault("spring", "a", {"stiffness": 2.0, "rest": 0.1}), 3.0).numbers == {"stiffness": 6, "rest": 0.1}


def test_a_wrong_description_has_small_errors() -> None:
    stated = described("ur5")
    true = mistaken(stated, 0.05, np.random.default_rng(0))
    masses = [
        np.array([body.mass for body in list(signid.robot.robot_from_text(x.urdf, "urdf", "ur5").model.inertias)[1:]])
        for x in (stated, true)
    ]
    off = masses[1] / masses[0] - 1
    assert 0.01 < float(rms(off)) < 0.15 and len(off) == 6


def test_soft_dry_friction_creeps(scene: Scene) -> None:
    left = []
    for soft in (False, True):
        track = simulate(scene.body, scene.drives, scene.motions[0], PERIOD, 500, soft=soft)
        v = np.gradient(track.q, track.t, axis=0)
        rest = track.tau - scene.inverse(track.q, v, np.gradient(v, track.t, axis=0))
        friction = scene.drives.viscous_friction * v + scene.drives.coulomb_friction * np.sign(v)
        left.append(rms((rest - friction)[100:])[1] / scene.drives.coulomb_friction[1])
    assert left[1] > 1.5 * left[0]


def test_a_session_does_not_reveal_its_answer(tmp_path: Path) -> None:
    case = Case("exact", "1r", ("coulomb_friction",), 0.05, 0)
    folder = session.make(case, tmp_path)
    assert sorted(path.name for path in folder.iterdir()) == sorted(
        ["robot.urdf", "actuators.toml", *(f"recording_{k}.parquet" for k in range(1, 5))]
    )
    answer = json.loads((tmp_path / "answers" / f"{case.name}.json").read_text())
    (fault,) = answer["faults"]
    assert fault["joint"] == "joint_1" and fault["size"] == pytest.approx(0.05)
    assert "coulomb" not in str(folder) and case.name in str(folder)
    stated = tomllib.loads((folder / "actuators.toml").read_text())["joint"]["joint_1"]
    assert set(stated) == {"armature", "viscous_friction"}
    robot = signid.load_robot(folder / "robot.urdf")
    assert robot.actuators.armature[0] == pytest.approx(stated["armature"])
    times = [signid.read_recording(folder / f"recording_{k}.parquet", robot).read().t for k in range(1, 5)]
    assert all(len(t) == 2000 for t in times)
    assert [round(t[0]) for t in times] == [0, 16, 32, 48]
    before = (folder / "robot.urdf").stat().st_mtime_ns
    assert session.make(case, tmp_path) == folder and (folder / "robot.urdf").stat().st_mtime_ns == before


FIT = {"held_out_rms": [1.02, 2.04, 3.06], "irreducible_rms": [1.0, 2.0, 3.0]}


def cause(effect: str, joint: str | None, p: float = 0.99, **more: Any) -> dict[str, Any]:
    """A finding."""
    found = {"effect": effect, "joint": joint, "role": "cause", "probability": p, "parameters": {}, "alternatives": []}
    return {**found, **more}


def document(*findings: Mapping[str, Any], verdict: str = "named", unexplained: Sequence[str] = ()) -> dict[str, Any]:
    """Document of a diagnosis with joints of unexplained torque."""
    rest = [{"joint": joint, "depends_on": "velocity", "share": 0.5} for joint in unexplained]
    return {"verdict": verdict, "findings": list(findings), "unexplained": rest, "fit": {"after": FIT}}


def rate(case: Case, diagnosis: Mapping[str, Any], *faults: tuple[str, str | None, dict[str, Any]]) -> Evaluation:
    """Evaluate a document against concealed faults."""
    hidden = [{"effect": e, "joint": j, "parameters": p, "size": case.size} for e, j, p in faults]
    joints = JOINTS[: int(case.robot[0])]
    return evaluate({**case.document(), "faults": hidden, "joints": joints}, {"document": diagnosis, "cpu": 0.5})


SINGLE = Case("exact", "3r", ("spring",), 0.05, 0)
SPRING = ("spring", "joint_2", {"stiffness": 10.0, "rest": 0.0})


@pytest.mark.parametrize(
    ("diagnosis", "outcome", "sure", "spurious"),
    [
        (document(cause("spring", "joint_2")), "right", False, 0),
        (document(cause("spring", "joint_2"), cause("backlash", "joint_1")), "right", False, 1),
        (document(cause("spring", "joint_2"), cause("backlash", "joint_1", role="secondary")), "right", False, 0),
        (document(cause("spring", "joint_3")), "wrong", True, 0),
        (document(cause("spring", "joint_3", 0.8)), "wrong", False, 0),
        (document(cause("armature", "joint_2", 0.6, alternatives=[cause("spring", "joint_2")])), "stated", False, 0),
        (document(verdict="unknown", unexplained=["joint_2"]), "lead", False, 0),
        (document(verdict="unknown", unexplained=["joint_1"]), "unknown", False, 0),
        (document(cause("spring", "joint_2"), verdict="unknown", unexplained=["joint_1"]), "lead", False, 0),
        (document(verdict="nothing_missing"), "missed", False, 0),
    ],
)
def test_evaluation_of_one_fault(diagnosis: dict[str, Any], outcome: str, sure: bool, spurious: int) -> None:
    found = rate(SINGLE, diagnosis, SPRING)
    assert (found.outcome, found.sure, found.spurious) == (outcome, sure, spurious)
    assert found.after == pytest.approx(1.02)


def test_evaluation_of_other_suites() -> None:
    healthy = replace(SINGLE, suite="none", effects=())
    assert rate(healthy, document(verdict="nothing_missing")).outcome == "right"
    assert rate(healthy, document(cause("spring", "joint_1"))).outcome == "alarm"
    assert rate(healthy, document(verdict="unknown", unexplained=["joint_1"])).outcome == "alarm"
    both = document(cause("spring", "joint_2"), cause("time_delay", None))
    late = ("time_delay", None, {"delay": 0.01})
    pair = replace(SINGLE, suite="pairs")
    assert [rate(pair, both, SPRING, x).outcome for x in (late, ("armature", "joint_1", {}))] == ["both", "one"]
    assert rate(replace(SINGLE, suite="foreign"), document(cause("spring", "joint_2")), ("soft_stop", "joint_2", {}))
    absent, wave = replace(SINGLE, suite="absent"), ("velocity_wave", "joint_2", {})
    unknown = document(verdict="unknown", unexplained=["joint_2"])
    assert rate(absent, unknown, wave).outcome == "right"
    assert rate(absent, document(cause("spring", "joint_2")), wave).outcome == "wrong"
    crossed = ("crossed_torque", "joint_1", {"partner": "joint_2"})
    assert rate(absent, unknown, crossed).outcome == "unknown"
    removed = replace(SINGLE, suite="removed", skip=("time_delay",))
    assert rate(removed, document(cause("torque_lag", None)), late).outcome == "twin"
    assert rate(removed, unknown, SPRING).outcome == "right"


def test_pairs_of_joints_and_single_joints_match_either_name() -> None:
    fault = ("channel_swap", "joint_1", {"partner": "joint_2"})
    swapped = replace(SINGLE, effects=("channel_swap",))
    for joint, partner in (("joint_1", "joint_2"), ("joint_2", "joint_1")):
        named = cause("channel_swap", joint, parameters={"partner": {"value": partner}})
        assert rate(swapped, document(named), fault).outcome == "right"
    other = cause("channel_swap", "joint_1", parameters={"partner": "joint_3"})
    assert rate(swapped, document(other), fault).outcome == "wrong"
    single, late = replace(SINGLE, robot="1r"), ("time_delay", None, {"delay": 0.01})
    assert rate(single, document(cause("time_delay", "joint_1")), late).outcome == "right"
    assert rate(single, document(cause("base_tilt", None)), ("payload", "joint_1", {})).outcome == "twin"
    assert rate(SINGLE, document(cause("payload", "joint_3")), ("encoder_offset", "joint_3", {})).outcome == "twin"
    assert rate(SINGLE, document(cause("payload", "joint_3")), ("encoder_offset", "joint_2", {})).outcome == "wrong"


def test_errors_of_parameters() -> None:
    true = {"level": 2.0, "velocity": 0.1}
    assert error("stribeck_friction", {"level": {"value": 2.2}, "velocity": 0.1}, true, 3) == pytest.approx(0.05)
    wave = {"amplitude": {"value": -1.0}, "phase": {"value": np.pi}}
    assert error("counterbalance", wave, {"amplitude": 1.0, "phase": 0.0}, 1) == pytest.approx(0, abs=1e-12)
    body = {"mass": 1.0, "first_moment_x": 0.0, "first_moment_y": 0.0, "first_moment_z": 0.0}
    assert error("payload", {**body, "mass": 1.1}, body, 3) == pytest.approx(0.1)
    assert np.isnan(error("payload", body, body, 1)) and np.isnan(error("link_inertia", body, body, 6))


def test_statistics_of_evaluations() -> None:
    found = document(cause("spring", "joint_2", parameters={"stiffness": {"value": 10.4}}))
    right, missed = rate(SINGLE, found, SPRING), rate(SINGLE, document(verdict="nothing_missing"), SPRING)
    wrong = rate(SINGLE, document(cause("armature", "joint_2", 0.97)), SPRING)
    evaluations = [*[right] * 40, missed, wrong]
    assert confusion(evaluations) == [("exact", "spring", "armature", 1), ("exact", "spring", "nothing", 1)]
    bins = {one.low: (one.names, one.right) for one in reliability(evaluations)}
    assert bins[0.99] == (40, 40) and bins[0.95] == (1, 0)
    by_name = {target.words: target for target in targets(evaluations)}
    first = by_name["exact, 3 joints and more, 5%: effect and joint first"]
    assert (first.share, first.of, first.met) == (pytest.approx(40 / 42), 42, False)
    assert by_name["wrong and sure (P > .95)"].met is False
    assert by_name["exact, median parameter error at 5 %, plain laws: worst is spring"].share == pytest.approx(0.04)
    assert by_name["false alarms"].met is None
    assert by_name["residual of the extended model over the noise floor: median"].met


def test_diagnoses_are_kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []
    diagnosis = document(cause("viscous_friction", "joint_1"))
    monkeypatch.setattr(session, "diagnose_session", lambda folder, skip: calls.append((folder, skip)) or diagnosis)
    monkeypatch.setattr(session, "make", lambda case, cache: cache / "sessions" / case.name)
    case = replace(SINGLE, skip=("spring",))
    assert session.process(case, tmp_path, True, False) == session.process(case, tmp_path, True, False) == ""
    assert calls == [(tmp_path / "sessions" / case.name, ("spring",))]
    (tmp_path / "answers").mkdir()
    (tmp_path / "answers" / f"{case.name}.json").write_text("{}")
    ((answer, result),) = session.results([case, SINGLE], tmp_path)
    assert answer == {} and result["document"] == diagnosis and result["cpu"] >= 0
    monkeypatch.setattr(session, "make", lambda case, cache: 1 / 0)
    assert session.process(SINGLE, tmp_path, True, False).startswith(f"{SINGLE.key}: ZeroDivisionError")
