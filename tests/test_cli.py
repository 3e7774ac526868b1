"""The command line: output, files and exit codes."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from strict_json import strict
from swing import changed, csv, pristine, swing

import signid
from signid.cli import run
from signid.effects import EFFECT_NAMES
from signid.errors import ON_COMMAND_LINE, RecordingError

ROOT = Path(__file__).parents[1]
COMMANDS = """demo inspect check identify diagnose validate watch payload effects convert excite export simulate replay
fleet data"""
OUTPUTS = ["identification.json", "model.json", "report.html", "robot.urdf"]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """Run every test in its own folder with a recording of the pendulum."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "swing.csv").write_text(csv(swing()))
    yield tmp_path


def process(*arguments: str, **more: Any) -> subprocess.CompletedProcess[str]:
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "signid", *arguments]
    return subprocess.run(command, capture_output=True, text=True, env=there, check=False, **more)


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == f"signid {signid.__version__}\n"


def test_help_lists_commands_and_default_effects(capsys: pytest.CaptureFixture[str]) -> None:
    assert run([]) == 0
    out = capsys.readouterr().out
    assert re.findall(r"^  (\w+)  ", out.partition("Commands:")[2], re.MULTILINE) == COMMANDS.split()
    assert run(["check", "--help"]) == 0
    assert ", ".join(EFFECT_NAMES) in " ".join(capsys.readouterr().out.split())


def test_help_needs_no_library() -> None:
    heavy = "{'numpy', 'pinocchio', 'polars', 'cvxpy'}"
    code = f"import sys; from signid.cli import run; run(['--help']); print(sorted({heavy} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.endswith("\n[]\n")


def test_identify_finds_the_pendulum_and_ends_with_the_paths(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["identify", "1r", "swing.csv", "-o", "new/result"]) == 0
    out, err = capfd.readouterr()
    assert err == "" and "\x1b" not in out
    assert sorted(out.splitlines()[-4:]) == [f"  new/result/{name}" for name in OUTPUTS]
    assert sorted(path.name for path in (folder / "new/result").iterdir()) == OUTPUTS
    assert "The inertials are physically consistent" in out and "Excitation sufficient" in out
    assert max(map(len, out.splitlines())) <= 100
    found = strict((folder / "new/result/identification.json").read_text())
    base = {entry["expression"]: entry for entry in found["base_parameters"]}
    truth = {"mz_1": -2.5, "Iyy_1 + armature_1": 1.67085, "viscous_friction_1": 0.8, "coulomb_friction_1": 1.5}
    for expression, value in truth.items():
        assert abs(base[expression]["value"] - value) < 4 * base[expression]["std"], expression
    assert base["Iyy_1 + armature_1"]["unit"] == "kg.m^2"
    model = signid.load_model(folder / "new/result/model.json")
    assert model.laws[0].parameters["coefficient"] == pytest.approx(base["viscous_friction_1"]["value"])
    robot = signid.load_robot(folder / "new/result/robot.urdf")
    assert robot.model.inertias[1].mass * robot.model.inertias[1].lever[2] == pytest.approx(base["mz_1"]["value"])
    assert robot.actuators.viscous_friction[0] == pytest.approx(base["viscous_friction_1"]["value"])


