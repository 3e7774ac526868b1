"""Readers of drives: lines of a watched stream, servo columns, stated and saved drives, names in exported programs."""

from __future__ import annotations

import ast
import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

import signid
from signid.errors import InputError, SignidError
from signid.faults import audit_servos
from signid.model import with_servos
from signid.output.export import export
from signid.recording import read_bare, read_recording
from signid.robot.actuators import state_actuators
from signid.servo.stated import stated_servos
from signid.servo.validate import need_commands
from signid.servos import Servo
from signid.watch import watch

from .factors import pendulum
from .readers import Reader

HERE = Path(__file__).parents[2]
T = np.arange(60) / 50
ROWS = [(t, 0.3 * np.sin(4 * t), np.cos(3 * t)) for t in T.tolist()]
STREAM = "t,q_1,tau_1\n" + "".join(f"{t:g},{q:.4f},{tau:.4f}\n" for t, q, tau in ROWS)
LINES = "".join(json.dumps({"t": t, "q": [round(q, 4)], "tau": [round(tau, 4)]}) + "\n" for t, q, tau in ROWS)
SERVO = "t,q_1,q_des_1,dq_des_1,tau_ff_1,on_1,pwm_1,volt\n" + "".join(
    f"{t:g},{q:.4f},{0.3 * np.sin(4 * t + 0.2):.4f},{1.2 * np.cos(4 * t):.4f},0,1,{0.1 * tau:.3f},12\n"
    for t, q, tau in ROWS
)
DRIVES = """[joint.joint_1.servo]\nlaw = "duty"\nkp = 20.0\nkd = 0.5\nkd_on = "error"\ndelay = 0.02\nstall_torque = 3
speed_limit = 6.0\ndead_band = 1e-3\nprofile_speed = 4\nkp_register = 32\nvoltage = 12\ncoulomb_friction = "find"
[recording."a.csv".joint_1]\nkp_register = 400\n"""
NAMES = (
    b'function\n"""+__import__("os")+"""', b"arrays\n*/ int x; /*", b"isaaclab\n'; import os", b"mjlab\n{0}\\",
    b"expected\njoint_1\nimport os", b"c\n*/\nint main", b"function\n${x} %s\t", b"arrays\n\xe2\x80\xa8a",
)  # fmt: skip
PYTHON = ("function", "arrays", "isaaclab", "mjlab", "expected")
MOST_LINES = 3000  # lines of a stream that are read


def drive_readers() -> Iterator[Reader]:
    """Readers of this file."""
    yield Reader("watched lines, CSV", "lines.csv", [STREAM.encode()], _watched)
    yield Reader("watched lines, JSON", "lines.json", [LINES.encode()], _watched)
    yield Reader("servo columns", "servo.csv", [SERVO.encode()], _servo_columns)
    yield Reader("stated drives", "a.toml", [DRIVES.encode()], _stated)
    yield Reader("saved drives", "model.json", [_saved()], _saved_drives)
    yield Reader("names in exports", "names", NAMES, _exported)


def _watched(path: Path) -> None:
    text = path.read_bytes().decode("utf-8", "replace")
    for _ in watch(pendulum(), iter(text.splitlines(keepends=True)[:MOST_LINES]), quiet=0.5):
        pass


def _servo_columns(path: Path) -> None:
    """Audit a recording with and without its robot."""
    try:
        audit_servos(read_bare(path)[0])
    except SignidError as error:
        assert str(error).strip(), "error without message"
    recording = read_recording(path, pendulum())
    need_commands([recording], moving=True)
    audit_servos(recording)


def _stated(path: Path) -> None:
    stated_servos(state_actuators(pendulum(), path))


@cache
def _saved() -> bytes:
    servo = Servo(law="torque_speed", kp=20.0, kd=0.5, delay=0.02, effort_limit=3.0, speed_limit=6.0, kp_register=32.0)
    return json.dumps(with_servos(signid.load_model("1r"), {"joint_1": servo}).document()).encode()


def _saved_drives(path: Path) -> None:
    model = signid.load_model(path)
    for kind in ("expected", "lerobot") if model.servos else ():
        export(model, kind)


@cache
def _shape(kind: str) -> list[str]:
    """Kinds of the statements and expressions of a program with a harmless name."""
    return _nodes(_program(kind, "joint_1", Path()))


def _nodes(text: str) -> list[str]:
    return [type(node).__name__ for node in ast.walk(ast.parse(text))]


def _program(kind: str, name: str, folder: Path) -> str:
    text = (HERE / "robots" / "1r" / "robot.urdf").read_text(encoding="utf-8")
    if name != "joint_1":
        text = text.replace('"joint_1"', quoteattr(name, {"\n": "&#10;", "\r": "&#13;", "\t": "&#9;"}))
        (folder / "r.urdf").write_text(text, encoding="utf-8", errors="replace")
    model = signid.load_model(folder / "r.urdf" if name != "joint_1" else "1r")
    servos = {joint: Servo(kp=20.0, effort_limit=3.0) for joint in model.robot.joints}
    made = export(with_servos(model, servos), kind)
    return "".join((made.text, *made.beside.values()))


def _exported(path: Path) -> None:
    """Export a program of a robot whose joint has this name: the name stays a text or a comment."""
    kind, _, name = path.read_bytes().decode("utf-8", "replace").partition("\n")
    if kind not in (*PYTHON, "c") or not name.strip():
        raise InputError("neither a kind of program nor a name")
    text = _program(kind, name, path.parent)
    if kind == "c":
        assert _without_comments(text) == _without_comments(_program("c", "joint_1", path.parent)), "a name is code"
    else:
        assert _nodes(text) == _shape(kind), "a name is code"


def _without_comments(text: str) -> str:
    """C without its comments, read as a compiler does."""
    kept, rest = "", text
    while "/*" in rest:
        before, _, rest = rest.partition("/*")
        kept, rest = kept + before, rest.partition("*/")[2]
    return kept + rest
