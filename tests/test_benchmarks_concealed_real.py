"""Evaluation of known changes of real robots: right, twin, part and wrong names; flags, parameters, control."""

from __future__ import annotations

from dataclasses import replace

import pytest

from benchmarks.concealed_real import evaluate
from benchmarks.concealed_real.changes import Truth
from benchmarks.concealed_real.evaluate import (
    EXACT,
    PART,
    TWIN,
    Answer,
    Arm,
    Candidate,
    already_named,
    flagged,
    relation,
)

ARM = Arm(("a", "b", "c"))
ONE = Arm(("a",))
NOTHING = Answer("nothing_missing")
COULOMB = Truth(("coulomb_friction",), (1,), {"level": 0.8}, {"level": 1.2})


def cause(effect: str, *joints: int, p: float = 0.999, **value: float) -> Candidate:
    return Candidate(effect, joints, p, True, value, dict.fromkeys(value, 0.1))


def test_a_name_is_right_only_at_its_joint() -> None:
    assert relation(cause("coulomb_friction", 1), COULOMB, ARM) == EXACT
    assert relation(cause("coulomb_friction", 0), COULOMB, ARM) == ""
    assert relation(cause("viscous_friction", 1), COULOMB, ARM) == ""
    assert relation(cause("asymmetric_friction", 1), COULOMB, ARM) == PART
    assert relation(cause("asymmetric_friction", 2), COULOMB, ARM) == ""
    tilt = Truth(("base_tilt",), None)
    assert relation(cause("base_tilt", 0, 1, 2), tilt, ARM) == EXACT


def test_twins_cannot_be_distinguished_by_motion() -> None:
    load, link = Truth(("payload",), (2,)), Truth(("link_inertia",), (1,))
    assert relation(cause("link_inertia", 2), load, ARM) == TWIN
    assert relation(cause("encoder_offset", 2), load, ARM) == TWIN
    assert relation(cause("link_inertia", 1), load, ARM) == ""
    assert relation(cause("armature", 1), link, ARM) == ""
    assert relation(cause("armature", 0), Truth(("link_inertia",), (0,)), ARM) == TWIN
    assert relation(cause("payload", 2), link, ARM) == ""
    assert relation(cause("torque_lag", 0, 1, 2), Truth(("time_delay",), (0, 1, 2)), ARM) == TWIN
    assert relation(cause("time_delay", 1), Truth(("time_delay",), (0, 1, 2)), ARM) == PART
    assert relation(cause("counterbalance", 0), Truth(("base_tilt",), None), ONE) == TWIN
    assert relation(cause("torque_offset", 0), Truth(("base_tilt",), None), ONE) == ""
    assert relation(cause("torque_offset", 0), Truth(("base_tilt",), None), replace(ONE, slides=True)) == TWIN


def test_a_pair_matches_in_either_order() -> None:
    swap = Truth(("channel_swap",), (0, 1))
    assert relation(cause("channel_swap", 1, 0), swap, ARM) == EXACT
    assert relation(cause("channel_swap", 1, 2), swap, ARM) == ""


@pytest.mark.parametrize(
    ("fault", "joints", "sentence", "right"),
    [
        ("sign", (1,), "the torque of b has the wrong sign: negated, model and friction explain 99 %", True),
        ("sign", (1,), "the torque of c has the wrong sign: negated, model and friction explain 99 %", False),
        ("sign", (1,), "the torque of joints a and b has the wrong sign: negated, it is better", False),
        ("sign", (1,), "the position of b has the wrong sign: negated, it is better", False),
        ("swap", (0, 1), "the torques of joints a and b are exchanged: put in order, it is better", True),
        ("swap", (0, 1), "the torques of joints a and c are exchanged: put in order, it is better", False),
        ("late", (0, 1, 2), "the torque of all joints is recorded 30 ms late against the motion; record both", True),
        ("late", (0, 1, 2), "the torque of all joints is recorded 30 ms early against the motion; record both", False),
        ("early", (0, 1, 2), "the torque of all joints is recorded 30 ms early against the motion; record both", True),
        ("gain", (2,), "the torque of c is 1.15 times the one that the other joints suggest (± 2 %)", True),
        ("", (2,), "the torque of c is 1.15 times the one that the other joints suggest (± 2 %)", False),
    ],
)
def test_a_flag_names_the_fault_and_its_joints(fault: str, joints: tuple[int, ...], sentence: str, right: bool) -> None:
    truth = Truth(("torque_sign",), joints, fault=fault)
    assert flagged(["something else", sentence], truth, ARM) is right


