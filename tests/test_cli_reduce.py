"""The command `signid reduce`, and its files as inputs of other commands."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fleets import ARM

import signid
from signid.cli import run
from signid.recording.formats import FORMATS
from signid.regression.factors import LAGS, Node, reduce_rows
from signid.regression.reduced import encode_factors, is_factor_file, reduce


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recording = str(ARM / "recording.parquet")
    assert run(["reduce", "3r", recording, "-o", "day.npz"]) == 0
    assert run(["reduce", "3r", recording, "-o", "cut.npz", "--parts", "2"]) == 0
    assert Path("cut.npz").read_bytes() == Path("day.npz").read_bytes()
    codes = [run(["identify", "3r", *given]) for given in ([recording, "-o", "a"], ["day.npz", "-o", "b"])]
    ours, theirs = (json.loads(Path(place, "identification.json").read_text("utf-8")) for place in "ba")
    assert ours.pop("recordings") == [] and [one["path"] for one in theirs.pop("recordings")] == [recording]
    assert codes[0] == codes[1] and ours["inputs"].pop()["role"] == "factors" and ours == theirs
    assert Path("b/model.json").read_bytes() == Path("a/model.json").read_bytes()
    pages = {place: Path(place, "report.html").read_text("utf-8") for place in "ab"}
    assert "without samples to plot" in pages["b"] and "rms as described" not in pages["b"]
    assert "without samples to plot" not in pages["a"] and "rms as described" in pages["a"]
    capsys.readouterr()
    for words, why in (
        (["identify", "3r", "day.npz", recording, "-o", "c"], "reduce the recording in the same way"),
        (["identify", "3r", "day.npz", "--cutoff", "5", "-o", "c"], "give it to signid reduce"),
        (["identify", "3r", "day.npz", "--held-out", recording, "-o", "c"], "give it to signid reduce"),
        (["identify", "3r", "day.npz", "--robust", "-o", "c"], "give the recordings instead"),
        (["identify", "3r", recording, "--held-out", "day.npz", "-o", "c"], "holds factors"),
        (["diagnose", "3r", "day.npz", "-o", "c"], "holds factors of signid reduce"),
        (["check", "3r", "day.npz"], "only signid identify reads factors; give the recording here"),
        (["convert", "day.npz", "-o", "c.csv"], "holds factors"),
        (["simulate", "3r", "--motion", "day.npz", "-o", "x.npz"], "holds factors"),
        (["reduce", "3r", recording], "add -o FILE.npz"),
        (["reduce", "3r", recording, "-o", "day.csv"], "use a name that ends in .npz"),
        (["reduce", "3r", recording, "-o", "x.npz", "--only", "3"], "write K/N"),
        (["reduce", "3r", recording, "-o", "x.npz", "--scheduler", "tcp://x"], "add --parts"),
    ):
        assert run(words) == 2 and why in capsys.readouterr().err, words
    assert not Path("c").exists() and not Path("x.npz").exists()
    columns = {"t": [0.0, 1.0], "header": [1, 2]}  # a recording may have a column of that name
    np.savez("own.npz", **columns)
    assert not is_factor_file("own.npz") and FORMATS["npz"].open(Path("own.npz")).columns == tuple(columns)


def test_days_add_up_and_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    days = [str(ARM / f"{name}.parquet") for name in ("recording", "held_out")]
    assert run(["reduce", "3r", days[0], "-o", "a.npz"]) == run(["reduce", "3r", days[0], "-o", "again.npz"]) == 0
    assert Path("a.npz").read_bytes() == Path("again.npz").read_bytes()
    assert run(["reduce", "3r", days[1], "--like", "a.npz", "-o", "b.npz"]) == 0
    assert run(["identify", "3r", "a.npz", "b.npz", "-o", "both"]) == 0
    inputs = json.loads(Path("both/identification.json").read_text("utf-8"))["inputs"]
    assert [file["path"] for file in inputs] == [*days, "3r", "a.npz", "b.npz"]


def test_factors_without_held_out_or_training_rows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    robot = signid.load_robot("3r")
    found = reduce(robot, [signid.read_recording(ARM / "recording.parquet", robot)])
    none = {name: (Node(0, 0, reduce_rows(found.task, (), lags)),) for name, lags in (("train", LAGS), ("held_out", 0))}
    for name, empty in none.items():
        Path(f"{name}.npz").write_bytes(encode_factors(replace(found, **{name: empty})))
    assert run(["identify", "3r", "held_out.npz", "-o", "out"]) == 0
    fit = json.loads(Path("out/identification.json").read_text("utf-8"))["fit"]
    assert fit["held_out_rms"] == fit["held_out_r2"] == [None] * 3 and None not in fit["train_rms"]
    assert "nan" not in Path("out/report.html").read_text("utf-8").partition("<script>")[0]
    assert run(["identify", "3r", "train.npz", "-o", "c"]) == 2 and "or is damaged" in capsys.readouterr().err
