"""Servo identification: selection of laws, what is identifiable, and fits of simulated drives."""

from __future__ import annotations

import re
import runpy
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import signid
from signid.model import Model, load_model, with_servos
from signid.servo.fit.coordinates import Coordinates, Slot
from signid.servo.given import given_texts
from signid.servo.identify import ServoIdentification, ServoOptions
from signid.servo.identify.fits import alternatives, closed_loops, mass_ratio
from signid.servo.identify.identifiable import JointFacts, dependence, dependent_numbers, joint_numbers
from signid.servo.identify.run import _fit_starts, start_fit
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servo.search.choice import improves, law_probabilities
from signid.servo.search.data import servo_data
from signid.servos import Servo
from signid.types import Array, Robot

ELBOW = Servo(kp=20.0, kd=1.0, delay=0.01, coulomb_friction=0.2, armature=0.01)
FREE = ("kp", "kd", "delay", "coulomb_friction", "armature")
STD = np.array([0.2, 0.02, 0.0005, 0.01, 0.0005])


def test_equal_laws_share_the_probability_and_few_windows_give_no_certainty() -> None:
    same = np.full(9, -4.0)
    assert law_probabilities({"effort": same, "duty": same}) == pytest.approx({"effort": 0.5, "duty": 0.5})
    assert law_probabilities({"effort": np.array([-4.0]), "duty": np.array([-5.0])})["duty"] == pytest.approx(0.75)
    assert law_probabilities({"effort": np.array([]), "duty": np.array([])})["duty"] == 0.5


def test_a_number_is_kept_only_if_unseen_windows_improve_surely() -> None:
    rng = np.random.default_rng(1)
    before = rng.normal(-4, 0.3, 30)
    assert improves(before, before - 0.05 + rng.normal(0, 0.02, 30))
    assert not improves(before, before - 0.005) and not improves(before, before + rng.normal(0, 0.3, 30))
    assert not improves(before[:1], before[:1] - 1)


def test_well_known_numbers_have_intervals() -> None:
    facts = JointFacts("elbow", saturated_share=0.0, largest_torque=3.0)
    numbers, said = joint_numbers(ELBOW, FREE, np.diag(STD**2), facts)
    assert numbers["kp"].value == 20 and numbers["kp"].interval == pytest.approx((20 - 0.392, 20 + 0.392))
    assert numbers["damping"].value == 1 and numbers["damping"].std == pytest.approx(0.02)
    assert numbers["kd"].value is None and numbers["viscous_friction"].value is None
    assert numbers["effort_limit"].value is None and any("above 3 N.m" in line for line in said)
    assert numbers["lag"].value == pytest.approx(0.06)


def test_delay_and_damping_are_one_number_in_slow_motion() -> None:
    servo, covariance = ELBOW.with_(delay=0.02), np.diag(STD**2)
    covariance[2, 2] = 0.012**2
    covariance[1, 1] = (0.012 * 20) ** 2
    covariance[1, 2] = covariance[2, 1] = -0.999 * 0.012**2 * 20
    numbers, said = joint_numbers(servo, FREE, covariance, JointFacts("thigh"))
    assert numbers["delay"].value is None and numbers["lag"].value == pytest.approx(0.07)
    assert (numbers["lag"].std or 1) < 0.002 and any("lag of 70 ms" in line for line in said)


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        (JointFacts("gripper", known_load_share=0.07), "only 7 % of the torque"),
        (JointFacts("gripper", scale_known=False), "only relative to each other"),
    ],
)
def test_without_a_scale_only_ratios_are_given(facts: JointFacts, words: str) -> None:
    numbers, said = joint_numbers(ELBOW, FREE, np.diag(STD**2), facts)
    assert all(numbers[name].value is None for name in ("kp", "damping", "armature", "coulomb_friction"))
    assert numbers["delay"].value == 0.01 and numbers["lag"].value == pytest.approx(0.06)
    assert any(words in line and "kp/armature 2000 1/s2" in line for line in said)


def test_ratios_to_kp_have_intervals_that_no_scale_widens() -> None:
    """A common scale of all torques, known to 300 %, changes no ratio; each number has 1 % of its own."""
    facts, size = JointFacts("gripper", known_load_share=0.07), np.array([getattr(ELBOW, name) for name in FREE])
    scaled = np.array([name != "delay" for name in FREE]) * size
    covariance = np.diag(np.where(np.array(FREE) == "kp", 0.0, 0.01 * size) ** 2) + np.outer(3 * scaled, 3 * scaled)
    numbers, _ = joint_numbers(ELBOW, FREE, covariance, facts)
    assert numbers["kp"].value is None and numbers["coulomb_friction"].value is None
    friction, wave = numbers["coulomb_friction/kp"], numbers["kp/armature"]
    assert friction.value == pytest.approx(ELBOW.coulomb_friction / 20) and friction.unit == "rad"
    assert friction.std == pytest.approx(0.01 * ELBOW.coulomb_friction / 20, rel=1e-6)
    assert numbers["damping/kp"].value == pytest.approx(0.05) and numbers["damping/kp"].unit == "s"
    assert wave.value == pytest.approx(2000) and wave.std == pytest.approx(20, rel=1e-6) and wave.unit == "1/s2"


