"""The audit of servo recordings finds the numbers of simulated drives and faults put into logs, and is else silent."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from servo_logs import FAULTS, Columns, audit, drive, negated, recording

from signid.cli.run import run
from signid.errors import RecordingError
from signid.faults.commands import audit_servos
from signid.recording import read_bare, read_recording
from signid.recording.formats.base import memory_table
from signid.types import Recording


def test_numbers_of_a_drive() -> None:
    found = audit_servos(recording(drive()))
    [one] = found.joints
    assert not found.flags, found.flags
    assert one.lag == pytest.approx(0.03 + 2 * 0.9 / 25, abs=0.003)
    assert one.delay == pytest.approx(0.03, abs=0.006)
    flat = 1 - 2 * 0.9**2
    assert one.bandwidth == pytest.approx(25 / 2 / np.pi * np.sqrt(flat + np.sqrt(flat**2 + 1)), rel=0.1)
    assert one.residual < 0.02 and one.width < 0.002 and one.saturated < 0.01
    assert one.quantum == pytest.approx(2 * np.pi / 4096)
    assert one.droop < 0.002 and one.holds >= 4


def test_friction_and_droop() -> None:
    one = audit(drive(friction=0.02, droop=0.05))
    assert not one.flags
    assert one.width == pytest.approx(0.02, rel=0.3)
    assert one.droop == pytest.approx(0.05, abs=0.021) and one.zero == pytest.approx(0.05, abs=0.01)
    assert one.lag == pytest.approx(0.102, abs=0.015)


def test_the_interval_of_the_lag_holds() -> None:
    found = [audit(drive(seed=seed, friction=0.005, seconds=20)) for seed in range(6)]
    errors = [abs(one.lag - 0.102) / one.lag_std for one in found]
    assert sum(error < 3 for error in errors) >= 5


def test_same_numbers_in_degrees_and_from_a_file(tmp_path: Path) -> None:
    columns = drive(seconds=12)
    pl.DataFrame(columns).write_csv(tmp_path / "a.csv")
    degrees = {name: values if name == "t" else np.degrees(values) for name, values in columns.items()}
    read, units = read_bare(degrees, columns={"units": {"q": "deg", "q_des": "deg"}})
    first, second = audit(columns), audit_servos(read).joints[0]
    from_file, _ = read_bare(tmp_path / "a.csv")
    assert units == {"a": "rad"}
    assert second.lag == pytest.approx(first.lag, rel=1e-3)
    assert audit_servos(from_file).joints[0].numbers() == first.numbers()


def test_saturated_share_of_duties_and_of_speeds() -> None:
    columns = drive()
    error = columns["q_des_a"] - columns["q_a"]
    assert audit({**columns, "pwm_a": np.clip(10 * error, -1, 1)}).saturated == pytest.approx(
        np.mean(np.abs(10 * error) >= 0.98)
    )
    t = np.arange(3000) / 100
    steps = np.where(t % 4 < 2, 0.0, 2.0)
    q = np.zeros(len(t))
    for k in range(1, len(t)):
        q[k] = q[k - 1] + np.clip(steps[k - 1] - q[k - 1], -0.02, 0.02)
    assert audit({"t": t, "q_a": q, "q_des_a": steps}).saturated == pytest.approx(0.45, abs=0.1)


def test_rows_with_the_drive_off_are_left_out() -> None:
    columns = drive()
    off = columns["t"] > 20
    fallen = {**columns, "q_a": np.where(off, -2.0, columns["q_a"]), "on_a": (~off).astype(float)}
    assert audit(fallen).lag == pytest.approx(audit({k: v[~off] for k, v in columns.items()}).lag, rel=1e-6)
    emptied = {**columns, "q_des_a": np.where(off, np.nan, columns["q_des_a"])}
    assert audit(emptied).samples == int((~off).sum())


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_faults_of_a_simulated_log(fault: Callable[[Columns, str], Columns]) -> None:
    [flag] = audit_servos(recording(fault(drive(), "a"))).flags
    assert FAULTS[fault] in flag and flag.startswith("a") and "\n" not in flag


def test_faults_of_stamps() -> None:
    columns = drive()
    rng = np.random.default_rng(2)
    jitter = 0.01 * rng.uniform(-0.9, 0.9, len(columns["t"]))
    uneven = {**columns, "t": columns["t"] + 0.5 * jitter}
    assert any("time steps differ" in flag for flag in audit_servos(recording(uneven)).flags)
    back = audit_servos(recording({**columns, "t": columns["t"] + jitter}))  # repaired
    assert any("stamps of time go back by up to" in sentence for sentence in (*back.flags, *back.notes))
    same = columns["t"].copy()
    same[10:-1:10] = same[11::10][: len(same[10:-1:10])]
    assert any("repeat the time" in flag for flag in audit_servos(recording({**columns, "t": same})).flags)
    back = columns["t"].copy()
    back[100] = 0.0
    assert any("goes back" in flag for flag in audit_servos(recording({**columns, "t": back})).flags)


def test_unusable_logs_get_a_sentence() -> None:
    columns = drive(seconds=5)
    for change, words in (
        ({"t": 1000 * columns["t"]}, "milliseconds"),
        ({"t": np.ones(500)}, "does not change"),
        ({"t": np.full(500, np.nan)}, "has no values"),
        ({"q_a": 1e150 * columns["q_a"]}, "beyond 1e"),
    ):
        with pytest.raises(RecordingError, match=words):
            audit_servos(recording({**columns, **change}))
    for change in ({"on_a": np.zeros(500)}, {"q_a": np.full(500, np.nan)}):
        found = audit_servos(recording({**columns, **change}))
        assert not found.joints and any("without a gap" in flag for flag in found.flags)
    constant = audit_servos(recording({**columns, "q_a": np.zeros(500), "q_des_a": np.zeros(500)}))
    assert "no command changes and no joint moves" in constant.flags[0] and np.isnan(constant.joints[0].lag)


def test_a_recording_without_commands_is_refused() -> None:
    columns = drive(seconds=5)
    with pytest.raises(RecordingError, match="no joint J with both columns q_J and q_des_J"):
        read_bare({"t": columns["t"], "q_a": columns["q_a"], "tau_a": columns["q_a"]})
    with pytest.raises(RecordingError, match="no column 't'"):
        read_bare({"q_a": columns["q_a"], "q_des_a": columns["q_a"]})
    bare = Recording(("a",), memory_table(columns, "x"), {"t": ("t",), "q": ("q_a",)}, np.ones(1), np.ones(1, bool))
    with pytest.raises(RecordingError, match="no commanded position"):
        audit_servos(bare)
    with pytest.raises(RecordingError, match="rows"):
        audit_servos(recording({name: values[:5] for name, values in columns.items()}))


def test_check_without_and_with_a_robot(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    first = drive(seconds=12)
    columns = {"t": first["t"]}
    for j in (1, 2, 3):
        own = drive(seconds=12, seed=j)
        columns |= {f"q_{j}": own["q_a"], f"q_des_{j}": own["q_des_a"]}
    file = tmp_path / "log.csv"
    pl.DataFrame(columns).write_csv(file)
    assert run(["check", str(file)]) == 0
    out = capsys.readouterr().out
    assert "1 recording of 3 servo joints" in out and "hysteresis" in out
    assert run(["check", str(file), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["schema"] == "signid.check/1" and document["robot"] is None
    assert [one["joint"] for one in document["servo"]] == ["1", "2", "3"] and not document["flags"]
    assert run(["check", "3r", str(file), "--json"]) == 0
    named = json.loads(capsys.readouterr().out)
    assert [one["joint"] for one in named["servo"]] == ["joint_1", "joint_2", "joint_3"] and named["robot"] == "3r"
    assert named["servo"][0]["lag"] == document["servo"][0]["lag"]
    pl.DataFrame(negated(columns, "2")).write_csv(file)
    assert run(["check", str(file)]) == 3
    assert "2 moves against its command" in capsys.readouterr().err
    assert run(["check", "3r"]) == 2
    assert "no recording was given" in capsys.readouterr().err


def test_recordings_are_audited_together_and_in_any_order() -> None:
    parts = [recording(drive(seconds=10, seed=seed)) for seed in (1, 2)]
    parts = [replace(part, path=f"{k}.csv") for k, part in enumerate(parts)]
    one, other = audit_servos(parts), audit_servos(parts[::-1])
    assert one.joints[0].samples == 2000 and one.joints[0].lag == pytest.approx(other.joints[0].lag, rel=0.02)


def test_the_audit_reads_what_a_robot_reads() -> None:
    columns = {name.replace("_a", "_1"): values for name, values in drive(seconds=10).items()}
    own = audit_servos(read_recording(columns, "1r"))
    assert own.joints[0].lag == audit_servos(read_bare(columns)[0]).joints[0].lag


@pytest.mark.parametrize("change", [np.negative, np.abs, np.square])
def test_a_lost_sign_looks_like_a_wrong_one_where_nothing_crosses_zero(change: Callable[[Any], Any]) -> None:
    log = drive(seconds=20)
    below = {**log, "q_des_a": log["q_des_a"] - 3, "q_a": change(log["q_a"] - 3)}
    (flag,) = [flag for flag in audit(below).flags if "moves against" in flag]
    assert "has the wrong sign, or is a magnitude or a square" in flag
    (flag,) = [flag for flag in audit({**log, "q_a": -log["q_a"]}).flags if "moves against" in flag]
    assert "magnitude" not in flag
