"""Diagnoses of impossible input: bodies of negative mass, gains of zero, joints without columns."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from arm import arm, smooth_motion
from numpy.testing import assert_allclose
from test_diagnose_noise import RATE, table, waves

from signid.diagnose.data.hypotheses import Hypothesis, finite
from signid.diagnose.data.noise import measure_noise
from signid.diagnose.data.rows import Group, tolerance
from signid.diagnose.extend import has_possible_numbers, move_bodies
from signid.effects import EFFECTS
from signid.effects.base import Trial
from signid.effects.bodies import body_inertia
from signid.model import Model, stated_inertials
from signid.regression.motion import Motion
from signid.types import Array, Law


def model(mass: float | None, body: int = 2) -> Model:
    """The arm, one link of another mass."""
    inertials = stated_inertials(arm())
    if mass is not None:
        inertials[body, 0] = mass
    return Model(arm(), inertials)


@pytest.mark.parametrize("time_constant", (-0.004, -1e-9, 0.0, 1e-12))
def test_an_impossible_lag_leaves_torque_unchanged(time_constant: float) -> None:
    """A negative time constant made a matrix singular."""
    torque = np.sin(np.arange(400.0))[:, None]
    x = Trial(torque, torque, t=0.005 * np.arange(400)[:, None], dt=0.005, torque=torque, joints=(0,))
    recorded = EFFECTS["torque_lag"].recorded_torque(x, time_constant=time_constant)  # type: ignore[attr-defined]
    assert_allclose(recorded, torque, atol=2e-3)


@pytest.mark.parametrize("inertial", (np.zeros(10), np.r_[0.0, 0, 0, 0, 1, 0.1, 2, 0.2, 0.3, 3],
                                      np.r_[0.0, 0.1, 0.2, 0.3, 1, 0.1, 2, 0.2, 0.3, 3],
                                      np.r_[-0.3, 0.1, 0.2, 0.3, 1, 0.1, 2, 0.2, 0.3, 3]))  # fmt: skip
def test_massless_bodies_keep_their_parameters(inertial: Array) -> None:
    assert_allclose(body_inertia(inertial).toDynamicParameters(), inertial, atol=1e-6)


@pytest.mark.parametrize("mass", (0.0, -0.3, -2.0))
def test_torque_and_tolerance_of_impossible_bodies_are_finite(mass: float) -> None:
    motion, wrong = smooth_motion(), model(mass)
    assert np.isfinite(wrong.inverse(motion)).all()
    spread = tolerance(wrong)
    assert np.isfinite(spread).all() and (spread > 0).all() and spread.max() < 10
    massless = replace(wrong, inertials=np.zeros_like(wrong.inertials))
    assert (tolerance(massless) > 0).all()


def test_an_impossible_body_becomes_consistent_despite_exact_knowledge() -> None:
    from signid.regression.base_parameters import build_base
    from signid.types import pseudo_inertia

    base, inertials = build_base(arm()), model(-0.3).inertials
    step = np.zeros_like(inertials)
    step[2, 0] = -0.2
    for covariance in (np.zeros((30, 30)), 1e-4 * np.eye(30)):
        moved = move_bodies(base, inertials, step, covariance)
        assert all(np.linalg.eigvalsh(pseudo_inertia(body)).min() > 0 for body in moved)


def test_no_link_swings_behind_a_spring_without_inertia() -> None:
    motion = smooth_motion()
    heavy, light = (replace(motion, robot=replace(arm(), model=m.bodies())) for m in (model(None), model(-50.0)))
    for name in ("joint_elasticity", "backlash"):
        effect = EFFECTS[name]
        assert effect.possible(heavy.at((1,)), **effect.shape(effect.example))
        assert not effect.possible(light.at((1,)), **effect.shape(effect.example))


def test_infinite_columns_explain_nothing() -> None:
    x = np.column_stack([np.ones(4), [1, 2, np.nan, 4], [1, 2, np.inf, 4], [1e70, 0, 0, 0], [1e50, 0, 0, 0]])
    assert_allclose(finite(x), x * [1, 0, 0, 0, 1] if np.isfinite(x).all() else np.nan_to_num(finite(x)))
    assert not finite(x)[:, 1:4].any() and finite(x)[:, 0].all() and finite(x)[0, 4] == 1e50
    assert finite(np.zeros((0, 2))).shape == (0, 2)


@pytest.mark.parametrize(
    ("effect", "value", "possible"),
    [
        ("torque_gain", -1.0001, False),  # deletes the torque
        ("torque_gain", -0.999, False),
        ("torque_gain", -2.0, False),  # a sign
        ("torque_gain", -0.71, False),
        ("torque_gain", -0.69, True),
        ("torque_gain", 1.0001, True),
        ("torque_gain", 2.31, False),
        ("torque_lag", -0.004, False),
        ("torque_lag", 0.004, True),
        ("time_delay", -0.008, True),
        ("spring", -0.3, True),  # a change of a stated law
    ],
)
def test_impossible_parameters_are_not_found(effect: str, value: float, possible: bool) -> None:
    group = Group(0, len(EFFECTS[effect].linear()), Hypothesis((Law(EFFECTS[effect], (1,)),)))
    assert has_possible_numbers(group, np.full(group.size, value)) == possible


def test_stated_laws_count_too() -> None:
    stated = Law(EFFECTS["torque_gain"], (1,), {"error": -0.5})
    group = Group(0, 1, Hypothesis((Law(EFFECTS["torque_gain"], (1,)),), stated=stated))
    assert has_possible_numbers(group, np.array([0.4])) and not has_possible_numbers(group, np.array([-0.4]))


@pytest.mark.parametrize("columns", (np.zeros((500, 3)), np.full((500, 3), np.nan), np.zeros((500, 0))))
def test_noise_of_a_joint_without_columns_is_its_torque(columns: Array) -> None:
    """Regression test: a joint with zero columns raised IndexError."""
    torque = np.random.default_rng(3).standard_normal(500)
    found = measure_noise(table(torque, columns), [None], RATE)
    assert found.floor[0] == pytest.approx(torque.std(), rel=0.05) and np.isfinite(found.coefficients).all()


@pytest.mark.parametrize("count", (1, 2, 5, 9, 30))
def test_noise_of_few_rows_is_finite(count: int) -> None:
    torque = np.random.default_rng(4).standard_normal(count)
    found = measure_noise(table(torque, waves(count)), [None], RATE)
    assert np.isfinite(found.floor[0]) and found.floor[0] > 0 and np.isfinite(found.innovation[0])


def test_a_gain_of_zero_acts_on_the_recording_only() -> None:
    gain = EFFECTS["torque_gain"]
    motion: Motion = smooth_motion()
    x = motion.at((1,))
    assert_allclose(gain.columns(x)[0], x.torque, rtol=1e-6)  # of predicted torque: no measured noise is in the column


def test_a_gain_that_deletes_the_torque_is_not_found() -> None:
    """A recorded current that is friction and nothing of the rigid bodies: the gain's error is -1, and no cause."""
    pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")
    from diagnosed import Posed, read, recorded, simulation

    from signid.diagnose.data.dataset import whitened
    from signid.diagnose.evidence.bayes_factors import Evidence
    from signid.diagnose.run import _no_progress, _posterior, build, prepare_session
    from signid.diagnose.search.contributions import measure_contributions
    from signid.diagnose.search.stepwise import is_admissible
    from signid.regression.session import Options, prepare
    from signid.signs import recover

    made = []
    for columns in recorded("3r"):
        v = np.gradient(columns["q_2"], columns["t"])
        made.append({**columns, "tau_2": 2.0 * np.tanh(v / 0.02) + 0.5 * v})
    robot = simulation("3r")
    recovered = recover(prepare(robot.robot, read("3r", tuple(made))))
    session, _ = prepare_session(robot, recovered, Options(effects=()), _no_progress)
    dataset = build(robot, session, (), _no_progress)
    data = whitened(dataset.table, dataset.noise)
    posed = Posed(session, dataset, _posterior(robot, Evidence(data), ()))
    gain = posed.group("torque_gain", 1)
    state = posed.found(gain)
    value = measure_contributions(posed.posterior.evidence, (gain,), state.dispersion, 0.0).coefficients[gain]
    assert value[0] == pytest.approx(-1, abs=0.1)
    assert not is_admissible(posed.found(), gain)
