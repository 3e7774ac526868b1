"""Files with their own rates and clocks become the recording of one table."""

from __future__ import annotations

import json
import shlex
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from bags import START, state, store, write2
from swing import csv
from test_recording_convert import same
from test_recording_formats import sentence

import signid
from signid.cli import run
from signid.recording import read_recording
from signid.recording.convert import Conversion, convert
from signid.recording.joining import Files
from signid.types import Array

EPOCH = 1.7e9  # [s]
PARTS = ((1.1, 0.35, 0.2), (0.6, 0.8, 1.9), (0.3, 1.7, 0.4), (0.4, 0.137, 0.7))  # amplitude, frequency, phase
T, FAST = np.arange(0, 20, 0.01), np.arange(0, 20, 0.004)


def motion(t: Array, order: int = 0) -> Array:
    """Position, or a derivative of it."""
    return np.sum(
        [a * (2 * np.pi * f) ** order * np.sin(2 * np.pi * f * t + p + order * np.pi / 2) for a, f, p in PARTS], 0
    )


def torque(t: Array) -> Array:
    v = motion(t, 1)
    return 0.5 * motion(t, 2) + 0.8 * v + 1.5 * np.sign(v) + 4 * np.sin(motion(t))


def write(folder: Path, name: str, **columns: Array) -> str:
    pl.DataFrame(columns).write_csv(folder / name)
    return str(folder / name)


def joined(*paths: str, align: bool = False, **offsets: float) -> Conversion:
    return convert(Files(paths, {f"{name}.csv": value for name, value in offsets.items()}, align))


def noted(found: Conversion, *words: str) -> None:
    assert all(any(word in note for note in found.notes) for word in words), found.notes


def refused(capfd: pytest.CaptureFixture[str], line: str, *words: str) -> None:
    assert run(shlex.split(f"convert {line} -o out.csv")) == 2
    error = capfd.readouterr().err.strip()
    assert error.count("\n") == 0 and all(word in error for word in words), error


@pytest.fixture
def positions(tmp_path: Path) -> str:
    return write(tmp_path, "pos.csv", t=T, q_1=motion(T))


