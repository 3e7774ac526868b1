"""Robot descriptions, good and bad: each bad one gets one sentence, and nothing is printed."""

from __future__ import annotations

import gzip
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st

from signid.errors import InputError, RobotError
from signid.robot import configuration, held_positions, hold, load_robot, locate, names, robot_from_text
from signid.types import Robot

BODY = '<inertial><mass value="2"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
LIMIT = '<limit lower="-1" upper="2" effort="3" velocity="4"/>'


def link(name: str, body: str = BODY) -> str:
    return f'<link name="{name}">{body}</link>'


def joint(name: str, parent: str, child: str, kind: str = "revolute", more: str = LIMIT, axis: str = "0 1 0") -> str:
    ends = f'<parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}{more}</joint>'


def urdf(*parts: str, name: str = ' name="toy"') -> str:
    return f"<robot{name}>{''.join(parts)}</robot>"


def toy(*parts: str, name: str = ' name="toy"') -> Robot:
    return robot_from_text(urdf(*parts, name=name), "urdf", "file")


PAIR = (link("a"), link("b"), joint("z", "a", "b"))
CHAIN = (link("a"), link("b"), link("c"), joint("z", "a", "b"), joint("y", "b", "c"))


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
    "mjcf type": ('<mujoco><worldbody><body><joint type="x"/></body></worldbody></mujoco>', "Pinocchio cannot build"),
    "mjcf include": ('<mujoco><include file="none.xml"/></mujoco>', "none.xml cannot be read"),
    "mjcf frame": ("<mujoco><worldbody><frame><body/></frame></worldbody></mujoco>", "<frame>"),
    "mjcf numbers": (
        '<mujoco><worldbody><body><joint range="a b" limited="true"/><geom size="1"/></body></worldbody></mujoco>',
        "expected numbers|Pinocchio cannot build",
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
        "link triangle has an inertia that breaks the triangle inequality",
    )


def test_a_body_fixed_to_a_massless_link_is_its_mass() -> None:
    robot = toy(link("a"), link("b", ""), link("c"), joint("z", "a", "b"), joint("f", "b", "c", "fixed"))
    assert robot.notes == () and robot.links == ("b",)


def test_floating_and_planar_joints_are_held_at_neutral() -> None:
    robot = toy(link("a"), link("b"), link("c"), link("d"), joint("f", "a", "b", "floating"),
                joint("p", "b", "c", "planar"), joint("z", "c", "d"))  # fmt: skip
    assert robot.joints == ("z",) and robot.drive.shape == (10, 1)
    assert "held fixed at neutral: f (floating), p (planar)" in robot.notes
    assert configuration(robot, np.array([0.5])).tolist() == [0, 0, 0, 0, 0, 0, 1, 0, 0, 1, 0, 0.5]


MIMICS = (
    *(link(name) for name in "abcdef"),
    joint("u", "a", "b", "continuous"),
    joint("v", "b", "c", more='<mimic joint="u" multiplier="-2" offset="0.5"/>' + LIMIT),
    joint("w", "c", "d", "continuous", more='<mimic joint="v" multiplier="3" offset="1"/>'),
    joint("x", "d", "e"),
    joint("y", "e", "f", more='<mimic joint="nobody"/>' + LIMIT),
)


