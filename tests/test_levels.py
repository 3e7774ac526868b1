"""Imports point one way: between rooms, between the sub-rooms of a room, and between the files of a folder."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from functools import cache
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "signid"
ROOMS = {  # modules and folders of a folder in the order of the data; one imports only those before it
    "": "version errors typed deadline toml_json registry frozen types servos optimisers robot effects "
    "recording regression model simulation estimation signs faults payload check identify diagnose "
    "validate servo watch output cli __main__ __init__",
    "cli": "app terminal arguments fleet demo commands run __init__",
    "faults": "result channels commands evidence distortions search gravity examine identified __init__",
    "servo": "__init__ given plant simulate fit search zeros identify validate diagnose compare",
    "diagnose": "thresholds data evidence result holdout extend search findings detectable run __init__",
    "output": "__init__ geometry report replay viewers export frames display",
    "output/export": "bodies formats drives urdf mjcf actuators code vendor function loop __init__",
    "output/report": "layout write documents quantities sections pages plots results __init__",
    "estimation": "__init__ fit_quality excitation feasible pbrp repeats least_squares standard estimators",
    "recording": "vocabulary mapping match streams formats source sampling columns joining reading missing gallery "
    "read __init__ convert",
    "simulation": "__init__ plant excite rollout whole_rollout refine",
}
MOST_FOLDERS, MOST_MODULES, MOST_FILES = 16, 15, 14  # below signid/, below signid/, in any folder but effects/
Arrows = Mapping[str, set[str]]  # file -> files that it imports; "robot/load", without .py


@cache
def sources() -> dict[str, str]:
    """Source of every file, by its path below signid/ without .py."""
    return {path.relative_to(PACKAGE).as_posix()[:-3]: path.read_text() for path in sorted(PACKAGE.rglob("*.py"))}


@cache
def parsed(source: str) -> ast.Module:
    """The tree of a source, made once for all tests."""
    return ast.parse(source)


@cache
def import_statements(source: str) -> list[ast.Import | ast.ImportFrom]:
    """Imports anywhere in a source."""
    return [node for node in ast.walk(parsed(source)) if isinstance(node, ast.Import | ast.ImportFrom)]


@cache
def rooms() -> list[Path]:
    """Every folder of the package that can be imported, without the package itself."""
    return [path.parent for path in sorted(PACKAGE.glob("*/**/__init__.py"))]


def arrows(files: Mapping[str, str]) -> dict[str, set[str]]:
    """The files that each file imports anywhere, for type checkers too."""
    return {name: set(imported(name, source, files)) for name, source in files.items()}


def imported(name: str, source: str, files: Mapping[str, str]) -> Iterator[str]:
    for node in import_statements(source):
        if isinstance(node, ast.ImportFrom) and node.level:
            folder = name.split("/")[:-1]
            base = [*folder[: len(folder) - node.level + 1], *(node.module.split(".") if node.module else ())]
            for alias in node.names:
                places = ("/".join([*base, alias.name]), "/".join([*base, alias.name, "__init__"]), "/".join(base))
                yield next((place for place in places if place in files), "/".join([*base, "__init__"]))


def wrong_way(found: Arrows) -> Iterator[str]:
    """One line for each import that goes from one room to a later one."""
    for file, targets in found.items():
        for target in sorted(targets):
            a, b = file.split("/"), target.split("/")
            k = next(k for k in range(len(a)) if k >= len(b) - 1 or a[k] != b[k])
            order = ROOMS.get("/".join(a[:k]), "").split()
            if order and a[k] != b[k]:
                if a[k] not in order or b[k] not in order:
                    yield f"{file} -> {target}: no such room in tests/test_levels.py"
                elif order.index(b[k]) > order.index(a[k]):
                    yield f"{file} -> {target}: {a[k]} comes before {b[k]}"


def absolute(name: str, source: str) -> Iterator[str]:
    """One line for each import of signid that is not relative."""
    for node in import_statements(source):
        if isinstance(node, ast.Import):
            modules = [alias.name for alias in node.names]
        else:
            modules = [] if node.level else [node.module or ""]
        yield from (
            f"{name}:{node.lineno}: {module} is absolute" for module in modules if module.split(".")[0] == "signid"
        )


def test_imports_go_one_way() -> None:
    found = list(wrong_way(arrows(sources())))
    assert not found, "\n" + "\n".join(found)


def test_no_files_import_each_other_in_a_circle() -> None:
    try:
        TopologicalSorter(arrows(sources())).prepare()
    except CycleError as error:
        raise AssertionError(" -> ".join(error.args[1])) from None


def test_imports_inside_the_package_are_relative() -> None:
    found = [line for name, source in sources().items() for line in absolute(name, source)]
    assert not found, "\n" + "\n".join(found)


def test_every_room_is_in_the_table() -> None:
    for room, order in ROOMS.items():
        there = {path.stem for path in (PACKAGE / room).iterdir() if path.suffix == ".py" or path in rooms()}
        assert there == set(order.split()), room
    parents = {folder.parent.relative_to(PACKAGE).as_posix() for folder in rooms()}
    assert {parent.removeprefix(".") for parent in parents} == set(ROOMS)


def test_rooms_are_few_and_small() -> None:
    assert len([folder for folder in rooms() if folder.parent == PACKAGE]) <= MOST_FOLDERS
    for folder in (PACKAGE, *rooms()):
        files = [path for path in folder.glob("*.py") if not path.stem.startswith("__")]
        assert len(files) <= (MOST_MODULES if folder == PACKAGE else MOST_FILES) or folder.name == "effects", folder


def test_planted_imports_are_caught() -> None:
    files = {
        "types": "",
        "robot/load": "",
        "cli/files": "",
        "cli/run": "",
        "diagnose/data/rows": "",
        "robot/__init__": "",
    }
    files["diagnose/search/stepwise"] = "from ..data.rows import RowTable"
    assert not list(wrong_way(arrows(files)))
    planted = {
        "types": "from .robot.load import load_robot",
        "cli/files": "def f():\n    from .run import run",
        "robot/load": "if TYPE_CHECKING:\n    from ..cli.run import run",
        "diagnose/data/rows": "from ..search.stepwise import search",
        "elsewhere": "from .types import Array",
    }
    for name, source in planted.items():
        assert len(list(wrong_way(arrows({**files, name: source})))) == 1, name
    assert list(absolute("motion", "from signid.types import Array")) and list(
        absolute("motion", "import signid.types")
    )


def is_reexport(node: ast.stmt) -> bool:
    """A docstring, an import, a plain name, or code for lazy imports."""
    if isinstance(node, ast.If):
        return ast.unparse(node.test) == "TYPE_CHECKING" and all(map(is_reexport, node.body)) and not node.orelse
    docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return docstring or isinstance(node, ast.Import | ast.ImportFrom | ast.Assign | ast.AnnAssign)


def test_package_init_files_only_reexport() -> None:
    source = (PACKAGE / "__init__.py").read_text()
    assert len(source.splitlines()) <= 40
    assert [ast.unparse(node) for node in ast.parse(source).body if not is_reexport(node)] == []
