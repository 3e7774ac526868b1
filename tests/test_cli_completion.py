"""Shell completion, and help that names arguments as users do."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest


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
        ("signid identify 3r a.csv --effects armature,visc", ["armature,viscous_friction"]),
        ("signid effects counter", ["counterbalance"]),
        ("signid identify robot.ur", []),  # the shell then completes file names
        ("signid replay 3r rec", []),
    ],
)
def test_names_are_completed(words: str, offered: list[str]) -> None:
    assert completed(words) == offered
