"""Senseless recordings of position drives are refused or flagged by every command, and healthy ones are not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from senseless_servo import SWING, healthy, senseless
from servo_logs import recording

import signid
from signid.cli import run
from signid.faults.channels import judge_samples
from signid.faults.commands import audit_servos
from signid.regression.session import prepare
from signid.robot import load_robot

GOOD, OTHER = healthy(1), healthy(2)
SENSELESS = senseless(GOOD, OTHER)
SHORT = senseless(healthy(1, seconds=8.0), healthy(2, seconds=8.0))  # a search takes its time row by row
WORDS = {
    "noise": "does not follow",
    "random walk": "does not follow",
    "another motion": "does not follow",
    "position twice as fast": "does not follow",
    "position half as fast": "does not follow",
    "signs at random": "does not follow",
    "commands in any order": "does not follow",
    "constant command": "q_des never changes",
    "constant position": "moves by less than",
    "both constant": "no joint moves",
    "stuck": "the sensor is stuck",
    "halved": "of q_des throughout",
    "off by 90 degrees": "above its command",
    "early by 1 s": "leads q_des by",
    "late by 1 s": "ms after its command, later than a drive",
    "spikes": "q has spikes",
    "spikes of the command": "q_des has spikes",
    "drop-outs": "q drops to 0 for single samples",
    "drop-outs of the command": "q_des drops to 0 for single samples",
    "8 bits of a turn": "72 different values",
    "three levels": "3 different values",
    "reversed in time": "leads",
    "exchanged": "leads",
    "negated position": "wrong sign",
    "position reversed": "wrong sign",
    "stuck now and then": "repeat the position before",
}


def test_healthy_recordings_are_silent() -> None:
    assert not audit_servos(recording(GOOD)).flags and not audit_servos(recording(OTHER)).flags


@pytest.fixture(scope="module")
def actuators(tmp_path_factory: pytest.TempPathFactory) -> str:
    place = tmp_path_factory.mktemp("robot") / "actuators.toml"
    numbers = "\n".join(f"{key} = {getattr(SWING, key)}" for key in ("kp", "kd", "delay", "coulomb_friction"))
    place.write_text(f"[joint.joint_1.servo]\n{numbers}\n")
    return str(place)


@pytest.mark.parametrize("name", SENSELESS)
def test_commands_end_with_2_or_3(
    name: str, actuators: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "log.csv")
    pl.DataFrame(SENSELESS[name]).write_csv(file)
    for words in (["check", file], ["validate", "1r", file, "--actuators", actuators]):
        assert run(words) in (2, 3)
        said = capsys.readouterr().err.splitlines()
        assert any(WORDS[name] in line for line in said) and all(line.startswith("signid: ") for line in said), said


@pytest.mark.slow_cases("identify-(another|halved|spikes)|diagnose-stuck")
@pytest.mark.parametrize(
    ("verb", "name"),
    [
        *(("identify", name) for name in ("another motion", "stuck", "halved", "spikes")),
        *(("diagnose", name) for name in ("stuck", "spikes", "both constant")),
    ],
)
def test_identification_and_diagnosis_end_with_2_or_3(
    verb: str, name: str, actuators: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = str(tmp_path / "log.csv")
    pl.DataFrame(SHORT[name]).write_csv(file)
    code = run([verb, "1r", file, "--actuators", actuators, "--json"])
    assert code == 2 or (code == 3 and WORDS[name] in capsys.readouterr().err)


def test_a_healthy_recording_is_validated_without_a_flag(actuators: str, tmp_path: Path) -> None:
    pl.DataFrame(GOOD).write_csv(tmp_path / "log.csv")
    assert run(["validate", "1r", str(tmp_path / "log.csv"), "--actuators", actuators]) == 0


@pytest.mark.parametrize("name", ["spikes", "drop-outs", "stuck", "8 bits of a turn"])
def test_a_recording_of_torque_is_checked_by_the_same_list(name: str) -> None:
    bad, robot = SENSELESS[name], load_robot("1r")
    rows = {"t": bad["t"], "q": bad["q_1"][:, None], "tau": np.sin(GOOD["q_1"])[:, None]}
    session = prepare(robot, [signid.read_recording(rows, robot)])
    of_torque = {
        fault.sentence.removeprefix("the position of joint_1") for fault in judge_samples(session.whole, robot)
    }
    of_commands = {said.removeprefix("1: q") for said in audit_servos(recording(bad)).faults}
    assert of_torque & of_commands, (of_torque, of_commands)
