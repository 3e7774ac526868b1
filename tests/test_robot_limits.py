"""Numbers, names and sizes of descriptions that would crash the reader or take hours are refused in one sentence."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from toys import joint, link, toy, urdf

from signid.errors import RobotError
from signid.robot import load_robot, robot_from_text
from signid.robot.document import MAX_MAGNITUDE, MAX_MOVING_JOINTS
from signid.robot.dynamics import check_masses

ROOT = Path(__file__).parents[1]
THREE = (ROOT / "robots/3r/robot.urdf").read_text()
BODY = '<mujoco><worldbody><body name="{}"{}><joint name="{}"{}/><geom size="{}"/></body></worldbody></mujoco>'


def mjcf(body: str = "b", joint: str = "j", size: str = ".1", more: str = "", place: str = "") -> str:
    return BODY.format(body, place, joint, more, size)


def within_joint_3() -> tuple[str, str]:
    """Text before and after the end of joint 3."""
    place = THREE.index("</joint>", THREE.index('<joint name="joint_3"'))
    return THREE[:place], THREE[place + len("</joint>") :]


@pytest.mark.parametrize("number", ["1e300", "1e150", "-1e300", "1e400", "nan"])
@pytest.mark.parametrize("old", ['mass value="', 'ixx="', 'origin xyz="', ' rpy="', 'axis xyz="'])
def test_huge_numbers_of_a_urdf_are_refused(old: str, number: str) -> None:
    before, found, after = THREE.rpartition(old)
    if not found:
        pytest.skip(f"3r has no {old}")
    value, _, rest = after.partition('"')
    changed = " ".join([number, *value.split()[1:]])
    with pytest.raises(RobotError, match=r"expected a (finite )?number"):
        robot_from_text(f'{before}{old}{changed}"{rest}', "urdf", "3r")


def test_negligible_numbers_are_zero_and_limits_may_be_huge() -> None:
    robot = robot_from_text(ended('<dynamics damping="1e-310"/>'), "urdf", "3r")
    assert robot.actuators.viscous_friction[-1] == 0
    wide = toy(link("a"), link("b"), joint("z", "a", "b", more='<limit lower="-1e308" upper="1e308" effort="1e308"/>'))
    assert np.isinf(wide.upper[0])


def ended(more: str) -> str:
    """The 3r with more inside of its joint 3."""
    head, end = within_joint_3()
    return f"{head}{more}</joint>{end}"


REFUSED = [  # description, words
    *((ended(f"<{x}/>"), "1e\\+09") for x in ('mimic joint="joint_2" multiplier="1e300"', 'dynamics damping="1e300"')),
    *((mjcf(size=x, place=y), "number up to 1e\\+09") for x, y in (("1e300", ""), (".1", ' pos="0 0 1e150"'))),
    *((mjcf(more=f" {x}"), "number up to 1e\\+09") for x in ('damping="1e300"', 'armature="1e12"', 'axis="1e300 0 0"')),
    *((x, "Pinocchio uses itself") for x in (mjcf(joint="universe"), mjcf(body="universe"))),
    (THREE.replace("joint_1", "universe"), "Pinocchio uses itself"),
    (ended('<dynamics damping="-1"/>'), "joint 'joint_3' has damping=-.*expected 0 or more"),
    (ended('<dynamics friction="-0.1"/>'), "joint 'joint_3' has friction=-.*expected 0 or more"),
    *(
        (mjcf(more=f' {x}="-0.1"'), rf"<joint> has {x}='-.*expected 0 or more")
        for x in ("damping", "frictionloss", "armature")
    ),
]


@pytest.mark.parametrize(("text", "words"), REFUSED)
def test_numbers_and_names_that_no_robot_has_are_refused(text: str, words: str) -> None:
    with pytest.raises(RobotError, match=words):
        robot_from_text(text, "mjcf" if text.startswith("<mujoco") else "urdf", "r")


def chain(joints: int) -> str:
    links = (link(f"l{i}") for i in range(joints + 1))
    return urdf(*links, *(joint(f"j{i}", f"l{i}", f"l{i + 1}") for i in range(joints)))


def test_long_chains_are_refused_at_once() -> None:
    assert len(robot_from_text(chain(MAX_MOVING_JOINTS), "urdf", "c").joints) == MAX_MOVING_JOINTS
    bodies = "".join(f'<body><joint name="j{i}"/><geom size="1"/></body>' for i in range(999))
    start = time.process_time()
    for kind, text in (("urdf", chain(999)), ("mjcf", f"<mujoco><worldbody>{bodies}</worldbody></mujoco>")):
        with pytest.raises(RobotError, match=f"999 moving joints, more than {MAX_MOVING_JOINTS}"):
            robot_from_text(text, kind, "c")
    assert time.process_time() - start < 5


def test_devices_pipes_and_giants_are_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os = pytest.importorskip("os")
    if not hasattr(os, "mkfifo"):
        pytest.skip("no pipes")
    os.mkfifo(tmp_path / "pipe.xml")
    (tmp_path / "r.xml").write_text(mjcf().replace("<worldbody>", '<include file="pipe.xml"/><worldbody>'))
    with pytest.raises(RobotError, match=r"pipe.xml: it is no regular file"):
        load_robot(tmp_path / "r.xml")
    with pytest.raises(RobotError, match="pipe.xml"):
        load_robot(tmp_path / "pipe.xml")
    monkeypatch.setattr("signid.robot.document.MAX_FILE_BYTES", 10)
    with pytest.raises(RobotError, match="more than 0 MB"):
        load_robot("3r")


def test_negative_masses_are_named() -> None:
    heavy = robot_from_text(THREE, "urdf", "3r")
    check_masses(heavy)
    head, _, tail = THREE.rpartition('mass value="')
    with pytest.raises(RobotError, match=r"link_3 .* mass of -2 kg"):
        check_masses(robot_from_text(f'{head}mass value="-2{tail[tail.index(chr(34)) :]}', "urdf", "3r"))
    assert MAX_MAGNITUDE >= 1e6
