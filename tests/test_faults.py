"""Each planted recording fault gives its own sentence and no other; sound recordings pass."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from motions import Trial, trial
from numpy.testing import assert_allclose
from swing import csv

import signid
from signid.check import check
from signid.cli import run
from signid.errors import OptionError
from signid.faults import RecordingFaults, examine
from signid.faults.distortions import Distortion, distortion_fault
from signid.faults.evidence import gather, missing_laws
from signid.model import Model, stated_inertials, stated_laws
from signid.output.report.results.check import check_document
from signid.regression.motion import Motion
from signid.regression.session import Options, prepare
from signid.types import Array, Robot

JOINTS = tuple(f"{name}_joint" for name in ("shoulder_pan", "shoulder_lift", "elbow", "wrist_1", "wrist_2", "wrist_3"))
Spoil = Callable[[Trial, Array, Array], dict[str, Array]]


@cache
def arm() -> Trial:
    """A UR5 with friction, and rotors that its description lacks."""
    return trial(signid.load_robot("ur5"), seed=4)


def sound(seed: int = 0) -> tuple[Array, Array]:
    """Positions and torques of the arm as encoders and drives measure them."""
    whole, rng = arm(), np.random.default_rng(seed)
    count = 2 * np.pi / 2**17
    noise = 0.02 * np.std(whole.torque, axis=0) * rng.standard_normal(whole.torque.shape)
    return np.round(whole.q / count) * count, whole.torque + noise


def look(robot: Robot, columns: dict[str, Array], options: Options | None = None) -> RecordingFaults:
    recording = signid.read_recording(columns, robot)
    session = prepare(robot, [recording], [recording], options)
    return examine(Model(session.robot, stated_inertials(session.robot), stated_laws(session.robot)), session)


def faults_of(found: RecordingFaults) -> list[tuple[str, tuple[str, ...]]]:
    return [(f.kind, f.joints) for f in found.findings if f.severity != "note"]


def turned(x: Array, *joints: int, by: float = -1.0) -> Array:
    out = x.copy()
    out[:, list(joints)] *= by
    return out


def exchanged(x: Array, *joints: int) -> Array:
    out = x.copy()
    out[:, list(joints)] = x[:, [*joints[1:], joints[0]]]
    return out


def late(x: Array, seconds: float, *joints: int) -> Array:
    t, out = arm().t, x.copy()
    for j in joints:
        out[:, j] = np.interp(t - seconds, t, x[:, j])
    return out


def held(x: Array, joint: int, first: int, count: int) -> Array:
    out = x.copy()
    out[first : first + count, joint] = x[first, joint]
    return out


def skipping(q: Array) -> Array:
    for first in (700, 1500, 2300):
        q = held(q, 2, first, 20)
    return q


PLANTED: dict[str, tuple[Callable[[Array, Array], tuple[Array, Array]], str, tuple[int, ...], str]] = {
    "torque negated": (lambda q, tau: (q, turned(tau, 2)), "torque sign", (2,), "warn"),
    "torques negated": (lambda q, tau: (q, turned(tau, 1, 2, 3)), "torque sign", (1, 2, 3), "warn"),
    "position negated": (lambda q, tau: (turned(q, 1), tau), "position sign", (1,), "refuse"),
    "axis reversed": (lambda q, tau: (turned(q, 2), turned(tau, 2)), "axis", (2,), "refuse"),
    "torques exchanged": (lambda q, tau: (q, exchanged(tau, 1, 3)), "torque order", (1, 3), "warn"),
    "torques in a ring": (lambda q, tau: (q, exchanged(tau, 1, 2, 3)), "torque order", (1, 2, 3), "warn"),
    "positions exchanged": (lambda q, tau: (exchanged(q, 1, 2), tau), "position order", (1, 2), "refuse"),
    "joints exchanged": (lambda q, tau: (exchanged(q, 0, 2), exchanged(tau, 0, 2)), "joint order", (0, 2), "refuse"),
    "millinewtons": (lambda q, tau: (q, 1e3 * tau), "units", (), "refuse"),
    "currents": (lambda q, tau: (q, tau / [11, 11, 9, 8, 10, 9]), "units", (), "refuse"),
    "a gain": (lambda q, tau: (q, turned(tau, 1, by=2.2)), "gain", (1,), "warn"),
    "a small gain": (lambda q, tau: (q, turned(tau, 2, by=0.4)), "gain", (2,), "warn"),
    "late": (lambda q, tau: (q, late(tau, 0.12, *range(6))), "lag", (0, 1, 2, 3, 4, 5), "warn"),
    "early": (lambda q, tau: (q, late(tau, -0.15, *range(6))), "lag", (0, 1, 2, 3, 4, 5), "warn"),
    "one late": (lambda q, tau: (q, late(tau, 0.15, 3)), "lag", (3,), "warn"),
    "clipped": (
        lambda q, tau: (q, np.minimum(tau, np.where(np.arange(6) == 1, np.quantile(tau, 0.9, axis=0), np.inf))),
        "clipping",
        (1,),
        "warn",
    ),
    "stuck": (lambda q, tau: (q, held(tau, 4, 1000, 200)), "stuck torque", (4,), "warn"),
    "absolute": (lambda q, tau: (q, np.abs(tau)), "absolute torque", tuple(range(6)), "refuse"),
    "one absolute": (lambda q, tau: (q, tau * np.sign(tau) ** (np.arange(6) == 2)), "absolute torque", (2,), "refuse"),
    "skipping": (lambda q, tau: (skipping(q), tau), "skipping position", (2,), "warn"),
}


def test_a_sound_recording_passes() -> None:
    q, tau = sound()
    found = look(arm().robot, {"t": arm().t, "q": q, "tau": tau})
    assert found.findings == () and found.refusal == ""
    assert set(found.signs) == set(found.order) == {"right"}
    assert found.explained.min() > 0.98
    known = np.isfinite(found.factor)
    assert known[1:3].all()
    assert_allclose(found.factor[known], 1, atol=0.05)
    assert np.nanmax(np.abs(found.lag)) < 0.02


@cache
def planted(name: str) -> RecordingFaults:
    """Faults found in the arm's recording with a fault of the table."""
    q, tau = PLANTED[name][0](*sound())
    return look(arm().robot, {"t": arm().t, "q": q, "tau": tau})


