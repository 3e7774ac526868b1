"""Readers of what is no file of its own: laws, options, names of columns, expressions of xacro, numbers in files."""

from __future__ import annotations

import contextlib
import io
import shlex
import types
import zlib
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

import signid
from signid.check import check
from signid.cli import run
from signid.effects import EFFECTS
from signid.effects.naming import law_syntax, parse_law
from signid.errors import InputError
from signid.recording import read_recording
from signid.recording.draft import draft_map
from signid.types import Robot

from ..faults.senseless import senseless

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
    b"excite 1r -o none/x.csv --duration 5 --rate 100 --seed 3", b"reduce 1r none.csv --json --only 1/2 --white",
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
