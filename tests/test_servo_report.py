"""Reports of position drives: headline, bounds, one sentence a reason, friction, time of held-out data, red."""

from __future__ import annotations

import re
from base64 import b64decode
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from servo_results import invented

import signid
from signid.cli.terminal import show
from signid.model import load_model, with_servos
from signid.output.report import tables
from signid.output.report.pages import friction_plots, steady_friction
from signid.output.report.plots import closed_loop_plots
from signid.output.report.results.servo_identification import loop_words, poor_joints
from signid.servo.identify import ServoIdentification, ServoJoint, ServoNumber
from signid.servo.identify.flags import by_sentence
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servos import Servo


def head(page: str) -> str:
    """Classes and headline of a page."""
    found = re.search(r'<header class="([^"]*)">.*?<h1>(.*?)</h1>', page, re.DOTALL)
    assert found is not None
    return " | ".join(found.groups())


def with_errors(whole: Any, nominal: str = "q = q_des", **more: Any) -> ServoIdentification:
    """The invented identification with other errors of whole recordings [rad]; tracking errors of 100 mrad."""
    rms, tracking = np.asarray(whole, float), np.full(3, 0.1)
    rollout = replace(
        invented().rollout, whole_rms=rms, nominal=nominal, nominal_whole_rms=tracking, tracking_rms=tracking
    )
    return replace(invented(), rollout=rollout, **more)


def test_the_headline_has_the_error_and_its_share_of_the_tracking_error() -> None:
    page = signid.report(with_errors([0.004, 0.006, 0.008]))
    error = "predicted to 6.2 mrad rms of held-out motion, 6 % of their tracking error"
    unit = "in units of the described masses"
    assert head(page) == f"top | 3r: 3 drives, {error}; {unit} (--known kp=VALUE: of the gain at the joint)"
    assert " ".join(repr(with_errors([0.004, 0.006, 0.008])).split()).startswith(head(page).removeprefix("top | "))
    heavier = replace(invented().scale, mass_ratios=(1.55, 1.29, 1.4), gain="kp=20")
    page = signid.report(with_errors([0.004, 0.006, 0.008], scale=heavier))
    assert head(page).endswith(
        f"; {unit}; with --known kp=20 the moved bodies are 1.29 to 1.55 times as heavy as described"
    )
    mixed = replace(with_errors([0.004, 0.003, 0.001]).rollout, units=("rad", "rad", "m"))
    assert loop_words(mixed) == "predicted to 3.5 mrad and 1.0 mm rms, 4 % and 1 % of their tracking error"
    assert "whose simulation diverges" in head(signid.report(with_errors([0.004, np.inf, 0.008])))


@pytest.mark.parametrize(
    ("whole", "nominal", "far", "poor"),
    [
        ([0.004, 0.09, 0.008], "q = q_des", (), []),
        ([0.004, 0.11, 0.008], "q = q_des", (), ["joint_2"]),
        ([0.004, np.inf, 0.008], "stated numbers", (), ["joint_2"]),
        ([0.004, 0.006, 0.008], "q = q_des", ("joint_1",), ["joint_1"]),
        ([0.004, np.nan, 0.008], "q = q_des", (), []),
    ],
)
def test_red_is_for_bad_predictions_alone(
    whole: list[float], nominal: str, far: tuple[str, ...], poor: list[str]
) -> None:
    found = with_errors(whole, nominal, far=far)
    assert found.flags and poor_joints(found.rollout, far) == poor
    assert ("unreliable" in head(signid.report(found))) == bool(poor)


def lost(joint: str, **numbers: ServoNumber) -> ServoJoint:
    """A joint with numbers that are not identifiable."""
    said = tuple(number.sentence for number in numbers.values() if number.sentence)
    return replace(invented().joints[0], joint=joint, numbers=numbers, not_identifiable=said)


def small(joint: str, name: str, below: float, unit: str) -> ServoNumber:
    """A number with an upper bound."""
    words = f"{joint}: {name.replace('_', ' ')} is not identifiable from this motion: it is below {below} {unit}"
    return ServoNumber(name, unit, None, sentence=words, below=below)


def limit(sentence: str, above: float) -> ServoNumber:
    """A limit with a lower bound."""
    return ServoNumber("effort_limit", "N.m", None, sentence=sentence, above=above)