def test_a_ratio_without_an_upper_end_is_a_lower_bound() -> None:
    facts, armature = JointFacts("gripper", known_load_share=0.07), FREE.index("armature")
    covariance = np.diag(STD**2)
    covariance[armature, armature] = 0.01**2  # of an armature of 1e-15: 1 / (1e-15 + 1.96 * .01) * 20
    numbers, said = joint_numbers(ELBOW.with_(armature=1e-15), FREE, covariance, facts)
    assert numbers["kp/armature"].value is None and numbers["kp/armature"].above == pytest.approx(20 / 0.0196)
    assert any("kp/armature at least 1020 1/s2" in line for line in said)
    assert "/" not in "".join(joint_numbers(ELBOW, FREE, covariance, JointFacts("elbow"))[0]), "the scale is known"


def test_a_stated_gain_gives_light_joints_their_scale() -> None:
    facts = JointFacts("gripper", known_load_share=0.05, masses_set_scale=False, stated={"kp": 20.0})
    numbers, _ = joint_numbers(ELBOW, FREE[1:], np.diag(STD[1:] ** 2), facts)
    assert numbers["kp"].stated and numbers["kp"].interval is None and numbers["damping"].value == 1


def test_vague_numbers_are_bounds() -> None:
    vague = np.diag(STD**2)
    vague[3, 3] = 0.3**2
    numbers, said = joint_numbers(ELBOW, FREE, vague, JointFacts("elbow"))
    assert numbers["coulomb_friction"].value is None
    assert "elbow: coulomb friction is not identifiable from this motion: it is below 0.79 N.m" in said
    _, said = joint_numbers(ELBOW, FREE, vague, JointFacts("elbow", largest_torque=0.7))
    assert "elbow: coulomb friction is not identifiable from this motion" in said, "it never moves against more"


def test_times_with_intervals_of_many_times_their_size_are_not_given() -> None:
    wide = np.diag(STD**2)
    wide[2, 2] = 3.0**2
    numbers, said = joint_numbers(ELBOW, FREE, wide, JointFacts("elbow"))
    assert numbers["delay"].value is None and numbers["lag"].value is None
    assert {f"elbow: {name} is not identifiable from this motion" for name in ("delay", "lag")} <= {*said}
    wide[2, 2] = 0.03**2
    assert joint_numbers(ELBOW, FREE, wide, JointFacts("elbow"))[0]["lag"].value is not None, (
        "60 ± 59 ms says something"
    )


def test_null_directions_of_the_information_name_their_numbers() -> None:
    names = [("elbow", "kp"), ("elbow", "kd"), ("elbow", "viscous_friction"), ("wrist", "dead_band")]
    rows = np.random.default_rng(2).normal(size=(50, 2))
    columns = np.column_stack([rows[:, 0], rows[:, 1], rows[:, 1], 0 * rows[:, 0]])
    found = dependent_numbers(columns.T @ columns, names)
    assert found == ((names[3],), (names[1], names[2]))
    lines = dependence(found)
    assert "not identifiable: dead band of wrist" in lines[0] and "only in combination" in lines[1]
    assert dependence([[names[0]], [names[1]], [("wrist", "kp")]]) == (
        "without effect in these recordings, so not identifiable: kp of elbow, wrist; kd of elbow",
    )
    assert dependent_numbers(np.eye(4), names) == ()


def test_masses_that_a_stated_gain_implies() -> None:
    ratio, error = mass_ratio(np.array([14.6, 14.2]), np.array([0.6, 0.5]), np.array([20.0, 20.0]))
    assert 1.36 < ratio < 1.42 and 0.02 < error < 0.06
    servos = {"hip": ELBOW, "thigh": ELBOW.with_(kp=14.4)}
    args = ([("hip", "thigh")], servos, {"hip": 9.0, "thigh": 0.3}, {"hip": 20.0, "thigh": 20.0})
    (said,) = alternatives(*args)
    assert said.startswith("if the firmware's kp is 20 as stated, the part that hip, thigh move is 1.39")
    assert said.endswith("--known kp=20 assumes that gain")
    assert alternatives(args[0], servos, {}, args[3]) == ()
    apart = [("hip",), ("thigh",)]
    servos = {"hip": ELBOW.with_(kp=14.2), "thigh": ELBOW.with_(kp=15.4)}
    (said,) = alternatives(apart, servos, {"hip": 0.5, "thigh": 0.9}, args[3])
    assert "hip, thigh move is 1.38 +- 0.08 times" in said, "one factor, so one sentence"
    assert len(alternatives(apart, servos, {"hip": 0.1, "thigh": 0.1}, args[3])) == 2


