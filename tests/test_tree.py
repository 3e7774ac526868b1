"""What there is is found from the tree: tests by what they test, benchmarks by their names, and what a README names."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
BENCHMARKS = ROOT / "benchmarks"
TOLD = {path: (ROOT / path).read_text(encoding="utf-8") for path in ("README.md", "benchmarks/README.md")}
RUN = re.compile(r"python -m\s+(benchmarks\.[a-z]\w*)")
PATH = re.compile(r"`((?:signid|tests|robots|benchmarks)/[\w./*-]+)`")


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in (ROOT / "signid").glob("*/__init__.py")))
def test_every_folder_has_tests_of_its_name(folder: str) -> None:
    found = [path.stem for path in (ROOT / "tests").glob("test_*.py")]
    assert any(name == f"test_{folder}" or name.startswith(f"test_{folder}_") for name in found)


def test_every_benchmark_and_every_file_that_they_share_is_told() -> None:
    told = TOLD["benchmarks/README.md"]
    asked = set(RUN.findall(told))
    names = {path.stem for path in BENCHMARKS.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    lost = [n for n in names if f"benchmarks.{n}" not in asked and f"`{n}.py`" not in told and f"`{n}/`" not in told]
    assert not lost


@pytest.mark.parametrize("path", TOLD)
def test_every_benchmark_that_is_told_can_be_run(path: str) -> None:
    for name in RUN.findall(TOLD[path]):
        place = ROOT / name.replace(".", "/")
        file = place / "__main__.py" if place.is_dir() else place.with_suffix(".py")
        assert '__name__ == "__main__"' in file.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", TOLD)
def test_every_file_that_is_told_is_there(path: str) -> None:
    named = [name for name in PATH.findall(TOLD[path]) if "NAME" not in name]
    assert not [name for name in named if not any(ROOT.glob(name))]