def test_outcomes() -> None:
    right, other = cause("coulomb_friction", 1, level=0.75), cause("spring", 0)
    rival = replace(other, rivals=(Candidate("coulomb_friction", (1,), 0.1),))

    def outcome(*named: Candidate, verdict: str = "named") -> str:
        return evaluate.evaluate(Answer(verdict, named), COULOMB, NOTHING, ARM).outcome

    assert outcome(right, other) == "first"
    assert outcome(other, right) == outcome(rival) == outcome(other, replace(right, cause=False)) == "list"
    assert outcome(other) == "missed"
    assert outcome(verdict="nothing_missing") == "silent"
    assert outcome(verdict="refused") == "refused"
    assert outcome(verdict="crash") == "crash"
    refused = Answer("refused", (), ("the torque of b has the wrong sign: negate the column",))
    assert evaluate.evaluate(refused, Truth(("torque_sign",), (1,), fault="sign"), NOTHING, ARM).outcome == "flag"


def test_causes_of_the_control_are_neither_wrong_nor_first() -> None:
    old, right, new = cause("spring", 0), cause("coulomb_friction", 1, p=0.8), cause("backlash", 2)
    found = evaluate.evaluate(Answer("named", (old, right, new)), COULOMB, Answer("named", (old,)), ARM)
    assert (found.outcome, found.first_new, found.right, found.probability) == ("list", True, True, 0.8)
    assert found.sure == ("backlash c P 0.999",)
    found = evaluate.evaluate(
        Answer("named", (old, replace(new, probability=0.98))), COULOMB, Answer("named", (old,)), ARM
    )
    assert (found.first_new, found.sure) == (False, ())
    part = evaluate.evaluate(Answer("named", (cause("asymmetric_friction", 1),)), COULOMB, NOTHING, ARM)
    assert (part.outcome, part.relation, part.sure) == ("list", PART, ())


def test_a_parameter_is_compared_with_the_change_or_the_total_if_stated() -> None:
    def numbers(name: Candidate) -> list[evaluate.Number]:
        return list(evaluate.evaluate(Answer("named", (name,)), COULOMB, NOTHING, ARM).numbers)

    (added,) = numbers(cause("coulomb_friction", 1, level=0.75))
    assert added.truth == 0.8 and added.within
    whole = replace(cause("coulomb_friction", 1, level=1.25), stated={"level": 0.4})
    (found,) = numbers(whole)
    assert found.truth == 1.2 and found.within
    assert not numbers(cause("coulomb_friction", 1, level=1.1))[0].within
    assert not numbers(cause("coulomb_friction", 0, level=0.8))
    load = Truth(("payload",), (2,), {"mass": -1.0}, last=True)
    answer = Answer("named", (cause("link_inertia", 2, mass=-0.9),))
    assert [x.within for x in evaluate.evaluate(answer, load, NOTHING, ARM).numbers] == [True]


def test_the_control_names_a_law_that_contains_the_truth() -> None:
    assert already_named(Answer("named", (cause("asymmetric_friction", 1),)), COULOMB, ARM)
    assert already_named(Answer("named", (cause("coulomb_friction", 1),)), COULOMB, ARM)
    assert not already_named(Answer("named", (cause("coulomb_friction", 0), cause("spring", 1))), COULOMB, ARM)
    assert not already_named(Answer("named", (replace(cause("coulomb_friction", 1), cause=False),)), COULOMB, ARM)
