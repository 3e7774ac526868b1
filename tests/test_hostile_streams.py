"""Hostile lines of a stream and hostile names in exports: a sentence or a note, never a crash or another program."""

from __future__ import annotations

import ast
import json
from itertools import chain, repeat
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

import signid
from signid.cli.run import run
from signid.errors import RecordingError, RobotError
from signid.output.export import export
from signid.watch import watch

ROBOT = Path(__file__).parents[1] / "robots" / "1r" / "robot.urdf"
GOOD = [json.dumps({"t": k / 100, "q": [k / 1000], "tau": [0.0]}) + "\n" for k in range(60)]


@pytest.mark.parametrize("line", ['{"t": 1' + "0" * 400 + ', "q": [1], "tau": [0]}', '{"t":' + "[" * 100_000])
def test_a_line_without_numbers_is_noted(line: str) -> None:
    events = list(watch("1r", iter([*GOOD[:30], line + "\n", *GOOD[30:]]), quiet=1.0))
    assert any("left out" in getattr(event, "sentence", "") for event in events)


def test_a_line_without_end_and_repeated_columns_are_refused() -> None:
    with pytest.raises(RecordingError, match="line of more than"):
        list(watch("1r", chain(["t,q_1,tau_1\n"], repeat("1" * 100_000, 1000))))
    with pytest.raises(RecordingError, match="twice"):
        list(watch("1r", iter(["t,q_1,tau_1,q_1\n", "0,0,0,0\n"])))


def test_stamps_that_hardly_advance_are_repeated_ones() -> None:
    rows = (f"{5e-324 * k},1,1\n" for k in range(200))
    events = list(watch("1r", chain(["t,q_1,tau_1\n"], rows)))
    assert ["repeated" in getattr(event, "sentence", "") for event in events] == [True, False]


UNREADABLE = {
    "": "no row, only a header, could be watched",
    "x,y,z\n" * 50: "none of the 50 rows could be watched",
    "nan,nan,nan\n" * 50: "none of the 50 rows could be watched",
    "1,2\n" * 50: "none of the 50 rows could be watched",
    "5,1,1\n" * 50: "1 of the 50 rows could be watched",
}


@pytest.mark.parametrize("rows", UNREADABLE)
@pytest.mark.parametrize("way", ["text", "file", "input"])
def test_a_stream_without_readable_rows_is_flagged(
    way: str, rows: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    content = f"t,q_1,tau_1\n{rows}"
    if way == "text":
        assert UNREADABLE[rows] in getattr(list(watch("1r", iter([content])))[-1], "sentence", "")
        return
    (tmp_path / "log.csv").write_text(content)
    with open(tmp_path / "log.csv", "rb") as source:
        monkeypatch.setattr("sys.stdin", source)
        given = ["-"] if way == "input" else [str(tmp_path / "log.csv"), "--follow", "--idle", "0.1"]
        assert run(["watch", "1r", *given, "--json"]) == 3
    assert UNREADABLE[rows] in capfd.readouterr().err


def _named(name: str, folder: Path) -> Path:
    (folder / "r.urdf").write_text(ROBOT.read_text().replace('"joint_1"', quoteattr(name, {"\n": "&#10;"})))
    return folder / "r.urdf"


@pytest.mark.parametrize("name", ["a\nimport os", "a\x7f", "a\u2028b"])
def test_names_of_several_lines_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(RobotError, match="control character"):
        signid.load_robot(_named(name, tmp_path))


@pytest.mark.parametrize("kind", ["function", "arrays", "isaaclab", "mjlab"])
@pytest.mark.parametrize("name", ['"""+__import__("os")+"""', "\\", "*/ x /*", "{0}", "'; import os"])
def test_names_stay_texts_in_exported_python(kind: str, name: str, tmp_path: Path) -> None:
    plain, hostile = (export(signid.load_model(_named(x, tmp_path)), kind).text for x in ("joint_1", name))
    first, second = ([type(node) for node in ast.walk(ast.parse(text))] for text in (plain, hostile))
    assert first == second
