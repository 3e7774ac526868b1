"""Pendulum in MuJoCo at rest, with elasticity and with backlash, compared with closed-form physics."""

from __future__ import annotations

import numpy as np
import pytest
from faulty import BARE, FULL, INERTIA_1R, PENDULUM, WEIGHT

pytest.importorskip("mujoco", reason="MuJoCo is not installed; pip install 'signid[bench]'")

from benchmarks.plants.bodies import Drives  # noqa: E402
from benchmarks.plants.control import STEP, Table  # noqa: E402
from benchmarks.plants.faults import Fault  # noqa: E402
from benchmarks.plants.mujoco_ import simulate  # noqa: E402


def at_rest(q: float, *faults: Fault, drives: Drives = BARE) -> tuple[float, float]:
    """Final position of the pendulum and motor torque there [rad, N.m]."""
    still = np.zeros((2, 1))
    track = simulate(PENDULUM, drives, Table(np.array([0.0, 2.0]), still + q, still, still), 2.0, 100, faults)
    return float(track.q[-1, 0]), float(track.tau[-1, 0])


@pytest.mark.parametrize("angle", [0.4, 1.5, -2.0])
def test_static_torque_of_the_pendulum(angle: float) -> None:
    carried = {"mass": 0.8, "first_moment_x": 0.1, "first_moment_y": 0.3, "first_moment_z": -0.6}
    q, tau = at_rest(angle)
    assert tau == pytest.approx(WEIGHT * np.sin(q), abs=1e-6)
    q, tau = at_rest(angle, Fault("payload", None, carried))
    assert tau == pytest.approx((WEIGHT + 9.81 * 0.6) * np.sin(q) - 9.81 * 0.1 * np.cos(q), abs=1e-6)
    q, tau = at_rest(angle, Fault("base_tilt", None, {"x": 0.0, "y": 0.03}))
    assert tau == pytest.approx(WEIGHT * np.sin(q + 0.03), abs=1e-6)
    q, tau = at_rest(angle, Fault("base_tilt", None, {"x": 0.2, "y": 0.0}))
    assert tau == pytest.approx(WEIGHT * np.cos(0.2) * np.sin(q), abs=1e-6)
    q, tau = at_rest(angle, Fault("encoder_offset", "joint_1", {"offset": 0.05}))
    assert tau == pytest.approx(WEIGHT * np.sin(q - 0.05), abs=1e-6)


def test_dry_friction_holds_a_motor_without_torque() -> None:
    limp = Fault("torque_saturation", "joint_1", {"limit": 0.0})
    for stuck in (
        Fault("coulomb_friction", "joint_1", {"level": 1.05 * WEIGHT}),
        Fault("load_friction", "joint_1", {"coefficient": 1.05}),
        Fault("stribeck_friction", "joint_1", {"level": 1.05 * WEIGHT, "velocity": 0.1}),
    ):
        assert abs(at_rest(np.pi / 2, limp, stuck)[0] - np.pi / 2) < 1e-5
    assert abs(at_rest(np.pi / 2, limp, Fault("coulomb_friction", "joint_1", {"level": 0.95 * WEIGHT}))[0] - 1.57) > 0.1


def test_an_elastic_joint_oscillates_at_its_resonance() -> None:
    """A push makes the link oscillate behind a heavy motor; the motor's torque shows the oscillation."""
    stiffness, still, rotor = 4000.0, np.zeros((2, 1)), 300.0
    push = {"force_x": 200.0, "force_y": 0.0, "force_z": 0.0, "start": 0.1, "end": 0.13}
    faults = [
        Fault("joint_elasticity", "joint_1", {"stiffness": stiffness}),
        Fault("external_contact", None, push),
    ]
    drives = Drives((rotor,), (0.0,), (0.0,), (0.0,))
    track = simulate(PENDULUM, drives, Table(np.array([0.0, 3.0]), still, still, still), 1.2, FULL, faults)
    a = np.diff(track.q[:, 0], 2)[1000:]
    up = np.flatnonzero((a[:-1] < 0) & (a[1:] >= 0))
    measured = 2 * np.pi * (len(up) - 1) / ((up[-1] - up[0]) * STEP)
    assert measured == pytest.approx(np.sqrt((stiffness + WEIGHT) / INERTIA_1R), rel=0.01)


def test_a_joint_with_backlash_moves_freely_through_its_gap() -> None:
    """Slowly past the lowest point, the motor torque is zero until the gap is crossed."""
    gap, t, w = 0.08, np.linspace(0, 40, 401), np.pi / 40
    x = w * t[:, None]
    table = Table(t, -0.3 * np.cos(x), 0.3 * w * np.sin(x), 0.3 * w**2 * np.cos(x))
    track = simulate(PENDULUM, BARE, table, 40.0, 10, [Fault("backlash", "joint_1", {"gap": gap})])
    link = np.arcsin(track.tau[:, 0] / WEIGHT)  # where the torque says that the link hangs
    before, after = (np.median((track.q[:, 0] - link)[rows]) for rows in (slice(20, 120), slice(-120, -20)))
    assert after - before == pytest.approx(gap, rel=0.01)  # its stops give way a little
