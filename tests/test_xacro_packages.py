"""Descriptions made of packages: numbers in YAML files, packages found without ROS, values of arguments as folders."""

from __future__ import annotations

import math
import re
import shutil
from pathlib import Path

import pytest

import signid
from signid.cli import run
from signid.errors import RobotError

OPEN = '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"'
BODY = '<link name="base"/><link name="arm"/><joint name="j" type="continuous"><parent link="base"/><child link="arm"/>'
ROBOT = f"{OPEN} name='r'>{BODY}</joint></robot>"

TOP = f"""{OPEN} name="$(arg name)">
<xacro:arg name="name" default="arm"/><xacro:include filename="$(find two_arm)/urdf/inc/two_macro.xacro"/>
<xacro:arg name="kind" default="none"/><xacro:arg name="prefix" default=""/><xacro:arg name="absolute" default="false"/>
<xacro:arg name="limits" default="$(find two_arm)/config/$(arg kind)/limits.yaml"/>
<xacro:arg name="masses" default="$(find two_arm)/config/$(arg kind)/masses.yaml"/>
<xacro:property name="start" default="$(find two_arm)/config/start.yaml"/><link name="world"/>
<xacro:two_arm prefix="$(arg prefix)" limits_file="$(arg limits)" masses_file="$(arg masses)"
  start="${{xacro.load_yaml(start)}}" absolute="$(arg absolute)">
<origin xyz="0 0 1" rpy="0 0 0"/></xacro:two_arm></robot>"""
MACRO = f"""{OPEN}><xacro:include filename="$(find two_arm)/urdf/inc/two_common.xacro"/>
<xacro:macro name="two_arm" params="prefix *origin limits_file masses_file absolute control:=true
  start:=${{dict(shoulder=0.0,elbow=-1.57)}}">
<xacro:read_numbers limits_file="${{limits_file}}" masses_file="${{masses_file}}" absolute="${{absolute}}"/>
<xacro:if value="${{control}}"><ros2_control name="c" type="system">
  <joint name="${{prefix}}shoulder"><param name="initial_value">${{start['shoulder']}}</param></joint>
</ros2_control></xacro:if>
<link name="${{prefix}}base"/>
<joint name="${{prefix}}fix" type="fixed"><xacro:insert_block name="origin"/><parent link="world"/>
  <child link="${{prefix}}base"/></joint>
<xacro:limb name="shoulder" parent="base" axis="0 0 1"/><xacro:limb name="elbow" parent="shoulder_link" axis="0 1 0"/>
</xacro:macro></robot>"""
COMMON = f"""{OPEN}>
<xacro:macro name="read_numbers" params="limits_file masses_file absolute">
<xacro:property name="absolute" value="${{absolute}}" scope="parent"/>
<xacro:property name="numbers" value="${{xacro.load_yaml(masses_file)}}"/>
<xacro:property name="limits" value="${{xacro.load_yaml(limits_file)['limits']}}" scope="parent"/>
<xacro:property name="links" value="${{numbers['links']}}" scope="parent"/></xacro:macro>
<xacro:macro name="mesh" params="name:=^">
<xacro:if value="${{absolute}}">
  <xacro:property name="path" value="file://$(find ${{links[name]['package']}})/a"/></xacro:if>
<xacro:unless value="${{absolute}}">
  <xacro:property name="path" value="package://${{links[name].package}}/a"/></xacro:unless>
<visual><geometry><mesh filename="${{path}}"/></geometry></visual></xacro:macro>
<xacro:macro name="limb" params="name parent axis prefix:=^|''">
<xacro:property name="c" value="${{links[name]['centre']}}"/><xacro:property name="I" value="${{links[name].tensor}}"/>
<link name="${{prefix}}${{name}}_link"><xacro:mesh/><inertial><mass value="${{links[name]['mass']}}"/>
<origin xyz="${{c['x']}} ${{c['y']}} ${{c['z']}}" rpy="${{pi/2}} 0 0"/>
<inertia ixx="${{I.xx}}" iyy="${{I.yy}}" izz="${{I.zz}}" ixy="0" ixz="0" iyz="${{I['yz']}}"/></inertial></link>
<xacro:property name="turns" value="${{'revolute' if limits[name]['limited'] else 'continuous'}}"/>
<joint name="${{prefix}}${{name}}" type="${{turns}}"><parent link="${{prefix}}${{parent}}"/>
<child link="${{prefix}}${{name}}_link"/><axis xyz="${{axis}}"/><origin xyz="0 0 ${{links[name].reach or 0}}"/>
<xacro:if value="${{turns != 'continuous'}}"><limit lower="${{limits[name]['low']}}" upper="${{limits[name]['high']}}"
  effort="${{limits[name]['effort']}}" velocity="${{limits[name]['speed']}}"/></xacro:if>
<xacro:unless value="${{turns != 'continuous'}}">
  <limit effort="${{limits[name]['effort']}}" velocity="1"/></xacro:unless>
</joint></xacro:macro></robot>"""
LIMITS = """limits:
  shoulder:  # [deg]
    {limited: true, low: !degrees -90.0, high: !degrees 180.0, speed: !radians 2*pi, effort: 150.0}
  elbow: {limited: false, effort: 28.0}
"""
MASSES = """links:
  shoulder: {mass: 3.5, centre: {x: 0.1, y: 0.0, z: -0.02}, reach: 0.25, package: absent_meshes,
    tensor: {xx: 0.01, yy: 0.02, zz: 0.025, yz: 0.001}}
  elbow: {mass: 1.25, centre: {x: 0.0, y: 0.3, z: 0.0}, reach: !millimeters 425, package: absent_meshes,
    tensor: {xx: 0.004, yy: 0.003, zz: 0.005, yz: 0.0}}
"""


