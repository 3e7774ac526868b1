"""Every named robot can be loaded, and its affine map from joints to model is correct."""

from __future__ import annotations

from functools import cache
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from signid.errors import RobotError
from signid.robot import configuration, load_robot, locate, names
from signid.types import Robot

PREFIX = Path(find_spec("pinocchio").origin).parents[4]
URDFS = sorted((PREFIX / "share" / "example-robot-data" / "robots").rglob("*.urdf"))
UNMOVED = {"quadrotor_base", "hector", "iris_simple", "ur/ur3"}
MOVED = [path for path in URDFS if path not in {locate(name) for name in UNMOVED}]
LOADERS = """a1 allegro_left_hand allegro_right_hand anymal anymal_c anymal_kinova asr_twodof b1 b1_z1 baxter bolt
    double_pendulum double_pendulum_continuous double_pendulum_simple finger_edu g1 go1 go2 hector human hyq icub
    icub_reduced iris kinova laikago panda pr2 quadruped romeo simple_humanoid simple_humanoid_classical solo8 solo12
    talos talos_arm talos_box talos_full talos_full_box tiago tiago_dual tiago_no_hand tiago_pro ur10 ur10_limited
    ur3 ur3_gripper ur3_limited ur5 ur5_gripper ur5_limited xarm7 z1""".split()


@cache
def loaded(path: Path) -> Robot:
    return load_robot(path)


def states(robot: Robot, seed: int = 0) -> tuple[np.ndarray, ...]:
    """Model configuration, velocity, acceleration of one random state."""
    q, v, a = np.random.default_rng(seed).normal(size=(3, len(robot.joints)))
    return configuration(robot, q), robot.drive @ v, robot.drive @ a


def test_every_file_has_a_name() -> None:
    assert len(URDFS) > 60
    assert set(URDFS) <= {locate(name) for name in names()}
    assert set(LOADERS) <= set(names())
    assert {"1r", "3r", "emps"} <= set(names())


@pytest.mark.parametrize("name", sorted(set(names()) - UNMOVED))
def test_robot(name: str) -> None:
    robot = loaded(locate(name))
    model, n = robot.model, len(robot.joints)
    assert robot.drive.shape == (model.nv, n) and robot.rest.shape == (model.nv,)
    assert len(robot.links) == model.njoints - 1
    assert robot.numbers == tuple(range(1, n + 1))
    assert np.all(robot.lower < robot.upper) and np.all(robot.velocity_limit > 0) and np.all(robot.effort_limit > 0)
    for j, joint in enumerate(robot.joints):
        own = model.joints[model.getJointId(joint)].idx_v
        assert np.array_equal(np.flatnonzero(robot.drive[own]), [j]) and robot.drive[own, j] == 1
    q, v, a = states(robot)
    data = model.createData()
    regressor = pin.computeJointTorqueRegressor(model, data, q, v, a)
    standard = np.concatenate([body.toDynamicParameters() for body in list(model.inertias)[1:]])
    torque = pin.rnea(model, data, q, v, a)
    np.testing.assert_allclose(regressor @ standard, torque, atol=1e-9 * max(1, np.abs(torque).max()))
    assert all(len(note.splitlines()) == 1 for note in robot.notes)


@pytest.mark.parametrize("name", sorted(UNMOVED))
def test_robots_without_a_moving_joint_are_refused_in_one_sentence(name: str) -> None:
    with pytest.raises(RobotError, match="moving joint") as caught:
        load_robot(name)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("path", MOVED, ids=lambda path: path.stem)
def test_the_model_matches_the_file(path: Path) -> None:
    """Pinocchio gets the file without geometry and returns the same joints, placements and bodies."""
    robot, whole = loaded(path), pin.buildModelFromUrdf(str(path))
    assert list(robot.model.names) == list(whole.names)
    assert [j.shortname() for j in robot.model.joints] == [j.shortname() for j in whole.joints]
    for i in range(whole.njoints):
        assert robot.model.jointPlacements[i].isApprox(whole.jointPlacements[i], 1e-12)
        ours, theirs = (x.inertias[i].toDynamicParameters() for x in (robot.model, whole))
        np.testing.assert_allclose(ours, theirs, atol=1e-12)
    children = {frame.name: frame.parentJoint for frame in whole.frames if frame.type == pin.FrameType.BODY}
    assert [children[link] for link in robot.links] == list(range(1, whole.njoints))


@pytest.mark.parametrize("name", ["panda", "pr2", "tiago_pro", "baxter"])  # Pinocchio's own mimics need leaders first
def test_mimic_joints_have_the_torque_of_the_mimic_model(name: str) -> None:
    robot = load_robot(name)
    assert robot.model.nv > len(robot.joints)
    reduced = pin.buildModelFromUrdf(robot.path, mimic=True)
    q, v, a = np.random.default_rng(3).normal(size=(3, len(robot.joints)))
    order = [reduced.joints[reduced.getJointId(joint)].idx_v for joint in robot.joints]
    assert sorted(order) == list(range(reduced.nv))
    there = pin.neutral(reduced)
    for joint, position in zip(robot.joints, q, strict=True):
        axis = reduced.joints[reduced.getJointId(joint)]
        turned = [np.cos(position), np.sin(position)] if axis.nq == 2 else [position]
        there[axis.idx_q : axis.idx_q + axis.nq] = turned
    v_there, a_there = np.zeros((2, reduced.nv))
    v_there[order], a_there[order] = v, a
    expected = pin.rnea(reduced, reduced.createData(), there, v_there, a_there)[order]
    data, state = robot.model.createData(), (configuration(robot, q), robot.drive @ v, robot.drive @ a)
    regressor = pin.computeJointTorqueRegressor(robot.model, data, *state)
    standard = np.concatenate([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]])
    scale = max(1.0, np.abs(expected).max())
    np.testing.assert_allclose(robot.drive.T @ regressor @ standard, expected, atol=1e-12 * scale)
    np.testing.assert_allclose(robot.drive.T @ pin.rnea(robot.model, data, *state), expected, atol=1e-12 * scale)


def test_the_fingers_of_the_panda_are_one_joint() -> None:
    robot = load_robot("panda")
    assert robot.joints[-1] == "panda_finger_joint1" and len(robot.joints) == 8
    fingers = [robot.model.joints[robot.model.getJointId(f"panda_finger_joint{i}")].idx_v for i in (1, 2)]
    assert robot.drive[fingers, -1].tolist() == [1.0, 1.0]
    assert robot.prismatic.tolist() == [False] * 7 + [True]


@pytest.mark.parametrize("name", ["panda", "romeo", "talos_full", "tiago_pro"])
def test_power_is_equal_in_joints_and_model(name: str) -> None:
    """Joint torque times joint velocity equals the rate of energy, by central differences."""
    robot = load_robot(name)
    rng, h = np.random.default_rng(5), 1e-5
    q, v, a = rng.normal(size=(3, len(robot.joints)))
    data = robot.model.createData()

    def energy(t: float) -> float:
        position, speed = configuration(robot, q + v * t + a * t * t / 2), robot.drive @ (v + a * t)
        return pin.computeKineticEnergy(robot.model, data, position, speed) + pin.computePotentialEnergy(
            robot.model, data, position
        )

    torque = robot.drive.T @ pin.rnea(robot.model, data, configuration(robot, q), robot.drive @ v, robot.drive @ a)
    assert torque @ v == pytest.approx((energy(h) - energy(-h)) / (2 * h), rel=1e-6)
