"""Exported drives start from a recording, and MuJoCo repeats the loop from its first row."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import polars as pl
import pytest
from servo_loops import SWING, driven, motion, pendulum
from test_servo_export import LOOPS

from benchmarks.export_loop import configured, errors, executed, of_mjcf, table_of
from signid.cli import run
from signid.errors import OptionError
from signid.model import Model
from signid.output.export import export
from signid.recording import read_recording
from signid.servo.fit.start import first_state
from signid.servo.plant import roll_out
from signid.servo.plant.course import motion_of
from signid.servos import Servo, ServoGrid

SPEED, RATE = 1.0, 100.0  # [rad/s] least speed of the first row, in motion; [Hz]
CLOSE, WIDE = 1.0, 1.2  # [mrad]; errors over what the rounding of delays costs
FIRST, WHOLE, ROUNDING = 0, 2, 4  # of the errors


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


def repeated(model: Model, folder: Path, kind: str = "mjcf") -> list[list[float]]:
    """Errors of the drives that an export starts from a recording, of each roll-out."""
    recording, arm = read_recording(recorded(model, folder), model.robot), folder / "arm.xml"
    arm.write_text(export(model, "mjcf", start=recording).text)
    table = table_of(model, recording)
    if kind == "mjcf":
        return [errors(of_mjcf(arm, table), table)]
    written = executed(export(model, kind, start=recording).text, 0.005)
    return [errors(run, table) for run in configured(arm, written, table)]


@pytest.mark.parametrize("name", LOOPS)
def test_mujoco_repeats_the_loop_from_the_first_row(name: str, tmp_path: Path) -> None:
    (found,) = repeated(driven(pendulum(), {"swing": LOOPS[name]}), tmp_path)
    assert found[FIRST] < CLOSE and found[WHOLE] < CLOSE
    assert found[FIRST + 1] < CLOSE and found[WHOLE + 1] < CLOSE, "from the recording"
    there = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
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
    down, up = repeated(model, tmp_path, kind)
    for found in (down, up):
        assert found[WHOLE] < WIDE * found[ROUNDING] + CLOSE
    assert min(down[ROUNDING], up[ROUNDING]) > 0.1


def test_the_torque_offset_moves_targets(tmp_path: Path) -> None:
    servo = SWING.with_(delay=0.0125)  # two and a half steps and half a step of the integrator: whole
    model = driven(pendulum(), {"swing": servo.with_(torque_offset=0.3)})
    (found,) = repeated(model, tmp_path, "isaaclab")
    assert found[WHOLE] < CLOSE and found[ROUNDING] == 0
    assert f'"swing": {-0.3 / servo.kp:.6g}' in export(model, "isaaclab").text


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
    (found,) = repeated(model, tmp_path)
    assert found[WHOLE] < CLOSE


def test_the_command_writes_the_start(tmp_path: Path) -> None:
    model = driven(pendulum(), {"swing": SWING})
    saved, recording = model.save(tmp_path / "model.json"), recorded(model, tmp_path)
    files = {"mjcf": "arm.xml", "isaaclab": "isaaclab.py", "mjlab": "mjlab.py"}
    options = [part for kind, name in files.items() for part in (f"--{kind}", str(tmp_path / "out" / name))]
    assert run(["export", str(saved), *options, "--start", str(recording)]) == 0
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(files.values())
    read = read_recording(recording, model.robot)
    for kind, name in files.items():
        text = (tmp_path / "out" / name).read_text()
        assert text == export(model, kind, start=read).text
        if kind != "mjcf":
            written = executed(text, 0.001)
            assert written["PHYSICS_STEP"] == 0.001 and written["HELD"].keys() == {"swing"}
            assert written["START"]["joint_pos"].keys() == written["START"]["joint_vel"].keys() == {"swing"}


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
