"""Fits of drives to simulated recordings: numbers, intervals, limits, starts and bad input."""

import numpy as np
import pytest
from servo_loops import RATE, recorded

from signid.errors import OptionError
from signid.model import load_model
from signid.servo.fit import fit_servos, start_servos
from signid.servo.plant import grids_of_arrays
from signid.servos import Servo

FREE = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")


@pytest.mark.slow
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
