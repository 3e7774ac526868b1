"""What the README shows is so; numbers in its extract may differ, words may not."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from signid.cli import run

ROOT = Path(__file__).parents[1]


def readme(start: str, language: str = "") -> list[str]:
    """Lines of the first block of the README whose first line begins so."""
    blocks = re.findall(r"^```(\w*)\n(.*?)^```$", (ROOT / "README.md").read_text(), re.MULTILINE | re.DOTALL)
    return next(block for kind, block in blocks if kind == language and block.startswith(start)).splitlines()


@pytest.mark.parametrize(
    ("start", "code"),
    [
        ("$ signid demo", 0),
        ("$ signid identify 3r robots", 0),
        ("$ signid diagnose 3r recording.csv", 3),
        ("$ signid payload 3r --without bare.csv --with recording.csv", 0),
        ("$ signid replay 3r recording.csv", 0),
        ("$ signid identify 3r recording.csv --unsigned", 0),
        ("$ signid export result/model.json", 0),
        ("$ signid fleet manifest.csv", 3),
        ("$ signid data", 0),
    ],
)
def test_the_extract_in_the_readme_is_what_is_printed(
    start: str, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    def form(text: str) -> str:
        return " ".join(re.sub(r"(?<![\w.])-?\d[\d.]*", "#", text).split())

    command, *extract = readme(start)
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("SIGNID_DATA", raising=False)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "robots").symlink_to(ROOT / "robots")
    if "recording.csv" in start:
        for line in "\n".join(readme("signid excite", "sh")).replace("\\\n", "").splitlines():
            assert run(line.split()[1:]) == 0
        if "diagnosis/" in command:
            assert run(readme("$ signid diagnose 3r")[0].split()[2:]) == 3
        capfd.readouterr()
    if "manifest.csv" in start:
        (tmp_path / "manifest.csv").write_text("\n".join(readme("robot,recording", "csv")))
    if "bare.csv" in start:
        assert run("\n".join(readme("signid simulate 3r", "sh")).replace("\\\n", "").split()[1:]) == 0
        capfd.readouterr()
    if "model.json" in start:
        assert run(readme("$ signid identify 3r robots")[0].split()[2:]) == 0
        capfd.readouterr()
    assert run(command.split()[2:]) == code
    printed, at = form(capfd.readouterr().out), 0
    for line in extract:
        if line != "...":
            at = printed.find(form(line), at)
            assert at >= 0, line


def test_the_python_in_the_readme_runs() -> None:
    starts = ("import signid", "lost = ", "model = ", "text = ", "found = ", "shown = ")
    code = "\n".join(line for start in starts for line in readme(start, "python"))
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, env=there, check=False
    )
    *lines, verdict = done.stdout.splitlines()
    assert (done.returncode, done.stderr) == (0, "") and len(lines) >= 28, "27 lines and the causes"
    drive = ("friction", "armature", "torque_offset")
    assert all(any(name in line for name in drive) and "probability" in line for line in lines[27:])
    assert verdict.startswith("named")


def test_the_readme_lists_the_commands(capfd: pytest.CaptureFixture[str]) -> None:
    listed = re.findall(r"^\| `signid (\w+) ", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert run(["--help"]) == 0
    assert listed == re.findall(r"^  (\w+)  ", capfd.readouterr().out.partition("Commands:")[2], re.MULTILINE)
