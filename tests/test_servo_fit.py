"""Fits of drives to simulated recordings: numbers, intervals, limits, starts and bad input."""

from dataclasses import replace

import numpy as np
import pytest

from signid.errors import OptionError
from signid.model import Model, load_model
from signid.servo.fit import fit_servos, solve, start_servos
from signid.servo.fit.coordinates import slots
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servo.search.data import thinned
from signid.servos import Servo, ServoGrid

RATE = 100.0
FREE = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")


def motion(rng: np.random.Generator, rows: int, joints: int, size: float = 0.4) -> np.ndarray:
    t = np.arange(rows)[:, None] / RATE
    waves = [rng.uniform(0.3, 1, joints) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6, joints)) for f in (0.3, 1, 2.3)]
    return size * np.minimum(t / 0.5, 1) * sum(waves)


def recorded(model: Model, servos: dict[str, Servo], seconds: float, seed: int, size: float = 0.4) -> ServoGrid:
    """Simulated recording of 12 bit encoders."""
    joints, rng = model.robot.joints, np.random.default_rng(seed)
    u = motion(rng, int(seconds * RATE), len(joints), size)
    t = np.arange(len(u)) / RATE
    (ideal,) = grids_of_arrays(joints, t, u * 0, u)
    q = roll_out(model, servos, ideal) + 3e-4 * rng.standard_normal(u.shape)
    return grids_of_arrays(joints, t, np.round(q * 4096 / (2 * np.pi)) * 2 * np.pi / 4096, u)[0]


def test_a_fit_finds_the_drives_of_an_arm() -> None:
    model = load_model("3r")
    truth = {
        joint: Servo(kp=kp, kd=kp / 25, delay=0.016, coulomb_friction=kp / 200, armature=0.05)
        for joint, kp in zip(model.robot.joints, (300.0, 200.0, 80.0), strict=True)
    }
    grid = recorded(model, truth, 12.0, 1)
    start = start_servos(model, [grid])
    fit = fit_servos(model, [grid], start, [(joint, name) for joint in truth for name in FREE])
    for (joint, name), value, std in zip(fit.names, fit.values, fit.std, strict=True):
        exact = getattr(truth[joint], name)
        assert abs(value - exact) < 4 * std + 1e-9, (joint, name)
        assert name not in ("kp", "kd") or value == pytest.approx(exact, rel=0.05), (joint, name)
    assert (fit.residual_rms < 7e-4).all() and (fit.saturated_share == 0).all()
    assert fit.information.shape == fit.covariance.shape == (18, 18)
    assert fit.servos[model.robot.joints[0]].kp == fit.values[0]


def test_each_joint_has_a_delay_of_its_own() -> None:
    model = load_model("3r")
    delays = dict(zip(model.robot.joints, (0.016, 0.012, 0.02), strict=True))
    truth = {joint: Servo(kp=150.0, kd=6.0, delay=late, armature=0.1) for joint, late in delays.items()}
    start = {joint: servo.with_(delay=0.016) for joint, servo in truth.items()}
    free = [(joint, name) for joint in truth for name in ("kp", "delay")]
    fit = fit_servos(model, [recorded(model, truth, 4.0, 4)], start, free, relinearise=False)
    for joint, late in delays.items():
        assert fit.servos[joint].delay == pytest.approx(late, abs=3e-4)


def test_limits_are_found_and_laws_distinguished() -> None:
    model = load_model("1r")
    (joint,) = model.robot.joints
    truth = {joint: Servo(kp=150.0, kd=12.0, delay=0.01, coulomb_friction=1.0, armature=0.3, effort_limit=25.0)}
    grid = recorded(model, truth, 12.0, 2, 0.6)
    rms = {}
    for law in ("effort", "duty"):
        servos = start_servos(model, [grid], law)
        for window in (0.2, 0.8):
            fit = fit_servos(model, [grid], servos, [(joint, name) for name in (*FREE, "effort_limit")], window=window)
            servos = dict(fit.servos)
        rms[law] = fit.residual_rms[0]
        if law == "effort":
            assert 0.03 < fit.saturated_share[0] < 0.9
            found = fit.servos[joint]
            assert (found.effort_limit, found.kp) == pytest.approx((25.0, 150.0), rel=0.03)
    assert rms["effort"] < 0.9 * rms["duty"]


def test_numbers_without_influence_have_infinite_variance() -> None:
    model = load_model("1r")
    (joint,) = model.robot.joints
    truth = {joint: Servo(kp=150.0, kd=12.0, coulomb_friction=1.0, armature=0.3)}
    grid = recorded(model, truth, 4.0, 3, 0.2)
    start = {joint: replace(truth[joint], effort_limit=1e4)}
    fit = fit_servos(model, [grid], start, [(joint, "kp"), (joint, "effort_limit")])
    assert np.isinf(fit.std[1]) and fit.std[0] < 5 and fit.covariance[0, 1] == 0


def test_a_chain_of_fits_keeps_the_bounds_of_torque() -> None:
    names = ("kp", "coulomb_friction")
    for kp in (10.0, 1e3, 1e9):  # of the last fit, which the typical sizes follow
        found = slots([names], [{"kp": kp, "coulomb_friction": kp / 20}], dict.fromkeys(names, [0]), [10.0], {}, {})
        largest = {slot.number: np.exp(slot.high) - slot.soft for slot in found}
        assert largest == pytest.approx({"kp": 1e3, "coulomb_friction": 50.0}, rel=1e-3)


def test_rows_are_left_out_where_nothing_moves() -> None:
    t, u = np.arange(6000) / RATE, np.zeros((6000, 2))
    u[1500:2000, 0], u[4200:4700, 1] = 0.1 * np.sin(t[:500]), 0.5 * np.sin(t[:500])
    (grid,) = grids_of_arrays(["a", "b"], t, u, u)
    blocks = thinned([grid], 1200)
    assert len(blocks) == 4 and sum(map(len, blocks)) == 1200
    kept = np.concatenate([block.command for block in blocks])
    assert np.all(np.ptp(kept, axis=0) > 0.5 * np.ptp(u, axis=0)), "each joint moves somewhere else"


def test_steps_that_are_no_numbers_leave_the_start(monkeypatch: pytest.MonkeyPatch) -> None:
    model = load_model("1r")
    (joint,) = model.robot.joints
    truth = {joint: Servo(kp=20.0, kd=1.0, armature=0.05)}
    grid = recorded(model, truth, 3.0, 5)
    monkeypatch.setattr(solve, "damped", lambda where, here, values, damping: values * np.nan)
    fit = fit_servos(model, [grid], truth, [(joint, "kp"), (joint, "delay")])
    assert fit.servos[joint].kp == 20.0 and np.isfinite(fit.residual_rms).all()


def test_bad_input_is_a_sentence() -> None:
    model = load_model("1r")
    (joint,) = model.robot.joints
    t = np.arange(100) / RATE
    (grid,) = grids_of_arrays([joint], t, 0 * t, 0 * t)
    with pytest.raises(OptionError, match="at least one"):
        fit_servos(model, [], {}, [])
    with pytest.raises(OptionError, match="has no commands"):
        fit_servos(model, [grid], {"other": Servo()}, [])
    with pytest.raises(OptionError, match="choose from"):
        fit_servos(model, [grid], {joint: Servo(kp=1.0)}, [(joint, "mass")])