def test_mimics_of_mimics() -> None:
    robot = toy(*MIMICS)
    assert robot.joints == ("u", "x", "y")
    assert robot.drive.tolist() == [[1, 0, 0], [-2, 0, 0], [-6, 0, 0], [0, 1, 0], [0, 0, 1]]
    assert robot.rest.tolist() == [0, 0.5, 2.5, 0, 0]
    assert "y (nobody)" in robot.notes[0]
    q = configuration(robot, np.array([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(q, [np.cos(0.1), np.sin(0.1), 0.3, np.cos(1.9), np.sin(1.9), 0.2, 0.3], atol=1e-15)


def test_a_mimic_of_a_fixed_joint_stands_at_its_offset() -> None:
    robot = toy(*CHAIN[:3], link("d"), joint("f", "a", "b", "fixed"), joint("z", "b", "c"),
                joint("y", "c", "d", more='<mimic joint="f" offset="0.5"/>' + LIMIT))  # fmt: skip
    assert robot.joints == ("z",) and robot.rest.tolist() == [0, 0.5] and robot.drive.tolist() == [[1], [0]]


@given(q=st.lists(st.floats(-10, 10), min_size=3, max_size=3))
def test_configurations_are_what_pinocchio_integrates(q: list[float]) -> None:
    robot = toy(*MIMICS)
    expected = pin.integrate(robot.model, pin.neutral(robot.model), robot.drive @ q + robot.rest)
    np.testing.assert_allclose(configuration(robot, np.array(q)), expected, atol=1e-12)


def test_configurations_of_many_and_of_the_wrong_shape() -> None:
    robot = toy(*MIMICS)
    q = np.random.default_rng(0).normal(size=(7, 3))
    assert np.array_equal(configuration(robot, q), [configuration(robot, row) for row in q])
    assert configuration(robot, np.empty((0, 3))).shape == (0, 7)
    for wrong in (np.zeros(2), np.zeros((3, 4)), np.zeros(())):
        with pytest.raises(InputError, match="count its 3 joints"):
            configuration(robot, wrong)


def test_held_joints_have_the_torque_of_a_joint_that_stands_still() -> None:
    robot = load_robot("ur5")
    held = hold(robot, {"elbow_joint": 0.7, "1": -0.2})
    assert held.joints == ("shoulder_lift_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
    assert held.numbers == (2, 4, 5, 6) and held.model is robot.model
    assert "shoulder_pan_joint at -0.2 rad, elbow_joint at 0.7 rad" in held.notes[-1]
    assert held_positions(held) == pytest.approx({"shoulder_pan_joint": -0.2, "elbow_joint": 0.7})
    q = np.array([0.1, 0.2, 0.3, 0.4])
    full = configuration(robot, np.array([-0.2, 0.1, 0.7, 0.2, 0.3, 0.4]))
    np.testing.assert_allclose(configuration(held, q), full)
    assert hold(hold(robot, {"1": -0.2}), {"3": 0.7}).rest.tolist() == held.rest.tolist()


def test_mimics_of_held_joints_follow() -> None:
    held = hold(toy(*MIMICS), {"u": 0.25})
    assert held.rest.tolist() == [0.25, 0.0, 1.0, 0, 0] and held.drive[:3].tolist() == [[0, 0]] * 3
    assert held_positions(held) == {"u": 0.25}
    again = robot_from_text(held.document, held.kind, held.name, lock=held_positions(held))
    assert again.joints == held.joints and np.array_equal(again.rest, held.rest)


def test_a_part_of_a_robot() -> None:
    part = load_robot("panda", joints=["7", "panda_joint6"], lock={"panda_joint2": 0.5})
    assert part.joints == ("panda_joint6", "panda_joint7") and part.numbers == (6, 7)
    positions = held_positions(part)
    assert positions["panda_joint2"] == 0.5 and positions["panda_joint1"] == 0
    assert positions["panda_joint4"] == load_robot("panda").upper[3] < 0  # zero lies outside its limits
    assert "panda_joint4 at -0.0698 rad" in part.notes[-1]


@pytest.mark.parametrize(
    ("options", "sentence"),
    [
        ({"joints": ["panda_jont1"]}, "did you mean panda_joint1"),
        ({"joints": ["0"]}, "no joint '0'"),
        ({"joints": ["9"]}, "no joint '9'"),
        ({"joints": []}, "leave at least one"),
        ({"joints": ["1"], "lock": {"panda_joint1": 0}}, "both move and be locked"),
        ({"lock": {"1": 0, "panda_joint1": 0}}, "locked twice"),
        ({"lock": {"1": math.inf}}, "finite number"),
        ({"lock": {"1": "0.5"}}, "finite number"),
        ({"lock": {"1": None}}, "finite number"),
        ({"lock": {"panda_finger_joint2": 0}}, "no joint 'panda_finger_joint2' that moves by itself"),
    ],
)
def test_bad_choices_of_joints_get_a_sentence(options: dict[str, object], sentence: str) -> None:
    with pytest.raises(RobotError, match=sentence):
        load_robot("panda", **options)


def test_the_actuators_file_wins_over_the_urdf(tmp_path: Path) -> None:
    damped = LIMIT + '<dynamics damping="0.5" friction="0.25"/>'
    path = tmp_path / "toy.urdf"
    path.write_text(urdf(*CHAIN[:3], joint("z", "a", "b", more=damped), joint("y", "b", "c", more=damped)))
    (tmp_path / "actuators.toml").write_text("[joint.y]\narmature = 2\nviscous_friction = 0.75\n[joint.1]\n"
                                             "torque_offset = -1\ntorque_constant = -0.5\n")  # fmt: skip
    stated = load_robot(path).actuators
    nan = np.nan
    np.testing.assert_array_equal(stated.viscous_friction, [0.5, 0.75])
    np.testing.assert_array_equal(stated.coulomb_friction, [0.25, 0.25])
    np.testing.assert_array_equal(stated.armature, [nan, 2])
    np.testing.assert_array_equal(stated.torque_offset, [-1, nan])
    np.testing.assert_array_equal(stated.torque_constant, [-0.5, nan])
    held = load_robot(path, lock={"z": 0}).actuators
    np.testing.assert_array_equal([held.viscous_friction[0], held.armature[0]], [0.75, 2])
    other = tmp_path / "other.toml"
    other.write_text("[joint.z]\narmature = 7\n")
    np.testing.assert_array_equal(load_robot(path, actuators=other).actuators.armature, [7, nan])


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("[joint.elbow]\narmature = 1", "no joint 'elbow'"),
        ("[joint.z]\ninertia = 1", "unknown key 'inertia'"),
        ("[joint.z]\narmature = -1", "cannot be negative"),
        ("[joint.z]\narmature = '1'", "expected a finite number"),
        ("[joint.z]\narmature = true", "expected a finite number"),
        ("[joint.z]\narmature = nan", "expected a finite number"),
        ("[joint.z]\ntorque_offset = inf", "expected a finite number"),
        ("[joint.z]\ntorque_constant = 0", "tell nothing"),
        ("[joint]\nz = 1", "not a table"),
        ("joint = 1", "not a table"),
        ("[joints.z]\narmature = 1", "no entry 'joints'"),
        ("[joint.z]\narmature = 1\n[joint.1]\narmature = 1", "two tables"),
        ("[joint.z", "not valid TOML"),
        (b"\xff", "not UTF-8"),
        (None, "cannot be read"),
    ],
)
def test_bad_actuators_get_a_sentence(text: str | bytes | None, sentence: str, tmp_path: Path) -> None:
    path, stated = tmp_path / "toy.urdf", tmp_path / "stated.toml"
    path.write_text(urdf(*PAIR))
    if text is not None:
        stated.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises(RobotError, match=sentence) as caught:
        load_robot(path, actuators=stated)
    assert "\n" not in str(caught.value) and str(caught.value).startswith("stated.toml: ")


def test_xacro(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    package = tmp_path / "toys"
    (package / "urdf").mkdir(parents=True)
    (package / "package.xml").write_text("<package><name>toys</name></package>")
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    (package / "urdf" / "parts.xacro").write_text(
        f'<robot {space}><xacro:property name="half" value="${{pi/2}}"/></robot>'
    )
    text = urdf(
        '<xacro:include filename="$(find toys)/urdf/parts.xacro"/>', link("a"), link("b"),
        joint("z", "a", "b", more='<limit lower="-${half}" upper="${half}" effort="1" velocity="1"/>'),
        name=f' name="toy" {space}',
    )  # fmt: skip
    inside, outside = package / "urdf" / "toy.urdf.xacro", tmp_path / "toy.xacro"
    for path, options in ((inside, {}), (outside, {"package_dirs": [tmp_path]})):
        path.write_text(text)
        robot = load_robot(path, **options)
        assert robot.upper == [math.pi / 2] and "half" not in robot.document and robot.kind == "urdf"
        assert robot_from_text(robot.document, "urdf", "toy").joints == ("z",)
    plain = tmp_path / "toy.urdf"
    plain.write_text(text)
    assert load_robot(plain, package_dirs=[tmp_path]).joints == ("z",)
    for bad, sentence in (("${nothing}", "nothing"), ("$(find nowhere)", "nowhere"), ("${1/0}", "division")):
        outside.write_text(urdf(*PAIR[:2], joint("z", "a", "b", axis=bad), name=f' name="toy" {space}'))
        with pytest.raises(RobotError, match=f"xacro cannot expand it.*{sentence}") as caught:
            load_robot(outside)
        assert "\n" not in str(caught.value)
    assert capfd.readouterr() == ("", "")


def test_declarations_that_are_wrong_do_not_matter() -> None:
    for declaration in ('<?xml version="0.0" ?>', '\n<?xml version="1.0" encoding="utf-16"?>', "<?xml version='1.0'?>"):
        assert robot_from_text(declaration + urdf(*PAIR), "urdf", "toy").joints == ("z",)


def test_prefixes_that_nobody_declared_and_namespaces() -> None:
    loose = urdf(*PAIR, '<drake:joint name="z" type="ball"/><sensor:camera/>')
    assert robot_from_text(loose, "urdf", "toy").joints == ("z",)
    assert robot_from_text(urdf(*PAIR, name=' xmlns="http://www.ros.org"'), "urdf", "toy").name == "toy"
    with pytest.raises(RobotError, match="said to be 'mjcf'"):
        robot_from_text(loose, "mjcf", "toy")


ARM = """<mujoco model="arm"><compiler angle="degree"/><option gravity="0 0 -5"/>
<default><joint armature="0.3" damping="2" frictionloss="0.4"/>
  <default class="wrist"><joint damping="7"/></default></default>
<worldbody><geom type="plane" size="1 1 1"/>
<body name="base" pos="0 0 1" quat="0.8 0.6 0 0"><freejoint/><inertial mass="2" pos="0 0 0" diaginertia="1 1 1"/>
  <body pos="0 0 0.1"><joint name="turn" axis="0 1 0" range="-90 45"/><joint axis="1 0 0" type="slide" range="-1 0.5"/>
    <geom type="box" size=".1 .2 .3" mass="3" contype="0" conaffinity="0"/><geom type="mesh" mesh="absent"/>
    <body name="hand" pos="0 0 1" childclass="wrist"><joint name="wrist" axis="1 1 0" range="0 1" limited="false"/>
      <inertial mass="2" pos="0 0 0.1" diaginertia="1 1 1"/>
      <body name="tip"><joint name="ball" type="ball"/><geom size="0.1"/></body></body></body></body>
<body name="other" pos="1 0 0"><joint name="knob" axis="0 0 1"/><geom type="sphere" size="0.1" pos="0.2 0 0"/></body>
</worldbody><asset><mesh name="absent" file="absent.stl"/></asset>
<equality><joint joint1="knob" joint2="turn" polycoef="0.1 2 0 0 0"/><weld body1="tip" body2="other"/></equality>
</mujoco>"""


def test_mjcf() -> None:
    robot = robot_from_text(ARM, "mjcf", "file")
    assert robot.name == "arm" and robot.joints == ("turn", "joint_3", "wrist") and robot.numbers == (1, 2, 3)
    assert robot.prismatic.tolist() == [False, True, False]
    np.testing.assert_allclose(robot.lower, [-np.pi / 2, -1, -np.inf])
    np.testing.assert_allclose(robot.upper, [np.pi / 4, 0.5, np.inf])
    np.testing.assert_allclose(robot.actuators.viscous_friction, [2 + 2**2 * 2, 2, 7])
    np.testing.assert_allclose(robot.actuators.coulomb_friction, [0.4 + 2 * 0.4, 0.4, 0.4])
    np.testing.assert_allclose(robot.actuators.armature, [0.3 + 2**2 * 0.3, 0.3, 0.3])
    assert robot.model.gravity.linear.tolist() == [0, 0, -5] and not np.any(robot.model.armature)
    assert len(robot.notes) == 5
    for i, sentence in enumerate(("no name", "from the meshes", "body base is free", "1 equality", "neutral: ball")):
        assert sentence in robot.notes[i]
    knob = robot.model.joints[robot.model.getJointId("knob")].idx_v
    assert robot.drive[knob].tolist() == [2, 0, 0] and robot.rest[knob] == 0.1
    assert held_positions(hold(robot, {"turn": 0.25})) == {"turn": 0.25}


def test_mjcf_includes(tmp_path: Path) -> None:
    (tmp_path / "hand.xml").write_text("<mujocoinclude><body><joint/><geom size='1'/></body></mujocoinclude>")
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><worldbody><body><joint/><geom size="1"/><include file="hand.xml"/></body></worldbody></mujoco>'
    )
    robot = load_robot(path)
    assert robot.joints == ("joint_1", "joint_2") and robot.name == "arm"
    assert robot_from_text(robot.document, "mjcf", "arm").joints == robot.joints
    (tmp_path / "hand.xml").write_text('<mujocoinclude><include file="hand.xml"/></mujocoinclude>')
    with pytest.raises(RobotError, match="includes itself"):
        load_robot(path)


def test_mjcf_has_the_torques_of_mujoco() -> None:
    mujoco = pytest.importorskip("mujoco")
    text = ARM.replace('<geom type="mesh" mesh="absent"/>', "").replace('<mesh name="absent" file="absent.stl"/>', "")
    text = text[: text.index("<equality>")] + "</mujoco>"
    robot = robot_from_text(text, "mjcf", "arm")
    theirs = mujoco.MjModel.from_xml_string(text)
    theirs.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    state, data, rng = mujoco.MjData(theirs), robot.model.createData(), np.random.default_rng(0)
    places = [theirs.jnt_qposadr[1], theirs.jnt_qposadr[2], theirs.jnt_qposadr[3], theirs.joint("knob").qposadr[0]]
    rows = [theirs.jnt_dofadr[1], theirs.jnt_dofadr[2], theirs.jnt_dofadr[3], theirs.joint("knob").dofadr[0]]
    assert robot.joints == ("turn", "joint_3", "wrist", "knob")
    for _ in range(10):
        q, v, a = rng.normal(size=(3, 4))
        state.qpos[:] = theirs.qpos0
        state.qpos[places], state.qvel[rows], state.qacc[rows] = q, v, a
        mujoco.mj_inverse(theirs, state)
        rigid = (state.qfrc_inverse + state.qfrc_passive)[rows] - robot.actuators.armature * a
        model_state = configuration(robot, q), robot.drive @ v, robot.drive @ a
        np.testing.assert_allclose(robot.drive.T @ pin.rnea(robot.model, data, *model_state), rigid, atol=1e-10)
