"""The audit names shifts of rows, lost signs, other zeros, and episodes or files that differ from the others."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from servo_logs import Columns, audit, drive, recording

from signid.cli.run import run
from signid.faults.commands import audit_flags, audit_servos
from signid.recording import read_bare
from signid.robot import load_robot
from signid.types import Recording

RATE, EPISODES, ODD = 50.0, 20, 7
SPEEDS, SIZES, PLACES = (12.0, 25.0, 18.0), (1.0, 0.6, 1.4), (0.2, -0.4, 1.0)  # of joints 1, 2, 3


@pytest.mark.parametrize("seconds", [1.0, 1.5, -1.0, -1.5])
def test_columns_of_different_rows_are_named_with_the_time_between_them(seconds: float) -> None:
    columns, healthy = drive(), audit(drive())
    rows = round(abs(seconds) * 100)
    first, last = ("q_a", "q_des_a") if seconds < 0 else ("q_des_a", "q_a")
    found = audit({"t": columns["t"][rows:], first: columns[first][rows:], last: columns[last][:-rows]})
    assert found.shift == pytest.approx(healthy.shift + seconds, abs=0.005)
    [flag] = found.flags
    size = f"{1e3 * abs(found.shift):.0f} ms"
    assert flag.startswith(f"a answers {size} after its command" if seconds > 0 else f"a: q leads q_des by {size}")


def test_a_period_of_the_motion_is_no_shift() -> None:
    t = np.arange(3000) / 100
    q, c = (np.sin(2 * np.pi * (t - late)) for late in (0.08, 0.0))
    assert audit({"t": t, "q_a": q, "q_des_a": c}).shift == pytest.approx(0.08, abs=0.01)


@pytest.mark.parametrize(("change", "name"), [(np.abs, "magnitude"), (np.square, "square")])
def test_columns_without_their_sign(change: Callable[[np.ndarray], np.ndarray], name: str) -> None:
    columns = drive()
    for key, other in (("q", "q_des"), ("q_des", "q")):
        flags = audit({**columns, f"{key}_a": change(columns[f"{key}_a"])}).flags
        assert f"a: {key} is never negative and like the {name} of {other}" in flags[0], flags


def test_another_zero_is_told_from_the_droop_by_a_load() -> None:
    """At a gain of 4 N.m/rad, 0.9 N.m of a horizontal link droops by 0.22 rad, less when it is raised."""
    columns = drive(droop=0.0)
    [flag] = audit({**columns, "q_a": columns["q_a"] + 0.22}).flags
    assert flag.startswith("a stays 0.22 rad above its command")
    loaded = columns["q_a"] - 0.22 * np.cos(columns["q_a"])
    assert not audit({**columns, "q_a": loaded}).flags


@cache
def _episodes(seed: int) -> tuple[Columns, ...]:
    """Motions of three joints that are set at other places and move by other amounts."""
    rng = np.random.default_rng(seed)
    found = []
    for _ in range(EPISODES):
        own: Columns = {}
        for k, (speed, size, place) in enumerate(zip(SPEEDS, SIZES, PLACES, strict=True), 1):
            one = drive(rate=RATE, seconds=8.0, speed=speed, friction=0.004, seed=int(rng.integers(1 << 30)))
            own |= {"t": one["t"], f"q_{k}": size * one["q_a"] + place, f"q_des_{k}": size * one["q_des_a"] + place}
        found.append(own)
    return tuple(found)


def episodes(seed: int) -> list[Columns]:
    return list(_episodes(seed))


def flipped(x: Columns) -> Columns:
    return {**x, "q_2": -x["q_2"]}


def exchanged(x: Columns) -> Columns:
    return {**x, "q_1": x["q_3"], "q_3": x["q_1"]}


def halved(x: Columns) -> Columns:
    return {**x, "q_3": 0.5 * x["q_3"]}


def moved(x: Columns) -> Columns:
    return {**x, "q_1": x["q_1"] + 0.25}


def late(x: Columns) -> Columns:
    return {"t": x["t"][50:], **{key: values[50:] for key, values in x.items() if key != "t"}, "q_2": x["q_2"][:-50]}


def limp(x: Columns) -> Columns:
    return {**x, "q_3": np.full(len(x["t"]), x["q_3"][0])}


CHANGES: dict[Callable[[Columns], Columns], tuple[str, ...]] = {
    flipped: ("2 moves against its command in {}, unlike",),
    exchanged: ("1 follows q_des of 3 in {}, unlike", "3 follows q_des of 1 in {}, unlike"),
    halved: (r"3 moves by 0\.(49|5)\d* of what it does in the others in {}",),
    moved: (r"1 is 0\.2(4|5)\d* rad above its usual place in {}, unlike",),
    late: (r"2 answers (99\d|100\d) ms later in {}, unlike",),
    limp: ("3 does not follow its command in {}, unlike",),
}


def compare(flags: tuple[str, ...], patterns: tuple[str, ...], where: str) -> None:
    assert len(flags) == len(patterns), flags
    for flag, pattern in zip(sorted(flags), patterns, strict=True):
        assert re.match(pattern.format(where), flag), flag


def files(parts: list[Columns]) -> list[Recording]:
    return [replace(recording(part), path=f"run{k}.csv") for k, part in enumerate(parts)]


@pytest.mark.parametrize("change", CHANGES, ids=lambda change: change.__name__)
def test_one_of_many_files_differs(change: Callable[[Columns], Columns]) -> None:
    parts = episodes(1)
    parts[ODD] = change(parts[ODD])
    compare(audit_servos(files(parts)).flags, CHANGES[change], f"run{ODD}.csv")


@pytest.mark.slow
def test_files_and_episodes_that_agree_are_silent() -> None:
    for seed in (1, 2, 3):
        assert not audit_servos(files(episodes(seed))).flags


def lerobot(folder: Path, parts: list[Columns]) -> Path:
    (folder / "meta").mkdir(parents=True)
    (folder / "data" / "chunk-000").mkdir(parents=True)
    names = {"names": ["1.pos", "2.pos", "3.pos"]}
    features = {"observation.state": names, "action": names}
    (folder / "meta" / "info.json").write_text(json.dumps({"fps": RATE, "features": features}))
    tables = [
        pl.DataFrame(
            {
                "observation.state": np.column_stack([np.degrees(part[f"q_{k}"]) for k in (1, 2, 3)]).tolist(),
                "action": np.column_stack([np.degrees(part[f"q_des_{k}"]) for k in (1, 2, 3)]).tolist(),
                "frame_index": np.arange(len(part["t"])),
                "episode_index": np.full(len(part["t"]), 100 + number),
            }
        )
        for number, part in enumerate(parts)
    ]
    pl.concat(tables).write_parquet(folder / "data" / "chunk-000" / "file-000.parquet")
    return folder


@pytest.mark.slow
def test_an_episode_of_a_dataset_is_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    parts = episodes(2)
    assert run(["check", str(lerobot(tmp_path / "good", parts))]) == 0
    parts[ODD] = flipped(parts[ODD])
    folder = lerobot(tmp_path / "set", parts)
    found, units = read_bare(folder)
    compare(audit_servos(found, units).flags, CHANGES[flipped], f"episode {100 + ODD}")
    capsys.readouterr()
    assert run(["check", str(folder)]) == 3
    assert f"in episode {100 + ODD}, unlike in the others" in capsys.readouterr().err


def test_flags_of_the_recordings_of_a_robot() -> None:
    parts = episodes(3)[:5]
    robot = load_robot("3r")
    assert not audit_flags(robot, files(parts))
    parts[2] = {**parts[2], "q_1": -parts[2]["q_1"], "q_2": parts[2]["q_2"] + 0.2}
    first, second = audit_flags(robot, files(parts))
    assert first.startswith("run2.csv: 1 moves against its command") and "others" not in first
    assert re.match(r"2 is 0\.(19|2)\d* rad above its usual place in run2\.csv, unlike in the others", second)
