"""All readers of a campaign with their shares: of files, of drives, and of what is no file of its own."""

from __future__ import annotations

import ast
import contextlib
import io
import json
import shlex
import types
import zlib
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any
from xml.sax.saxutils import quoteattr

import numpy as np

import signid
from signid.check import check
from signid.cli import run
from signid.effects import EFFECTS
from signid.effects.naming import law_syntax, parse_law
from signid.errors import InputError, SignidError
from signid.faults.commands.audit import audit_servos
from signid.model import with_servos
from signid.output.export import export
from signid.recording import read_bare, read_recording
from signid.recording.draft import draft_map
from signid.robot.actuators import state_actuators
from signid.servo.stated import stated_servos
from signid.servo.validate import need_commands
from signid.servos import Servo
from signid.types import Robot
from signid.watch import watch

from ..recording_faults.senseless import senseless
from .pendulum import pendulum
from .readers import TOKENS, Reader, readers as file_readers

HERE = Path(__file__).parents[2]
HEADERS = (
    b"time\nelbow_pos\nelbow_vel\nelbow_eff\n",
    b"t\nq_1\ntau_1\nq_des_1\n",
    b"timestamp_ms\njoint_1_deg\neffort_joint_1\ncmd.joint_1\ncurrent[0]\n",
    b"/joint_states/joint_1/position\n/joint_states/joint_1/effort\n/joint_states/header/stamp\n",
)
EXPRESSIONS = (
    b"1 + 2 * 3 ** 2 - size / 4", b"[1, 2.5, 'a'][0] * pi", b"{'a': {'b': 2}}['a']['b']", b"math.sin(radians(30))",
    b"'left' if size > 3 else 'right'", b"'%s_%d' % ('a', 3) + 'x' * 4", b"[x * 2 for x in range(4)]",
    b"size.__class__.__base__", b"dict(a=1).get('a', 2)", b"max(len('abc'), int('7'), float('1e3'), *[1, 2])",
    b"xacro.load_yaml('a.yaml')", b"not (1 < 2 <= 3) or ~5 & 6 | 7 ^ 8 << 2", b"'a b'.split()[0].upper().format(1)",
)  # fmt: skip
OPTIONS = (
    b"check 1r none.csv --cutoff 10 --derivatives computed --effects viscous_friction,armature --seed 1",
    b"identify 1r none.csv --json --method pbrp --total-mass 1,2 --time-limit 60 --lock joint_1=0.3 --joints joint_1",
    b"diagnose 1r none.csv --json --reference none.csv --held-out none.csv --time-limit 5",
    b"excite 1r -o none/x.csv --duration 5 --rate 100 --seed 3", b"identify 1r none.csv --json --white",
    b"simulate 1r --motion none.csv --inject coulomb_friction@joint_1:level=3 --noise 0.1 --encoder-bits 12 -o a.csv",
    b"replay 1r none.csv --html none.html --duration 2", b"fleet none.csv -o none --workers 2 --scheduler tcp://a:1",
    b"inspect none.urdf", b"export none.json --urdf none.urdf", b"convert none.bag -o none.csv --map none.toml",
    b"validate none.json none.csv", b"payload 1r --without none.csv --with none.csv", b"effects coulomb_friction",
)  # fmt: skip
SIMULATED = b"coulomb_friction@joint_1:level=3\n0.1\n12\n0.01\n"  # law, noise, bits of the encoder, step
INNER = (type, types.ModuleType, types.FunctionType, types.CodeType, types.FrameType, types.GeneratorType)
SILENT = {"time_double"}  # friction and rotors explain the slow motion as well; see tests/test_faults_garbage


def _text(path: Path) -> str:
    return path.read_bytes().decode("utf-8", "replace")


@cache
def arm() -> Robot:
    """The 3R arm."""
    return signid.load_robot("3r")


def law_seeds() -> list[bytes]:
    """The syntax of every law, at joints of the 3R arm."""
    return [law_syntax(effect).replace("JOINT", "joint_2").strip("[]").encode() for effect in EFFECTS]


def read_law(path: Path) -> None:
    """Parse a law."""
    parse_law(_text(path), arm())


def read_header(path: Path) -> None:
    """Read a recording with these names of columns, and draft its column map."""
    t = np.arange(30) / 100
    columns = {name: np.sin((k + 1) * t) if k else t for k, name in enumerate(_text(path).splitlines()[:50])}
    if len(path.read_bytes()) % 4 == 0:
        draft_map(columns, arm())
    read_recording(columns, arm())


@cache
def _evaluate() -> Any:
    from signid.robot.description import sandbox

    sandbox._restrict_expressions(lambda package: package)
    import xacro

    return xacro


