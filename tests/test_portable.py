"""Code that works on one system only: text in the machine's encoding, and calls that other systems lack."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("signid", "robots", "benchmarks")
TEXT = {"read_text": 0, "write_text": 1}  # positional arguments before that of the encoding
LINES = {"open": 1, "fdopen": 1, "NamedTemporaryFile": 0, "TemporaryFile": 0}  # those before that of the mode
PROCESSES = {"run", "Popen", "check_output"}
FOREIGN = {"fcntl", "grp", "pty", "pwd", "resource", "termios"}
CALLS = {"fork", "forkpty", "getuid", "geteuid", "killpg", "mkfifo", "setsid", "symlink", "symlink_to"}


def constant(call: ast.Call, position: int, keyword: str) -> object:
    """Value of a literal argument, None if it is absent, its node if it is computed."""
    given = [x.value for x in call.keywords if x.arg == keyword] + call.args[position : position + 1]
    return given[0].value if given and isinstance(given[0], ast.Constant) else next(iter(given), None)


def is_text(call: ast.Call, name: str) -> bool:
    """Whether a call reads or writes text."""
    if name in TEXT:
        return len(call.args) <= TEXT[name]
    if name in PROCESSES:
        return constant(call, 99, "text") is True or constant(call, 99, "universal_newlines") is True
    if name not in LINES:
        return False
    if ast.unparse(call.func) == "os.open":
        return False
    method = name == "open" and isinstance(call.func, ast.Attribute)  # of a path, whose mode comes first
    first = constant(call, 0, "mode") if method else constant(call, LINES[name], "mode")
    usual = "w+b" if name.endswith("TemporaryFile") else "r"
    return isinstance(mode := usual if first is None else first, str) and set(mode) <= set("rwax+t")


def faults(source: str) -> Iterator[str]:
    """System-dependent calls of a module."""
    tree = ast.parse(source)
    tried = {id(node) for part in ast.walk(tree) if isinstance(part, ast.Try) for node in ast.walk(part)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute | ast.Name):
            name = node.func.attr if isinstance(node.func, ast.Attribute) else node.func.id
            if is_text(node, name) and not any(x.arg in ("encoding", None) for x in node.keywords):
                yield f"{node.lineno}: {name} without encoding"
            if name in CALLS:
                yield f"{node.lineno}: {name}"
        if isinstance(node, ast.Import) and node in tree.body and id(node) not in tried:
            yield from (f"{node.lineno}: import {alias.name}" for alias in node.names if alias.name in FOREIGN)


@pytest.mark.parametrize("folder", FOLDERS)
def test_nothing_is_of_one_system(folder: str) -> None:
    found = []
    for path in sorted((ROOT / folder).rglob("*.py")):
        found += [f"{path.relative_to(ROOT).as_posix()}:{fault}" for fault in faults(path.read_text(encoding="utf-8"))]
    assert not found, "\n" + "\n".join(found)


def test_planted_faults_are_found() -> None:
    planted = (
        "path.read_text()",
        "path.write_text('a')",
        "open('a')",
        "open('a', 'w')",
        "path.open()",
        "path.open(mode='a')",
        "os.fdopen(1, 'w')",
        "tempfile.NamedTemporaryFile('w')",
        "subprocess.run(['a'], text=True)",
        "import resource",
        "os.fork()",
    )
    innocent = (
        "path.read_text('utf-8')",
        "path.write_text('a', encoding='utf-8')",
        "open('a', 'rb')",
        "path.open('wb')",
        "form.open(path)",
        "os.open('a', os.O_RDONLY)",
        "os.fdopen(1, 'wb')",
        "tempfile.TemporaryFile(dir='a')",
        "subprocess.run(['a'], capture_output=True)",
        "try:\n    import resource\nexcept ImportError:\n    pass",
        "def f():\n    import resource",
    )
    assert all(list(faults(source)) for source in planted)
    assert [source for source in innocent if list(faults(source))] == []
