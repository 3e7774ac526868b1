"""Manifests: every wrong row is reported in one sentence before any session runs."""

from __future__ import annotations

from pathlib import Path

import pytest
from fleets import manifest

from signid.cli import run
from signid.cli.fleet.manifest import read_manifest
from signid.errors import ManifestError

BAD = {
    "robot,recoding\n3r,a": "'recoding'.*did you mean recording",
    "robot,recording,shade\n3r,a,red": "'shade'.*columns are robot",
    "robot\n3r": "no column recording",
    "": "no column robot and none recording",
    "robot,recording,robot\n3r,a,3r": "a column twice",
    "robot,recording\n": "lists no session",
    "robot,recording\n,a.csv": "line 2: the cell robot is empty",
    "robot,recording\n3r,": "line 2: the cell recording is empty",
    "robot,recording\n3r, ; ": "line 2: the recording ';' names no file",
    "robot,recording\n3r,a,b": "line 2: it has more cells",
    "robot,recording\n3r,--json": "read as an option; write ./--json",
    "robot,recording,task\n3r,a,mend": "task 'mend' is unknown; use one of diagnose, identify",
    "robot,recording,task,reference\n3r,a,identify,b": "reference is not used by identify",
    "robot,recording,like\n3r,a,b": "unknown column 'like'",
    "robot,recording,time\n3r,a,yesterday": "'yesterday' is not a date; write 2026-03-31",
    "robot,recording,session\n3r,a,../up": "'../up' is not a valid folder name",
    "robot,recording\n3r,a\n3r,b\n3r,a": "lines 2, 4: all have the session name 3r_a",
    "robot,recording,name\n3r,a,X\n3r,a,x": "lines 2, 3",
    'robot,recording\n3r,"a': "is not a CSV file",
}


@pytest.mark.parametrize("text", BAD)
def test_a_wrong_manifest_is_refused_in_one_sentence(text: str, tmp_path: Path) -> None:
    (tmp_path / "list.csv").write_text(text, encoding="utf-8")
    with pytest.raises(ManifestError, match=BAD[text]) as caught:
        read_manifest(tmp_path / "list.csv")
    assert len(caught.value.sentences) == 1 and caught.value.sentences[0].startswith("list.csv")


def test_all_wrong_rows_are_reported_before_any_session_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    rows = ["3r,a.csv,,,cure", "3r,b.csv,,,identify", "3r,c.csv,,noon,identify"]
    path, out = manifest(tmp_path, *rows), tmp_path / "out"
    assert run(["fleet", str(path), "-o", str(out)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and "line 2" in lines[0] and "line 4" in lines[1]
    manifest(tmp_path, "3r,b.csv,,,identify", "no_robot,b.csv,,,identify", "robot.urdf,b.csv,,,diagnose")
    assert run(["fleet", str(path), "-o", str(out)]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 2 and "line 3: " in lines[0] and "no_robot" in lines[0] and "line 4: " in lines[1]
    assert not out.exists()
    for words, why in (([], "add -o DIR"), (["-o", str(out), "--scheduler", "tcp://x", "--workers", "2"], "give one")):
        manifest(tmp_path, "3r,manifest.csv,,,identify")
        assert run(["fleet", str(path), *words]) == 2 and why in capsys.readouterr().err


def test_a_row_equals_its_single_command(tmp_path: Path) -> None:
    head = "robot,recording,held_out,reference,columns,actuators,name,time"
    row = "arms/7.urdf,a.csv; b.csv,c.csv,d.csv,map.toml,drives.toml,Ä 7/b,2026-03-31T14:00+02:00"
    (entry,) = read_manifest(manifest(tmp_path, row, head="\ufeff" + head)).entries
    words = "diagnose arms/7.urdf a.csv b.csv --held-out c.csv --reference d.csv --columns map.toml"
    assert entry.arguments(3) == (*words.split(), "--actuators", "drives.toml", "--seed", "3")
    assert entry.session == "Ä-7-b_2026-03-31T14-00-02-00" and entry.day == pytest.approx(20543.5)
