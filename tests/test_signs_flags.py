"""Flags and notes of unreliable signs name existing joints, units and options."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from arm import arm
from motions import trial
from signless import Lost, lost

from signid.recording import read_recording
from signid.regression.session import prepare
from signid.robot import load_robot
from signid.signs import recover
from signid.signs.infer import Inferred, infer
from signid.signs.observations import law_coefficients, observe
from signid.signs.recover import _notes, raise_flags
from signid.signs.result import SignProof


@cache
def inferred() -> tuple[Lost, Inferred]:
    made = lost(0.02)
    return made, infer(made.task, made.observed)


def test_sound_results_have_no_flags_and_no_notes() -> None:
    made, found = inferred()
    assert raise_flags(made.observed, found) == ()
    assert _notes(made.observed, found) == ()


def test_cut_segments_are_counted_by_the_name_of_their_joint() -> None:
    made, found = inferred()
    one, more = _notes(made.observed, replace(found, impure={0: 1, 2: 3}))
    first, _, last = made.observed.joints
    assert one == f"{first}: 1 segment cut at a change of sign of the torque inside"
    assert more == f"{last}: 3 segments cut at a change of sign of the torque inside"


@pytest.mark.parametrize("unit", ["N.m", "N"])
def test_numbers_have_units(unit: str) -> None:
    made, found = inferred()
    place = {law: k for k, law in law_coefficients(made.task).items()}
    value = found.refined.value.copy()
    value[place["torque_offset", 1]] = 100.0
    observed = replace(made.observed, units=(unit,) * 3)
    (flag,) = raise_flags(observed, replace(found, refined=replace(found.refined, value=value)))
    assert f"offset of {made.observed.joints[1]} (1e+02 {unit}) is large" in flag
    steps = 0.5 * np.sqrt(np.mean(made.observed.torque**2, axis=0))
    coarse = replace(observed, torque=steps * np.round(made.observed.torque / steps))
    flags = [flag for flag in raise_flags(coarse, found) if "recorded in steps" in flag]
    assert len(flags) == 3 and f"steps of {steps[0]:.2g} {unit}, " in flags[0]


def test_units_are_those_of_the_joints() -> None:
    robot = arm("prismatic")
    session = prepare(robot, [trial(robot, seconds=3).recording()])
    observed = observe(session.task, session.train)
    assert observed.units == ("N.m", "N", "N.m")
    assert set(observed.coefficients.values()) >= {("coulomb_friction", 1), ("torque_offset", 1)}


def test_flags_of_unexplained_torque_name_existing_options() -> None:
    made, found = inferred()
    large = replace(
        found, refined=replace(found.refined, sigma=10 * made.torque.std(axis=0)), inflation=np.full(3, 9.0)
    )
    (flag,) = raise_flags(made.observed, large)
    assert "much of the torque unexplained" in flag and flag.endswith("try more laws (--effects) or a higher --cutoff")


@pytest.mark.parametrize(("gap", "words"), [(0.03, "(gap 0.03)"), (1.0, "no bound was proved"), (np.inf, "no bound")])
def test_a_gap_of_all_proves_nothing(gap: float, words: str) -> None:
    made, found = inferred()
    (flag,) = raise_flags(made.observed, replace(found, proof=SignProof(False, gap, 10)))
    assert words in flag and ("gap" in flag) == (gap < 1)


def test_a_refinement_that_had_not_settled_is_flagged() -> None:
    made, found = inferred()
    assert found.refined.change < 1e-3
    (flag,) = raise_flags(made.observed, replace(found, refined=replace(found.refined, change=0.02)))
    assert f"not settled after {found.refined.rounds} rounds" in flag and "by 2 %" in flag


@pytest.mark.parametrize("offset", [True, False])
def test_torque_without_a_trace_of_the_bodies(offset: bool) -> None:
    """A torque of constant size: an offset keeps its sign, Coulomb friction does not."""
    t = np.arange(0, 30, 0.01)
    q, v = np.sin(1.1 * t) + 0.3 * np.sin(2.3 * t), 1.1 * np.cos(1.1 * t) + 0.69 * np.cos(2.3 * t)
    torque = np.where(offset, 1.0, np.sign(v)) + 0.02 * np.random.default_rng(0).standard_normal(len(t))
    robot = load_robot("1r")
    signs = recover(prepare(robot, [read_recording({"t": t, "q_1": q, "abs_tau_1": np.abs(torque)}, robot)])).signs
    assert signs is not None and not signs.is_certain()
    assert any("torque of joint_1 shows nothing of the robot's bodies" in flag for flag in signs.flags)
