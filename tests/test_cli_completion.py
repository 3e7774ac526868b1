"""Shell completion, and help that names arguments as users do."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest
from typer.main import get_command

from signid.cli import run
from signid.cli.app import app

COMMANDS = tuple(get_command(app).commands)  # type: ignore[attr-defined]


def completed(words: str) -> list[str]:
    """Words that bash offers for a line."""
    environment = {
        **os.environ,
        "_SIGNID_COMPLETE": "complete_bash",
        "COMP_WORDS": words,
        "COMP_CWORD": str(len(words.split(" ")) - 1),
    }
    done = subprocess.run(
        [sys.executable, "-m", "signid"], env=environment, capture_output=True, text=True, timeout=300
    )
    assert done.stderr == ""
    return done.stdout.split()


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        ("signid ide", ["identify"]),
        ("signid identify emp", ["emps"]),
        ("signid diagnose emp", ["emps"]),
        ("signid identify 3r a.csv --effects armature,visc", ["armature,viscous_friction"]),
        ("signid effects counter", ["counterbalance"]),
        ("signid convert a.csv --robot emp", ["emps"]),
        ("signid identify robot.ur", []),  # the shell then completes file names
        ("signid replay 3r rec", []),
    ],
)
def test_names_are_completed(words: str, offered: list[str]) -> None:
    assert completed(words) == offered


def test_the_script_can_be_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SHELL", "/bin/bash")
    text = subprocess.run(
        [sys.executable, "-m", "signid", "--help"], capture_output=True, text=True, check=True, timeout=60
    ).stdout
    assert "--install-completion" in text and "--show-completion" in text


@pytest.mark.parametrize("command", COMMANDS)
def test_help_shows_no_types_of_python(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run([command, "--help"]) == 0
    out = capsys.readouterr().out
    assert "<" not in out and "list[" not in out and "{" not in out.partition("\n")[0], out
