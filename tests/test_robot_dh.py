"""A URDF from a Denavit-Hartenberg table has the frames, the bodies and the torques of that table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin
import polars as pl
import pytest
from hypothesis import given, strategies as st

from signid.errors import RobotError
from signid.robot import DHLink, configuration, load_robot, robot_from_text, urdf_from_dh
from signid.types import Robot

ROBOTS = Path(__file__).parents[1] / "robots"
LIMITS = {"velocity": 5.0, "effort": 20.0}
ARM = (  # the 3R arm that signid carries
    DHLink(np.pi / 2, 0.0, 0.3, mass=10.0, centre=(0, -0.15, 0), inertia=(7.708e-2, 4.167e-3, 7.708e-2),
           box=(0.05, 0.3, 0.05), **LIMITS),
    DHLink(0.0, 0.3, -0.09, mass=1.125, centre=(-0.15, 0, -0.06), inertia=(4.6879e-4, 8.6715e-3, 8.6715e-3),
           box=(0.3, 0.05, 0.05), **LIMITS),
    DHLink(0.0, 0.2, 0.0, mass=0.75, centre=(-0.10, 0, 0), inertia=(3.1252e-4, 2.6565e-3, 2.6565e-3),
           box=(0.2, 0.05, 0.05), **LIMITS),
)  # fmt: skip


def transform(link: DHLink, q: float) -> np.ndarray:
    """Rot_z Trans_z Trans_x Rot_x, one factor after the other."""
    theta, d = (link.theta, link.d + q) if link.prismatic else (link.theta + q, link.d)
    turn = pin.SE3(pin.utils.rotate("z", theta), np.zeros(3)).homogeneous
    slide = pin.SE3(np.eye(3), np.array([0.0, 0.0, d])).homogeneous
    reach = pin.SE3(np.eye(3), np.array([link.a, 0.0, 0.0])).homogeneous
    twist = pin.SE3(pin.utils.rotate("x", link.alpha), np.zeros(3)).homogeneous
    return turn @ slide @ reach @ twist


def frames(links: tuple[DHLink, ...], q: np.ndarray) -> list[np.ndarray]:
    """Poses of the DH frames 1..n in the base."""
    pose, found = np.eye(4), []
    for link, position in zip(links, q, strict=True):
        pose = pose @ transform(link, position)
        found.append(pose)
    return found


def frames_of(robot: Robot, links: tuple[DHLink, ...], q: np.ndarray) -> list[np.ndarray]:
    """The same from the URDF: frame i is where joint i + 1 sits, the last one is the tool."""
    model, data = robot.model, robot.model.createData()
    pin.framesForwardKinematics(model, data, configuration(robot, q))
    origins = [
        data.oMi[model.parents[model.getJointId(f"joint_{i}")]] * model.jointPlacements[model.getJointId(f"joint_{i}")]
        for i in range(2, len(links) + 1)
    ]
    return [pose.homogeneous for pose in [*origins, data.oMf[model.getFrameId("tool")]]]


def kinetic_and_potential(links: tuple[DHLink, ...], q: np.ndarray, v: np.ndarray) -> tuple[float, float]:
    """Energy from the table alone: bodies in their DH frames, velocities by central differences."""
    h, kinetic, potential = 1e-6, 0.0, 0.0
    before, after, now = (frames(links, q + step * v) for step in (-h, h, 0.0))
    for link, a, b, x in zip(links, before, after, now, strict=True):
        rate = (b - a) / (2 * h)
        centre = np.append(np.asarray(link.centre, float), 1.0)
        spin = x[:3, :3].T @ rate[:3, :3]
        omega = np.array([spin[2, 1], spin[0, 2], spin[1, 0]])
        inertia = np.diag(link.inertia) if np.shape(link.inertia) == (3,) else np.asarray(link.inertia)
        kinetic += 0.5 * link.mass * np.sum((rate @ centre)[:3] ** 2) + 0.5 * omega @ inertia @ omega
        potential += 9.81 * link.mass * (x @ centre)[2]
    return kinetic, potential


angles = st.floats(-3.2, 3.2)
lengths = st.floats(-1.0, 1.0)
rows = st.builds(
    DHLink,
    alpha=st.one_of(angles, st.sampled_from([0.0, np.pi / 2, -np.pi / 2, np.pi])),
    a=lengths,
    d=lengths,
    theta=angles,
    prismatic=st.booleans(),
    mass=st.floats(0.1, 10.0),
    centre=st.tuples(lengths, lengths, lengths),
    inertia=st.builds(
        lambda angle, axis: pin.utils.rotate(axis, angle) @ np.diag([0.1, 0.2, 0.25]) @ pin.utils.rotate(axis, -angle),
        angles,
        st.sampled_from("xyz"),
    ),
)
tables = st.lists(rows, min_size=1, max_size=6).map(tuple)


@given(links=tables, seed=st.integers(0, 2**31))
def test_frames_are_the_product_of_the_transforms(links: tuple[DHLink, ...], seed: int) -> None:
    robot = robot_from_text(urdf_from_dh("any", links), "urdf", "any")
    assert robot.prismatic.tolist() == [link.prismatic for link in links]
    q = np.random.default_rng(seed).uniform(-3, 3, len(links))
    for expected, found in zip(frames(links, q), frames_of(robot, links, q), strict=True):
        np.testing.assert_allclose(found, expected, atol=1e-10)


@given(links=tables, seed=st.integers(0, 2**31))
def test_bodies_have_the_energy_of_the_table(links: tuple[DHLink, ...], seed: int) -> None:
    robot = robot_from_text(urdf_from_dh("any", links), "urdf", "any")
    q, v = np.random.default_rng(seed).uniform(-1, 1, (2, len(links)))
    data = robot.model.createData()
    kinetic = pin.computeKineticEnergy(robot.model, data, configuration(robot, q), v)
    potential = pin.computePotentialEnergy(robot.model, data, configuration(robot, q))
    expected = kinetic_and_potential(links, q, v)
    assert kinetic == pytest.approx(expected[0], rel=1e-6, abs=1e-6)
    assert potential == pytest.approx(expected[1], rel=1e-9, abs=1e-9)


def test_the_three_ways_to_state_an_inertia_agree() -> None:
    full = np.array([[0.3, 0.01, 0.02], [0.01, 0.2, 0.03], [0.02, 0.03, 0.25]])
    six = (0.3, 0.01, 0.2, 0.02, 0.03, 0.25)  # Pinocchio's order
    texts = {urdf_from_dh("x", [DHLink(0.1, 0.2, 0.3, mass=1.0, inertia=given)]) for given in (full, six)}
    assert len(texts) == 1
    diagonal = [urdf_from_dh("x", [DHLink(0, 0, 0, inertia=given)]) for given in ((1, 2, 3), np.diag([1, 2, 3]))]
    assert diagonal[0] == diagonal[1]


@pytest.mark.parametrize(
    ("links", "sentence"),
    [
        ([], "no row"),
        ([DHLink(0, np.nan, 0)], "not finite"),
        ([DHLink(0, 0, 0, centre=(1.0, 2.0))], "3 numbers"),
        ([DHLink(0, 0, 0, inertia=np.arange(9.0).reshape(3, 3))], "not symmetric"),
        ([DHLink(0, 0, 0, inertia=(1.0,))], "3, 6 or 3 x 3"),
        ([DHLink(0, 0, 0, lower=1.0, upper=-1.0)], "give the lower one first"),
    ],
)
def test_bad_tables_get_a_sentence(links: list[DHLink], sentence: str) -> None:
    with pytest.raises(RobotError, match=sentence):
        urdf_from_dh("x", links)


def test_the_carried_arm_is_generated_from_its_table() -> None:
    assert (ROBOTS / "3r" / "robot.urdf").read_bytes() == urdf_from_dh("3r", ARM).encode()


def test_the_boxes_of_the_arm_are_those_of_its_inertias() -> None:
    for link in ARM:
        x, y, z = link.box
        moments = link.mass / 12 * np.array([y * y + z * z, x * x + z * z, x * x + y * y])
        np.testing.assert_allclose(link.inertia, moments, rtol=1e-3)


@pytest.mark.parametrize(
    ("name", "recording", "tolerance"),
    [
        ("1r", "1dof_experiment1", 1.1e-7),  # 24.5 N.m sin q with q to nine digits: the formula itself is 1.02e-7 off
        ("3r", "3dof_experiment123", 2e-4),
        ("3r", "3dof_experiment456", 2e-4),
    ],
)
def test_torques_are_those_of_the_first_recordings(data: Path, name: str, recording: str, tolerance: float) -> None:
    table = pl.read_csv(data / "seed_penne" / f"{recording}.csv.gz", infer_schema_length=None)
    robot = load_robot(name)
    n = len(robot.joints)
    q, v, a, tau = (
        table.select([f"{kind}_{j + 1}" for j in range(n)]).to_numpy() for kind in ("q", "dq", "ddq", "tau")
    )
    work = robot.model.createData()
    found = [pin.rnea(robot.model, work, *row) for row in zip(configuration(robot, q), v, a, strict=True)]
    assert len(q) == 501
    assert np.abs(np.array(found) - tau).max() < tolerance


def test_the_pendulum_is_the_formula() -> None:
    robot = load_robot("1r")
    work, rng = robot.model.createData(), np.random.default_rng(1)
    for q, v, a in rng.normal(size=(20, 3)):
        torque = pin.rnea(robot.model, work, np.array([q]), np.array([v]), np.array([a]))[0]
        assert torque == pytest.approx(5 * 9.81 * 0.5 * np.sin(q) + (5 * 8.417e-2 + 5 * 0.5**2) * a, abs=1e-12)
