"""`signid reduce`, and its files where recordings may stand."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from fleets import ARM

from signid.cli import run


def test_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    recording = str(ARM / "recording.parquet")
    assert run(["reduce", "3r", recording, "-o", "day.npz"]) == 0
    assert run(["reduce", "3r", recording, "-o", "cut.npz", "--parts", "2"]) == 0
    assert Path("cut.npz").read_bytes() == Path("day.npz").read_bytes()
    codes = [run(["identify", "3r", *given]) for given in ([recording, "-o", "a"], ["day.npz", "-o", "b"])]
    ours, theirs = (json.loads(Path(place, "identification.json").read_text("utf-8")) for place in "ba")
    assert codes[0] == codes[1] and ours["inputs"].pop()["role"] == "factors" and ours == theirs
    assert Path("b/model.json").read_bytes() == Path("a/model.json").read_bytes()
    assert "there are no samples to draw" in Path("b/report.html").read_text("utf-8")
    capsys.readouterr()
    for words, why in (
        (["identify", "3r", "day.npz", recording, "-o", "c"], "reduce the recording like those"),
        (["identify", "3r", "day.npz", "--cutoff", "5", "-o", "c"], "give it to signid reduce"),
        (["identify", "3r", "day.npz", "--held-out", recording, "-o", "c"], "give it to signid reduce"),
        (["diagnose", "3r", "day.npz", "-o", "c"], "no column"),
        (["reduce", "3r", recording], "add -o FILE.npz"),
        (["reduce", "3r", recording, "-o", "day.csv"], "let its name end in .npz"),
        (["reduce", "3r", recording, "-o", "x.npz", "--only", "3"], "write K/N"),
        (["reduce", "3r", recording, "-o", "x.npz", "--scheduler", "tcp://x"], "add --parts"),
    ):
        assert run(words) == 2 and why in capsys.readouterr().err, words
    assert not Path("c").exists() and not Path("x.npz").exists()