def write(folder: Path, **contents: str) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in contents.items():
        (folder / name.replace("__", ".")).write_text(content)


def manifest(name: str) -> str:
    return f'<package format="3">\n  <name>{name}</name>\n</package>'


def package(folder: Path) -> Path:
    """A package of the form that makers of arms publish; the folder with its urdf and config."""
    write(folder / "urdf", two__urdf__xacro=TOP)
    write(folder / "urdf/inc", two_macro__xacro=MACRO, two_common__xacro=COMMON)
    write(folder / "config", start__yaml="{shoulder: 0.0, elbow: -1.57}\n")
    for kind in ("long", "short"):
        write(folder / "config" / kind, limits__yaml=LIMITS, masses__yaml=MASSES)
    return folder / "urdf/two.urdf.xacro"


def has_known_numbers(robot: signid.Robot) -> None:
    first, second = robot.model.inertias[1], robot.model.inertias[2]
    assert (first.mass, second.mass) == (3.5, 1.25)
    assert first.lever.tolist() == [0.1, 0.0, -0.02] and second.lever.tolist() == [0.0, 0.3, 0.0]
    # turned by 90 degrees about x: yy and zz change places, and yz its sign
    turned = [[0.01, 0, 0], [0, 0.025, -0.001], [0, -0.001, 0.02]]
    assert abs(first.inertia - turned).max() < 1e-15
    assert robot.model.jointPlacements[2].translation[2] == 0.425
    assert (robot.lower[0], robot.upper[0]) == pytest.approx((-math.pi / 2, math.pi))
    assert robot.effort_limit.tolist() == [150.0, 28.0] and robot.velocity_limit[0] == pytest.approx(2 * math.pi)
    assert robot.upper[1] == math.inf


@pytest.mark.parametrize("absolute", [False, True])
def test_numbers_in_yaml_reach_the_model_and_meshes_need_no_package(tmp_path: Path, absolute: bool) -> None:
    path = package(tmp_path / "clone_of_it")
    write(tmp_path / "clone_of_it", package__xml=manifest("two_arm"))
    robot = signid.load_robot(path, xacro={"kind": "long", "absolute": absolute})
    assert robot.name == "arm" and robot.joints == ("shoulder", "elbow")
    has_known_numbers(robot)
    other = signid.load_robot(path, xacro={"kind": "long", "name": "b", "prefix": "left_"})
    assert other.name == "b" and other.joints == ("left_shoulder", "left_elbow")


