"""Signs and zeros of recorded positions against the description, found by the load of simulated arms."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from servo_loops import pendulum

from signid.model import load_model, with_servos
from signid.robot import configuration, load_robot
from signid.robot.dynamics import rigid_torque
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servo.plant.course import bodies_of
from signid.servo.plant.roll_out import torques, tree_of
from signid.servo.zeros import JointZero, find_zeros
from signid.servo.zeros.run import log_odds, probability
from signid.servos import Servo, ServoGrid
from signid.types import Robot

ARM = Path(__file__).parents[1] / "robots" / "so101" / "arm.urdf"
DRIVE = Servo(kp=12.0, kd=0.5, delay=0.012, coulomb_friction=0.05, armature=0.015)
LIFT, ELBOW, WRIST = "shoulder_lift", "elbow_flex", "wrist_flex"
RATE, SECONDS = 100.0, 24.0


def recorded(robot: Robot, seed: int) -> ServoGrid:
    """Motion of a robot with position drives about its zero, with noise of encoders."""
    rng, n = np.random.default_rng(seed), len(robot.joints)
    t = np.arange(int(RATE * SECONDS)) / RATE
    f, phase = rng.uniform(0.1, 1.2, (n, 4)), rng.uniform(0, 6, (n, 4))
    waves = (np.sin(2 * np.pi * f * t[:, None, None] + phase) / (1 + f)).sum(axis=2)
    command = 0.4 * waves * np.minimum(t, 1.0)[:, None]
    (grid,) = grids_of_arrays(robot.joints, t, np.zeros_like(command), command)
    servos = {joint: DRIVE for joint in robot.joints}
    q = roll_out(with_servos(load_model(robot), servos), servos, grid)
    return replace(grid, q=q + 4e-4 * rng.standard_normal(q.shape))


def changed(grid: ServoGrid, change: dict[str, tuple[int, float]]) -> ServoGrid:
    """The recording of a robot some of whose positions have another sign and zero."""
    q, command = grid.q.copy(), grid.command.copy()
    for joint, (sign, zero) in change.items():
        j = grid.joints.index(joint)
        q[:, j], command[:, j] = sign * (q[:, j] - zero), sign * (command[:, j] - zero)
    return replace(grid, q=q, command=command)


def found(robot: Robot, grid: ServoGrid) -> dict[str, JointZero]:
    servos = {joint: DRIVE for joint in grid.joints}
    bodies = bodies_of(load_model(robot), grid.joints)
    return {one.joint: one for one in find_zeros(bodies, (grid,), servos)}


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot(ARM)


@pytest.fixture(scope="module")
def grid(arm: Robot) -> ServoGrid:
    return recorded(arm, 0)


@pytest.mark.slow
def test_nothing_is_said_of_an_arm_as_described(arm: Robot, grid: ServoGrid) -> None:
    zeros = found(arm, grid)
    assert not any(one.changed for one in zeros.values())
    for joint in (LIFT, ELBOW, WRIST):
        one = zeros[joint]
        assert one.sign == 1 and one.sign_probability > 0.95 and one.identifiable
        assert one.zero is not None and one.std is not None and abs(one.zero) < 2.5 * one.std < 0.25
    assert not zeros["shoulder_pan"].identifiable and zeros["shoulder_pan"].zero is None


@pytest.mark.slow_cases("change1")
@pytest.mark.parametrize("change", [{ELBOW: (-1, 0.7), WRIST: (1, -0.4)}, {LIFT: (-1, 1.2), ELBOW: (1, -0.8)}])
def test_other_signs_and_zeros_of_an_arm_are_found(
    change: dict[str, tuple[int, float]], arm: Robot, grid: ServoGrid
) -> None:
    zeros = found(arm, changed(grid, change))
    assert {joint for joint, one in zeros.items() if one.changed} == set(change)
    for joint, (sign, zero) in change.items():
        one = zeros[joint]
        assert one.sign == sign and one.probability > 0.95
        assert one.zero is not None and one.std is not None
        assert abs(one.zero - zero) < 2.5 * one.std < 0.25


def test_the_sign_of_a_pendulum_is_not_identifiable_but_its_zero_is() -> None:
    robot = pendulum()
    plain = recorded(robot, 3)
    shifted = changed(plain, {"swing": (1, 0.6)})
    assert not found(robot, plain)["swing"].changed
    one = found(robot, shifted)["swing"]
    assert one.changed and one.zero == pytest.approx(0.6, abs=0.05)
    assert one.sign_probability < 0.9 and not one.identifiable


def test_drives_that_are_off_and_short_recordings_give_nothing(arm: Robot, grid: ServoGrid) -> None:
    assert found(arm, replace(grid, on=np.zeros_like(grid.on))) == {}
    short = replace(grid, **{key: getattr(grid, key)[:300] for key in ("q", "command", "on", "voltage")})
    assert found(arm, short) == {}
    tiny = replace(grid, **{key: getattr(grid, key)[:5] for key in ("q", "command", "on", "voltage")})
    assert found(arm, tiny) == {}


def test_the_load_is_that_of_pinocchio(arm: Robot) -> None:
    bodies, rng = bodies_of(load_model(arm), arm.joints), np.random.default_rng(0)
    q, v, a = rng.normal(size=(3, 20, len(arm.joints)))
    wanted = rigid_torque(bodies, configuration(bodies, q), v @ bodies.drive.T, a @ bodies.drive.T)
    assert torques(tree_of(bodies), q, v, a) == pytest.approx(wanted, abs=1e-12)


def test_few_or_unsteady_blocks_give_little_evidence() -> None:
    assert log_odds(np.full(10, 5.0), np.full(10, 5.0), 0) == 0
    assert probability(log_odds(np.full(10, 5.0), np.linspace(40, 50, 10), 1)) > 0.99
    assert probability(log_odds(np.array([5.0, 5, 5]), np.array([4.0, 30, 4.5]), 1)) < 0.5
    assert log_odds(np.linspace(40, 50, 10), np.full(10, 5.0), 0) < -5
