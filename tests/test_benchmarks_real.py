"""Benchmark on real recordings: targets, tables and one complete robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

import signid
from benchmarks.real import cases
from benchmarks.real.__main__ import show_left, show_repeats, show_rows, show_targets
from benchmarks.real.data import blocks, without
from benchmarks.real.repeat import Repeat, agree
from benchmarks.real.row import Row, Target, within
from signid.model import Model


def repeat(name: str, first: str, value: float, std: float) -> Repeat:
    """Diagnosis of a recording with one cause and one parameter."""
    return Repeat("arm", "nothing", name, "named", first, first, 1.0, {"number": (value, std)}, 1.0)


def test_within_uses_a_relative_tolerance() -> None:
    """The tolerance is relative to the wanted value."""
    assert within("mass", 2.9, 2.805, 0.05).met
    assert not within("mass", 2.6, 2.805, 0.05).met


def test_a_row_without_targets_does_not_hold() -> None:
    """A refusal without target is a miss."""
    row = Row("arm", "payload", "refused", (), (), {}, {}, ("too little",), 0.0, 1.0)
    assert not row.holds
    assert Row("arm", "payload", "named", (), (Target("shown", "1"),), {}, {}, (), 5.0, 1.0).holds


def test_recordings_agree_within_their_intervals() -> None:
    """Same cause, and parameters that agree within their uncertainty."""
    same = [repeat("one", "load", 1.0, 0.1), repeat("two", "load", 1.15, 0.1)]
    assert agree(same).holds
    assert not agree([*same, repeat("three", "lag", 1.1, 0.1)]).same_first
    assert agree([*same, repeat("three", "load", 3.0, 0.1)]).within == {"number": False}


def test_tables_mark_missed_targets() -> None:
    """All tables can be printed."""
    row = Row("arm", "payload", "named", (), (Target("mass", "1 kg", "2 kg", False),), {}, {"j": 1.0}, (), 5.0, 1.0)
    rows = [repeat("one", "load", 1.0, 0.1), repeat("two", "lag", 9.0, 0.1)]
    console = Console(width=160, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(show_rows([row]), show_targets([row]), show_left([row]), show_repeats([rows], [agree(rows)]))
    text = console.export_text()
    assert "NOT MET" in text and "apart: number" in text


def test_blocks_split_a_recording(data: Path, tmp_path: Path) -> None:
    """Every third block is held out, and blocks are disjoint."""
    robot = signid.load_robot(data / "emps_janot" / "emps.urdf")
    whole = signid.read_recording(data / "emps_janot" / "emps_train.csv.gz", robot)
    train, held_out = blocks(whole, robot, 4.0, 3, tmp_path)
    assert (len(train), len(held_out)) == (4, 2)
    ends = sorted((block.read().t[0], block.read().t[-1]) for block in (*train, *held_out))
    assert all(a[1] < b[0] for a, b in zip(ends[:-1], ends[1:], strict=True))


def test_laws_are_removed_and_summed(data: Path) -> None:
    """Model without friction, and total drive parameters in both directions."""
    robot = signid.load_robot("emps")
    train = signid.read_recording(data / "emps_janot" / "emps_train.csv.gz", robot)
    model: Model = signid.identify(robot, [train]).model
    numbers = cases.drive_numbers(model)
    assert np.isclose(numbers["mass"], 95.0, rtol=0.02)
    assert np.isclose(numbers["viscous +"], numbers["viscous -"])
    assert cases.drive_numbers(without(model, ["viscous_friction"]))["viscous +"] == 0


def test_the_drive_is_asymmetric(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Complete run on the smallest robot: cause named, published parameters, better on the pulses."""
    monkeypatch.setenv("SIGNID_DATA", str(data))
    (row,) = cases.emps()
    assert row.findings[0].effect == "asymmetric_friction"
    assert row.holds, [t for t in row.targets if not t.met]