def test_json_is_the_file_and_nothing_else(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert run(["identify", "1r", "swing.csv", "-o", "result", "--json"]) == 0
    out, err = capfd.readouterr()
    assert out == (folder / "result/identification.json").read_text() and err == ""
    assert strict(out)["schema"] == "signid.identification/1"


def test_json_alone_writes_nothing(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for command in (["inspect", "1r"], ["check", "1r", "swing.csv"], ["identify", "1r", "swing.csv"]):
        assert run([*command, "--json"]) == 0
        found = strict(capfd.readouterr().out)
        assert found["robot"] == "1r" and found["seed"] == 0 and found["version"] == signid.__version__
        assert found["inputs"][-1]["path"] == "1r"
    assert [path.name for path in folder.iterdir()] == ["swing.csv"]


def test_same_inputs_and_seed_give_the_same_bytes(folder: Path) -> None:
    for name in ("one", "two"):
        assert run(["identify", "1r", "swing.csv", "--seed", "3", "-o", name]) == 0
    for name in OUTPUTS:
        assert (folder / "one" / name).read_bytes() == (folder / "two" / name).read_bytes()


def test_a_flagged_result_is_complete_and_exits_3(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    robot = "3r"
    t, q, tau = (pristine()[name] for name in ("t", "q_1", "tau_1"))
    columns = {"t": t} | {f"q_{j}": j * q for j in (1, 2, 3)} | {f"tau_{j}": tau / j for j in (1, 2, 3)}
    (folder / "step.csv").write_text(csv(columns))
    assert run(["identify", robot, "step.csv", "-o", "result"]) == 3
    out, err = capfd.readouterr()
    assert "moved in step" in err and all(line.startswith("signid: ") for line in err.splitlines())
    assert "Excitation insufficient" in out and "written" in out
    assert sorted(path.name for path in (folder / "result").iterdir()) == OUTPUTS
    assert strict((folder / "result/identification.json").read_text())["flags"]
    assert run(["check", robot, "step.csv"]) == 3
    assert "unidentifiable" in capfd.readouterr().out


def test_mjcf_gets_no_urdf_and_says_so(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "arm.xml").write_text(
        '<mujoco model="arm"><worldbody><body name="rod"><joint name="joint_1" axis="0 1 0"/>'
        '<inertial pos="0 0 -0.5" mass="5" diaginertia="0.42 0.42 0.01"/></body></worldbody></mujoco>'
    )
    assert run(["identify", "arm.xml", "swing.csv", "-o", "result"]) == 0
    assert "robot.urdf is not written: the robot comes from MJCF" in capfd.readouterr().out
    assert sorted(path.name for path in (folder / "result").iterdir()) == OUTPUTS[:3]


def test_every_option_has_an_effect(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    (folder / "a.toml").write_text("[joint.1]\ntorque_constant = 2.0\n")
    (folder / "m.toml").write_text('q_1 = "angle"\ncurrent_1 = "amps"\n')
    angle, tau = pristine()["q_1"], pristine()["tau_1"]
    for name, half in (("amps", tau / 2), ("judge", tau / 2 + 0.01)):
        (folder / f"{name}.csv").write_text(csv(swing(q_1=None, tau_1=None, angle=angle, amps=half)))
    given = "--actuators a.toml --columns m.toml --effects viscous_friction,coulomb_friction,torque_offset --cutoff 10"
    more = "--method wls --robust --white --no-instruments --derivatives computed --held-out judge.csv --seed 5 --json"
    assert run(["identify", "1r", "amps.csv", *given.split(), *more.split()]) == 0
    found = strict(capfd.readouterr().out)
    assert (found["method"], found["seed"], len(found["effects"])) == ("wls", 5, 3)
    assert found["cutoff"]["torque"] == pytest.approx(10)
    assert [entry["path"] for entry in found["inputs"]] == ["amps.csv", "judge.csv", "1r", "a.toml", "m.toml"]
    base = {entry["expression"]: entry["value"] for entry in found["base_parameters"]}
    assert base["Iyy_1"] == pytest.approx(1.67085, rel=0.01)


def test_part_of_a_robot(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    for given in (["--joints", "1"], ["--lock", "2=0.5", "--lock", "joint_3=-0.5"]):
        assert run(["inspect", "3r", "--effects", "none", "--json", *given]) == 0
        found = strict(capfd.readouterr().out)
        assert [joint["name"] for joint in found["joints"]] == ["joint_1"]
        assert len(found["base_parameters"]) == 1


def test_interrupt_is_quiet(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    def stop(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("signid.robot.load_robot", stop)
    assert run(["inspect", "1r"]) == 130
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (MemoryError(), 2, "memory for this; ask for fewer samples or steps"),
        (OSError(5, "Input/output error", "far.csv"), 2, "far.csv: Input/output error"),
        (ZeroDivisionError("division by zero"), 1, "ZeroDivisionError: division by zero"),
    ],
)
def test_unexpected_errors_are_reported(
    error: Exception, code: int, says: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def fail(*_: Any, **__: Any) -> None:
        raise error

    monkeypatch.setattr("signid.robot.load_robot", fail)
    assert run(["inspect", "1r"]) == code
    err = capfd.readouterr().err
    assert says in err and len(err.splitlines()) == 1
    monkeypatch.setenv("SIGNID_DEBUG", "1")
    assert run(["inspect", "1r"]) == code
    assert "Traceback" in capfd.readouterr().err


def test_a_closed_pipe_is_no_error() -> None:
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    for more in ("", " --json"):
        line = f"set -o pipefail; {sys.executable} -m signid inspect panda{more} | head -n 1"
        done = subprocess.run(["bash", "-c", line], capture_output=True, text=True, env=there, check=False)
        assert (done.returncode, done.stderr, len(done.stdout.splitlines())) == (0, "", 1)


def test_an_unwritable_folder_is_refused_at_once(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def forbid(*_: Any, **__: Any) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("tempfile.TemporaryFile", forbid)
    monkeypatch.setattr("signid.robot.load_robot", lambda *_, **__: pytest.fail("it began to compute"))
    assert run(["identify", "1r", "swing.csv", "-o", "result"]) == 2
    assert "Permission denied" in capfd.readouterr().err


@pytest.mark.slow
def test_libraries_print_nothing(folder: Path) -> None:
    (folder / "spoilt.csv").write_text(changed("tau_1", lambda x: np.where(np.arange(len(x)) == 500, np.nan, x)))
    done = process("identify", "1r", "spoilt.csv", "-o", "result", cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert "missing" in done.stdout


@pytest.mark.parametrize(
    ("options", "arguments"),
    [
        ("a column map (--columns) may fit", "a column map (columns=) may fit"),
        ("give --known kp=20, or --cutoff 10", 'give known="kp=20", or options=signid.Options(cutoff=10)'),
        ("more laws (--effects)", "more laws (options=signid.Options(effects=...))"),
        ("add --xacro name:=VALUE; use --method convex", 'add xacro={"name": VALUE}; use method="convex"'),
        ("state it with --gravity 0,0,-9.81; or --unsigned", "state it with gravity=(0,0,-9.81); or unsigned=True"),
        ("signid export --actuators FILE writes it, --lock elbow=0.5 holds", None),
    ],
)
def test_sentences_name_arguments_in_python_and_options_on_the_command_line(
    options: str, arguments: str | None
) -> None:
    error = signid.SignidError(options)
    if arguments is None:  # what follows a whole command, up to the comma, is that command's
        arguments = 'signid export --actuators FILE writes it, lock={"elbow": 0.5} holds'
    assert str(error) == arguments
    words = ON_COMMAND_LINE.set(True)
    try:
        assert str(error) == options
    finally:
        ON_COMMAND_LINE.reset(words)


def test_an_error_of_the_command_line_has_options_and_the_same_in_python_arguments(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.csv").write_text("Zeit,Achse1,Kraft\n0,0,0\n.01,.1,1\n")
    assert run(["identify", "1r", "log.csv", "-o", "out"]) == 2
    assert "(--columns)" in capsys.readouterr().err
    with pytest.raises(RecordingError, match=r"\(columns=\)") as caught:
        signid.read_recording("log.csv", "1r")
    assert "--" not in str(caught.value).split("signid ")[0]
