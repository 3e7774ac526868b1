"""Robot descriptions, good and bad: each bad one gets one sentence, and nothing is printed."""

from __future__ import annotations

import gzip
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from toys import BODY, CHAIN, LIMIT, PAIR, joint, link, toy, urdf

from signid.errors import RobotError
from signid.robot import load_robot, locate, names, robot_from_text

BAD = {
    "empty": ("", "is empty"),
    "blank": (" \n ", "is empty"),
    "not xml": ("robot: toy", "not valid XML"),
    "cut off": (urdf(*PAIR)[:-20], "not valid XML"),
    "other root": ("<html/>", "<html> as its root"),
    "sdf": ('<sdf version="1.6"><model name="x"/></sdf>', "SDF"),
    "mujoco part": ("<mujocoinclude/>", "part of an MJCF"),
    "entities": ('<!DOCTYPE r [<!ENTITY x SYSTEM "file:///dev/null">]>' + urdf(*PAIR, "<x>&x;</x>"), "document type"),
    "no link": (urdf(), "no link"),
    "no joint": (urdf(link("a")), "no moving joint"),
    "fixed only": (urdf(link("a"), link("b"), joint("z", "a", "b", "fixed")), "no moving joint"),
    "twice a link": (urdf(*PAIR, link("a")), "two links named 'a'"),
    "twice a joint": (urdf(*PAIR, link("c"), joint("z", "b", "c")), "two joints named 'z'"),
    "missing link": (urdf(link("a"), joint("z", "a", "b")), "a link 'b' that the file does not have"),
    "no parent": (urdf(*PAIR[:2], '<joint name="z" type="revolute"><child link="b"/></joint>'), "no parent link"),
    "two roots": (urdf(*PAIR, link("c")), "2 root links"),
    "two parents": (urdf(*CHAIN, joint("x", "a", "c")), "child of two joints"),
    "circle": (urdf(link("a"), link("b"), joint("z", "a", "b"), joint("y", "b", "a")), "in a circle"),
    "circle apart": (urdf(link("r"), *PAIR, joint("y", "b", "a")), "in a circle"),
    "unknown type": (urdf(*PAIR[:2], joint("z", "a", "b", "ball")), "unknown type 'ball'"),
    "no type": (urdf(*PAIR[:2], '<joint name="z"><parent link="a"/><child link="b"/></joint>'), "no type"),
    "no name": (urdf("<link/>"), "link without a name"),
    "joint without a name": (urdf(*PAIR[:2], PAIR[2].replace(' name="z"', "")), "joint without a name"),
    "no child": (urdf(*PAIR[:2], '<joint name="z" type="revolute"><parent link="a"/></joint>'), "no child link"),
    "zero axis": (urdf(*PAIR[:2], joint("z", "a", "b", axis="0 0 0")), "axis 0 0 0"),
    "short axis": (urdf(*PAIR[:2], joint("z", "a", "b", axis="0 1")), "three numbers"),
    "words": (urdf(*PAIR[:2], joint("z", "a", "b", more='<limit lower="low"/>')), "lower='low'; expected a number"),
    "underscore": (urdf(*PAIR[:2], joint("z", "a", "b", more='<limit lower="1_0"/>')), "expected a number"),
    "mass is not a number": (urdf(link("a"), link("b", '<inertial><mass value="nan"/></inertial>'), PAIR[2]), "finite"),
    "mimic of nobody": (urdf(*PAIR[:2], joint("z", "a", "b", more="<mimic/>")), "<mimic> without a joint"),
    "mimics in a circle": (
        urdf(*CHAIN[:3], joint("z", "a", "b", more='<mimic joint="y"/>'),
             joint("y", "b", "c", more='<mimic joint="z"/>')),
        "no joint that moves by itself",
    ),
    "mimics in a circle beside a joint": (
        urdf(link("r"), *CHAIN[:3], joint("x", "r", "a"), joint("z", "a", "b", more='<mimic joint="y"/>'),
             joint("y", "b", "c", more='<mimic joint="z"/>')),
        "mimics itself in a circle",
    ),
    "xacro left": (urdf(*PAIR[:2], joint("z", "a", "b", axis="${x} 0 0")), "end in .xacro"),
    "empty mjcf": ("<mujoco/>", "no moving joint"),
    "mjcf without joint": ("<mujoco><worldbody><body/></worldbody></mujoco>", "no moving joint"),
    "mjcf type": ('<mujoco><worldbody><body><joint type="x"/></body></worldbody></mujoco>', "MuJoCo cannot compile"),
    "mjcf include": ('<mujoco><include file="none.xml"/></mujoco>', "none.xml cannot be read"),
    "mjcf cloth": ("<mujoco><worldbody><frame><flexcomp/></frame></worldbody></mujoco>", "<flexcomp>"),
    "mjcf body of the world": (
        '<mujoco><worldbody><body name="world"><joint/><geom size="1"/></body></worldbody></mujoco>',
        "MuJoCo cannot compile it: .*'world'",
    ),
    "mjcf numbers": (
        '<mujoco><worldbody><body><joint range="a b" limited="true"/><geom size="1"/></body></worldbody></mujoco>',
        "MuJoCo cannot compile it: .*'range'",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_descriptions_get_one_sentence(case: str, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    text, sentence = BAD[case]
    path = tmp_path / "toy.urdf"
    path.write_text(text)
    with pytest.raises(RobotError, match=sentence) as caught:
        load_robot(path)
    assert "\n" not in str(caught.value) and str(caught.value).startswith("toy.urdf: ")
    assert capfd.readouterr() == ("", "")


def test_bad_files_get_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "latin.urdf").write_bytes(urdf(*PAIR, "<!-- ü -->").encode("latin-1"))
    (tmp_path / "zipped.urdf").write_bytes(gzip.compress(urdf(*PAIR).encode()))
    for source, sentence in {
        tmp_path / "none.urdf": "there is no file",
        tmp_path: "is a folder without a robot.urdf",
        tmp_path / "latin.urdf": "not UTF-8",
        tmp_path / "zipped.urdf": "not UTF-8",
        "": "no robot was named",
        "pandda": "did you mean panda",
        "cassie": "SDF",
        "x" * 1000: "cannot be reached",
        "qqqqqq": "some known names are",
    }.items():
        with pytest.raises(RobotError, match=sentence) as caught:
            load_robot(source)
        assert "\n" not in str(caught.value)


def test_nothing_is_printed_where_pinocchio_would_complain(tmp_path: Path) -> None:
    path = tmp_path / "toy.urdf"
    path.write_text(
        urdf(link("a"), link("b", '<visual><geometry><mesh filename="package://none/x.stl"/></geometry></visual>'),
             joint("z", "a", "b", more=""), '<gazebo reference="b"/>', name="")  # no name, no limit, no mass, no mesh
    )  # fmt: skip
    program = f"from signid.robot import load_robot; print(load_robot({str(path)!r}).notes)"
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, env=environment, check=True)
    assert run.stderr == ""
    for sentence in ("has no name", "link b moves but carries no mass", "no position limit is stated for z"):
        assert sentence in run.stdout


def test_paths_names_and_case(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert load_robot("1R").joints == ("joint_1",)
    assert locate("PANDA") == locate("panda")
    assert list(names()) == sorted(names(), key=str.casefold)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "panda").mkdir()  # a folder of recordings, say
    assert load_robot("panda").name == "panda"
    (tmp_path / "panda" / "robot.urdf").write_text(urdf(*PAIR))
    assert load_robot("panda").name == "toy"


def test_joints_are_in_the_order_of_the_file() -> None:
    robot = toy(*CHAIN)
    assert robot.joints == ("z", "y") and robot.numbers == (1, 2)
    branches = toy(link("a"), link("b"), link("c"), joint("z", "a", "b"), joint("y", "a", "c"))
    assert branches.joints == ("z", "y")
    assert list(branches.model.names)[1:] == ["y", "z"] and branches.links == ("c", "b")
    assert branches.drive.tolist() == [[0, 1], [1, 0]]


def test_limits_and_friction() -> None:
    damped = LIMIT + '<dynamics damping="0.5" friction="0.25"/>'
    endless = '<limit lower="-1e16" upper="1e16" effort="0" velocity="0"/>'
    robot = toy(
        *(link(name) for name in "abcde"),
        joint("p", "a", "b", more=damped),
        joint("q", "b", "c", "continuous", more='<limit effort="3" velocity="4"/>'),
        joint("r", "c", "d", "prismatic", more=endless),
        joint("s", "d", "e", more='<limit lower="0" upper="0" effort="1" velocity="1"/>'),
    )
    assert robot.prismatic.tolist() == [False, False, True, False]
    assert robot.lower.tolist() == [-1, -math.inf, -math.inf, -math.inf]
    assert robot.upper.tolist() == [2, math.inf, math.inf, math.inf]
    assert robot.velocity_limit.tolist() == [4, 4, math.inf, 1]
    assert robot.effort_limit.tolist() == [3, 3, math.inf, 1]
    np.testing.assert_array_equal(robot.actuators.viscous_friction, [0.5, np.nan, np.nan, np.nan])
    np.testing.assert_array_equal(robot.actuators.coulomb_friction, [0.25, np.nan, np.nan, np.nan])
    assert np.isnan(robot.actuators.armature).all()
    assert [note for note in robot.notes if "position limit" in note] == ["no position limit is stated for r, s"]


def test_inertials_that_no_body_has_are_noted() -> None:
    def inertial(mass: float, x: float, y: float, z: float) -> str:
        return (f'<inertial><mass value="{mass}"/><inertia ixx="{x}" ixy="0" ixz="0" iyy="{y}" iyz="0" izz="{z}"/>'
                "</inertial>")  # fmt: skip

    bodies = {"none": "", "good": BODY, "triangle": inertial(1, 1, 1, 3), "negative": inertial(-1, 1, 1, 1)}
    bodies |= {"flat": inertial(1, 0, 1, 1), "rod": inertial(1, 1e-4, 1, 1), "weightless": inertial(0, 1, 1, 1)}
    robot = toy(link("base", inertial(-5, 1, 1, 1)), *(link(name, body) for name, body in bodies.items()),
                *(joint(f"to_{name}", "base", name) for name in bodies))  # fmt: skip
    assert robot.notes == (
        "links none, weightless move but carry no mass",
        "links negative, weightless have an inertia without a positive mass",
        "link flat has an inertia that is not positive definite",
        "link triangle has an inertia that violates the triangle inequality",
    )


def test_a_body_fixed_to_a_massless_link_is_its_mass() -> None:
    robot = toy(link("a"), link("b", ""), link("c"), joint("z", "a", "b"), joint("f", "b", "c", "fixed"))
    assert robot.notes == () and robot.links == ("b",)


def test_declarations_that_are_wrong_do_not_matter() -> None:
    for declaration in ('<?xml version="0.0" ?>', '\n<?xml version="1.0" encoding="utf-16"?>', "<?xml version='1.0'?>"):
        assert robot_from_text(declaration + urdf(*PAIR), "urdf", "toy").joints == ("z",)


def test_undeclared_prefixes_and_namespaces() -> None:
    loose = urdf(*PAIR, '<drake:joint name="z" type="ball"/><sensor:camera/>')
    assert robot_from_text(loose, "urdf", "toy").joints == ("z",)
    assert robot_from_text(urdf(*PAIR, name=' xmlns="http://www.ros.org"'), "urdf", "toy").name == "toy"
    with pytest.raises(RobotError, match="declared as 'mjcf'"):
        robot_from_text(loose, "mjcf", "toy")