def test_files_on_one_clock_are_the_table_of_both(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    tau = torque(T)
    a, b = write(tmp_path, "a.csv", t=T, tau_1=tau), write(tmp_path, "b.csv", t=T, q_1=motion(T))
    whole = write(tmp_path, "whole.csv", t=T, q_1=motion(T), tau_1=tau)
    out = str(tmp_path / "out.csv")
    assert run(["convert", a, b, "-o", out]) == 0
    assert "2000 rows, 20.0 s at 100 Hz, no gap" in " ".join(capfd.readouterr().out.split())
    robot = signid.load_robot("1r")
    same(read_recording(out, robot).read(), read_recording(whole, robot).read())


def test_an_offset_is_recovered_and_removed_only_on_request(positions: str, tmp_path: Path) -> None:
    late = write(tmp_path, "vel.csv", t=FAST - 0.137, dq_1=motion(FAST, 1))
    left = joined(positions, late)
    [file] = left.joined
    assert file.offset == 0.0 and file.estimate == pytest.approx(0.137, abs=1e-3)
    [flag] = left.flags
    sentence(flag, "shows an offset of 0.13")
    assert "--align removes it, and --offset vel.csv=0.13" in flag
    np.testing.assert_allclose(left.columns["dq_1"][5:-5], motion(left.columns["t"] + 0.137, 1)[5:-5], atol=5e-3)
    found = joined(positions, late, align=True)
    assert found.flags == () and found.joined[0].offset == pytest.approx(0.137, abs=1e-3)
    noted(found, "is added to its times (--align)")
    np.testing.assert_allclose(found.columns["dq_1"], motion(found.columns["t"], 1), atol=0.05)
    other_way = joined(
        write(tmp_path, "v.csv", t=T + 0.137, q_1=motion(T)), write(tmp_path, "w.csv", t=FAST, dq_1=motion(FAST, 1))
    )
    assert other_way.joined[0].estimate == pytest.approx(0.137, abs=1e-3)


def test_a_velocity_in_the_file_of_the_rows_is_compared_too(tmp_path: Path) -> None:
    a = write(tmp_path, "a.csv", t=T, q_1=motion(T), dq_2=motion(T, 1))
    b = write(tmp_path, "b.csv", t=FAST - 0.137, q_2=motion(FAST))
    assert joined(a, b).joined[0].estimate == pytest.approx(0.137, abs=1e-3)


@pytest.mark.parametrize("align", [False, True])
@pytest.mark.parametrize("kind", ["dq", "tau"])
def test_no_offset_stays_none(kind: str, align: bool, positions: str, tmp_path: Path) -> None:
    noise = 0.05 * np.random.default_rng(0).standard_normal(len(FAST))
    values = (motion(FAST, 1) if kind == "dq" else torque(FAST)) + noise
    found = joined(positions, write(tmp_path, "b.csv", t=FAST, **{f"{kind}_1": values}), align=align)
    assert found.flags == () and found.joined[0].offset == 0.0
    assert abs(found.joined[0].estimate or 0.0) < 2e-3
    assert any("no offset" in note for note in found.notes) == align
    rows = np.searchsorted(FAST, found.columns["t"][::2] - 1e-9)
    np.testing.assert_array_equal(found.columns[f"{kind}_1"][::2], values[rows])  # every other row is one of both


def test_of_alike_shifts_of_a_periodic_motion_the_smallest_is_removed(tmp_path: Path) -> None:
    a = write(tmp_path, "a.csv", t=T, q_1=np.sin(2 * np.pi * T / 4) + 0.3 * np.sin(np.pi * T))
    v = 0.5 * np.pi * np.cos(2 * np.pi * FAST / 4) + 0.3 * np.pi * np.cos(np.pi * FAST)
    found = joined(a, write(tmp_path, "b.csv", t=FAST - 0.137, dq_1=v), align=True)
    assert found.joined[0].offset == pytest.approx(0.137, abs=1e-3)


def test_epochs_that_do_not_overlap_are_aligned_by_torque(positions: str, tmp_path: Path) -> None:
    found = joined(positions, write(tmp_path, "tau.csv", t=FAST + EPOCH, tau_1=torque(FAST)))
    assert found.joined[0].offset == pytest.approx(-EPOCH, abs=2e-3) and found.flags == ()
    noted(found, "do not overlap", "torque of 1 with the motion")
    assert set(np.rint(found.columns["t"] * 100)) >= set(range(1, 1999))


def test_an_offset_that_cannot_be_estimated_is_asked_for(
    positions: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "b.csv", t=FAST + EPOCH, tau_2=torque(FAST))
    refused(capfd, "pos.csv b.csv", "do not overlap", "--offset b.csv=SECONDS", "-1700000000 lets both begin together")
    found = joined(positions, "b.csv", b=-EPOCH)
    np.testing.assert_allclose(
        found.columns["tau_2"][::2], torque(FAST)[::5][: len(found.columns["t"][::2])], atol=1e-5
    )
    periodic = np.sin(2 * np.pi * T)
    write(tmp_path, "p.csv", t=T, q_1=periodic)
    write(tmp_path, "v.csv", t=T + EPOCH, dq_1=np.cos(2 * np.pi * T))
    refused(capfd, "p.csv v.csv", "the motion repeats itself", "--offset v.csv=SECONDS")
    refused(capfd, "pos.csv b.csv --offset b.csv=5", "does not overlap", "correct --offset")
    refused(capfd, "pos.csv b.csv --offset c.csv=5", "c.csv is none of the files")
    refused(capfd, "pos.csv b.csv --offset b.csv=now", "write --offset b.csv=1.25")
    refused(capfd, "pos.csv --align", "several files")
    refused(capfd, "pos.csv pos.csv", "is given twice")


def test_the_lag_of_a_servo_is_no_offset(positions: str, tmp_path: Path) -> None:
    command = motion(FAST + 0.06)
    for align in (False, True):
        found = joined(positions, write(tmp_path, "cmd.csv", t=FAST, q_des_1=command), align=align)
        assert found.joined[0].offset == 0.0 and found.flags == ()
        noted(found, "shift of 0.06", "the lag of the servo", "is not removed")
        assert found.joined[0].estimate == pytest.approx(0.06, abs=1e-3)
    apart = joined(positions, write(tmp_path, "far.csv", t=FAST + EPOCH, q_des_1=command))
    assert apart.joined[0].offset == pytest.approx(0.06 - EPOCH, abs=1e-3)
    assert len(apart.flags) == 1 and "lag of the servo cannot be distinguished" in apart.flags[0]


def test_one_file_a_joint(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    q, tau = motion(T), torque(T)
    write(tmp_path, "elbow.csv", time=T, position=q, torque=tau)
    pl.DataFrame({"t": T, "pos [deg]": np.degrees(2 * q), "effort": -tau, "index": T}).write_csv("wrist.csv")
    assert run(shlex.split("convert elbow.csv wrist.csv -o out.csv --json")) == 0
    document = json.loads(capfd.readouterr().out)
    assert [joint["name"] for joint in document["joints"]] == ["elbow", "wrist"]
    assert [file["path"] for file in document["inputs"]] == ["elbow.csv", "wrist.csv"]
    assert document["joined"] == [{"path": "wrist.csv", "offset": 0.0, "estimate": None, "std": None}]
    out = pl.read_csv("out.csv")
    for name, wanted in {
        "t": T,
        "q_elbow": q,
        "tau_elbow": tau,
        "q_wrist": 2 * q,
        "tau_wrist": -tau,
        "index": T,
    }.items():
        np.testing.assert_allclose(out[name].to_numpy(), wanted, rtol=1e-12, err_msg=name)
    alone = convert("elbow.csv")
    assert "position" in alone.columns and "q_elbow" not in alone.columns
    parted = joined(write(tmp_path, "p.csv", t=T, position=q), write(tmp_path, "f.csv", t=T, torque=tau))
    assert set(parted.columns) == {"t", "position", "torque"}, "neither file is that of a joint"


def test_a_drafted_reading_serves_the_joined_files(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.csv", stamp_ms=1e3 * T, joint1_pos_deg=np.degrees(motion(T)))
    write(tmp_path, "b.csv", t=T, joint1_trq=torque(T))
    assert run(shlex.split("convert a.csv b.csv --robot 1r -o out.csv")) == 0
    assert "Reading of a.csv + b.csv" in capfd.readouterr().out
    samples = read_recording("out.csv", signid.load_robot("1r")).read()
    np.testing.assert_allclose(samples.q[:, 0], motion(T), atol=1e-9)


def test_gaps_missing_rows_and_repeated_ones(tmp_path: Path) -> None:
    a = write(tmp_path, "a.csv", t=T, q_1=motion(T))
    kept = (FAST < 5) | (FAST > 6)
    kept[::7] &= FAST[::7] > 10  # single rows are missing
    t, tau = FAST[kept], torque(FAST)[kept]
    order = np.r_[0, 0, np.arange(len(t))]
    order[[50, 51]] = order[[51, 50]]
    found = joined(a, write(tmp_path, "b.csv", t=t[order], tau_1=tau[order]))
    lacking = np.isnan(found.columns["tau_1"])
    inside = (found.columns["t"] > 4.997) & (found.columns["t"] < 6.003)
    np.testing.assert_array_equal(lacking, inside)
    smooth = np.abs(np.diff(np.sign(motion(found.columns["t"], 1)), append=0)) == 0
    sure = ~lacking & smooth & ~np.roll(~smooth, 1)
    np.testing.assert_allclose(found.columns["tau_1"][sure], torque(found.columns["t"])[sure], atol=0.02)
    noted(
        found, "2 rows with the time of the previous one: omitted", "1 row out of order", "101 joined rows lack a value"
    )
    assert found.flags == ()


def test_units_of_time_differ(positions: str, tmp_path: Path) -> None:
    wanted = torque(FAST)[::5][:1000]
    for name, t in (("t", FAST * 1e3), ("time_us", FAST * 1e6), ("t [ms]", FAST * 1e3)):
        found = joined(positions, write(tmp_path, "b.csv", **{name: t, "tau_1": torque(FAST)}))
        np.testing.assert_allclose(found.columns["tau_1"][::2], wanted, atol=1e-9)
    noted(found, "b.csv: interpolated at the times of")
    bare = joined(positions, write(tmp_path, "b.csv", t=np.rint(FAST * 1e3), tau_1=torque(FAST)))
    noted(bare, "is read in ms, because it steps by 4, which cannot be seconds")


def test_a_signal_in_two_files_and_other_faults(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write(tmp_path, "a.csv", t=T, q_1=motion(T), note=T)
    write(tmp_path, "b.csv", t=T, q_1=motion(T), tau_1=motion(T))
    refused(capfd, "a.csv b.csv", "a.csv and b.csv both have the signal q_1")
    write(tmp_path, "c.csv", t=np.r_[T, T], tau_1=np.r_[T, T])
    refused(capfd, "a.csv c.csv", "c.csv", "jumps back by 20 s after row 2000")
    write(tmp_path, "d.csv", tau_1=T)
    refused(capfd, "a.csv d.csv", "d.csv has no column of time")
    write(tmp_path, "e.csv", t=T[:1], tau_1=T[:1])
    refused(capfd, "a.csv e.csv", "fewer than two different values")
    refused(capfd, "a.csv missing.csv", "missing.csv does not exist")
    refused(capfd, "a.csv b.csv --topic x", "has topics")
    Path("out.csv").unlink(missing_ok=True)
    short = joined("a.csv", write(tmp_path, "f.csv", t=T[:500], tau_1=T[:500], note=T[:500]))
    assert short.flags and "only 500 of its 2000 rows" in short.flags[0]
    assert {"note of a", "note of f"} <= set(short.columns)


def test_wrapped_positions_are_not_averaged(tmp_path: Path) -> None:
    turns = np.arange(0, 20, 0.003)
    a = write(tmp_path, "a.csv", t=T, q_1=motion(T))
    b = write(tmp_path, "b.csv", **{"t": turns, "q_2 [deg]": np.degrees(np.mod(turns, 2 * np.pi))})
    found = joined(a, b).columns
    step = np.abs(np.mod(found["q_2"] - found["t"] + np.pi, 2 * np.pi) - np.pi)
    assert step.max() < 2e-3


def test_a_bag_and_dates_keep_their_epoch(tmp_path: Path) -> None:
    known, t = store(), T[:500]
    messages = [
        ("/js", state(known, START + round(s * 1e9), ["joint_1"], [q], [], []), START + round(s * 1e9))
        for s, q in zip(t, motion(t), strict=True)
    ]
    write2(tmp_path / "bag", known, messages)
    dates = (START + np.rint((t + 1) * 1e9).astype(np.int64)).astype("datetime64[ns]")
    pl.DataFrame({"t": dates, "tau_joint_1": t}).write_parquet(tmp_path / "b.parquet")
    Path(tmp_path / "c.csv").write_text(csv({"t": t, "temp_joint_1": t}))
    found = joined(str(tmp_path / "bag"), str(tmp_path / "b.parquet"))
    np.testing.assert_allclose(found.columns["t"], t[100:], atol=1e-9)
    np.testing.assert_allclose(found.columns["tau_joint_1"], t[100:] - 1, atol=1e-9)
