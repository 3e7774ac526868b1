"""Grids of servo recordings, and the closed loop: exact cases, laws of the drives, roll-outs."""

from dataclasses import replace

import numpy as np
import pytest

from signid.errors import RecordingError
from signid.model import Model, load_model
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servo.plant.course import bodies_of, course, motion_of
from signid.servo.plant.grid import commands_at, held_before
from signid.servos import Servo, ServoGrid

RATE = 100.0
DRIVE = Servo(kp=20.0, kd=1.0, armature=0.02, coulomb_friction=0.1, viscous_friction=0.1, delay=0.012)


@pytest.fixture(scope="module")
def one() -> Model:
    return load_model("1r")


def still(model: Model, command: float, seconds: float = 3.0, **options: float) -> ServoGrid:
    """Recording at rest at 0 whose command steps after .5 s."""
    joints, rows = model.robot.joints, int(seconds * RATE)
    t = np.arange(rows) / RATE
    u = np.where(t[:, None] < 0.5, 0.0, command) * np.ones(len(joints))
    return grids_of_arrays(joints, t, np.zeros((rows, len(joints))), u, **options)[0]


def test_commands_keep_their_time_between_uneven_stamps() -> None:
    t = np.cumsum(np.where(np.arange(400) % 3, 0.004, 0.007))
    u = np.sin(3 * t)
    (grid,) = grids_of_arrays(["a"], t, u, u, rate=200.0)
    held = np.interp(grid.origin + (np.arange(len(grid)) + 0.5) / 200.0, t, u)
    lag = np.polyfit(np.gradient(held)[5:-5] * 200.0, (held - grid.command[:, 0])[5:-5], 1)[0]
    assert lag == pytest.approx(np.mean(np.diff(t) ** 2) / np.mean(np.diff(t)) / 2, abs=2e-4)  # that of a held command


def test_gaps_split_a_recording_and_lost_commands_turn_a_drive_off() -> None:
    t = np.r_[np.arange(100) * 0.02, 5 + np.arange(60) * 0.02, 9.0]
    u = np.where(np.arange(161) < 30, np.nan, 1.0)
    first, second = grids_of_arrays(["a"], t, np.zeros(161), u)
    assert (len(first), len(second), second.origin) == (100, 60, 5.0)
    assert first.on[:, 0].sum() == 70 and first.driven == (True,)
    with pytest.raises(RecordingError, match="no commanded position"):
        grids_of_arrays(["a"], t, np.zeros(161), np.full(161, np.nan))
    (drop,) = grids_of_arrays(["a"], t[:100], np.ones(100), np.full(100, np.nan), driven=[True])
    assert drop.driven == (True,) and not drop.on.any() and (drop.command == 1).all()
    with pytest.raises(RecordingError, match="no stretch"):
        grids_of_arrays(["a"], np.arange(9) * 0.01, np.zeros(9), np.zeros(9))


def test_delays_between_rows_share_them() -> None:
    (grid,) = grids_of_arrays(["a"], np.arange(80) / RATE, np.zeros(80), np.arange(80.0))
    at = [commands_at(grid, 0, "velocity", delay, np.inf, 1)[0, 40] for delay in (0.0, 0.004, 0.01, 0.025, 9.0)]
    assert at == pytest.approx([40.0, 39.6, 39.0, 37.5, 0.0])
    slow = commands_at(grid, 0, "velocity", 0.0, 50.0, 2)[0]
    assert np.diff(slow).max() == pytest.approx(50.0 * 0.005)


def test_a_drive_that_starts_from_rest_held_its_position_before() -> None:
    t = np.arange(60) / RATE
    leaves = 0.2 + 0.5 * (1 - np.exp(-10 * np.maximum(t - 0.03, 0.0)))
    (grid,) = grids_of_arrays(["a"], t, leaves, np.full(60, 0.7))
    assert held_before(grid, 0) == pytest.approx(0.2)
    held = commands_at(grid, 0, "velocity", 0.03, np.inf, 1)[0]
    assert held[:5] == pytest.approx([0.2, 0.2, 0.2, 0.7, 0.7])
    (moving,) = grids_of_arrays(["a"], t, 2.0 * t, 2.0 * (t + 0.05))  # follows a ramp, 50 ms behind
    (standing,) = grids_of_arrays(["a"], t, np.full(60, 0.2), np.full(60, 0.25))  # carries a load
    assert held_before(moving, 0) == pytest.approx(0.1) and held_before(standing, 0) == pytest.approx(0.25)


