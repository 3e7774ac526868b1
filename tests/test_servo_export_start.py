"""Exported drives start from a recording, and a script without signid repeats the loop from its first row."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import polars as pl
import pytest
from servo_loops import SWING, driven, motion, pendulum
from test_servo_export import LOOPS, executed

from signid.cli import run
from signid.errors import OptionError
from signid.model import Model
from signid.output.export import check_loop, export
from signid.recording import read_recording
from signid.servo.fit.first_state import first_state
from signid.servo.plant import roll_out
from signid.servo.plant.course import motion_of
from signid.servos import Servo, ServoGrid

SPEED, RATE = 1.0, 100.0  # [rad/s] least speed of the first row, in motion; [Hz]
CLOSE, WIDE = 1.0, 1.2  # [mrad]; errors over what the rounding of delays costs
FILES = {"mjcf": "mjcf.xml", "isaaclab": "isaaclab.py", "mjlab": "mjlab.py"}
FIRST, WHOLE, ROUNDING = 0, 2, 4  # columns of the script


def recorded(model: Model, folder: Path, seed: int = 3) -> Path:
    """A recording of 4 s of a closed loop that begins in fast motion, as a file."""
    grid: ServoGrid = motion(model, seed, seconds=8.0)
    q = roll_out(model, model.servos, grid)
    speed = np.abs(np.gradient(q, grid.step, axis=0)).min(axis=1)
    first = next(k for k in range(1000, 4000, 10) if speed[k] > SPEED or k == 3990)
    rows = slice(first, first + 4000, 10)
    columns = {"t": np.arange(first, first + 4000, 10) * grid.step}
    for j, joint in enumerate(grid.joints):
        columns |= {f"q_{joint}": q[rows, j], f"q_des_{joint}": grid.command[rows, j]}
        if any(servo.kd_on == "error" for servo in model.servos.values()) and grid.command_speed is not None:
            columns[f"dq_des_{joint}"] = grid.command_speed[rows, j]
    pl.DataFrame(columns).write_csv(folder / "moving.csv")
    return folder / "moving.csv"


def exported(model: Model, folder: Path, *kinds: str) -> list[str]:
    """Write exports that start from a recording; return the arguments of the script, from its path on."""
    saved, recording = model.save(folder / "model.json"), recorded(model, folder)
    options = [part for kind in ("mjcf", *kinds) for part in (f"--{kind}", str(folder / FILES[kind]))]
    assert run(["export", str(saved), *options, "--start", str(recording)]) == 0
    return [str(folder / name) for name in ("mjcf_check_loop.py", "mjcf.xml", "mjcf_loop.json")]


def errors(arguments: list[str]) -> list[list[float]]:
    """Errors that the script prints for all joints together, of each roll-out, where signid cannot be imported."""
    done = subprocess.run([sys.executable, "-I", *arguments], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return [[float(x) for x in line.split()[1:]] for line in done.stdout.splitlines() if line.startswith("all ")]


@pytest.mark.parametrize("name", LOOPS)
def test_mujoco_repeats_the_loop_from_the_first_row(name: str, tmp_path: Path) -> None:
    (found,) = errors(exported(driven(pendulum(), {"swing": LOOPS[name]}), tmp_path))
    assert found[FIRST] < CLOSE and found[WHOLE] < CLOSE
    assert found[FIRST + 1] < CLOSE and found[WHOLE + 1] < CLOSE, "from the recording"
    there = mujoco.MjModel.from_xml_path(str(tmp_path / "mjcf.xml"))
    assert abs(there.key("start").qvel[0]) > SPEED / 2, "the recording begins in motion"


def test_the_first_state_is_at_rest_where_the_recording_begins_at_rest() -> None:
    model = driven(pendulum(), {"swing": SWING})
    grid = motion(model, seed=3, seconds=2.0)
    recorded = replace(grid, q=roll_out(model, model.servos, grid)[::10], command=grid.command[::10], rate=RATE)
    recorded = replace(recorded, **{name: getattr(grid, name)[::10] for name in ("on", "voltage", "command_speed")})
    (q,), (v,) = first_state(model, recorded)
    assert abs(q - grid.q[0, 0]) < 1e-4
    assert abs(v) < 0.2 * abs(motion_of(recorded).v[0, 0]), "smoothed positions seem to move before"


@pytest.mark.parametrize("kind", ["isaaclab", "mjlab"])
@pytest.mark.parametrize("name", ["effort", "effort, saturated", "duty, saturated"])
def test_other_simulators_differ_by_whole_steps_of_delay(kind: str, name: str, tmp_path: Path) -> None:
    model = driven(pendulum(), {"swing": LOOPS[name].with_(torque_offset=0.0)})
    script = exported(model, tmp_path, kind)
    down, up = errors([*script, "--actuators", str(tmp_path / FILES[kind])])
    for found in (down, up):
        assert found[WHOLE] < WIDE * found[ROUNDING] + CLOSE
    assert min(down[ROUNDING], up[ROUNDING]) > 0.1


def test_the_torque_offset_moves_targets(tmp_path: Path) -> None:
    servo = SWING.with_(delay=0.0125)  # two and a half steps and half a step of the integrator: whole
    script = exported(driven(pendulum(), {"swing": servo.with_(torque_offset=0.3)}), tmp_path, "isaaclab")
    (found,) = errors([*script, "--actuators", str(tmp_path / "isaaclab.py")])
    assert found[WHOLE] < CLOSE and found[ROUNDING] == 0
    assert f'"swing": {-0.3 / servo.kp:.6g}' in (tmp_path / "isaaclab.py").read_text()


def test_load_friction_becomes_dry_friction_at_the_mean_torque(tmp_path: Path) -> None:
    model = driven(pendulum(), {"swing": SWING.with_(load_friction=0.3)})
    recording = read_recording(recorded(model, tmp_path), model.robot)
    made = export(model, "mjcf", start=recording)
    assert any("dry friction of swing has load_friction in it" in note for note in made.notes)
    assert not any("cannot hold friction per motor torque" in note for note in made.notes)
    level = mujoco.MjModel.from_xml_string(made.text).dof_frictionloss[0]
    mean = np.mean(np.abs(SWING.kp * (recording.read().q_des - recording.read().q)))
    assert level == pytest.approx(SWING.coulomb_friction + 0.3 * mean, rel=0.3)


def test_joints_without_a_drive_follow_the_recording(tmp_path: Path) -> None:
    model = driven("3r", {"joint_2": Servo(kp=400.0, kd=40.0, armature=0.1)})
    (found,) = errors(exported(model, tmp_path))
    assert found[WHOLE] < CLOSE


def test_the_script_reads_what_the_file_computes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    exported(driven(pendulum(), {"swing": SWING}), tmp_path, "isaaclab", "mjlab")
    for kind, module in {"isaaclab": "isaaclab.actuators", "mjlab": "mjlab.actuator"}.items():
        run_file = executed((tmp_path / FILES[kind]).read_text(), module, monkeypatch)
        read = check_loop.read_configuration(str(tmp_path / FILES[kind]))
        assert all(read[name] == run_file[name] for name in ("START", "HELD", "PHYSICS_STEP"))
        group: Any = next(iter(run_file["ACTUATORS"].values())) if kind == "isaaclab" else run_file["ACTUATORS"][0]
        drive = check_loop.drive_of("swing", read["ACTUATORS"])
        assert (drive["kind"], drive["stiffness"], drive["late"]) == (group.kind, 8.0, SWING.delay)
        armature, damping = drive["armature"]
        assert group.armature == armature + 0.0025 * damping


def test_the_script_refuses_other_files_in_one_sentence(tmp_path: Path) -> None:
    script, mjcf, loop = exported(driven(pendulum(), {"swing": SWING}), tmp_path, "isaaclab")
    bare = tmp_path / "bare.xml"
    bare.write_text(export(driven(pendulum(), {"swing": SWING}), "mjcf").text)
    plain = tmp_path / "plain.py"
    plain.write_text(export(driven(pendulum(), {"swing": SWING}), "isaaclab").text)
    for arguments, sentence in (
        ([str(bare), loop], "has no keyframe 'start'"),
        ([mjcf, str(tmp_path / "model.json")], "is no loop of signid"),
        ([mjcf, loop, "--actuators", str(plain)], "has no START"),
        ([mjcf, str(tmp_path / "none.json")], "No such file"),
    ):
        done = subprocess.run([sys.executable, "-I", script, *arguments], capture_output=True, text=True, check=False)
        assert (done.returncode, len(done.stderr.splitlines())) == (2, 1) and sentence in done.stderr
    assert check_loop.main([mjcf, loop, "--within", "1e-9"]) == 1


def test_a_start_needs_drives_on_a_fixed_base(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model = driven(pendulum(), {"swing": SWING})
    saved, recording = str(model.save(tmp_path / "model.json")), str(recorded(model, tmp_path))
    for options, sentence in (
        (["--urdf", "a.urdf", "--start", recording], "--start belongs to --mjcf, --isaaclab, --mjlab"),
        (["--mjcf", "a.xml", "--columns", "map.toml"], "--columns names the columns of --start"),
        (["--mjcf", "a.xml", "--floating", "--start", recording], "fixed base"),
        (["--mjcf", recording, "--start", recording], "moving.csv"),
    ):
        assert run(["export", saved, *options]) == 2
        assert sentence in " ".join(capsys.readouterr().err.split())
    with pytest.raises(OptionError, match="no position drive"):
        export("3r", "mjcf", start=recording)


def test_conditions_that_no_drive_knows_are_noted(tmp_path: Path) -> None:
    model = driven(pendulum(), {"swing": SWING})
    table = pl.read_csv(recorded(model, tmp_path))
    table.with_columns(on_swing=pl.lit(1.0) * (pl.col("t") > 2.0)).write_csv(tmp_path / "off.csv")
    notes = export(model, "mjcf", start=read_recording(tmp_path / "off.csv", model.robot)).notes
    assert any("the torque off of the recording" in note for note in notes)


def test_the_rows_are_those_of_the_recording(tmp_path: Path) -> None:
    exported(driven(pendulum(), {"swing": SWING}), tmp_path)
    columns = json.loads((tmp_path / "mjcf_loop.json").read_text())["columns"]
    written = pl.read_csv(tmp_path / "moving.csv")
    np.testing.assert_allclose(columns["q_swing"], written["q_swing"], atol=1e-9)
    np.testing.assert_allclose(columns["q_des_swing"][:-1], written["q_des_swing"][:-1], atol=1e-9)
    assert list(columns) == ["t", "q_swing", "signid_swing", "q_des_swing"]