def test_each_reason_is_one_sentence() -> None:
    unreached = "no sample saturates, so the effort limit is above"
    joints = [
        lost(
            joint,
            load_friction=small(joint, "load_friction", 0.2 + 0.02 * k, "1"),
            armature=small(joint, "armature", 0.0042 * k, "kg.m2") if k else ServoNumber("armature", "kg.m2", 1),
            effort_limit=limit(f"{joint}: {unreached} {k + 1} N.m", k + 1.0),
        )
        for k, joint in enumerate(["a", "b", "c", "d"])
    ]
    assert list(by_sentence(joints)) == [
        "not identifiable from this motion: load friction of all joints (below 0.2 to 0.26); "
        "armature of all joints but a (below 0.0042 to 0.013 kg.m2)",
        f"all joints: {unreached} 1 to 4 N.m",
    ]
    unknown = replace(joints[0].numbers["effort_limit"], above=None)
    other = [replace(joints[0], numbers={**joints[0].numbers, "effort_limit": unknown}), *joints[1:]]
    assert f"all joints: {unreached} 2 to 4 N.m where their scale is known" in list(by_sentence(other))


def test_a_sentence_of_the_tables_is_no_flag_beside_them(capsys: pytest.CaptureFixture[str]) -> None:
    result = invented(flags=["joint_1, joint_2: kd apart", "another flag"])
    assert show(tables(result), result.flags) == 3
    out, err = capsys.readouterr()
    assert out.count("joint_1, joint_2: kd apart") == 1 and "kd apart" not in err
    assert err == "signid: another flag\nsignid: a sentence of the result says what not to rely on\n"
    assert repr(result).count("joint_1, joint_2: kd apart") == 1 and "flag: another flag" in repr(result)
    page = signid.report(result)
    assert page.count("joint_1, joint_2: kd apart") == 1 and "another flag" in page


def test_held_out_curves_are_at_their_own_time() -> None:
    page = signid.report(shifted(11.5))
    assert "time of the recording [s]" in page
    x = drawn_times(shifted(11.5))
    assert x[0] == pytest.approx(11.5) and x[-1] == pytest.approx(11.5 + 4.99)
    x = drawn_times(shifted(1.7e9 + 0.5))
    assert x[0] == pytest.approx(0.5) and "time after 1700000000 s [s]" in signid.report(shifted(1.7e9 + 0.5))


def drawn_times(result: ServoIdentification) -> Any:
    """Times of the first curve of the first joint [s]."""
    first, *_ = closed_loop_plots(result.traces, result.rollout)
    return np.frombuffer(b64decode(first.plots[0].data[0]["x"]["bdata"]), "<f4")


def shifted(seconds: float) -> ServoIdentification:
    """The invented identification, whose recording begins at a time [s]."""
    (trace,) = invented().traces
    return replace(invented(), traces=(replace(trace, t=trace.t + seconds),))


@pytest.mark.parametrize("load_friction", [0.0, 0.4])
def test_friction_at_steady_speed_is_that_of_the_simulated_loop(load_friction: float) -> None:
    """A lever follows slow ramps in both directions: the error of its drive is load and friction."""
    servo = Servo(kp=200.0, kd=30.0, coulomb_friction=0.3, viscous_friction=0.2, load_friction=load_friction)
    model = with_servos(load_model("1r"), {"joint_1": servo})
    t = np.arange(1200) * 0.01
    course = 0.6 + 0.02 * np.where(t < 6, t, 12 - t)
    (grid,) = grids_of_arrays(["joint_1"], t, course, course)
    q = roll_out(model, {"joint_1": servo}, grid)[:, 0]
    v, weight = np.gradient(q, t), gravity_torque(model, q)
    held = np.interp(t - 0.005, t, course)  # each command is in force for 10 ms
    friction = servo.kp * (held - q) - servo.kd * v - weight
    for row in (450, 1050):
        expected = steady_friction(servo, v[row : row + 1], weight[row], servo.viscous_friction)[0]
        assert friction[row] == pytest.approx(expected, abs=0.005), "up and down"


def gravity_torque(model: Any, q: Any) -> Any:
    """Torque of gravity at positions (N,) [N.m]."""
    import pinocchio as pin

    robot = model.robot
    data = robot.model.createData()
    return np.array([pin.computeGeneralizedGravity(robot.model, data, np.array([x]))[0] for x in q])


def test_friction_is_drawn_where_it_is_identifiable() -> None:
    found = invented()
    (plot,) = friction_plots(found, found.rollout.joints)
    assert plot.name == "joint_1: dry friction; viscous at most 0.055 N.m.s/rad"
    assert {note["text"] for note in plot.layout["annotations"]} == {"drive", "back-drive"}