PENDULUM = """<robot name="pendulum"><link name="base"/>
<link name="arm"><inertial><origin xyz="0 0 -0.2"/><mass value="1.0"/>
<inertia ixx="0.001" ixy="0" ixz="0" iyy="0.001" iyz="0" izz="0.001"/></inertial></link>
<joint name="swing" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3.1" upper="3.1" effort="100" velocity="100"/></joint></robot>"""
TRUE = Servo(kp=15.0, kd=0.8, delay=0.012, coulomb_friction=0.15, armature=0.01)


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory: pytest.TempPathFactory) -> tuple[Robot, dict[str, Array]]:
    """A pendulum with a position drive, 12 s at 100 Hz, encoder noise of 0.3 mrad."""
    path = tmp_path_factory.mktemp("servo") / "pendulum.urdf"
    path.write_text(PENDULUM)
    robot, t = signid.load_robot(path), np.arange(0, 12, 0.01)
    rng = np.random.default_rng(4)
    waves = [
        np.sin(2 * np.pi * f * t + p) / (1 + f)
        for f, p in zip(*rng.uniform(np.array([[0.2], [0.0]]), np.array([[3.0], [6.0]]), (2, 6)), strict=True)
    ]
    command = 0.9 * np.sum(waves, axis=0) * np.minimum(t, 1)
    (grid,) = grids_of_arrays(["swing"], t, command, command)
    model = with_servos(load_model(robot), {"swing": TRUE})
    q = roll_out(model, {"swing": TRUE}, grid)[:, 0] + rng.normal(0, 3e-4, len(grid))
    return robot, {"t": t[: len(grid)], "q_swing": q, "q_des_swing": command[: len(grid)]}


@pytest.fixture(scope="module")
def found(pendulum: tuple[Robot, dict[str, Array]]) -> ServoIdentification:
    robot, columns = pendulum
    return signid.identify_servos(robot, signid.read_recording(columns, robot))


def test_numbers_of_a_simulated_drive_are_found(found: ServoIdentification) -> None:
    numbers = found.joints[0].numbers
    for name, tolerance in (("kp", 0.02), ("damping", 0.03), ("armature", 0.1), ("coulomb_friction", 0.05)):
        true, number = getattr(TRUE, name), numbers[name]
        assert number.value == pytest.approx(true, rel=tolerance), name
    assert numbers["delay"].value == pytest.approx(0.012, abs=5e-4)
    assert found.rollout.whole_rms[0] < 2e-3 < found.rollout.nominal_whole_rms[0]


def test_a_rotor_too_heavy_for_its_loop_is_fitted_from_a_light_one(
    pendulum: tuple[Robot, dict[str, Array]],
) -> None:
    robot, columns = pendulum
    recordings = (signid.read_recording(columns, robot),)
    data, nothing = servo_data(robot, recordings, (), None), dict[str, dict[str, float]]()
    assumed = given_texts(robot, data.driven, nothing, known=None, prior=(), bounds=(), equal=())
    problem = start_fit(load_model(robot), data, assumed, ServoOptions(), recordings, None)
    servo = problem.start.servos["swing"]
    coasting = servo.with_(armature=1000 * servo.kp)
    heavy = replace(problem, start=problem.start.changed({"swing": coasting}))
    assert _fit_starts(heavy).candidate.servos["swing"].armature == pytest.approx(TRUE.armature, rel=0.3)
    where = Coordinates((servo,), (Slot(0, "armature", typical=10 * servo.kp),))
    largest = float(np.exp(where.allowed(where.values)[1][0])) - where.slots[0].soft
    assert largest == pytest.approx((0.2**2) * servo.kp), "no step goes beyond what follows the loop"


def test_without_a_scale_the_table_holds_the_true_ratios(pendulum: tuple[Robot, dict[str, Array]]) -> None:
    robot, columns = pendulum
    options = ServoOptions(additional=())
    result = signid.identify_servos(robot, signid.read_recording(columns, robot), known="nothing", options=options)
    numbers = result.joints[0].numbers
    assert numbers["kp"].value is None
    for name, true in (("damping/kp", 0.8 / 15), ("coulomb_friction/kp", 0.01), ("torque_offset/kp", 0.0)):
        assert (numbers[name].value, numbers[name].std) == pytest.approx((true, 0), abs=3e-3), name
    shown = repr(result)
    assert "damping/kp" in shown and "coulomb friction/kp" in shown and "effort limit" not in shown.split("\n\n")[1]
    words = " ".join(shown.split())
    assert "known=" in words and "--known" not in words


