"""Inspection of a description: base parameters and unidentifiable parameters."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from signid.check import inspect
from signid.errors import RobotError
from signid.output.report.results.identification import joint_table
from signid.robot import load_robot, names


def test_inspection_names_unidentifiable_parameters() -> None:
    found = inspect(load_robot("3r"))
    assert {"m_1", "mz_2", "Ixx_1"} <= set(found.invisible)
    assert "Izz_1" in found.combined
    assert not set(found.invisible) & set(found.combined)


TWINS = """TwoDofs alexander_v1.lowerBodyOnly anymal_b anymal-kinova b1-z1 borinot_flying_arm_2 g1_29dof_rev_1_0
    double_pendulum_continuous hextilt_flying_arm_5 hyq_no_sensors panda_collision solo talos_box talos_reduced
    talos_reduced_box talos_reduced_corrected talos_left_arm talos_full_box talos_full_v2 talos_full_v2_box
    ur10_joint_limited_robot ur10_limited ur10_robot ur3_gripper ur3_joint_limited_robot ur3_limited ur3_robot
    ur5_gripper ur5_joint_limited_robot ur5_limited ur5_robot""".split()  # the joints and bodies of another robot


@pytest.mark.slow_cases("tiago_dual")
@pytest.mark.parametrize("name", sorted({*names()} - {*TWINS}))
def test_every_robot_is_inspected_or_refused_in_one_sentence(name: str) -> None:
    try:
        found = inspect(load_robot(name))
    except RobotError as error:
        assert "\n" not in str(error)
        return
    base = found.base
    assert 0 < base.rank <= len(base.labels)
    assert base.condition < 5e3
    assert base.singular_values[base.rank - 1] > 1e3 * (
        base.singular_values[base.rank] if base.rank < len(base.labels) else 0
    )


def test_long_names_of_links_lose_their_middle_and_keep_one_line() -> None:
    robot, console = load_robot("g1"), Console(width=76, file=StringIO(), record=True)
    console.print(*joint_table(robot), sep="\n")
    head, *lines, last = console.export_text().splitlines()
    assert len(lines) == len(robot.joints)
    assert any("…" in line.split()[2] for line in lines)
    assert "type" not in head and last == "All joints are revolute: limits in rad, rad/s and N.m."


def test_the_type_of_joints_that_differ_is_a_column() -> None:
    console = Console(width=100, file=StringIO(), record=True)
    console.print(*joint_table(load_robot("panda")), sep="\n")
    text = console.export_text()
    assert "type" in text and text.count("prismatic") == 1 and "All joints" not in text
