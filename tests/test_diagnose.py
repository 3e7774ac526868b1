"""Diagnoses of robots in MuJoCo: faults are named with their parameters, and nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")

from diagnosed import DRIVES, Planted, fault, look, named, read, recorded, simulation  # noqa: E402

import signid  # noqa: E402
from signid.diagnose import Diagnosis, Finding  # noqa: E402
from signid.errors import RecordingError  # noqa: E402
from signid.output.report.results.diagnosis import diagnosis_document  # noqa: E402

ALL, SURE = (0, 1, 2), 4.0  # joints; standard deviations that a number may be off by
PAYLOAD = fault("payload", mass=0.2, first_moment_x=0.03, first_moment_y=0.0, first_moment_z=0.0)
SPRING = fault("spring", 2, stiffness=1.0, rest=0.2)
GAIN = fault("torque_gain", 2, error=0.1)
CONTACT = fault("external_contact", force_x=3.0, force_y=-2.0, force_z=4.0, start=11.0, end=13.0)
DRY = (("coulomb_friction", 2),)

FAULTS: list[tuple[Planted | tuple[tuple[str, int], ...], tuple[int, ...], dict[str, float], float]] = [
    ((("viscous_friction", 1),), (0,), {"coefficient": DRIVES["3r"].viscous_friction[0]}, 0.05),
    (DRY, (1,), {"level": DRIVES["3r"].coulomb_friction[1]}, 0.05),
    (SPRING, (1,), {"stiffness": 1.0, "rest": 0.2}, 0.05),
    (fault("armature", 2, inertia=0.05), (1,), {"inertia": 0.05}, 0.04),
    (PAYLOAD, (2,), {"mass": 0.2, "first_moment_x": 0.03}, 0.05),
    (GAIN, (1,), {"error": 0.1}, 0.05),
    (fault("time_delay", delay=0.01), ALL, {"delay": 0.01}, 0.05),
    (fault("torque_lag", time_constant=0.03), ALL, {"time_constant": 0.03}, 0.05),
    (fault("encoder_offset", 3, offset=0.05), (2,), {"offset": 0.05}, 0.03),
    (fault("base_tilt", x=0.05, y=0.03), ALL, {"x": 0.05, "y": 0.03}, 0.05),
    (fault("joint_coupling", 2, partner="joint_3", inertia=0.02, viscous=0.1, coulomb=0.1), (1, 2),
     {"inertia": 0.02, "viscous": 0.1, "coulomb": 0.1}, 0.05),
    (fault("torque_sign", 2), (1,), {}, 0.0),
    (fault("channel_swap", 2, partner="joint_3"), (1, 2), {}, 0.0),
    (CONTACT, ALL, {"force_x": 3.0, "force_y": -2.0, "force_z": 4.0, "start": 11.0, "end": 13.0}, 0.15),
]  # fmt: skip


def examine(planted: Any, **more: Any) -> Diagnosis:
    """Diagnosis with a planted fault or without stated friction."""
    return look("3r", planted, **more) if isinstance(planted[0], str) else look("3r", without=planted, **more)


def effect(planted: Any) -> str:
    return str(planted[0] if isinstance(planted[0], str) else planted[0][0])


@pytest.mark.slow_cases(
    "external_contact|time_delay|payload|torque_lag|torque_sign|armature|channel_swap|spring|joint_coupling"
)
@pytest.mark.parametrize(("planted", "joints", "truth", "share"), FAULTS, ids=[effect(f[0]) for f in FAULTS])
def test_a_fault_is_named_with_its_parameters(
    planted: Any, joints: tuple[int, ...], truth: dict[str, float], share: float
) -> None:
    found = examine(planted)
    assert (found.verdict, named(found)) == ("named", [(effect(planted), joints)])
    first = found.findings[0]
    assert len(found.findings) == 1 and 0 < first.probability <= 1 and first.statistic > first.threshold >= 3
    for key, value in truth.items():
        got, std = first.law.parameters[key] - first.stated.get(key, 0.0), first.std[key]
        assert got == pytest.approx(value, rel=share, abs=0.003), key
        assert abs(got - value) < SURE * std + 0.005 * abs(value), key
    on = np.flatnonzero(first.torque_share > 0)
    assert set(on) <= {j for j in ALL if j in joints or first.law.effect.scope != "joint"} and len(on)


@pytest.mark.slow_cases(
    "external_contact|time_delay|payload|torque_lag|torque_sign|armature|channel_swap|spring|joint_coupling"
)
@pytest.mark.parametrize("planted", [f[0] for f in FAULTS[:11]], ids=[effect(f[0]) for f in FAULTS[:11]])
def test_the_extended_simulation_is_as_good_as_noise_allows(planted: Any) -> None:
    found = examine(planted)
    floor = found.after.irreducible_rms
    assert np.all(found.after.held_out_rms < 1.6 * floor)  # of one recording with its own noise
    assert np.any(found.before.held_out_rms > 2 * floor) and found.findings[0].held_out_gain > 0.3
    assert found.rollout_before is not None and found.rollout_after is not None
    before, after = (x.rms(0.5) for x in (found.rollout_before, found.rollout_after))
    assert after.max() < before.max() or before.max() < 0.02
    assert found.unexplained == () and not any("no effect of the library" in flag for flag in found.flags)


@pytest.mark.slow_cases("-1$|1r")
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("robot", ("3r", "1r"))
def test_nothing_is_missing_for_a_healthy_robot(robot: str, seed: int) -> None:
    found = look(robot, seed=seed)
    assert (found.verdict, found.findings, found.unexplained, found.flags) == ("nothing_missing", (), (), ())
    assert 0 < found.tolerance < 0.02 and found.prior_scale == 0
    assert np.all(found.after.train_rms < 1.3 * found.after.irreducible_rms)
    assert [place.joint for place in found.located] == list(range(len(found.robot.joints)))


def test_unstated_friction_is_named_and_nothing_else() -> None:
    found = look("3r", stated=("armature",))
    plain = ("viscous_friction", "coulomb_friction")
    assert found.verdict == "named" and set(named(found)) == {(name, (j,)) for name in plain for j in ALL}
    for finding in found.findings:
        name, (j,) = finding.law.effect.name, finding.law.joints
        (value,), truth = finding.law.parameters.values(), getattr(DRIVES["3r"], name)[j]
        assert value == pytest.approx(truth, rel=0.05), (name, j)


@pytest.mark.slow
def test_delay_and_lag_are_alternatives_while_they_are_short() -> None:
    found = look("3r", fault("time_delay", delay=0.005))
    listed = {finding.law.effect.name for finding in (*found.findings, *found.findings[0].alternatives)}
    assert {"time_delay", "torque_lag"} <= listed
    assert any("one of several" in flag for flag in found.flags)
    (lag,) = look("3r", fault("torque_lag", time_constant=0.06)).findings
    assert lag.law.effect.name == "torque_lag" and lag.probability > 0.95  # distinguishable once they are long


def test_recording_faults_are_flagged_too() -> None:
    for planted, words in ((fault("torque_sign", 2), "wrong sign"), (FAULTS[12][0], "exchanged")):
        found = examine(planted)
        assert any(words in flag and "joint_2" in flag for flag in found.flags)


def test_the_extended_simulation_lacks_nothing() -> None:
    first = examine(PAYLOAD)
    again = signid.diagnose(first.model, read("3r", recorded("3r", PAYLOAD, seed=9, motions=3)))
    assert (again.verdict, again.findings) == ("nothing_missing", ())
    assert np.all(again.before.train_rms < 1.3 * again.before.irreducible_rms)


def test_a_fault_without_its_law_is_not_named() -> None:
    found = look("3r", GAIN, skip=("torque_gain",))
    assert found.verdict == "unknown" and all(one.law.effect.name != "torque_gain" for one in found.findings)
    assert any("no effect of the library explains" in flag for flag in found.flags)
    assert [left.joint for left in found.unexplained] == [1]


def test_unexplained_torque_is_unknown_and_located() -> None:
    found = look("3r", fault("velocity_wave", 2, amplitude=0.4, velocity=0.3), seconds=16.0, motions=2)
    assert found.verdict == "unknown" and not found.findings
    (left,) = found.unexplained
    assert (left.joint, left.place.variable) == (1, "velocity") and 0.03 < left.share < 0.2


@pytest.mark.slow
def test_a_law_outside_the_library_gives_the_right_family_or_unknown() -> None:
    found = look("3r", fault("tustin_friction", 2, level=0.5, velocity=0.2))
    assert found.verdict == "unknown" or named(found)[0] == ("stribeck_friction", (1,))
    assert {joint for _, joints in named(found) for joint in joints} <= {1}


HEAVY = (("link_2", 1.15),)


@pytest.mark.slow
def test_a_reference_distinguishes_the_load_from_wrong_bodies() -> None:
    made, healthy = recorded("3r", PAYLOAD, heavier=HEAVY), recorded("3r", seed=3, heavier=HEAVY)
    found = signid.diagnose(simulation("3r"), read("3r", made), reference=read("3r", healthy))
    first = found.findings[0]
    assert named(found) == [("payload", (2,))]
    assert first.law.parameters["mass"] == pytest.approx(0.2, rel=0.03)
    assert first.law.parameters["first_moment_x"] == pytest.approx(0.03, rel=0.02)
    assert np.all(found.after.held_out_rms < 1.6 * found.after.irreducible_rms)


def test_torque_without_a_sign_is_diagnosed() -> None:
    found = signid.diagnose(simulation("3r", without=DRY), read("3r", recorded("3r"), unsigned=True))
    assert found.signs is not None and len(found.signs.segments)
    first: Finding = found.findings[0]
    assert (found.verdict, named(found)) == ("named", [("coulomb_friction", (1,))])
    assert first.law.parameters["level"] == pytest.approx(DRIVES["3r"].coulomb_friction[1], rel=0.06)
    assert diagnosis_document(found)["signs"]["segments"]


@pytest.mark.parametrize("rows", (40, 100, 200))
def test_too_little_data_is_refused_in_one_sentence(rows: int) -> None:
    (whole,) = recorded("3r", motions=1)
    with pytest.raises(RecordingError) as refused:
        signid.diagnose(simulation("3r"), read("3r", ({key: x[:rows] for key, x in whole.items()},)))
    said = str(refused.value)
    assert "too short" in said or "too little" in said
    assert not said[0].isupper() and said[-1] != "." and any(x.isdigit() for x in said)
