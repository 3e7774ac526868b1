"""Output of --help: an example that works, defaults, units, whole sentences."""

from __future__ import annotations

import re
import shlex
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from readmes import TEXTS
from typer.main import get_command

from signid.cli import run
from signid.cli.app import app

GROUP: Any = get_command(app)
COMMANDS = tuple(GROUP.commands)
ORDER = ("simulate", "inspect", "check", "identify", "validate", "effects", "excite", "export", "replay")
FILES = ("-o", "--html", "--urdf", "--mjcf")


def shown(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    monkeypatch.setenv("COLUMNS", "80")
    assert run([*command.split(), "--help"]) == 0
    out, err = capsys.readouterr()
    assert not err
    return out


def example(text: str) -> list[str]:
    """Arguments of the one-line example."""
    found = re.findall(r"^  Example: signid (.+)$", text, re.MULTILINE)
    assert len(found) == 1
    return shlex.split(found[0])


def test_the_command_list_has_a_sentence_for_each_command(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    out = shown("", monkeypatch, capsys)
    lines = re.findall(r"^  (\w+)  +(\S.*)$", out.partition("Commands:")[2], re.MULTILINE)
    assert [name for name, _ in lines] == list(COMMANDS)
    for name, line in lines:
        assert line.endswith(".") and not line.endswith(".."), f"{name}: {line}"


@pytest.mark.parametrize("command", COMMANDS)
def test_help_is_complete(command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    out = shown(command, monkeypatch, capsys)
    assert max(map(len, out.splitlines())) <= 80 and "..." not in out.partition("Arguments:")[0].partition("\n")[2]
    assert "\n\n  Example: " in out and out.rstrip().splitlines()[-1].startswith("  Example: "), "nothing dangles"
    assert "<" not in out and "list[" not in out and "{" not in out.partition("\n")[0], "no types of Python"
    unseeded = ("effects", "convert", "export", "replay", "watch", "data")
    assert "--json" in out and ("--seed" in out) == (command not in unseeded), "where there is chance there is a seed"
    arguments = example(out)
    assert arguments[0] == command
    GROUP.commands[command].make_context(command, arguments[1:])  # it can be read


@pytest.mark.parametrize("command", COMMANDS)
def test_options_state_units_and_defaults(
    command: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    units = {"HZ": "[Hz]", "S": "[s]", "M": "[m]"}
    for option in GROUP.commands[command].params:
        if option.param_type_name != "option" or option.name == "help":
            continue
        help = option.help or ""
        assert help.endswith((".", "].")), f"{option.name}: {help}"
        assert units.get(option.metavar, "") in help, f"{option.name}: {help}"
        optional = option.multiple or option.is_flag or option.default is not None
        shown = any(word in help for word in ("efault", "Needed", "Repeatable"))
        apart = option.name in ("columns", "diagnosis", "html", "torque", "kp", "kd", "urdf", "mjcf", "function")
        assert optional or shown or apart or command == "export", f"{option.name}: {help} shows no default"


@pytest.mark.slow
def test_the_examples_work(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]) -> None:
    monkeypatch.chdir(tmp_path)
    assert " ".join(example(shown("diagnose", monkeypatch, capfd))) in TEXTS["README.md"], "test_readme.py executes it"
    for command in ORDER:
        arguments = example(shown(command, monkeypatch, capfd))
        assert run(arguments) == 0, (arguments, capfd.readouterr().err)
        capfd.readouterr()
        named = [name for option, name in pairwise(arguments) if option in FILES]
        assert all((tmp_path / name).exists() for name in named), named
