"""The READMEs show what signid prints; numbers in their extracts may differ, words may not."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import pytest
from readmes import READMES, TEXTS, Block, blocks, inline
from typer.main import get_command

from signid.cli import run
from signid.cli.app import app

ROOT = Path(__file__).parents[1]
EXTRACTS = [block for block in blocks("") if block.text.startswith("$ signid ")]
SCRIPTS = [block for block in blocks("sh") if block.commands()]
SOURCES = {  # file or folder that a command reads -> beginning of the block that makes it
    "recording.csv": "signid excite 3r",
    "motion.csv": "signid excite 3r",
    "bare.csv": "signid simulate 3r",
    "result/": "$ signid identify 3r robots",
    "loaded/": "$ signid payload 3r",
    "diagnosis/": "$ signid diagnose 3r recording.csv",
    "manifest.csv": "robot,recording",
}
FLAGGED = ("diagnose 3r recording.csv", "export go2 --mjcf")  # commands that end with exit code 3
DRIVE = ("friction", "armature", "torque_offset")  # effects that the description of 3r lacks
DONE: dict[str, Done] = {}


class Done(NamedTuple):
    """A block that was executed."""

    folder: Path
    printed: str


@pytest.fixture
def place(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> pytest.TempPathFactory:
    """Makes folders; the terminal is as wide as in the READMEs."""
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.delenv("SIGNID_DATA", raising=False)
    return tmp_path_factory


def title(block: Block) -> str:
    return f"{block.path}: {block.text.splitlines()[0]}"


def sources(block: Block) -> Iterator[Block]:
    """Blocks that make the files which the commands of a block read."""
    read = " ".join(argument for arguments in block.commands() for argument in arguments)
    starts = [start for name, start in SOURCES.items() if name in read]
    for start in dict.fromkeys(starts):
        if not block.text.startswith(start):
            yield next(made for made in blocks() if made.text.startswith(start))


def execute(block: Block, place: pytest.TempPathFactory, capfd: pytest.CaptureFixture[str]) -> Done:
    """Executes the commands of a block, once, in a folder of its own beside links to the files that they read."""
    key = repr(block.commands()) if block.kind != "csv" else block.text
    if key not in DONE:
        folder = place.mktemp("readme")
        (folder / "robots").symlink_to(ROOT / "robots")
        for file in (path for made in sources(block) for path in execute(made, place, capfd).folder.iterdir()):
            if not (folder / file.name).exists():
                (folder / file.name).symlink_to(file)
        if block.kind == "csv":
            (folder / "manifest.csv").write_text(block.text)
        capfd.readouterr()
        with contextlib.chdir(folder):
            for arguments in block.commands():
                assert run(arguments) == (3 if " ".join(arguments).startswith(FLAGGED) else 0), arguments
        DONE[key] = Done(folder, capfd.readouterr().out)
    return DONE[key]


def test_commands_of_readmes_are_executed() -> None:
    assert len(EXTRACTS) >= 9 and len(SCRIPTS) >= 3
    shown = [block for block in blocks() if re.search(r"^(?:\$ )?signid [a-z]+ ", block.text, re.MULTILINE)]
    assert [title(block) for block in shown if block not in (*EXTRACTS, *SCRIPTS)] == []


@pytest.mark.slow_cases("fleet manifest|signid demo|signid diagnose 3r recording.csv")
@pytest.mark.parametrize("block", EXTRACTS, ids=title)
def test_extracts_agree_with_the_printed_text(
    block: Block, place: pytest.TempPathFactory, capfd: pytest.CaptureFixture[str]
) -> None:
    def form(text: str) -> str:
        return " ".join(re.sub(r"(?<![\w.])-?\d[\d.]*", "#", text).split())

    printed, at = form(execute(block, place, capfd).printed), 0
    for line in block.text.splitlines()[1:]:
        if line != "...":
            at = printed.find(form(line), at)
            assert at >= 0, line


@pytest.mark.slow_cases("diagnose/README")
@pytest.mark.parametrize("block", SCRIPTS, ids=title)
def test_commands_succeed(block: Block, place: pytest.TempPathFactory, capfd: pytest.CaptureFixture[str]) -> None:
    execute(block, place, capfd)


@pytest.mark.slow
def test_python_of_readmes_runs(tmp_path: Path) -> None:
    parts = blocks("python")
    code = "\n".join(f"print('in', {block.path!r})\n{block.text}" for block in parts)
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    (tmp_path / "robots").symlink_to(ROOT / "robots")
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env=there, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    first, *others = done.stdout.split("in README.md\n")[1].split("\nin ")
    *lines, verdict = first.splitlines()
    assert len(lines) >= 26 and all(" +- " in line for line in lines[:25]), "25 base parameters and the causes"
    assert all(any(name in line for name in DRIVE) and "probability" in line for line in lines[25:])
    assert verdict.startswith("named")
    assert [text.split()[0] for text in others] == [block.path for block in parts[1:]]
    assert any(text.startswith("signid/simulation/README.md\n[") for text in others), "errors of a roll-out"


def test_the_readme_lists_the_commands(capfd: pytest.CaptureFixture[str]) -> None:
    listed = re.findall(r"^\| `signid (\w+) ", TEXTS["README.md"], re.MULTILINE)
    assert run(["--help"]) == 0
    assert listed == re.findall(r"^  (\w+)  ", capfd.readouterr().out.partition("Commands:")[2], re.MULTILINE)


@pytest.mark.parametrize("path", READMES)
def test_inline_commands_have_known_options(path: str) -> None:
    group: Any = get_command(app)
    for code in (code for code in inline(path) if re.match(r"signid [a-z]+\b", code)):
        _, name, *arguments = code.split()
        assert name in group.commands, code
        known = {option for parameter in group.commands[name].params for option in parameter.opts}
        assert {argument for argument in arguments if argument.startswith("-")} <= {*known, "--help"}, code