def test_a_package_is_found_by_its_folder_by_an_option_beside_and_where_ros_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = package(tmp_path / "two_arm")
    has_known_numbers(signid.load_robot(path, xacro={"kind": "long"}))
    top = tmp_path / "own/top.xacro"
    write(top.parent, top__xacro=TOP)
    for folder in (tmp_path, tmp_path / "two_arm"):
        has_known_numbers(signid.load_robot(top, xacro={"kind": "long"}, package_dirs=[folder]))
    with pytest.raises(RobotError, match=r"needs the ROS package 'two_arm', .*; add package_dirs=DIR"):
        signid.load_robot(top, xacro={"kind": "long"})
    write(tmp_path / "two_arm", package__xml=manifest("two_arm"))
    has_known_numbers(signid.load_robot(top, xacro={"kind": "long"}))
    shutil.move(tmp_path / "two_arm", tmp_path / "ros/share/two_arm")
    for variable, value in (("AMENT_PREFIX_PATH", "ros"), ("ROS_PACKAGE_PATH", "ros/share")):
        with monkeypatch.context() as patch, pytest.raises(RobotError, match="'two_arm'"):
            patch.setenv(variable, str(tmp_path / "none"))
            signid.load_robot(top, xacro={"kind": "long"})
        with monkeypatch.context() as patch:
            patch.setenv(variable, str(tmp_path / value))
            has_known_numbers(signid.load_robot(top, xacro={"kind": "long"}))


