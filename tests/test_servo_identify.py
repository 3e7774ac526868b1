"""Servo identification: selection of laws, what is identifiable, and fits of simulated drives."""

from __future__ import annotations

import numpy as np
import pytest

from signid.servo.identify.evidence import improves, law_probabilities, window_scores
from signid.servo.identify.identifiable import JointFacts, dependence, dependent_numbers, joint_numbers
from signid.servo.identify.scale import alternatives, mass_ratio
from signid.servos import Servo

ELBOW = Servo(kp=20.0, kd=1.0, delay=0.01, coulomb_friction=0.2, armature=0.01)
FREE = ("kp", "kd", "delay", "coulomb_friction", "armature")
STD = np.array([0.2, 0.02, 0.0005, 0.01, 0.0005])


def test_the_law_of_smaller_errors_gets_the_probability() -> None:
    rng = np.random.default_rng(0)
    good = rng.normal(-4, 0.3, 40)
    found = law_probabilities({"effort": good + 0.2, "duty": good, "torque_speed": good + 0.5})
    assert found["duty"] > 0.95 and found["duty"] < 1 and sum(found.values()) == pytest.approx(1)


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


def test_scores_are_log_rms_of_windows() -> None:
    error = np.full((10, 2), 0.01)
    assert window_scores(error, [slice(0, 5), slice(5, 10), slice(10, 12)]) == pytest.approx(
        np.full((2, 2), np.log(0.01))
    )


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
    assert numbers["lag"].std < 0.002 and any("lag of 70 ms" in line for line in said)


@pytest.mark.parametrize(
    ("facts", "words"),
    [
        (JointFacts("gripper", known_load_share=0.07), "only 7% of the torque"),
        (JointFacts("gripper", scale_known=False), "only relative to each other"),
    ],
)
def test_without_a_scale_only_ratios_are_given(facts: JointFacts, words: str) -> None:
    numbers, said = joint_numbers(ELBOW, FREE, np.diag(STD**2), facts)
    assert all(numbers[name].value is None for name in ("kp", "damping", "armature", "coulomb_friction"))
    assert numbers["delay"].value == 0.01 and numbers["lag"].value == pytest.approx(0.06)
    assert any(words in line and "kp/armature 2e+03" in line for line in said)


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


def test_null_directions_of_the_information_name_their_numbers() -> None:
    names = [("elbow", "kp"), ("elbow", "kd"), ("elbow", "viscous_friction"), ("wrist", "dead_band")]
    rows = np.random.default_rng(2).normal(size=(50, 2))
    columns = np.column_stack([rows[:, 0], rows[:, 1], rows[:, 1], 0 * rows[:, 0]])
    found = dependent_numbers(columns.T @ columns, names)
    assert found == ((names[3],), (names[1], names[2]))
    lines = dependence(found)
    assert "dead band of wrist does not act" in lines[0] and "only in combination" in lines[1]
    assert dependent_numbers(np.eye(4), names) == ()


def test_masses_that_a_stated_gain_implies() -> None:
    ratio, error = mass_ratio(np.array([14.6, 14.2]), np.array([0.6, 0.5]), np.array([20.0, 20.0]))
    assert 1.36 < ratio < 1.42 and 0.02 < error < 0.06
    servos = {"hip": ELBOW, "thigh": ELBOW.with_(kp=14.4)}
    args = ([("hip", "thigh")], servos, {"hip": 9.0, "thigh": 0.3}, {"hip": 20.0, "thigh": 20.0})
    (said,) = alternatives(*args)
    assert said.startswith("if the firmware's kp is 20 as stated, the part that hip, thigh move is 1.39")
    assert alternatives(args[0], servos, {}, args[3]) == ()
