"""Refinement by roll-outs: compiled roll-outs, whole recordings, numbers recovered, worse models refused."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.testing import assert_allclose

import signid
from signid.effects import EFFECTS
from signid.errors import OptionError
from signid.model import Model, stated_inertials
from signid.recording.sampling import survey
from signid.simulation.refine import refine
from signid.simulation.rollout import simulate_windows
from signid.simulation.whole_rollout import one_joint_errors, one_joint_numbers, roll_out_whole, whole_windows
from signid.types import Array, Law, Recording

ASYMMETRIC = {
    "viscous_positive": 160.0,
    "viscous_negative": 235.0,
    "coulomb_positive": 21.0,
    "coulomb_negative": 24.0,
}


def slide(factor: float = 1.0, **changed: float) -> Model:
    """The EMPS with direction-dependent friction."""
    robot = signid.load_robot("emps")
    law = Law(EFFECTS["asymmetric_friction"], (0,), {**ASYMMETRIC, **changed})
    return Model(robot, factor * stated_inertials(robot), (law,))


def force(t: Array) -> Array:
    """Force that moves the slide in both directions, with rests [N]."""
    wave = 60 * np.sin(2 * np.pi * 0.7 * t) + 40 * np.sin(2 * np.pi * 1.3 * t)
    return np.where((t % 3) > 2.6, 0.0, wave)


@cache
def moved(seconds: float = 12.0) -> Recording:
    """Recording of the slide, simulated by the plant."""
    model, t = slide(), np.arange(0, seconds, 1e-3)
    blank = {"t": t, "q_1": 1e-9 * np.sin(t), "tau_1": force(t)}
    window = whole_windows(model, of(signid.read_recording(blank, model.robot), model))[0]
    q = simulate_windows(model, window)[0, :, 0] + window.q[0, 1:, 0]
    noise = 2e-6 * np.random.default_rng(0).standard_normal(len(t))
    return signid.read_recording({"t": t, "q_1": np.append(0.0, q) + noise, "tau_1": force(t)}, model.robot)


def of(recording: Recording, model: Model) -> tuple:
    return recording, survey(recording, model.robot)


def law(name: str, **parameters: float) -> Law:
    return Law(EFFECTS[name], (0,), parameters)


@pytest.mark.slow_cases(but="spring|stribeck|viscous")
@pytest.mark.parametrize(
    "added",
    [
        law("torque_offset", offset=1.0),
        law("quadratic_friction", coefficient=80.0),
        law("spring", stiffness=30.0, rest=0.1),
        law("stribeck_friction", level=3.0, velocity=0.05),
        law("position_friction", amplitude=2.0, frequency=20.0, phase=0.5),
        law("torque_ripple", amplitude=2.0, frequency=20.0, phase=0.5),
        law("viscous_friction", coefficient=10.0),
        law("armature", inertia=5.0),
    ],
    ids=lambda x: x.effect.name,
)
def test_compiled_roll_outs_are_those_of_the_plant(added: Law) -> None:
    model = replace(slide(), laws=(*slide().laws, added))
    window = whole_windows(model, of(moved(), model))[0]
    numbers = one_joint_numbers(model)
    assert numbers is not None
    fast, slow = (x[0, :, 0] for x in (one_joint_errors(numbers, window), simulate_windows(model, window)))
    assert np.abs(fast - slow).max() < 0.01 * np.ptp(window.q)
    assert np.sqrt(np.mean((fast - slow) ** 2)) < 0.003 * np.ptp(window.q)


def test_a_pendulum_is_compiled_with_its_weight() -> None:
    model = signid.load_model("1r")
    t = np.arange(0, 2, 1e-3)
    recording = signid.read_recording(
        {"t": t, "q_1": 0.3 + 0.01 * np.sin(t), "tau_1": 0.2 * np.sin(5 * t)}, model.robot
    )
    window = whole_windows(model, of(recording, model))[0]
    numbers = one_joint_numbers(model)
    assert numbers is not None
    assert_allclose(one_joint_errors(numbers, window), simulate_windows(model, window), atol=5e-3)


def test_whole_roll_outs_of_the_truth_stay_at_the_recording() -> None:
    found = roll_out_whole(slide(), moved())
    assert found.rms[0] < 2e-4 and found.unit == ("m",) and found.seconds > 11.9
    assert roll_out_whole(slide(1.1), moved()).rms[0] > 1e-3


def test_whole_roll_outs_refuse_laws_of_the_recording() -> None:
    delayed = replace(slide(), laws=(*slide().laws, law("time_delay", delay=0.004)))
    with pytest.raises(OptionError, match="cannot undo time_delay; give a horizon in seconds"):
        roll_out_whole(delayed, moved())


def test_wrong_numbers_are_refined_to_the_true_ones() -> None:
    wrong = slide(0.95, viscous_positive=190.0, coulomb_negative=21.0)
    found = refine(wrong, moved())
    assert found.kept and found.whole and found.after[0] < 0.2 * found.before[0]
    assert_allclose(found.model.inertials[-1, 0] / slide().inertials[-1, 0], 1, atol=0.01)
    for key, value in found.model.laws[0].parameters.items():
        assert_allclose(value, ASYMMETRIC[key], rtol=0.03)
    assert "refined by roll-outs of 2.5 and 5 s" in found.sentence


def test_a_model_that_cannot_be_improved_is_kept() -> None:
    """Judged on a recording of another robot, every refinement to the first one is worse."""
    other = slide(1.0, viscous_positive=230.0, viscous_negative=150.0)
    t = np.arange(0, 12, 1e-3)
    window = whole_windows(other, of(moved(), other))[0]
    q = simulate_windows(other, window)[0, :, 0] + window.q[0, 1:, 0]
    judge = signid.read_recording({"t": t, "q_1": np.append(0.0, q), "tau_1": force(t)}, other.robot)
    found = refine(other, moved(), judge)
    assert not found.kept and found.model is not None and "its numbers are kept" in found.sentence
    assert_allclose(found.model.laws[0].parameters["viscous_positive"], 230.0)


def test_bad_requests_are_refused() -> None:
    with pytest.raises(OptionError, match="roll-outs cannot choose armature; the laws to choose from are asymmetric"):
        refine(slide(), moved(), candidates=["armature"])
    with pytest.raises(OptionError, match="windows of -1 s cannot be simulated"):
        refine(slide(), moved(), lengths=[-1.0])
    with pytest.raises(OptionError, match="no law whose numbers could be refined"):
        refine(signid.load_model("3r"), signid.read_recording("robots/3r/held_out.parquet", signid.load_robot("3r")))