def test_the_sentence_says_which_values_an_argument_may_have(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = package(tmp_path / "two_arm")
    assert run(["inspect", str(path)]) == 2
    error = capsys.readouterr().err
    assert "argument kind is 'none', but there is no" in error and error.count("\n") == 1
    assert error.endswith("add --xacro kind:=VALUE (there are long, short)\n")
    include = '<xacro:arg name="dof" default="7"/><xacro:include filename="arms/$(arg dof)dof.xacro"/>'
    part = f'{OPEN} name="r">{include}</robot>'
    write(tmp_path, part__xacro=part)
    write(tmp_path / "arms", **{"6dof__xacro": ROBOT})
    with pytest.raises(RobotError, match=r"dof is '7', .*add xacro={\"dof\": VALUE} \(there are 6dof\)"):
        signid.load_robot(tmp_path / "part.xacro")
    assert signid.load_robot(tmp_path / "part.xacro", xacro={"dof": 6}).joints == ("j",)


def test_a_file_that_the_caller_names_is_read_and_no_other_one(tmp_path: Path) -> None:
    path = package(tmp_path / "robots/two_arm")
    write(tmp_path / "mine", masses__yaml=MASSES.replace("3.5", "4.5"), limits__yaml=LIMITS)
    named = {"kind": "long", "masses": str(tmp_path / "mine/masses.yaml")}
    assert signid.load_robot(path, xacro=named).model.inertias[1].mass == 4.5
    named["limits"] = str(tmp_path / "mine/../mine/limits.yaml")
    assert signid.load_robot(path, xacro=named).model.inertias[1].mass == 4.5
    path.write_text(TOP.replace("$(find two_arm)/config/start.yaml", str(tmp_path / "mine/limits.yaml")))
    with pytest.raises(RobotError, match=r"it may not read .*limits.yaml, because it lies neither beside"):
        signid.load_robot(path, xacro={"kind": "long", "masses": named["masses"], "name": str(tmp_path / "mine")})


@pytest.mark.parametrize(
    "content",
    [
        '<xacro:include filename="$(find no_arm)/urdf/x.xacro"/>',
        '<xacro:include filename="$(find no_arm)/urdf/x.xacro" optional="true"/>',
        '<xacro:include filename="$(find no_arm)/urdf/*.xacro"/>',
        "<link name=\"${xacro.load_yaml('$(find no_arm)/x.yaml')}\"/>",
        "<link name=\"${load_yaml('$(find no_arm)/x.yaml')['a']}\"/>",
    ],
)
def test_absent_packages_are_named_where_the_model_needs_them(content: str, tmp_path: Path) -> None:
    write(tmp_path, r__xacro=ROBOT.replace("<link", f"{content}<link", 1))
    with pytest.raises(RobotError, match=re.escape("it needs the ROS package 'no_arm', which is neither above")):
        signid.load_robot(tmp_path / "r.xacro")


def test_folders_above_that_are_no_packages_stay_closed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    include = '<xacro:include filename="$(find NAME)/part.xacro"/>'
    for folder, name in (("plain/urdf", "plain"), ("some_files/deep/urdf", "some_files"), ("my_home/urdf", "my_home")):
        write(tmp_path / name, part__xacro=f"{OPEN}/>")
        write(tmp_path / folder, r__xacro=ROBOT.replace("<link", include.replace("NAME", name) + "<link", 1))
        monkeypatch.setenv("HOME", str(tmp_path / "my_home"))
        with pytest.raises(RobotError, match=f"needs the ROS package '{name}'"):
            signid.load_robot(tmp_path / folder / "r.xacro")


FRANKA = f"""{OPEN} name="r"><xacro:arg name="sn" default="XI130512B"/><xacro:arg name="bare" default="false"/>
<xacro:property name="config" value="${{load_yaml('links.yaml')}}"/><xacro:property name="sn" value="$(arg sn)"/>
<xacro:property name="number" value="-1"/><xacro:property name="bare" value="$(arg bare)"/>
<xacro:property name="prefix" value="${{'' if bare else 'arm' + '_'}}"/>
<xacro:if value="${{len(sn) >= 9 and (sn[0] == 'X' or sn[0] == 'L') and not sn.endswith('Z')}}">
  <xacro:property name="number" value="${{int(sn[2:6])}}"/></xacro:if>
<xacro:macro name="rod" params="mass radius h"><inertial><mass value="${{mass}}"/>
<inertia ixx="${{1./12 * mass * (3 * radius**2 + h**2)}}" iyy="${{1./12 * mass * (3 * radius**2 + h**2)}}"
  izz="${{1./2 * mass * radius**2}}" ixy="0" ixz="0" iyz="0"/></inertial></xacro:macro>
<xacro:macro name="part" params="name xyz:='0 0 0' direction:='z' config:=^"><link name="${{prefix}}${{name}}">
<xacro:unless value="${{name in config}}">${{xacro.warning('No inertia of ' + name)}}</xacro:unless>
<xacro:if value="${{name in config}}"><xacro:property name="I" value="${{config[name]}}" lazy_eval="false"/>
<xacro:property name="h" value="${{I.h if 'z' in direction else 0}}"/>
<xacro:rod mass="${{I.mass}}" radius="${{I.size.radius}}" h="${{h + float(xyz.split(' ')[2])}}"/></xacro:if></link>
</xacro:macro>
<xacro:part name="base"/><xacro:part name="arm" xyz="0 0 0.1"/>
<joint name="j" type="revolute"><parent link="${{prefix}}base"/><child link="${{prefix}}arm"/><axis xyz="1 0 0"/>
<limit lower="${{-radians(90)}}" upper="${{2 if number >= 1305 and number != 1380 else 1}}" effort="1" velocity="1"/>
</joint></robot>"""


def test_expressions_that_makers_use(tmp_path: Path) -> None:
    write(tmp_path, r__xacro=FRANKA, links__yaml="arm: {mass: 12, h: 0.2, size: {radius: 0.1}}\n")
    robot = signid.load_robot(tmp_path / "r.xacro")
    body = robot.model.inertias[1]
    assert body.mass == 12 and body.inertia[2, 2] == pytest.approx(0.06, rel=1e-12)
    assert body.inertia[0, 0] == pytest.approx(3 * 0.1**2 + 0.3**2, rel=1e-12)
    assert robot.upper[0] == 2 and robot.lower[0] == pytest.approx(-math.pi / 2)
    other = signid.load_robot(tmp_path / "r.xacro", xacro={"sn": "XI1200", "bare": True})
    assert other.upper[0] == 1
