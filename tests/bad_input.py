"""Bad inputs by name: files, the command to run in their folder, and words required in the message."""

from __future__ import annotations

import gzip
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from swing import cells, changed, csv, npz, only, pristine, put, swing

INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>'
LINKS = f'<link name="a"/><link name="b">{INERTIAL}</link>'
JOINT = '<joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint>'
BOMB = '<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "aa"><!ENTITY b "&a;&a;">]><robot name="r">&b;</robot>'


def urdf(inside: str) -> str:
    return f'<robot name="r">{inside}</robot>'


@dataclass(frozen=True)
class Case:
    """Files by name, the command to run in their folder, and words required in the message."""

    name: str
    command: str
    says: str
    files: Mapping[str, str | bytes] = field(default_factory=dict)


def recording(name: str, content: str | bytes, says: str, file: str = "bad.csv", more: str = "") -> Case:
    return Case(name, f"identify 1r {file} -o out {more}", says, {file: content})


def option(name: str, given: str, says: str, **files: str | bytes) -> Case:
    named = {key.replace("_toml", ".toml"): content for key, content in files.items()}
    return Case(name, f"identify 1r good.csv -o out {given}", says, {"good.csv": csv(swing()), **named})


def robot(name: str, content: str | bytes, says: str, file: str = "bad.urdf") -> Case:
    return Case(name, f"inspect {file}", says, {file: content})


def files() -> list[Case]:
    good, q = csv(swing()), pristine()["q_1"]
    return [
        Case("missing file", "identify 1r nothing.csv -o out", "does not exist"),
        Case("folder", "identify 1r . -o out", "folder"),
        recording("empty file", "", "empty"),
        recording("header alone", "t,q_1,tau_1\n", "no samples"),
        recording("wrong extension", good, "format", "bad.doc"),
        recording("no extension", good, "format", "bad"),
        recording("binary as CSV", bytes(range(256)) * 40, "bad.csv"),
        recording("prose as CSV", "It was a dark and stormy night; the robot fell.\n" * 3, "bad.csv"),
        recording("numbers without a header", good.split("\n", 1)[1], "header"),
        recording("ragged rows", cells(good, "\n0.5,", "\n0.5,1,2,3,"), "row"),
        recording("words among numbers", cells(good, "\n0.5,", "\n0.5,oops"), "oops"),
        recording("a column twice", cells(good, "t,q_1", "t,t"), "twice"),
        recording("gzip cut short", gzip.compress(good.encode())[:900], "gzip", "bad.csv.gz"),
        recording("NPZ of Python objects", npz(swing(q_1=np.array([{}] * len(q), object))), "q_1", "bad.npz"),
        recording("NPZ of unequal lengths", npz(swing(q_1=q[:-5])), "q_1", "bad.npz"),
        recording("NPZ garbage", b"PK\3\4" + bytes(300), "NumPy", "bad.npz"),
        recording("Parquet garbage", b"PAR1" + bytes(300) + b"PAR1", "Parquet", "bad.parquet"),
    ]


def columns() -> list[Case]:
    good, tau = csv(swing()), pristine()["tau_1"]
    flicker = np.where(np.arange(len(tau)) % 2, 0.0, 1.0)
    return [
        recording("no time", csv(swing(t=None)), "t"),
        recording("no position", csv(swing(q_1=None)), "position"),
        recording("no torque", csv(swing(tau_1=None)), "torque"),
        recording("strange joint name", cells(good, "q_1", "q_elbow"), "q_elbow"),
        recording("joint number too high", cells(good, "q_1", "q_5"), "q_5"),
        recording("NaN alone", changed("q_1", lambda x: put(x, ..., np.nan)), "q_1"),
        recording("torque NaN alone", changed("tau_1", lambda x: put(x, ..., np.nan)), "tau_1"),
        recording("infinity", changed("tau_1", lambda x: put(x, 7, np.inf)), "inf"),
        recording("time runs back", changed("t", lambda x: x[::-1]), "t"),
        recording("one step back in time", changed("t", lambda x: put(x, 600, x[400])), "row"),
        recording("time stands still", changed("t", lambda x: put(x, ..., 0.0)), "t"),
        recording("torque beyond all robots", changed("tau_1", lambda x: put(x, 300, 1e300)), "implausible value"),
        recording("torque constant", changed("tau_1", lambda x: put(x, ..., 3.0)), "tau_1"),
        recording("torque zero", changed("tau_1", lambda x: put(x, ..., 0.0)), "tau_1"),
        recording("position constant", changed("q_1", lambda x: put(x, ..., 0.3)), "q_1"),
        recording("degrees", changed("q_1", np.rad2deg), "degrees"),
        recording("milliseconds", changed("t", lambda x: 1000 * x), "milliseconds"),
        recording("too short", only(slice(30)), "short"),
        recording("too short for its filter", only(slice(300)), "filter"),
        recording("one sample", only(slice(1)), "bad.csv"),
        recording("an absolute torque below zero", csv(swing(tau_1=None, abs_tau_1=tau)), "negative"),
        recording("absolute torque zero", csv(swing(tau_1=None, abs_tau_1=0 * tau)), "zero"),
        recording("absolute torque constant", csv(swing(tau_1=None, abs_tau_1=0 * tau + 2)), "constant"),
        recording("one sample a segment", csv(swing(tau_1=None, abs_tau_1=flicker)), "record faster"),
        recording("signs by an unknown method", good, "exact, tree", more="--unsigned --signs magic"),
    ]


