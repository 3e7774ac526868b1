"""Base parameters from factors: exact without noise, with valid intervals otherwise."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from motions import FRICTION, Trial, trial, truth
from numpy.testing import assert_allclose

from signid.estimation.least_squares import estimate
from signid.regression.session import Options, Session, prepare
from signid.robot import load_robot
from signid.types import Estimate, Robot

EXACT = Options(cutoff=np.inf, derivatives="recorded")


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("3r")


def solve(made: Trial, options: Options, **changes: np.ndarray) -> tuple[Session, Estimate]:
    recording = made.recording(**changes)
    session = prepare(made.robot, [recording], [recording], options)
    return session, estimate(session.reduce(session.train), session.task.base, whiten=options.whiten)


def error(session: Session, found: Estimate) -> float:
    right = session.task.base.combination @ truth(session.robot)
    return float(np.linalg.norm(found.value - right) / np.linalg.norm(right))


@pytest.mark.parametrize("name", ["1r", "3r", "ur5", "panda", "emps"])
def test_exact_without_noise(name: str) -> None:
    made = trial(load_robot(name))
    session, found = solve(made, EXACT, dq=made.v, ddq=made.a)
    assert session.task.recorded_derivatives
    assert error(session, found) < 1e-9


def test_positions_alone_are_nearly_as_good(arm: Robot) -> None:
    made = trial(arm)
    session, found = solve(made, Options())
    assert not session.task.recorded_derivatives
    assert error(session, found) < 1e-2  # friction jumps in a hundredth of a second at each reversal
    smooth = Options(effects=("viscous_friction", "torque_offset", "armature"))
    session, found = solve(made, smooth, tau=made.torque - FRICTION["coulomb_friction"] * np.sign(made.v))
    standard = np.delete(truth(arm), slice(33, 36))
    right = session.task.base.combination @ standard
    assert_allclose(found.value, right, atol=1e-3 * np.abs(right).max())  # ripple of a 60 dB filter


def test_recorded_derivatives_are_used_only_when_they_are_right(arm: Robot) -> None:
    made = trial(arm)
    assert solve(made, Options(), dq=made.v, ddq=made.a)[0].task.recorded_derivatives
    assert not solve(made, Options(), dq=np.roll(made.v, 5, axis=0), ddq=made.a)[0].task.recorded_derivatives


def test_intervals_grow_with_the_noise(arm: Robot) -> None:
    made, rng = trial(arm), np.random.default_rng(0)
    noise = rng.standard_normal(made.torque.shape)
    small = solve(made, Options(), tau=made.torque + 0.05 * noise)[1]
    large = solve(made, Options(), tau=made.torque + 0.5 * noise)[1]
    assert_allclose(large.std / small.std, 10, rtol=0.1)
    assert_allclose(large.noise / small.noise, 10, rtol=0.1)


def test_coloured_noise_widens_the_intervals(arm: Robot) -> None:
    made, rng = trial(arm, seconds=60), np.random.default_rng(1)
    white = rng.standard_normal(made.torque.shape)
    coloured = np.zeros_like(white)
    for i in range(1, len(white)):
        coloured[i] = 0.99 * coloured[i - 1] + white[i]
    coloured *= white.std() / coloured.std()
    session, found = solve(made, Options(), tau=made.torque + 0.3 * coloured)
    plain = solve(made, Options(whiten=False), tau=made.torque + 0.3 * coloured)[1]
    assert max(found.orders) >= 1
    assert np.median(found.std / plain.std) > 1.3
    right = session.task.base.combination @ truth(arm)
    assert np.sqrt(np.mean(((found.value - right) / found.std) ** 2)) < 1.5


def test_a_joint_without_torque_is_identified_from_the_others(arm: Robot) -> None:
    import signid

    made = trial(arm)
    columns = {f"q_{j + 1}": made.q[:, j] for j in range(3)} | {f"tau_{j + 1}": made.torque[:, j] for j in range(2)}
    found = signid.identify(arm, [signid.read_recording({"t": made.t, **columns}, arm)], method="wls")
    assert found.flags == ()
    assert {found.robot.joints[law.joints[0]] for law in found.model.laws} == {"joint_1", "joint_2"}
    assert np.isnan(found.fit.held_out_r2[2])
    assert (found.fit.held_out_r2[:2] > 0.999).all()


def test_instruments_repair_a_coarse_encoder(arm: Robot) -> None:
    made, rng = trial(arm, seconds=40), np.random.default_rng(3)
    step = 2 * np.pi / 2**12
    coarse = np.round((made.q + step * rng.uniform(-0.5, 0.5, made.q.shape)) / step) * step
    tau = made.torque + 0.05 * rng.standard_normal(made.torque.shape)
    wide = Options(cutoff=10.0)
    session, plain = solve(made, wide, q=coarse, tau=tau)
    assert plain.method == "weighted least squares"
    instrumented, repaired = solve(made, wide, q=coarse, tau=tau, q_des=made.q)
    assert repaired.method == "instrumental variables"
    assert error(instrumented, repaired) < 0.5 * error(session, plain)


def inside(session: Session, found: Estimate) -> float:
    """Share of the 95 % intervals that contain the truth."""
    right = session.task.base.combination @ truth(session.robot)
    return float(np.mean(np.abs(found.value - right) < 1.96 * found.std))


def noise_alone(session: Session) -> Estimate:
    """The estimate without model discrepancy in its covariance."""
    return estimate(replace(session.reduce(session.train), sample=None), session.task.base)


def test_noise_alone_is_no_discrepancy(arm: Robot) -> None:
    wider = []
    for seed in range(4):
        made = trial(arm, seed=seed, seconds=40)
        noise = np.random.default_rng(seed).standard_normal(made.torque.shape)
        session, found = solve(made, Options(), tau=made.torque + 0.3 * noise)
        wider.append(np.median(found.std / noise_alone(session).std))
    assert 1 <= np.median(wider) < 1.05 and max(wider) < 1.3


@pytest.mark.slow_cases("ripple|delay")
@pytest.mark.parametrize("error", ["friction", "ripple", "delay", "hold"])
def test_intervals_cover_the_truth_under_model_error(arm: Robot, error: str) -> None:
    shares: list[tuple[float, float]] = []
    for seed in range(6):
        made = trial(arm, seed=seed, seconds=40, rate=500.0)
        index = np.arange(len(made.t))
        added = {
            "friction": 0.3 * np.sign(made.v) * np.exp(-((made.v / 0.4) ** 2)),
            "ripple": 0.2 * np.sin(6 * made.q) * np.sign(made.v),
            "delay": made.torque[np.maximum(index - 1, 0)] - made.torque,
            "hold": made.torque[index // 2 * 2] - made.torque,
        }[error]
        noise = 0.05 * np.random.default_rng(seed).standard_normal(added.shape)
        session, found = solve(made, Options(), tau=made.torque + added + noise)
        shares.append((inside(session, found), inside(session, noise_alone(session))))
    share, before = np.mean(shares, axis=0)
    assert share >= 0.9 and share > before


def test_friction_may_drift_only_where_there_is_discrepancy(arm: Robot) -> None:
    made, noise = trial(arm, seconds=40), np.random.default_rng(2).standard_normal((8000, 3))
    waves = 0.5 * np.sign(made.v) * np.cos(3 * made.v)
    clean, rough = (solve(made, Options(), tau=made.torque + x + 0.01 * noise) for x in (0 * waves, waves))
    leads = [clean[0].task.base.labels[k].name for k in clean[0].task.base.independent]
    for share, name in ((0.05, "viscous_friction"), (0.02, "coulomb_friction")):
        own = [k for k, lead in enumerate(leads) if lead.startswith(name)]
        assert np.all(clean[1].std[own] < 0.5 * share * FRICTION[name])
        assert np.all(rough[1].std[own] > 0.99 * share * np.abs(rough[1].value[own]))


def test_weak_instruments_are_not_used(arm: Robot) -> None:
    made = trial(arm)
    other = trial(arm, seed=9)
    found = solve(made, Options(), q_des=other.q)[1]
    assert found.method == "weighted least squares"


def test_robust_weights_survive_outliers(arm: Robot) -> None:
    import signid

    made, rng = trial(arm), np.random.default_rng(4)
    tau = made.torque + 0.1 * rng.standard_normal(made.torque.shape)
    for start in rng.integers(0, len(tau) - 40, 6):
        tau[start : start + 40, rng.integers(3)] += 30
    recording, clean = made.recording(tau=tau), trial(arm, seed=5).recording()
    errors = []
    for robust in (False, True):
        found = signid.identify(arm, [recording], held_out=[clean], method="wls", options=Options(robust=robust))
        right = found.base.combination @ truth(arm)
        errors.append(np.linalg.norm((found.estimate.value - right) / np.linalg.norm(right)))
    assert errors[1] < 0.4 * errors[0]


def test_the_covariance_stays_positive(arm: Robot) -> None:
    made = trial(arm, seconds=10)
    found = solve(made, Options(), tau=made.torque + 0.3 * np.sin(5 * made.q))[1]
    assert np.linalg.eigvalsh(found.covariance / np.outer(found.std, found.std))[0] > 0
