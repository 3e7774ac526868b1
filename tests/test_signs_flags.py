"""Flags and notes of unreliable signs, on evidence made by hand (each threshold from both sides) and on recordings."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm import arm
from by_hand import INERTIA, LAWS, T, observations, problem, refined
from motions import trial

from signid.recording import read_recording
from signid.regression.session import prepare
from signid.robot import load_robot
from signid.signs import recover
from signid.signs.infer import InferredSigns
from signid.signs.observations import Observations, Segment, observe
from signid.signs.recover import _sign_notes, raise_flags
from signid.signs.result import SignProof


def well() -> tuple[Observations, InferredSigns]:
    """Two joints without any flag: Coulomb friction, viscous friction, offset, a body."""
    v = np.column_stack([np.cos(2 * np.pi * T), np.cos(4 * np.pi * T)])
    columns = np.column_stack([np.sign(v[:, 0]), v[:, 0], np.ones(400), INERTIA])
    value = np.array([0.2, 0.1, 0.0, 1.0])
    torque = np.repeat((columns @ value)[:, None], 2, axis=1)
    observed = observations(torque, columns, v, LAWS)
    segments = tuple(Segment(j, a, a + 40) for j in (0, 1) for a in range(0, 400, 50))
    shared = problem([[9.0] * 17], [*[0] * 8, *[1] * 8, -1])
    evidence = InferredSigns(
        segments=segments,
        signs=np.ones(16),
        confidence=np.ones(16),
        refined=refined(np.sign(torque), value.tolist()),
        inflation=np.ones(2),
        threshold=np.full(2, 0.1),
        problem=replace(shared, back=np.full((4, 1), 1e-3)),
        proof=SignProof(True, 0.0, 1),
        complete=True,
        flip_probability={0: 0.0, 1: 0.0},
        impure={},
        finer=False,
        notes=(),
    )
    return observed, evidence


def test_nothing_is_flagged_without_reason() -> None:
    assert raise_flags(*well()) == _sign_notes(*well()) == ()


def test_cut_segments_are_counted_by_the_name_of_their_joint() -> None:
    observed, found = well()
    assert _sign_notes(observed, replace(found, impure={0: 1, 1: 3})) == (
        "shoulder: 1 segment cut at a change of sign of the torque inside",
        "elbow: 3 segments cut at a change of sign of the torque inside",
    )


def flag_of(observed: Observations, found: InferredSigns) -> str:
    (flag,) = raise_flags(observed, found)
    return flag


def test_rivals_too_many_to_enumerate() -> None:
    observed, found = well()
    assert "too many other signs" in flag_of(observed, replace(found, complete=False))
    unproved = replace(found, complete=False, proof=SignProof(False, 0.2, 9))
    assert "not proved to be optimal (gap 0.2)" in flag_of(observed, unproved)  # says the same


@pytest.mark.parametrize(("share", "flagged"), [(0.9e-3, False), (1.1e-3, True)])
def test_a_joint_that_may_be_inverted(share: float, flagged: bool) -> None:
    observed, found = well()
    flags = raise_flags(observed, replace(found, flip_probability={0: 0.0, 1: share}))
    assert len(flags) == flagged
    if flagged:
        assert "torque of elbow is not decided" in flags[0] and "together with the other joints" in flags[0]
        assert "(now 8.9 m/s2 rms)" in flags[0]  # 4 pi / sqrt(2), of a prismatic joint
        both = flag_of(observed, replace(found, flip_probability={0: 0.5, 1: share}))
        assert "shoulder, elbow" in both and "together" not in both and "probability 0.5" in both


@pytest.mark.parametrize(("offset", "flagged"), [(0.37, False), (0.39, True), (-0.39, True)])
def test_an_offset_near_twice_the_friction(offset: float, flagged: bool) -> None:
    """The limit is 0.95 * 2 * 0.2 = 0.38, and two standard deviations of 1e-3 each."""
    observed, found = well()
    value = np.array([0.2, 0.1, offset, 1.0])
    flags = raise_flags(observed, replace(found, refined=replace(found.refined, value=value)))
    assert len(flags) == flagged and all(f"offset of shoulder ({offset:.2g} N.m)" in flag for flag in flags)


@pytest.mark.parametrize(("sigma", "kappa", "flagged"), [(0.2, 4.0, True), (0.2, 2.0, False), (0.1, 4.0, False)])
def test_a_residual_must_be_large_and_correlated(sigma: float, kappa: float, flagged: bool) -> None:
    observed, found = well()
    some = replace(found.refined, sigma=np.array([sigma, 0.0]) * observed.scale)
    flags = raise_flags(observed, replace(found, refined=some, inflation=np.full(2, kappa)))
    assert len(flags) == flagged and all("unexplained at shoulder (20 %)" in flag for flag in flags)
    assert all(flag.endswith("try more laws (--effects) or a higher --cutoff") for flag in flags)


@pytest.mark.parametrize(("count", "flagged"), [(0, False), (1, True)])
def test_segments_that_hold_changes_of_sign(count: int, flagged: bool) -> None:
    observed, found = well()
    flags = raise_flags(observed, replace(found, impure={1: count}))  # of 8 segments: above a tenth
    assert len(flags) == flagged and all("elbow changes its sign within 1 of its segments" in flag for flag in flags)


@pytest.mark.parametrize(("loss", "flagged"), [(0.1, True), (9.0, False)])
def test_torque_without_bodies_rests_on_the_prior(loss: float, flagged: bool) -> None:
    """Segments that share little (small b) can follow an offset; where they share much, they cannot."""
    observed, found = well()
    value = np.array([0.2, 0.1, 0.0, 1e-3])
    posed = replace(found.problem, projections=np.full((1, 17), loss), energies=np.full(17, 17 * loss**2))
    flags = raise_flags(observed, replace(found, problem=posed, refined=replace(found.refined, value=value)))
    assert [flag for flag in flags if "shoulder shows nothing of the robot's bodies" in flag] == list(flags[:flagged])


@pytest.mark.parametrize(("gap", "words"), [(0.03, "(gap 0.03)"), (1.0, "no bound was proved"), (np.inf, "no bound")])
def test_a_gap_of_all_proves_nothing(gap: float, words: str) -> None:
    observed, found = well()
    flag = flag_of(observed, replace(found, proof=SignProof(False, gap, 10)))
    assert words in flag and ("gap" in flag) == (gap < 1)


def test_a_refinement_that_had_not_settled_is_flagged() -> None:
    observed, found = well()
    flag = flag_of(observed, replace(found, refined=replace(found.refined, change=0.02)))
    assert f"not settled after {found.refined.rounds} rounds" in flag and "by 2 %" in flag


def test_coarse_torque_is_flagged_with_its_steps_and_their_unit() -> None:
    observed, found = well()
    steps = 0.5 * np.sqrt(np.mean(observed.torque**2, axis=0))
    coarse = replace(observed, torque=steps * np.round(observed.torque / steps))
    flags = [flag for flag in raise_flags(coarse, found) if "recorded in steps" in flag]
    assert len(flags) == 2 and f"steps of {steps[0]:.2g} N.m, " in flags[0] and f"{steps[1]:.2g} N, " in flags[1]


def test_units_are_those_of_the_joints() -> None:
    robot = arm("prismatic")
    session = prepare(robot, [trial(robot, seconds=3).recording()])
    observed = observe(session.task, session.train)
    assert observed.units == ("N.m", "N", "N.m")
    assert set(observed.coefficients.values()) >= {("coulomb_friction", 1), ("torque_offset", 1)}


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
