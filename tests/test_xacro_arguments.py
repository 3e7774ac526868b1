"""Arguments of xacro files: on the command line, in Python, in fleets; what lacks or is strange is named."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest

import signid
from signid.cli import run
from signid.cli.fleet.manifest import read_manifest
from signid.errors import ManifestError, OptionError, RobotError

SPACE = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
ARM = f"""<robot {SPACE} name="$(arg name)">
<xacro:arg name="model"/><xacro:arg name="prefix" default=""/><xacro:arg name="heavy" default="false"/>
<xacro:property name="table" value="${{dict(short=0.2, long=0.5)}}"/>
<xacro:property name="len" value="${{table['$(arg model)']}}"/>
<link name="base"/><link name="upper"><inertial><origin xyz="${{len/2}} 0 0"/>
<mass value="${{3 if xacro.arg('heavy') else 2}}"/>
<inertia ixx="0.001" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="$(arg prefix)shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="20" velocity="3"/></joint></robot>"""
GIVEN = ["name:=ur5e", "model:=long"]


@pytest.fixture
def arm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> str:
    monkeypatch.chdir(tmp_path)
    Path("arm.urdf.xacro").write_text(ARM)
    return "arm.urdf.xacro"


def said(words: list[str], capsys: pytest.CaptureFixture[str], code: int = 2) -> str:
    """The sentence of a command that ends with 2, or its output."""
    assert run(words) == code
    out, err = capsys.readouterr()
    if code == 2:
        assert err.count("\n") == 1 and not out
    return err if code == 2 else out


