"""Pages of mathematics name existing files and functions."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "signid"
ROOMS = ("diagnose", "signs")
NAME = re.compile(r"`([A-Za-z_][\w/]*(?:\.\w+)*)`")
FEWEST = 25  # places that a page names


def definitions(path: Path) -> dict[str, set[str]]:
    """Names that a file defines -> names that these define in turn."""
    found: dict[str, set[str]] = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        inner = {str(x) for child in getattr(node, "body", ()) for x in _targets(child)}
        found |= {name: inner if isinstance(node, ast.ClassDef) else set() for name in _targets(node)}
    return found


def _targets(node: ast.AST) -> Iterator[str]:
    if isinstance(node, ast.FunctionDef | ast.ClassDef):
        yield node.name
    for target in [*getattr(node, "targets", ()), getattr(node, "target", None)]:
        yield from (leaf.id for leaf in ast.walk(target) if isinstance(leaf, ast.Name)) if target else ()


def unresolved(text: str, room: Path) -> Iterator[tuple[str, bool]]:
    """Each file, function or method of the room that a page names, and whether it is there."""
    files = {path.relative_to(room).with_suffix("").as_posix(): path for path in sorted(room.rglob("*.py"))}
    stems = {path.stem: path for path in files.values()}
    classes = {name: inner for path in files.values() for name, inner in definitions(path).items() if inner}
    for name in dict.fromkeys(NAME.findall(text)):
        first, *rest = name.removesuffix(".py").split(".")
        file = files.get(first) if "/" in first else stems.get(first)
        if "/" in first and (room / first).is_dir():
            continue
        if "/" in first or (file is not None and rest):
            there = file is not None and _holds(definitions(file), rest)
            yield name, there
        elif first in classes and rest:
            yield name, rest[0] in classes[first]


def _holds(defined: dict[str, set[str]], rest: list[str]) -> bool:
    return not rest or (rest[0] in defined and (len(rest) == 1 or rest[1] in defined[rest[0]]))


@pytest.mark.parametrize("room", ROOMS)
def test_names_on_pages_of_mathematics_exist(room: str) -> None:
    named = list(unresolved((PACKAGE / room / "README.md").read_text(encoding="utf-8"), PACKAGE / room))
    assert [name for name, there in named if not there] == []
    assert len(named) >= FEWEST


def test_a_missing_name_is_found() -> None:
    text = "`search/stepwise.nothing`, `evidence/nowhere`, `Selection.nothing`, `search/prune.prune`, `signid`"
    assert [name for name, there in unresolved(text, PACKAGE / "diagnose") if not there] == [
        "search/stepwise.nothing",
        "evidence/nowhere",
        "Selection.nothing",
    ]