def several() -> list[Case]:
    good = csv(swing())
    t, q, tau = pristine().values()
    return [
        Case(
            "two rates",
            "identify 1r good.csv slow.csv -o out",
            "Hz",
            {"good.csv": good, "slow.csv": csv({"t": 2 * t, "q_1": q, "tau_1": tau})},
        ),
        Case(
            "two sets of joints",
            "identify 3r one.csv two.csv -o out",
            "joint",
            {"one.csv": csv(swing()), "two.csv": csv({"t": t, "q_2": q, "tau_2": tau})},
        ),
        Case(
            "the one held out is missing", "identify 1r good.csv --held-out gone.csv -o out", "gone", {"good.csv": good}
        ),
        Case("check has the same eyes", "check 1r bad.csv", "q_1", {"bad.csv": csv(swing(q_1=None))}),
    ]


def options() -> list[Case]:
    return [
        option("unknown effect", "--effects viscous_friction,magic", "magic"),
        option("empty effect", "--effects ,", "empty"),
        option("unknown method", "--method magic", "magic"),
        option("unknown derivatives", "--derivatives magic", "magic"),
        option("derivatives that are not recorded", "--derivatives recorded", "dq_J"),
        option("negative cut-off", "--cutoff -3", "cut-off"),
        option("cut-off zero", "--cutoff 0", "cut-off"),
        option("cut-off not a number", "--cutoff nan", "cut-off"),
        option("cut-off in words", "--cutoff fast", "--cutoff"),
        option("cut-off too low", "--cutoff 0.1", "cut-off"),
        option("cut-off far too low", "--cutoff 1e-6", "cut-off"),
        option("the same file held out", "--held-out good.csv", "same samples"),
        option("lock without a value", "--lock joint_1", "J=VALUE"),
        option("lock without a joint", "--lock =1", "J=VALUE"),
        option("lock at a word", "--lock 1=up", "J=VALUE"),
        option("lock at infinity", "--lock 1=inf", "finite"),
        option("lock of a strange joint", "--lock elbow=1", "elbow"),
        option("lock twice", "--lock 1=1 --lock 1=2", "twice"),
        option("lock of every joint", "--lock 1=0", "every joint"),
        option("strange joint", "--joints elbow", "elbow"),
        option("empty joint", "--joints 1,,2", "empty"),
        option("seed in words", "--seed lucky", "--seed"),
        option("negative seed", "--seed -1", "seed"),
        option("strange option", "--frobnicate", "--frobnicate"),
        option("option without its value", "--method", "--method"),
    ]