@pytest.mark.parametrize("name", PLANTED)
def test_a_planted_fault_is_reported_and_nothing_else(name: str) -> None:
    _, kind, joints, severity = PLANTED[name]
    found = planted(name)
    assert faults_of(found) == [(kind, tuple(arm().robot.joints[j] for j in joints))]
    assert [f.severity for f in found.findings if f.severity != "note"] == [severity]
    assert bool(found.refusal) == (severity == "refuse")
    sentence = found.flags[0]
    assert sentence[0].islower() and ";" in sentence
    assert all(arm().robot.joints[j] in sentence for j in joints) or "all joints" in sentence


def test_sentences_say_how_much_how_sure_and_how_to_mend_it() -> None:
    sign, lag, unit, gain = (planted(name) for name in ("torque negated", "late", "millinewtons", "a gain"))
    assert sign.signs[2] == "wrong" and sign.signs[1] == "right"
    assert sign.flags[0].startswith("the torque of elbow_joint has the wrong sign: negated, model and friction")
    assert "(better in 8 of 8 blocks of the recordings); negate the column" in sign.flags[0]
    assert planted("torques exchanged").order[1:4:2] == ("wrong", "wrong")
    assert lag.findings[0].measures["lag"] == pytest.approx(0.12, abs=0.01)
    assert "mN.m" in unit.refusal and unit.findings[0].measures["factor"] == pytest.approx(1e3, rel=0.05)
    assert gain.findings[0].measures["factor"] == pytest.approx(2.2, rel=0.1)


def test_equal_explanations_are_alternatives() -> None:
    """A pendulum swings alike the other way round."""
    whole = trial(signid.load_robot("1r"), seed=1)
    found = look(whole.robot, {"t": whole.t, "q": whole.q, "tau": -whole.torque})
    (finding,) = found.findings
    assert {finding.kind, *(kind for kind, _ in finding.alternatives)} == {"torque sign", "position sign"}
    assert finding.severity == "warn" and "equally likely" in finding.sentence


def test_degrees_of_joints_without_limits_are_reported() -> None:
    free, whole = signid.load_robot("ur5"), arm()
    object.__setattr__(free, "lower", np.full(6, -np.inf))
    object.__setattr__(free, "upper", np.full(6, np.inf))
    found = look(free, {"t": whole.t, "q": np.degrees(0.3 * whole.q), "tau": small_torque(whole, 0.3)})
    assert faults_of(found) == [("degrees", free.joints)] and "convert it to radians" in found.refusal


def small_torque(whole: Trial, size: float) -> Array:
    """A smaller copy of the motion, with little friction."""
    motion = Motion(whole.robot, whole.t, size * whole.q, size * whole.v, size * whole.a)
    return motion.load + 0.05 * np.sign(motion.v)


def test_eight_seconds_of_seven_joints_are_refused() -> None:
    robot = signid.load_robot("panda", joints=[f"panda_joint{j}" for j in range(1, 8)])
    whole = trial(robot, seconds=40.0)
    rows = whole.t < 8
    found = look(robot, {"t": whole.t[rows], "q": whole.q[rows], "tau": whole.torque[rows]}, Options(cutoff=5.0))
    assert "too little" in found.refusal and "record for" in found.refusal
    assert "too little data" not in {
        kind for kind, _ in faults_of(look(robot, {"t": whole.t, "q": whole.q, "tau": whole.torque}))
    }


