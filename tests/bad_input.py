"""Bad inputs by name: files, the command to run in their folder, and words required in the message."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
from swing import changed, csv, only, pristine, put, swing

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
    good = csv(swing())
    return [
        Case("missing file", "identify 1r nothing.csv -o out", "does not exist"),
        Case("folder", "identify 1r . -o out", "folder"),
        recording("empty file", "", "empty"),
        recording("header alone", "t,q_1,tau_1\n", "no samples"),
        recording("wrong extension", good, "format", "bad.doc"),
        recording("no extension", good, "format", "bad"),
        recording("prose as CSV", "It was a dark and stormy night; the robot fell.\n" * 3, "bad.csv"),
    ]


def columns() -> list[Case]:
    good, tau = csv(swing()), pristine()["tau_1"]
    flicker = np.where(np.arange(len(tau)) % 2, 0.0, 1.0)
    return [
        recording("no position", csv(swing(q_1=None)), "position"),
        recording("no torque", csv(swing(tau_1=None)), "torque"),
        recording("time runs back", changed("t", lambda x: x[::-1]), "t"),
        recording("one step back in time", changed("t", lambda x: put(x, 600, x[400])), "row"),
        recording("torque beyond all robots", changed("tau_1", lambda x: put(x, 300, 1e300)), "implausible value"),
        recording("degrees", changed("q_1", np.rad2deg), "degrees"),
        recording("too short", only(slice(30)), "short"),
        recording("too short for its filter", only(slice(300)), "filter"),
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
        option("column map not UTF-8", "--columns m.toml", "m.toml", m_toml=b'q_1 = "\xff"'),
        option("no actuators file", given, "a.toml"),
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
        Case("missing description", "inspect gone.urdf", "gone.urdf"),
        Case("folder without a description", "inspect .", "folder"),
        Case("empty name", "inspect ''", "robot"),
        robot("entities", BOMB, "document type"),
        robot("two roots", urdf(LINKS + JOINT + '<link name="c"/>'), "root"),
        robot(
            "xacro that includes nothing",
            urdf('<xacro:include filename="gone.xacro" xmlns:xacro="http://ros.org/wiki/xacro"/>'),
            "gone.xacro",
            "bad.xacro",
        ),
    ]


CASES = [*files(), *columns(), *several(), *options(), *side_files(), *commands(), *robots()]
