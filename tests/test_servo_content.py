"""Servo mode on logs slower than their commands, and on logs that were interpolated or repeated to a higher rate."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from servo_loops import SWING, driven, pendulum

import signid
from signid.cli import run
from signid.faults.commands.response import content_rate, content_rows
from signid.servo.identify import ServoIdentification, ServoOptions
from signid.servo.simulate import simulate_servos
from signid.types import Array

Columns = dict[str, Array]


@cache
def log(steps: bool = False) -> Columns:
    """A log of 12 s, 100 Hz commands and rows, with noise of 0.2 mrad."""
    t, rng = np.arange(1200) / 100, np.random.default_rng(1)
    u = 0.25 * np.sum([np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / (1 + f) for f in (0.3, 0.7, 1.3, 2.1)], axis=0)
    u = u + (0.6 * (t % 0.94 > 0.47) if steps else 0)
    model = driven(pendulum(), {"swing": SWING})
    made = simulate_servos(model, signid.read_recording({"t": t, "q_swing": u, "q_des_swing": u}, model.robot))
    x = {name: made.columns[name] for name in ("t", "q_swing", "q_des_swing")}
    return x | {"q_swing": x["q_swing"] + 2e-4 * rng.standard_normal(len(x["t"]))}


def every(x: Columns, k: int) -> Columns:
    return {name: values[::k] for name, values in x.items()}


def interpolated(x: Columns, k: int) -> Columns:
    t = np.linspace(x["t"][0], x["t"][-1], (len(x["t"]) - 1) * k + 1)
    return {name: np.interp(t, x["t"], values) for name, values in x.items()}


def held(x: Columns, k: int) -> Columns:
    repeated = {name: np.repeat(values, k) for name, values in x.items()}
    return repeated | {"t": np.arange(k * len(x["t"])) * (x["t"][1] - x["t"][0]) / k}


def identified(x: Columns) -> ServoIdentification:
    robot = pendulum()
    return signid.identify_servos(robot, signid.read_recording(x, robot), options=ServoOptions(additional=()))


def test_the_delay_of_a_log_at_half_the_rate_of_its_commands_is_inside_its_interval() -> None:
    delay = identified(every(log(), 2)).joints[0].numbers["delay"]
    assert delay.interval is not None and delay.interval[0] < SWING.delay < delay.interval[1]
    assert "up to 10 ms longer if the command changes between the rows" in delay.sentence


def test_steps_of_the_command_show_that_it_is_held_between_rows() -> None:
    delay = identified(log(steps=True)).joints[0].numbers["delay"]
    assert delay.value == pytest.approx(SWING.delay, abs=2e-4) and (delay.std or 1) < 2e-4 and not delay.sentence


@pytest.mark.slow
@pytest.mark.parametrize("raised", [interpolated, held])
def test_rows_between_those_with_content_change_nothing(raised: type[dict[str, Array]]) -> None:
    half = every(log(), 2)
    first, again = identified(half), identified(raised(half, 4))  # type: ignore[call-arg,arg-type]
    for name in ("kp", "delay", "damping", "armature"):
        a, b = first.joints[0].numbers[name], again.joints[0].numbers[name]
        assert a.value is not None and b.value == pytest.approx(a.value, rel=1e-2), name
        assert b.std == pytest.approx(a.std, rel=0.1)


def test_rows_with_content_are_found_and_healthy_logs_keep_all() -> None:
    x = every(log(), 2)
    for table, rate in ((x, 50.0), (interpolated(x, 4), 50.0), (held(x, 4), 50.0), (log(), 100.0)):
        assert content_rate(table["t"], table["q_swing"][:, None]) == pytest.approx(rate)
    coarse = np.round(log()["q_swing"] / 0.005) * 0.005
    assert content_rows(log()["t"], coarse[:, None]) == slice(None)


@pytest.mark.parametrize("verb", ["check", "identify"])
def test_json_has_the_rate_of_content(verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from test_servo_cli import recording

    x = pl.read_csv(recording(tmp_path / "a.csv", 1))
    table = {("t" if name == "t" else name.replace("joint_1", "swing")): x[name].to_numpy() for name in x.columns}
    names = {name.replace("swing", "joint_1"): values for name, values in interpolated(table, 2).items()}
    pl.DataFrame(names).write_csv(tmp_path / "b.csv")
    assert run([verb, "1r", str(tmp_path / "b.csv"), "--json"]) in (0, 3)
    (one,) = json.loads(capsys.readouterr().out)["recordings"]
    assert one["content_rate"] == pytest.approx(100.0)