def test_stated_numbers_whose_loop_diverges_are_no_comparison(
    pendulum: tuple[Robot, dict[str, Array]], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, x = pendulum
    (grid,) = grids_of_arrays(["swing"], x["t"], x["q_swing"], x["q_des_swing"])
    model, undamped = load_model(robot), {"swing": Servo(kp=1e4)}

    def diverging(model: Model, servos: dict[str, Servo], *rest: Any) -> Array:
        return 1e6 * grid.q if servos is undamped else roll_out(model, servos, *rest)

    monkeypatch.setattr("signid.servo.identify.fits.roll_out", diverging)
    rolled, _ = closed_loops(model, {"swing": TRUE}, [grid], True, (model, undamped))
    assert rolled.nominal == "q = q_des" and rolled.nominal_whole_rms == pytest.approx(rolled.tracking_rms)
    rolled, _ = closed_loops(model, {"swing": TRUE}, [grid], True, (model, {"swing": TRUE}))
    assert rolled.nominal == "stated numbers" and rolled.nominal_whole_rms == rolled.whole_rms


def test_what_no_motion_tells_is_said(found: ServoIdentification) -> None:
    numbers = found.joints[0].numbers
    assert numbers["kd"].value is None and numbers["effort_limit"].value is None
    assert any("no sample saturates" in flag for flag in found.flags)
    assert found.joints[0].laws == {"effort": 0.5, "duty": 0.5}
    assert found.scale.known_by == "inertials of the description"
    assert found.model.servos["swing"] == found.servos["swing"]
    assert [one.role for one in found.inputs] == ["recording, learned from, except the last 30%, which is held out"]


@pytest.mark.parametrize(("prior", "error"), [((), 0.1), (("masses=1+-.3",), 0.3)])
def test_intervals_contain_the_error_of_the_masses_that_set_the_scale(
    pendulum: tuple[Robot, dict[str, Array]], prior: tuple[str, ...], error: float
) -> None:
    """The noise of this loop is below 1 % of each number, and the masses have 10 % where nothing else is said."""
    robot, columns = pendulum
    options = ServoOptions(additional=())
    result = signid.identify_servos(robot, signid.read_recording(columns, robot), prior=prior, options=options)
    numbers = result.joints[0].numbers
    for name in ("kp", "damping", "armature", "coulomb_friction"):
        assert numbers[name].std == pytest.approx(error * numbers[name].value, rel=0.05), name
    assert numbers["delay"].std < 5e-3, "no scale of torque moves a time"
    assert "in units of the described masses (--known kp=VALUE" in " ".join(repr(result).split())


def test_an_error_of_the_masses_is_a_share_of_them(pendulum: tuple[Robot, dict[str, Array]]) -> None:
    robot, columns = pendulum
    for text in ("masses=2+-.1", "masses=1+-0", "masses=1"):
        with pytest.raises(signid.SignidError, match=re.escape(f"prior is {text!r}; the described masses are 1; give")):
            signid.identify_servos(robot, signid.read_recording(columns, robot), prior=[text])


def test_a_stated_gain_scales_the_masses(pendulum: tuple[Robot, dict[str, Array]]) -> None:
    robot, columns = pendulum
    options = ServoOptions(additional=())
    result = signid.identify_servos(robot, signid.read_recording(columns, robot), known="kp=30", options=options)
    assert result.servos["swing"].kp == 30 and result.joints[0].numbers["kp"].stated
    assert result.model.inertials[0, 0] == pytest.approx(2.0, rel=0.03)
    assert any("times as heavy as the description says" in flag for flag in result.flags)
    assert "; with --known kp=30 the moved bodies are 2.0" in " ".join(repr(result).split())
    assert result.joints[0].numbers["damping"].std < 0.05 * result.joints[0].numbers["damping"].value, "not by masses"


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        ({"known": "mass"}, "give one of masses, kp, nothing"),
        ({"laws": "pid"}, "none of effort, duty, torque_speed"),
        ({"laws": {"elbow": "duty"}}, "the servo joints are swing; give one"),
    ],
)
def test_wrong_options_are_one_sentence(pendulum: tuple[Robot, dict[str, Array]], wrong: Any, words: str) -> None:
    robot, columns = pendulum
    with pytest.raises(signid.SignidError, match=words):
        signid.identify_servos(robot, signid.read_recording(columns, robot), **wrong)


@pytest.mark.slow
def test_the_example_of_a_real_drive_runs(capsys: pytest.CaptureFixture[str]) -> None:
    example = Path(__file__).parents[1] / "robots" / "so101" / "servo.py"
    result = runpy.run_path(str(example))["main"]()
    assert result.joints[0].numbers["lag"].interval[0] > 0.05 and "mrad" in capsys.readouterr().out
