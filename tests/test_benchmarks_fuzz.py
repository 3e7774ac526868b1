"""A small campaign of fuzzing without findings, and a supervisor that finds what it is for."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.fuzz.__main__ import counts, show
from benchmarks.fuzz.campaign import run_campaign
from benchmarks.fuzz.sources import TOKENS, readers
from benchmarks.fuzz.worker import content_of, give

FAULTY = """
import os, time
from benchmarks.fuzz.readers import Reader
from signid.errors import RecordingError
TOKENS = (b"x",)
CALLS = [0]

def after_the_seed(act):
    def read(path):
        if path.read_bytes() != b"seed 1":
            act()
    return read

def refuse(): raise RecordingError("refused")
def ends(): os.abort()
def fails(): raise KeyError("q_1")
def fills(): bytearray(10**11)
def prints(): os.write(2, b"thread panicked at lib.rs")
def silent(): raise RecordingError(" ")

def readers():
    acts = (refuse, lambda: time.sleep(60), ends, fails, fills, prints, silent)
    names = ("refuse", "hang", "end", "fail", "fill", "print", "silent")
    return tuple(Reader(n, "f.txt", [b"seed 1"], after_the_seed(a)) for n, a in zip(names, acts))
"""


def test_a_small_campaign_finds_nothing() -> None:
    rows = run_campaign(counts(1500), 0, 1)
    findings = [f"{one.reader}, input {one.first}: {one.fault}" for row in rows for one in row.findings.values()]
    assert not findings, "\n".join(findings)
    assert sum(row.inputs for row in rows) == 1500 and all(row.inputs == row.refused + row.accepted for row in rows)
    assert {row.reader for row in rows} == {reader.name for reader in readers()}
    assert show(rows).row_count == len(rows) + 1


def test_inputs_follow_from_seed_reader_and_number() -> None:
    reader = readers()[0]
    contents = [content_of(reader, TOKENS, seed, number) for seed in (0, 1) for number in range(20)]
    assert len(set(contents)) > 35
    assert contents == [content_of(reader, TOKENS, seed, number) for seed in (0, 1) for number in range(20)]


def test_shares_add_up() -> None:
    assert sum(counts(1_000_000).values()) == 1_000_000 and min(counts(1_000_000).values()) >= 100
    assert counts(10, ["URDF"]) == {"URDF": 10}


def test_hangs_ends_and_noise_are_found_and_the_campaign_continues(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "faulty_readers.py").write_text(FAULTY)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    names = ("refuse", "hang", "end", "fail", "fill", "print", "silent")
    rows = run_campaign(dict.fromkeys(names, 1), 0, 1, module="faulty_readers", wall=5.0)
    faults = {row.reader: " ".join(row.findings) for row in rows}
    assert all(row.inputs == 1 for row in rows), rows
    words = {
        "hang": "over 5 s",
        "end": "SIGABRT",
        "fail": "KeyError",
        "fill": "MemoryError",
        "print": "printed",
    }
    assert not faults["refuse"] and "without message" in faults["silent"]
    assert all(word in faults[name] for name, word in words.items()), faults


FOUND = [("motion", 22), ("diagnosis.json", 516), ("laws", 468), ("names of columns", 262), ("names of columns", 792)]
FOUND += [("actuators", 5122), ("factors, arrays", 498)]


@pytest.mark.parametrize(("name", "number"), FOUND)
def test_inputs_that_were_findings_are_refused(name: str, number: int, tmp_path: Path) -> None:
    """Huge numbers in a motion and a diagnosis, numbers of 200,000 digits, names of 200,000 characters."""
    (reader,) = (reader for reader in readers() if reader.name == name)
    assert give(reader, content_of(reader, TOKENS, 0, number), tmp_path) == (False, "")