def read_expression(path: Path) -> None:
    """Evaluate an expression as the process of xacro does; it may end in any exception there, but not in a class."""
    xacro = _evaluate()
    names = {"size": 4.0, "name": "arm", **xacro._global_symbols["math"], **xacro._global_symbols["python"]}
    try:
        found = xacro.safe_eval(_text(path)[:2000], names)
    except Exception as error:
        raise InputError(f"refused: {type(error).__name__}") from None
    named = callable(found) and any(found is value for value in names.values())
    assert named or not isinstance(found, INNER), f"an expression gives {type(found).__name__}"


def run_line(path: Path) -> None:
    """Run a command line whose files do not exist."""
    try:
        words = shlex.split(_text(path))
    except ValueError:
        words = _text(path).split()
    _run(words, path.parent)


def run_simulation(path: Path) -> None:
    """Simulate the 1R arm with a law, sensors and a step."""
    law, *given = [*_text(path).splitlines(), "", "", "", ""][:4]
    motion = path.parent / "motion.csv"
    rows = (f"{k / 100},{np.sin(k / 9):.6f},{np.cos(k / 9) / 0.09:.6f},0\n" for k in range(60))
    motion.write_text("t,q_1,dq_1,ddq_1\n" + "".join(rows), encoding="utf-8")
    names = ("--noise", "--encoder-bits", "--step")
    options = [word for pair in zip(names, given, strict=False) if pair[1] for word in pair]
    words = ["simulate", "1r", "--motion", str(motion), "--inject", law, *options, "-o", str(path.parent / "out.csv")]
    _run(words, path.parent)


def _run(words: list[str], folder: Path) -> None:
    """Run a command; refused if it ends with 2.

    Raises:
        InputError: exit code 2.
    """
    said = io.StringIO()
    words = [word.replace("\0", "") for word in words if word not in ("demo", "data", "--scheduler", "--live")]
    with contextlib.chdir(folder), contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = run(words)
    assert code in (0, 2, 3), f"exit code {code}: {said.getvalue()[-200:]}"
    assert "Traceback" not in said.getvalue(), "a traceback"
    if code == 2:
        raise InputError(said.getvalue()[-200:] or "refused")


@cache
def _good() -> tuple[Any, Any]:
    place = HERE / "robots" / "3r"
    read = [read_recording(place / f"{name}.parquet", arm()).read() for name in ("recording", "held_out")]
    return read[0], read[1].tau


def read_senseless(path: Path) -> None:
    """Check and identify a senseless recording: it is refused or flagged."""
    rows, other = _good()
    number = zlib.crc32(path.read_bytes())
    made = senseless(rows.t, rows.q, rows.tau, other, seed=number)
    name = sorted(set(made) - SILENT)[number % (len(made) - len(SILENT))]
    recording = read_recording(made[name], arm())
    assert check(arm(), [recording]).flags, f"check passes {name}"
    assert signid.identify(arm(), [recording], method="wls").flags, f"identify passes {name}"
    raise InputError(f"{name} is flagged")


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


__all__ = ["TOKENS", "readers"]

SHARES = {  # of the inputs of a campaign, per mille
    "URDF": 90,
    "xacro": 0.3,
    "MJCF": 40,
    "actuators": 60,
    "columns": 60,
    "bounds": 40,
    "CSV": 15,
    "CSV, gzip inside": 6,
    "CSV, gzip": 4,
    "Parquet": 6,
    "NPZ": 4,
    "NPZ, arrays": 8,
    "JSON lines": 6,
    "JSON": 6,
    "Arrow": 6,
    "NPY": 4,
    "MATLAB": 6,
    "HDF5": 4,
    "ROS 1 bag": 3,
    "ROS 2 bag": 3,
    "ROS 2 bag, metadata": 2,
    "MCAP": 3,
    "LeRobot": 3,
    "LeRobot, description": 5,
    "manifest": 80,
    "motion": 15,
    "model.json": 60,
    "diagnosis.json": 30,
    "laws": 110,
    "names of columns": 50,
    "expressions of xacro": 120,
    "command line": 8,
    "laws, simulated": 2,
    "senseless recordings": 0.4,
    "watched lines, CSV": 10,
    "watched lines, JSON": 10,
    "servo columns": 4,
    "stated drives": 40,
    "saved drives": 30,
    "names in exports": 6,
}


@cache
def readers() -> tuple[Reader, ...]:
    """All readers, with their shares."""
    found = (
        *file_readers(),
        *drive_readers(),
        Reader("laws", "law", law_seeds(), read_law),
        Reader("names of columns", "names", HEADERS, read_header),
        Reader("expressions of xacro", "expression", EXPRESSIONS, read_expression),
        Reader("command line", "line", OPTIONS, run_line),
        Reader("laws, simulated", "simulated", [SIMULATED, *law_seeds()], run_simulation),
        Reader("senseless recordings", "recording", [bytes(range(64))], read_senseless),
    )
    return tuple(replace(reader, share=SHARES[reader.name]) for reader in found)
