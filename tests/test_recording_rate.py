"""Recordings without a column of time: the rate of their rows, the only increasing column, or one sentence."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from example import RECORDING

import signid
from signid.cli import run
from signid.errors import OptionError, RecordingError
from signid.recording import read_recording
from signid.recording.mapping import read_map


@pytest.fixture
def rows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> pl.DataFrame:
    monkeypatch.chdir(tmp_path)
    return pl.read_parquet(RECORDING).head(2000)  # at 250 Hz


@pytest.mark.parametrize("how", ["argument", "map", "clock"])
def test_a_stated_rate_gives_the_recording_that_its_stamps_give(rows: pl.DataFrame, how: str) -> None:
    given = {"argument": None, "map": {"rate": 250}, "clock": {"clock": {"rate": 250}}}[how]
    bare = read_recording(rows.drop("t"), "3r", columns=given, rate=250 if how == "argument" else None)
    whole = read_recording(rows, "3r")
    for mine, theirs in zip(bare.read()[:3], whole.read()[:3], strict=True):
        np.testing.assert_allclose(mine, theirs, atol=1e-12)
    assert "times are those of 250 rows a second, as stated" in bare.notes


def test_every_column_of_time_gives_way_to_a_stated_rate(rows: pl.DataFrame) -> None:
    wrong = rows.with_columns(pl.col("t") * 7, (pl.col("t") * 3).alias("log_time"))
    found = read_recording(wrong, "3r", rate=250)
    np.testing.assert_allclose(found.read().t, np.arange(2000) / 250)
    assert any(note.endswith("not used: t, log_time") for note in found.notes)


def test_commands_take_the_rate(rows: pl.DataFrame, capfd: pytest.CaptureFixture[str]) -> None:
    rows.drop("t").write_csv("bare.csv")
    run("check 3r bare.csv --rate 250 --json".split())
    assert json.loads(capfd.readouterr().out)["recordings"][0]["rate"] == pytest.approx(250)
    run("convert bare.csv --rate 250 -o timed.csv".split())
    assert pl.read_csv("timed.csv")["t"][1] == pytest.approx(0.004)
    run("watch 3r bare.csv --rate 250 --quiet 5 --json".split())
    assert "watching" in capfd.readouterr().out


def test_a_live_stream_counts_its_rows(rows: pl.DataFrame) -> None:
    from signid.watch.sources import Parser

    text = rows.drop("t").write_csv()
    parser = Parser(signid.load_robot("3r"), None, "the stream", 250.0)
    parts = [found.t for part in (text[:5000], text[5000:]) if (found := parser.rows(part)) is not None]
    np.testing.assert_allclose(np.concatenate(parts), np.arange(2000) / 250)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "state the rate of its rows [Hz], --rate 100"),
        ({"idx": pl.int_range(0, pl.len())}, "idx counts the rows; state the rate"),
        ({"xyz": pl.col("t") * 1e3}, 'write t = { column = "xyz", unit = "ms" } into a column map'),
        ({"xyz": pl.col("t") * 1e6 + 1.7e15}, 'write t = { column = "xyz", unit = "us" } into a column map'),
    ],
)
def test_without_a_rate_one_sentence_has_the_ready_line(
    rows: pl.DataFrame, change: dict[str, pl.Expr], words: str, capfd: pytest.CaptureFixture[str]
) -> None:
    rows.with_columns(**change).drop("t").write_csv("bare.csv")
    assert run("identify 3r bare.csv -o out".split()) in (2, 3)
    assert words in capfd.readouterr().err


def test_rates_that_cannot_be(rows: pl.DataFrame, capfd: pytest.CaptureFixture[str]) -> None:
    rows.drop("t").write_csv("bare.csv")
    assert run("identify 3r bare.csv --rate -3 -o out".split()) == 2
    assert "rate = -3.0 is no rate of rows" in capfd.readouterr().err
    with pytest.raises(OptionError, match="is no rate of rows"):
        read_recording(rows, "3r", rate=float("nan"))
    with pytest.raises(RecordingError, match="gives t, so a rate of 100 Hz cannot hold as well"):
        read_map({"t": "stamp", "rate": 100})