def test_friction_and_noise_alone_give_no_order_and_no_units() -> None:
    """The last joint of a light wrist: no rigid torque to speak of, and noise."""
    q, tau = sound()
    rng = np.random.default_rng(5)
    tau[:, 5] = 0.2 * np.sign(arm().v[:, 5]) + 0.3 * rng.standard_normal(len(tau))
    found = look(arm().robot, {"t": arm().t, "q": q, "tau": tau})
    assert faults_of(found) == [] and np.isnan(found.factor[5])


def test_limits_of_the_description_are_compared() -> None:
    q, tau = sound()
    robot = signid.load_robot("ur5")
    object.__setattr__(robot, "effort_limit", np.array([150, 20, 150, 28, 28, 28.0]))
    object.__setattr__(robot, "velocity_limit", np.array([3.2, 3.2, 0.3, 3.2, 3.2, 3.2]))
    object.__setattr__(robot, "upper", np.array([6.3, 6.3, 6.3, 0.1, 6.3, 6.3]))
    found = look(robot, {"t": arm().t, "q": q, "tau": tau})
    kinds = {f.kind: f.joints for f in found.findings}
    assert kinds == {"torque limit": JOINTS[1:2], "velocity limit": JOINTS[2:3], "position limit": JOINTS[3:4]}
    assert found.refusal == ""


def test_torques_without_a_sign_are_checked_by_size_alone() -> None:
    q, tau = sound()
    columns = {"t": arm().t} | {f"q_{j + 1}": q[:, j] for j in range(6)}
    absolute = columns | {f"abs_tau_{j + 1}": np.abs(tau[:, j]) for j in range(6)}
    found = look(arm().robot, absolute)
    assert {f.kind for f in found.findings} <= {"excitation"}  # excitation is compared with the noise
    assert set(found.signs) == {"uncertain"} and np.isnan(found.explained).all()
    huge = look(arm().robot, columns | {f"abs_tau_{j + 1}": 1e3 * np.abs(tau[:, j]) for j in range(6)})
    assert [f.kind for f in huge.findings if f.severity == "warn" and f.kind != "torque limit"] == ["units"]


def test_a_simulation_of_other_joints_is_refused() -> None:
    whole = trial(signid.load_robot("3r"))
    session = prepare(whole.robot, [whole.recording()], [whole.recording()])
    other = signid.load_robot("1r")
    with pytest.raises(OptionError, match="give a simulation of the recorded joints"):
        examine(Model(other, stated_inertials(other), ()), session)


def test_check_reports_faults_and_exits_3(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    whole = trial(signid.load_robot("3r"), seed=3)
    columns = {"t": whole.t} | {f"q_{j + 1}": whole.q[:, j] for j in range(3)}
    columns |= {f"tau_{j + 1}": (-1 if j == 1 else 1) * whole.torque[:, j] for j in range(3)}
    (tmp_path / "wrong.csv").write_text(csv(columns))
    assert run(["check", "3r", str(tmp_path / "wrong.csv")]) == 3
    out, err = capfd.readouterr()
    assert "the torque of joint_2 has the wrong sign" in err
    assert "Usable once this is corrected: the torque of joint_2 has the wrong sign" in out
    assert "faults: the torque of joint_2 has the wrong sign: negated, model and friction explain" in " ".join(
        out.split()
    )
    assert max(map(len, out.splitlines())) <= 100
    document = check_document(check(whole.robot, [signid.read_recording(columns, whole.robot)]))
    assert [joint["sign"] for joint in document["recording_faults"]["joints"]] == ["right", "wrong", "right"]
    assert [finding["kind"] for finding in document["recording_faults"]["findings"]] == ["torque sign"]


def test_a_missing_body_explains_what_a_distortion_might() -> None:
    robot = signid.load_robot("ur5")
    stated = Model(robot, stated_inertials(robot), stated_laws(robot))
    q, torque = sound()
    session = prepare(robot, [signid.read_recording({"t": arm().t, "q": q, "tau": torque}, robot)], [])
    sole = gather(stated, session, list(session.train))
    assert sole is not None
    assert max(left.max() for _, left in missing_laws(sole)) < 2e-3
    lighter = stated_inertials(robot)
    lighter[3] *= 0.3  # wrist_1_link
    evidence = gather(Model(robot, lighter, stated_laws(robot)), session, list(session.train))
    assert evidence is not None
    shares = dict(missing_laws(evidence))
    assert shares["friction or a rotor of another size"].max() > 0.02
    assert shares["another body than stated at the link that wrist_1_joint moves"].max() < 2e-3


@pytest.mark.parametrize(("law", "severity"), [("", "refuse"), ("a body", "warn")])
def test_a_distortion_refuses_only_without_a_law_that_explains_as_much(law: str, severity: str) -> None:
    found = Distortion("position scale", (1,), 1.4, 0.06, 0.006, 1.0, signals=None, law=law)  # type: ignore[arg-type]
    fault = distortion_fault(found, ("a", "b"), 8)
    assert fault.severity == severity and ("(equally likely: a body)" in fault.sentence) == bool(law)