def test_a_step_in_the_first_row_acts_after_the_delay(one: Model) -> None:
    drive = replace(DRIVE, kp=100.0, kd=10.0, delay=0.05)
    whole = still(one, 0.5)  # its command steps in row 50
    moved = roll_out(one, {"joint_1": drive}, whole)
    first = replace(whole, q=moved[50:], command=whole.command[50:], on=whole.on[50:], voltage=whole.voltage[50:])
    again = roll_out(one, {"joint_1": drive}, first)[:, 0]
    early = roll_out(one, {"joint_1": replace(drive, delay=0.0)}, first)[:, 0]
    assert np.abs(again - first.q[:, 0]).max() < 0.02 < np.abs(early - first.q[:, 0]).max()


def test_a_single_joint_is_linear_oscillation_plus_gravity(one: Model) -> None:
    """Small steps without friction follow the analytic second order."""
    drive = Servo(kp=400.0, kd=4.0, armature=0.3)
    grid = still(one, 0.01)
    robot = bodies_of(one, grid.joints)
    along = course(robot, motion_of(grid))
    slope = (course(robot, motion_of(still(one, 0.0))).wave[0, 0]) * 1.0
    inertia, stiffness = along.mass[0, 0, 0] + 0.3, 400.0 + slope
    w, decay = np.sqrt(stiffness / inertia - (2 / inertia) ** 2), 2 / inertia
    t = np.maximum(np.arange(len(grid)) / RATE - 0.5, 0)
    rest = along.bias[0, 0] + along.wave[0, 1]
    still_at = -rest / stiffness
    start = roll_out(one, {grid.joints[0]: drive}, still(one, 0.0, 20.0))[-1, 0]
    assert start == pytest.approx(still_at, abs=1e-5)
    moved = (
        roll_out(one, {grid.joints[0]: drive}, grid)[:, 0] - roll_out(one, {grid.joints[0]: drive}, still(one, 0))[:, 0]
    )
    expected = 0.01 * 400 / stiffness * (1 - np.exp(-decay * t) * (np.cos(w * t) + decay / w * np.sin(w * t)))
    assert np.abs(moved - expected).max() < 1e-4


def test_dry_friction_holds_exactly(one: Model) -> None:
    grid = still(one, 0.001)
    load = abs(course(bodies_of(one, grid.joints), motion_of(grid)).torque).max()
    held = roll_out(one, {grid.joints[0]: replace(DRIVE, coulomb_friction=load + 1.0)}, grid)
    assert np.abs(held).max() == 0.0


def test_limits_of_torque(one: Model) -> None:
    """Without gravity or friction, a drive at its limit accelerates evenly, up to its largest speed."""
    robot = replace(one.robot, model=one.robot.model.copy())
    robot.model.gravity.linear = np.zeros(3)
    free = replace(one, robot=robot)
    joint, grid = one.robot.joints[0], still(one, 50.0, 2.0)
    inertia = course(bodies_of(free, grid.joints), motion_of(grid)).mass[0, 0, 0] + 0.5
    for law, kd in (("effort", 0.0), ("effort", 0.5), ("duty", 0.0)):
        drive = Servo(law=law, kp=100.0, kd=kd, armature=0.5, effort_limit=2.0)
        q = roll_out(free, {joint: drive}, grid)[:, 0]
        t = np.maximum(np.arange(len(grid)) / RATE - 0.5, 0)
        assert q == pytest.approx(2.0 / inertia * t**2 / 2, abs=2e-3 * q[-1])
    drive = Servo(law="torque_speed", kp=100.0, armature=0.5, effort_limit=20.0, speed_limit=3.0)
    q = roll_out(free, {joint: drive}, grid)[:, 0]
    time = inertia * 3.0 / 20.0
    assert q == pytest.approx(3.0 * (t + time * (np.exp(-t / time) - 1)), abs=2e-3 * q[-1])
