"""Faults of recordings and bad fits are flags of an identification; a healthy one has none."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

import signid
from signid.cli import run
from signid.recording.formats import find_format
from signid.types import Array, Robot

FOLDER = Path(__file__).parents[1] / "robots" / "3r"
Table = dict[str, Array]
Change = Callable[[Table], None]
DELAYS = [0.008, -0.008]  # s
TORQUES = ("tau_1", "tau_2", "tau_3")


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("3r")


@pytest.fixture(scope="module")
def healthy() -> Table:
    path = FOLDER / "recording.parquet"
    table = find_format(path).open(path)
    return dict(zip(table.columns, table.read(table.columns, 0, table.rows).T, strict=True))


def delayed(seconds: float) -> Change:
    def change(table: Table) -> None:
        for joint in (1, 2, 3):
            table[f"tau_{joint}"] = np.interp(table["t"] - seconds, table["t"], table[f"tau_{joint}"])

    return change


def scaled(factor: float, *columns: str) -> Change:
    def change(table: Table) -> None:
        table.update({name: factor * table[name] for name in columns})

    return change


def exchanged(table: Table) -> None:
    table["tau_1"], table["tau_2"] = table["tau_2"], table["tau_1"]


def absolute(table: Table) -> None:
    table.update({name: np.abs(table[name]) for name in TORQUES})


def stuck(table: Table) -> None:
    first = len(table["t"]) // 3
    table["tau_3"] = table["tau_3"].copy()
    table["tau_3"][first : first + 120] = table["tau_3"][first]


def foreign(table: Table) -> None:
    table["tau_3"] = 2 * np.sin(2 * np.pi * 1.7 * table["t"]) + np.sin(2 * np.pi * 2.9 * table["t"] + 1)


FAULTS: dict[str, tuple[Change, str, str]] = {
    "sign": (scaled(-1, "tau_2"), "the torque of joint_2 has the wrong sign", "run signid check"),
    "order": (exchanged, "the torques of joints joint_1 and joint_2 are exchanged", "run signid check"),
    "position": (scaled(-1, "q_2"), "the position of joint_2 has the wrong sign", "run signid check"),
    "absolute": (absolute, "is never negative", "run signid check"),
    "units": (scaled(1000, *TORQUES), "times the predicted ones", "run signid check"),
    "stuck": (stuck, "the torque of joint_3 is constant", "run signid check"),
    "late": (delayed(0.25), "ms late against the motion", "run signid check"),
    "foreign torque": (foreign, "joint_3", "signid diagnose"),
    **{
        f"{1e3 * d:g} ms": (delayed(d), f"ms {'late' if d > 0 else 'early'} against the motion", "run signid diagnose")
        for d in DELAYS
    },
}


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_is_flagged_with_the_next_command(name: str, robot: Robot, healthy: Table) -> None:
    change, says, command = FAULTS[name]
    table = dict(healthy)
    change(table)
    found = signid.identify(robot, [signid.read_recording(table, robot)])
    assert [flag for flag in found.flags if says in flag and command in flag], found.flags
    assert all(len(flag) <= 390 for flag in found.flags)


@pytest.mark.parametrize("seconds", DELAYS)
def test_a_delay_is_found_to_a_millisecond(seconds: float, robot: Robot, healthy: Table) -> None:
    table = dict(healthy)
    delayed(seconds)(table)
    found = signid.identify(robot, [signid.read_recording(table, robot)])
    (number,) = [float(flag.split(" ms ")[0].split()[-1]) for flag in found.flags if " ms " in flag]
    assert number == pytest.approx(1e3 * abs(seconds), abs=1.0)


def test_a_healthy_recording_is_not_flagged(robot: Robot, tmp_path: Path) -> None:
    for name in ("recording", "held_out"):
        assert run(["identify", "3r", str(FOLDER / f"{name}.parquet"), "-o", str(tmp_path / name)]) == 0


def test_a_model_worse_than_the_description_is_flagged(robot: Robot, healthy: Table, tmp_path: Path) -> None:
    first = signid.identify(robot, [signid.read_recording(healthy, robot)])
    lines = [f"[joint.{name}]\n{{}}" for name in robot.joints]
    for law in first.model.laws:
        (value,) = law.parameters.values()
        lines[law.joints[0]] += f"\n{law.effect.name} = {max(value, 0.0)}"
    (tmp_path / "actuators.toml").write_text("\n".join(line.replace("{}", "") for line in lines))
    known = signid.load_robot("3r", actuators=tmp_path / "actuators.toml")
    table = dict(healthy)
    table["tau_3"] = table["tau_3"] + 2 * np.sign(np.sin(2 * np.pi * 0.4 * table["t"]))
    learned, judge = signid.read_recording(table, known), signid.read_recording(FOLDER / "held_out.parquet", known)
    found = signid.identify(known, [learned], held_out=[judge])
    (flag,) = [flag for flag in found.flags if "is predicted worse than by the description" in flag]
    assert "joint_3" in flag and f"{found.fit.held_out_rms[2]:.3g}" in flag and "signid diagnose" in flag


def test_a_description_without_bodies_is_no_comparison(healthy: Table, tmp_path: Path) -> None:
    text = (FOLDER / "robot.urdf").read_text()
    bare = re.sub(r"<inertial>.*?</inertial>", "", text, flags=re.DOTALL)
    (tmp_path / "bare.urdf").write_text(bare)
    robot = signid.load_robot(tmp_path / "bare.urdf")
    found = signid.identify(robot, [signid.read_recording(healthy, robot)])
    assert not [flag for flag in found.flags if "signid check" in flag], found.flags


def test_a_recording_too_short_for_held_out_rows_is_evaluated_on_itself(robot: Robot, healthy: Table) -> None:
    table = {key: x[:1000] for key, x in healthy.items()}
    options = signid.Options(cutoff=5.0)
    found = signid.identify(robot, [signid.read_recording(table, robot)], options=options)
    assert [flag for flag in found.flags if "too short to hold anything out" in flag], found.flags
    assert found.fit.held_out_rms == pytest.approx(found.fit.train_rms)
    judge = signid.read_recording(FOLDER / "held_out.parquet", robot)
    (own, described) = signid.validate([found.model, signid.load_model("3r")], [judge]).models
    assert np.all(own.fit.held_out_rms < described.fit.held_out_rms)
