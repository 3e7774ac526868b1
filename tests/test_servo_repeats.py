"""Repeats of one command in servo recordings: where they are found, how far positions differ, how that is shown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from servo_logs import DATA, PUBLIC

from signid.cli import run
from signid.model import load_model, with_servos
from signid.recording import as_recordings
from signid.robot import load_robot
from signid.servo.diagnose.repeats import Pair, repeated, servo_repeats
from signid.servo.plant import grids_of_arrays, roll_out, servo_grids
from signid.servo.search.data import position_noise
from signid.servos import Servo, ServoGrid
from signid.toml_json import check_schema
from signid.types import Array

RATE = 100.0
NOISE = np.array([3e-4])
JITTER = 0.02  # [s] largest delay that the log does not know


def wave(seconds: float = 4.0) -> Array:
    """A command (N,) [rad] that does not repeat itself and begins and ends at 0."""
    t = np.arange(int(RATE * seconds)) / RATE
    return np.asarray(np.sin(2 * np.pi * t / seconds) * np.cos(2 * np.pi * 0.7 * t**1.3) * np.minimum(5 * t, 1))


def grid(command: Array, q: Array) -> ServoGrid:
    """A grid of one joint."""
    return grids_of_arrays(["j"], np.arange(len(command)) / RATE, q, command, rate=RATE)[0]


def still(one: ServoGrid) -> Array:
    """Errors of a simulation that is off by 0.1 rad."""
    return np.full_like(one.q, 0.1)


def late(command: Array, seconds: float) -> Array:
    """The command, later by a time [s]."""
    t = np.arange(len(command)) / RATE
    return np.interp(t - seconds, t, command)


def test_repeats_in_two_recordings_differ_by_what_the_log_does_not_know() -> None:
    u, rng = wave(), np.random.default_rng(0)
    grids = [grid(u, late(u, JITTER * rng.uniform()) + 3e-4 * rng.standard_normal(len(u))) for _ in range(6)]
    found = servo_repeats(grids, [0], NOISE, still)
    assert found is not None and found.joints == ("j",) and found.pairs == 15
    assert found.seconds == pytest.approx(15 * 4.0, rel=0.1)
    speed = np.sqrt(np.mean(np.gradient(u, 1 / RATE) ** 2))
    assert found.rms[0] == pytest.approx(speed * JITTER / np.sqrt(12), rel=0.35)
    assert found.mismatch_rms[0] == pytest.approx(0.1) and found.share[0] == pytest.approx((found.rms[0] / 0.1) ** 2)


def test_repeats_within_one_recording_are_found_with_all_their_rows() -> None:
    u = np.concatenate([wave(), 0.3 * wave(2.5), wave(), np.zeros(80)])
    (pair,) = repeated([grid(u, u)], [0])
    assert pair.a == pair.b == 0 and pair.j - pair.i == len(wave()) + 250 and pair.rows >= len(wave())


def test_a_slow_command_is_no_repeat_of_itself_and_standstill_is_none() -> None:
    slow = np.sin(0.2 * np.arange(2000) / RATE)
    still_then_step = np.repeat([0.0, 1.0, 0.0], 300)
    assert repeated([grid(slow, slow)], [0]) == []
    assert repeated([grid(still_then_step, still_then_step)], [0]) == []
    assert servo_repeats([grid(slow, slow)], [0], NOISE, still) is None


def test_commands_that_differ_are_no_repeats() -> None:
    u = wave()
    assert repeated([grid(u, u), grid(0.97 * u, u)], [0]) == []
    assert repeated([grid(u, u), grid(u, u)], [0]) == [Pair(0, 0, 1, 0, len(u))]


def test_a_recording_is_no_repeat_of_its_own_copy() -> None:
    u, rng = wave(), np.random.default_rng(0)
    one, other = (grid(u, u + 3e-4 * rng.standard_normal(len(u))) for _ in range(2))
    assert servo_repeats([one, one], [0], NOISE, still) is None
    found = servo_repeats([one, other, one], [0], NOISE, still)
    assert found is not None and found.pairs == 2 and found.rms[0] == pytest.approx(NOISE[0], rel=0.2)


def test_other_initial_states_are_compared_once_they_have_faded() -> None:
    u, t = wave(), np.arange(len(wave())) / RATE
    faded = grid(u, u + 0.5 * np.exp(-t / 0.1) + 3e-4 * np.random.default_rng(0).standard_normal(len(u)))
    found = servo_repeats([grid(u, u), faded], [0], NOISE, still)
    assert found is not None and found.rms[0] < 4 * NOISE[0]
    assert 2.5 < found.seconds < 3.5
    assert servo_repeats([grid(u, u), grid(u, u + 0.5)], [0], NOISE, still) is None


@PUBLIC
def test_public_repeats_of_a_hobby_servo() -> None:
    """Runs of a square command: 92 mrad by a comparison of whole runs, without signid."""
    folder = DATA / "mauicv_servo"
    robot = load_robot(folder / "arm.urdf")
    for name, rms in (("square_large", 0.092), ("chirp", None)):
        (read,) = as_recordings([str(folder / f"a_{name}.csv.gz")], robot, "test")
        grids = servo_grids(read, robot)
        found = servo_repeats(grids, [0], position_noise(grids), still)
        assert (found is None) == (rms is None)
        assert found is None or found.rms[0] == pytest.approx(rms, rel=0.05)


@pytest.mark.slow
def test_a_diagnosis_shows_repeats_in_terminal_report_and_document(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    model, servo = load_model("1r"), Servo(kp=20.0, kd=0.8, delay=0.02, armature=0.02)
    (joint,) = model.robot.joints
    driven, u, rng = with_servos(model, {joint: servo}), 0.6 * wave(), np.random.default_rng(1)
    rows = []
    for k in range(6):
        one = grids_of_arrays([joint], np.arange(len(u)) / RATE, np.full_like(u, u[0]), u, rate=RATE)[0]
        q = roll_out(driven, {joint: servo.with_(delay=0.02 + 0.01 * rng.uniform(-1, 1))}, one)[:, 0]
        q += 3e-4 * rng.standard_normal(len(u))
        rows.append(pl.DataFrame({"t": np.arange(len(u)) / RATE + 6.0 * k, f"q_{joint}": q, f"q_des_{joint}": u}))
    pl.concat(rows).write_csv("a.csv")
    driven.save("model.json")
    assert run(["diagnose", "model.json", "a.csv", "-o", "out"]) in (0, 3)
    document = json.loads(Path("out/diagnosis.json").read_text())
    check_schema(document, "diagnosis")
    repeats = document["repeats"]
    assert repeats["pairs"] >= 6 and repeats["joints"] == [joint] and 0.3 < repeats["share"][0] <= 1
    ratio = repeats["rms"][0] / repeats["mismatch_rms"][0]
    assert repeats["share"][0] == pytest.approx(min(ratio**2, 1.0), rel=1e-3) and 3e-3 < repeats["rms"][0] < 1.5e-2
    said = "repeats of the same command differ by"
    assert said in " ".join(capsys.readouterr().out.split()) and said in Path("out/report.html").read_text()
