"""A module imports only from lower levels of the package, or from its own folder."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "signid"
LEVELS = (
    "version errors threads deadline plain unfinished registry arrays parameters covariance types",
    "robot formats effects optimisers",
    "recording sampling filters cutoff rigid motion regressor basis residual rows",
    "row_sample factors session course prepare fit discrepancy estimate excitation consistent retrieve laws model "
    "standard simulate estimators rollout excite signs gross reduced",
    "identify check inspect payload diagnose convert gallery",
    "validate",
    "report replay export fleet",
    "demo",
    "cli",
    "__main__",
    "__init__",
)
IN_ORDER = (0, 2, 3)  # in these levels a module may also import those named before it
PLACE = {name: (level, i) for level, names in enumerate(LEVELS) for i, name in enumerate(names.split())}


def imported(node: ast.ImportFrom, folder: tuple[str, ...]) -> list[str]:
    """The modules right below the package that a relative import in this folder of the package reaches."""
    above = node.level - 1
    if above > len(folder):
        return ["what is above the package"]
    base = folder[: len(folder) - above] + tuple(node.module.split(".") if node.module else ())
    return [base[0]] if base else [alias.name for alias in node.names]


def may_import(importer: str, target: str) -> bool:
    if importer == target:
        return True
    if target not in PLACE:
        return False
    (level, i), (below, j) = PLACE[importer], PLACE[target]
    return below < level or (below == level and level in IN_ORDER and j < i)


def violations(source: str, path: str) -> Iterator[str]:
    """One line for each import that the level table forbids; `path` is inside the package: "robot/load.py"."""
    parts = Path(path).with_suffix("").parts
    folder, name = parts[:-1], parts[0]
    if name not in PLACE:
        yield f"signid/{path}: {name} stands at no level of tests/test_levels.py"
        return
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            for alias in node.names:
                if alias.name.split(".")[0] == "signid":
                    yield f"signid/{path}:{node.lineno}: import {alias.name} is absolute"
        elif isinstance(node, ast.ImportFrom) and not node.level:
            if (node.module or "").split(".")[0] == "signid":
                yield f"signid/{path}:{node.lineno}: from {node.module} import is absolute"
        elif isinstance(node, ast.ImportFrom):
            for target in imported(node, folder):
                if not may_import(name, target):
                    yield f"signid/{path}:{node.lineno}: {name} may not import {target}"


def files() -> list[Path]:
    return sorted(PACKAGE.rglob("*.py"))


def test_imports_point_downwards() -> None:
    found = [line for path in files() for line in violations(path.read_text(), path.relative_to(PACKAGE).as_posix())]
    assert not found, "\n" + "\n".join(found)


def test_planted_imports_are_caught() -> None:
    forbidden = {
        "types.py": "from .robot import load",
        "robot/load.py": "def f():\n    from ..motion import build",
        "effects/spring.py": "from ..formats import csv",
        "recording.py": "if TYPE_CHECKING:\n    from .motion import Motion",
        "identify.py": "from . import check",
        "report/page.py": "from .. import cli",
        "motion.py": "from signid.types import Array",
        "basis.py": "import signid.types",
        "model.py": "from . import __version__",
        "filters.py": "from ..elsewhere import thing",
        "helper.py": "",
    }
    for path, source in forbidden.items():
        assert len(list(violations(source, path))) == 1, path


def test_allowed_imports_pass() -> None:
    allowed = {
        "registry.py": "from .errors import OptionError",
        "effects/spring.py": "from .base import TorqueLaw\nfrom . import base\nfrom ..types import View",
        "effects/deep/law.py": "from ..base import TorqueLaw\nfrom ...types import View",
        "residual.py": "from .motion import Motion\nfrom . import types, filters",
        "cli.py": "from .identify import identify\nimport numpy",
        "__init__.py": "from .cli import main",
    }
    for path, source in allowed.items():
        assert not list(violations(source, path)), path


def is_reexport(node: ast.stmt) -> bool:
    """A docstring, an import, a plain name, or what makes imports lazy."""
    if isinstance(node, ast.If):
        return ast.unparse(node.test) == "TYPE_CHECKING" and all(map(is_reexport, node.body)) and not node.orelse
    docstring = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return docstring or isinstance(node, ast.Import | ast.ImportFrom | ast.Assign | ast.AnnAssign)


def test_the_face_of_the_package_only_reexports() -> None:
    face = PACKAGE / "__init__.py"
    if not face.exists():
        return
    source = face.read_text()
    assert len(source.splitlines()) <= 40
    assert [ast.unparse(node) for node in ast.parse(source).body if not is_reexport(node)] == []
