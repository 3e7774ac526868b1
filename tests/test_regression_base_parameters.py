"""Base parameters: known counts, known formulas, and the torque they promise."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from signid.effects import EFFECT_NAMES, EFFECTS
from signid.regression.base_parameters import build_base
from signid.robot import hold, load_robot, robot_from_text
from signid.types import Array, Law, Robot

COUNTS = {  # bodies alone, with the four usual effects
    "1r": (2, 5),
    "3r": (15, 25),
    "ur5": (36, 58),
    "panda": (None, None),
    "solo12": (68, 108),
}


def stated_inertials(robot: Robot) -> Array:
    return np.array([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]])


def all_laws(robot: Robot) -> list[Law]:
    return [Law(EFFECTS[name], (j,)) for name in EFFECT_NAMES for j in range(len(robot.joints))]


@pytest.mark.parametrize("name", ["3r", "ur5", "solo12"])
def test_counts(name: str) -> None:
    robot = load_robot(name)
    assert build_base(robot).rank == COUNTS[name][0]
    assert build_base(robot, all_laws(robot)).rank == COUNTS[name][1]


def test_the_pendulum_shows_its_first_moment_and_its_inertia_about_the_axis() -> None:
    robot = load_robot("1r")
    base = build_base(robot)
    value = base.combination @ stated_inertials(robot).ravel()
    assert_allclose(sorted(np.abs(value[np.abs(value) > 1e-9])), [0.42085 + 5 * 0.25, 2.5], rtol=1e-12)


def test_formulas_of_the_3r_arm() -> None:
    expressions = build_base(load_robot("3r")).expressions
    assert "Izz_2 + 0.09 m_3" in expressions
    assert "mx_2 + 0.3 m_3" in expressions
    assert "Izz_1 + Iyy_2 + 0.0981 m_3 - 0.18 mz_3 + Iyy_3" in expressions


def test_a_held_joint_leaves_fewer_base_parameters() -> None:
    robot = load_robot("ur5")
    held = hold(robot, {robot.joints[-1]: 0.3})
    assert build_base(held).rank < build_base(robot).rank
    assert len(held.joints) == 5


def test_angles_rounded_by_hand_separate_no_parameters() -> None:
    """1.57 and 3.14 stand for pi / 2 and pi; a joint turned by .01 rad is another robot."""
    link = (
        '<link name="{0}"><inertial><mass value="1"/><origin xyz=".1 .02 .03"/>'
        '<inertia ixx=".01" iyy=".02" izz=".03" ixy=".001" ixz=".002" iyz=".003"/></inertial></link>'
    )
    joint = (
        '<joint name="j{0}" type="revolute"><parent link="l{1}"/><child link="l{0}"/><origin xyz="0 0 .3" rpy="{2}"/>'
        '<axis xyz="0 0 1"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>'
    )
    ranks = []
    for rpy in ("1.5707963267948966 3.141592653589793 0", "1.57 3.14 0", "1.58 3.14 0"):
        links = "".join(link.format(f"l{k}") for k in range(3))
        text = f'<robot name="arm">{links}{joint.format(1, 0, "0 0 0")}{joint.format(2, 1, rpy)}</robot>'
        robot = robot_from_text(text, "urdf", "arm")
        base = build_base(robot, [Law(EFFECTS["armature"], (j,)) for j in range(2)])
        ranks.append(base.rank)
        assert not any("e-" in expression for expression in base.expressions)
    assert ranks[0] == ranks[1] and ranks[2] > ranks[0]
