"""Bad input: a message of one sentence, exit code 2 and no partial output."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
from bad_input import CASES as FILES, Case
from bad_motions import CASES as MOTIONS

from signid.cli import run

CASES = [*FILES, *MOTIONS]
AS_PROCESS = ("time runs back", "strange option", "two roots")


def lay(case: Case, folder: Path) -> list[str]:
    for name, content in case.files.items():
        (folder / name).write_bytes(content.encode() if isinstance(content, str) else content)
    return shlex.split(case.command)


def judge(case: Case, folder: Path, code: int, out: str, err: str) -> None:
    assert (code, out) == (2, ""), err
    assert err.endswith("\n") and len(err.splitlines()) == 1, err
    assert err.startswith("signid: ") and len(err.strip()) > 20
    assert len(err) <= 400, len(err)
    assert "Traceback" not in err
    assert case.says.lower() in err.lower(), err
    assert sorted(path.name for path in folder.iterdir()) == sorted(case.files), "nothing is left behind"


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_bad_input_gives_one_sentence(
    case: Case, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    code = run(lay(case, tmp_path))
    judge(case, tmp_path, code, *capfd.readouterr())


@pytest.mark.parametrize("name", AS_PROCESS)
def test_bad_input_gives_one_sentence_in_a_process(name: str, tmp_path: Path) -> None:
    (case,) = (case for case in CASES if case.name == name)
    command = [sys.executable, "-m", "signid", *lay(case, tmp_path)]
    there = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=there, check=False)
    judge(case, tmp_path, done.returncode, done.stdout, done.stderr)


def test_enough_bad_inputs_are_tried() -> None:
    assert len(CASES) >= 40
    assert len({case.name for case in CASES}) == len(CASES)
