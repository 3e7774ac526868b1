"""`signid simulate --servo`: recordings of closed loops, driven by commands."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from servo_loops import SWING, driven, motion, pendulum

import signid
from signid.cli import run
from signid.effects.naming import parse_law
from signid.effects.packing import beside_drives
from signid.model import load_model
from signid.servo.plant import roll_out
from signid.servo.simulate import simulate_servos
from signid.servo.validate import validate_servos
from signid.simulation.plant import Sensors
from signid.types import Array

TOML = """\
[joint.joint_2]
armature = 0.02
[joint.joint_2.servo]
law = "duty"
kp = 300.0
kd = 20.0
delay = 0.01
effort_limit = 60.0
"""


def columns(path: Path) -> dict[str, Array]:
    lines = path.read_text().splitlines()
    return dict(zip(lines[0].split(","), np.array([x.split(",") for x in lines[1:]], float).T, strict=True))


def test_commands_of_a_recording_drive_a_saved_model(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    model, first, again = tmp_path / "model.json", tmp_path / "a.csv", tmp_path / "b.csv"
    driven(pendulum(), {"swing": SWING.with_(effort_limit=0.8)}).save(model)
    assert run(["simulate", str(model), "--servo", "--duration", "5", "-o", str(first), "--rate", "50"]) == 0
    x = columns(first)
    assert list(x) == ["t", "q_swing", "dq_swing", "q_des_swing", "dq_des_swing", "on_swing"]
    assert len(x["t"]) == 251 and np.all(x["on_swing"] == 1) and np.ptp(x["q_des_swing"]) > 0.5
    assert run(["simulate", str(model), str(first), "--servo", "-o", str(again)]) == 0
    y = columns(again)
    np.testing.assert_allclose(y["q_des_swing"], x["q_des_swing"], atol=1e-12)
    np.testing.assert_allclose(y["q_swing"], x["q_swing"], atol=0.015)  # the first speed is estimated from 50 Hz
    assert "closed loop from commands" in capsys.readouterr().out
    found = validate_servos(str(model), str(again))
    assert found.models[0].rollout.whole_rms[0] < 0.01, "the recording validates the model"


def test_the_actuators_file_states_drives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "drives.toml").write_text(TOML)
    out = tmp_path / "x.csv"
    command = ["simulate", "3r", "--servo", "--actuators", str(tmp_path / "drives.toml"), "-o", str(out)]
    assert run([*command, "--duration", "3", "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["servos"]["joint_2"]["kp"] == 300.0 and document["servos"]["joint_2"]["armature"] == 0.02
    assert document["notes"] == ["joint_1, joint_3 without a drive follow the given motion"]
    assert {"q_des_joint_2", "q_joint_1"} < set(columns(out)) and "q_des_joint_1" not in columns(out)


def test_injected_laws_and_numbers_change_the_loop() -> None:
    model = driven(pendulum(), {"swing": SWING})
    grid = motion(model, seed=2, seconds=3.0)
    recording = signid.read_recording(
        {"t": np.arange(len(grid)) * grid.step, "q": grid.q, "q_des": grid.command}, model.robot
    )
    laws = [parse_law("coulomb_friction@swing:level=0.1", model.robot), parse_law("payload:mass=0.1", model.robot)]
    found = simulate_servos(model, recording, inject=laws, numbers={"swing": {"delay": 0.05}})
    servo = found.model.servos["swing"]
    assert (servo.coulomb_friction, servo.delay, servo.kp) == (0.08 + 0.1, 0.05, SWING.kp)
    assert [law.effect.name for law in beside_drives(found.model.laws)] == ["payload"]
    expected = roll_out(found.model, found.model.servos, grid)
    assert np.abs(found.q - expected).max() < 1e-3 < np.abs(found.q - roll_out(model, model.servos, grid)).max()


def test_encoder_jitter_and_losses_are_those_of_a_logger() -> None:
    model = driven(pendulum(), {"swing": SWING})
    plain, real = (
        simulate_servos(model, signid.read_recording(_commands(), model.robot), sensors).columns
        for sensors in (Sensors(), Sensors(encoder_bits=8, jitter=0.2, drop_outs=0.1))
    )
    assert len(real["t"]) < len(plain["t"]) and np.ptp(np.diff(real["t"])) > 0.001
    count = 2 * np.pi / 2**8
    assert np.abs((np.diff(real["q_swing"]) / count + 0.5) % 1 - 0.5).max() < 1e-6


def _commands() -> dict[str, Array]:
    t = np.arange(300) / 50
    return {"t": t, "q_swing": 0.4 * np.sin(t), "q_des_swing": 0.4 * np.sin(t)}


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (["--kp", "3", "--kd", "1"], "--servo takes kp and kd from the model"),
        (["--noise", "0.1"], "do not apply to a recording without torque"),
        (["--inject", "cable_torque@1"], "--servo cannot inject cable_torque"),
        (["--inject", "servo@swing:kq=1"], "a drive has no number 'kq'"),
        (["--inject", "servo@swing"], "cannot be read; write servo@JOINT"),
        (["--inject", "servo@swing:kp=1e9,kd=0"], "diverges at swing"),
    ],
)
def test_bad_input_gives_one_sentence(
    more: list[str], sentence: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    saved = driven(pendulum(), {"swing": SWING}).save(tmp_path / "model.json")
    assert run(["simulate", str(saved), "--servo", "--duration", "2", "-o", str(tmp_path / "x.csv"), *more]) == 2
    assert sentence in " ".join(capsys.readouterr().err.split()) and not (tmp_path / "x.csv").exists()


def test_a_robot_without_drives_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["simulate", "3r", "--servo", "-o", str(tmp_path / "x.csv")]) == 2
    assert "3r has no drive of a joint that the motion commands" in " ".join(capsys.readouterr().err.split())
    assert not load_model("3r").servos