def test_the_sentence_names_every_required_argument_and_the_option(
    arm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    error = said(["inspect", arm], capsys)
    assert "needs the arguments name, model; add --xacro name:=VALUE --xacro model:=VALUE" in error
    assert "needs the argument model; add" in said(["inspect", arm, "--xacro", "name:=a"], capsys)


@pytest.mark.parametrize(
    "words",
    [
        ["--xacro", "name:=ur5e", "--xacro", "model:=long"],
        GIVEN,
        ["--xacro=name:=ur5e", "model:=long"],
        ["--json", *GIVEN],
        ["name:=ur5e", "--effects", "none", "model:=long"],
    ],
)
def test_arguments_are_options_or_words_after_the_file(
    words: list[str], arm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert "ur5e" in said(["inspect", arm, *words], capsys, 0)


def test_values_reach_the_model_and_its_file_needs_no_argument(arm: str) -> None:
    robot = signid.load_robot(arm, xacro={"name": "ur5e", "model": "long", "prefix": "left_", "heavy": True})
    assert robot.name == "ur5e" and robot.joints == ("left_shoulder",)
    assert robot.model.inertias[1].mass == 3 and robot.model.inertias[1].lever[0] == 0.25
    signid.load_model(robot).save("model.json")
    again = signid.load_model("model.json").robot
    assert (again.name, again.joints) == (robot.name, robot.joints) and again.model.inertias[1].mass == 3
    assert "xacro" not in json.loads(Path("model.json").read_text())["robot"]["description"]
    short = signid.load_robot(arm, xacro={"name": 7, "model": "short"})
    assert short.name == "7" and short.model.inertias[1].lever[0] == 0.1


@pytest.mark.slow
def test_every_command_with_a_robot_takes_them(arm: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["excite", arm, *GIVEN, "--duration", "3", "-o", "motion.csv"]) in (0, 3)
    assert run(["simulate", arm, *GIVEN, "--motion", "motion.csv", "-o", "log.csv"]) == 0
    assert run(["export", arm, *GIVEN, "--mjcf", "arm.xml"]) == 0
    assert run(["validate", arm, *GIVEN, "log.csv", "--json"]) in (0, 3)
    assert run(["convert", "log.csv", "--robot", arm, *GIVEN, "-o", "new.csv"]) in (0, 3)
    assert run(["identify", arm, "log.csv", *GIVEN, "-o", "result"]) in (0, 3)
    assert run(["inspect", "result/robot.urdf"]) == 0
    capsys.readouterr()
    assert "holds the expanded description; leave --xacro out" in said(
        ["replay", "result/model.json", "log.csv", *GIVEN, "--html", "r.html"], capsys
    )
    report = Path("result/report.html").read_text()
    assert "name:=ur5e" in report, "the command of the report can be repeated"


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (["other:=a", *GIVEN], "has no argument 'other'; its arguments are heavy, model, name, prefix"),
        (["name:=a", *GIVEN], "names the argument name twice"),
        (["--xacro", "name=a"], "write NAME:=VALUE"),
        (["--xacro", ":=a"], "write NAME:=VALUE"),
        (["name:=a", "model:=other"], "'other'.*; its arguments are heavy, model, name, prefix"),
        (["name:=a\nb", "model:=long"], "value of the xacro argument name is no text of one line"),
    ],
)
def test_wrong_arguments_end_with_2(
    words: list[str], sentence: str, arm: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert re.search(sentence, said(["inspect", arm, *words], capsys))


def test_other_files_and_commands_take_none(arm: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "is no xacro file" in said(["inspect", "3r", "name:=a"], capsys)
    assert "unexpected extra argument" in said(["effects", "payload", "name:=a"], capsys)
    Path("plain.xacro").write_text(f"<robot name='r' {SPACE}/>")
    assert "it has none, so leave --xacro out" in said(["inspect", "plain.xacro", "name:=a"], capsys)


def test_arguments_of_included_files_are_named(tmp_path: Path) -> None:
    (tmp_path / "part.xacro").write_text(f'<robot {SPACE}><xacro:arg name="dof"/><link name="$(arg side)"/></robot>')
    path = tmp_path / "r.xacro"
    path.write_text(f'<robot name="$(arg name)" {SPACE}><xacro:include filename="part.xacro"/></robot>')
    with pytest.raises(RobotError, match='needs the arguments name, side, dof; add xacro={"name": VALUE}'):
        signid.load_robot(path)
    path.write_text(f'<robot name="r" {SPACE}><xacro:arg name="a" default="1"/>$(eval a + b)</robot>')
    with pytest.raises(RobotError, match=r"cannot expand it: .*b.*; its arguments are a \(xacro={\"NAME\": VALUE}\)"):
        signid.load_robot(path)


def test_values_are_no_code(arm: str) -> None:
    Path("s.xacro").write_text(f'<robot name="$(arg x)" {SPACE}><xacro:arg name="x"/></robot>')
    for value in ("${open('/etc/passwd').read()}", "$(eval open('/etc/passwd'))", '"/><link name="x'):
        with pytest.raises(RobotError):
            signid.load_robot("s.xacro", xacro={"x": value})


@pytest.mark.parametrize("wrong", [["name"], "name:=a", {"name": None}, {"": "a"}, {"a b": "c"}, {1: "a"}, {"a": "\0"}])
def test_python_says_what_it_expects(wrong: object, arm: str) -> None:
    with pytest.raises(OptionError, match="xacro"):
        signid.load_robot(arm, xacro=wrong)  # type: ignore[arg-type]


def test_manifests_of_fleets_have_a_column(tmp_path: Path, arm: str) -> None:
    manifest = tmp_path / "m.csv"
    manifest.write_text("robot,recording,xacro\narm.urdf.xacro,log.csv,name:=ur5e;model:=long\n")
    [entry] = read_manifest(manifest).entries
    assert entry.arguments()[-4:] == ("--xacro", "name:=ur5e", "--xacro", "model:=long")
    manifest.write_text("robot,recording,xacro\narm.urdf.xacro,log.csv,name\n")
    with pytest.raises(ManifestError, match="line 2: xacro='name' is not an argument"):
        read_manifest(manifest)


def test_a_file_of_macros_alone_is_named_so(tmp_path: Path) -> None:
    space = 'xmlns:xacro="http://www.ros.org/wiki/xacro"'
    macro = '<xacro:macro name="arm" params="prefix"><link name="${prefix}base"/></xacro:macro>'
    (tmp_path / "arm.xacro").write_text(f'<robot name="arm" {space}>{macro}</robot>', encoding="utf-8")
    with pytest.raises(
        RobotError, match=r"defines macros \(arm\) and has no link of its own; give the file that includes"
    ):
        signid.load_robot(tmp_path / "arm.xacro")