def side_files() -> list[Case]:
    given = "--actuators a.toml"
    return [
        option("no folder of packages", "--package-dir nowhere", "nowhere"),
        option("no column map", "--columns nothing.toml", "nothing.toml"),
        option("column map is no TOML", "--columns m.toml", "m.toml", m_toml="q_1 ="),
        option("column map of numbers", "--columns m.toml", "m.toml", m_toml="q_1 = 3"),
        option("column map to nowhere", "--columns m.toml", "gone", m_toml='q_1 = "gone"'),
        option("column map not UTF-8", "--columns m.toml", "m.toml", m_toml=b'q_1 = "\xff"'),
        option("no actuators file", given, "a.toml"),
        option("actuators file is no TOML", given, "a.toml", a_toml="[joint.1"),
        option("actuators file not UTF-8", given, "UTF-8", a_toml=b"# \xff"),
        option("actuators of a strange joint", given, "elbow", a_toml="[joint.elbow]\narmature = 1"),
        option("actuators with a strange key", given, "colour", a_toml="[joint.1]\ncolour = 1"),
        option("actuators with a word", given, "armature", a_toml='[joint.1]\narmature = "much"'),
        option("actuators below zero", given, "negative", a_toml="[joint.1]\narmature = -1"),
        option("actuators of another kind", given, "motor", a_toml="[motor.1]\narmature = 1"),
    ]


def commands() -> list[Case]:
    good = csv(swing())
    return [
        Case("result into a file", "identify 1r good.csv -o out", "out is a file", {"good.csv": good, "out": "mine"}),
        Case(
            "result below a file",
            "identify 1r good.csv -o out/deep/er",
            "out is a file",
            {"good.csv": good, "out": "mine"},
        ),
        Case("strange command", "recognise 1r good.csv -o out", "recognise"),
        Case("no recording", "identify 1r -o out", "RECORDING"),
        Case("no robot", "inspect", "ROBOT"),
        Case("an empty name for the result", "identify 1r good.csv -o ''", "-o", {"good.csv": good}),
        Case("an endless name", f"inspect {'x' * 2000}", "name"),
        Case("an endless name of a result", f"identify 1r good.csv -o {'x' * 2000}", "results", {"good.csv": good}),
        Case("no folder for the result", "identify 1r good.csv", "-o", {"good.csv": good}),
    ]


def robots() -> list[Case]:
    return [
        Case("unknown robot", "inspect pandda", "panda"),
        Case("unknown robot like no other", "inspect zzzzzz", "zzzzzz"),
        Case("missing description", "inspect gone.urdf", "gone.urdf"),
        Case("folder without a description", "inspect .", "folder"),
        Case("empty name", "inspect ''", "robot"),
        robot("empty description", "", "empty"),
        robot("description not UTF-8", b"\xff\xfe\x00<robot>", "UTF-8"),
        robot("invalid XML", "<robot name='r'><link", "XML"),
        robot("another root", "<html/>", "html"),
        robot("SDF", "<sdf version='1.6'><model name='m'/></sdf>", "SDF"),
        robot("entities", BOMB, "document type"),
        robot("no joint", urdf('<link name="a"/>'), "no moving joint"),
        robot("only fixed joints", urdf(LINKS + JOINT.replace("revolute", "fixed")), "no moving joint"),
        robot("two roots", urdf(LINKS + JOINT + '<link name="c"/>'), "root"),
        robot(
            "a cycle",
            urdf(
                LINKS
                + JOINT
                + JOINT.replace('"j"', '"k"').replace("parent", "x").replace("child", "parent").replace("x", "child", 2)
            ),
            "circle",
        ),
        robot("unknown link", urdf(LINKS + JOINT.replace('"b"', '"z"')), "'z'"),
        robot("joint without a name", urdf(LINKS + JOINT.replace(' name="j"', "")), "name"),
        robot("joint without a child", urdf(LINKS + JOINT.replace('<child link="b"/>', "")), "child"),
        robot("unknown type of joint", urdf(LINKS + JOINT.replace("revolute", "rubber")), "rubber"),
        robot("two links of one name", urdf(LINKS + LINKS + JOINT), "two links"),
        robot("axis zero", urdf(LINKS + JOINT.replace("0 0 1", "0 0 0")), "axis"),
        robot("words for numbers", urdf(LINKS.replace('value="1"', 'value="heavy"') + JOINT), "heavy"),
        robot("mass NaN", urdf(LINKS.replace('value="1"', 'value="nan"') + JOINT), "finite"),
        robot("MJCF without a joint", "<mujoco><worldbody/></mujoco>", "joint", "bad.xml"),
        robot(
            "xacro that includes nothing",
            urdf('<xacro:include filename="gone.xacro" xmlns:xacro="http://ros.org/wiki/xacro"/>'),
            "gone.xacro",
            "bad.xacro",
        ),
    ]


CASES = [*files(), *columns(), *several(), *options(), *side_files(), *commands(), *robots()]
