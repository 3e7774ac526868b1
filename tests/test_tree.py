"""The READMEs agree with the tree: tests, benchmarks, files and links."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from readmes import READMES, TEXTS, anchors, links

ROOT = Path(__file__).parents[1]
BENCHMARKS = ROOT / "benchmarks"
RUN = re.compile(r"python -m\s+(benchmarks\.[a-z]\w*)")
PATH = re.compile(r"`((?:signid|tests|robots|benchmarks)/[\w./*-]+)`")


@pytest.mark.parametrize("folder", sorted(path.parent.name for path in (ROOT / "signid").glob("*/__init__.py")))
def test_every_folder_has_tests_of_its_name(folder: str) -> None:
    found = [path.stem for path in (ROOT / "tests").glob("test_*.py")]
    assert any(name == f"test_{folder}" or name.startswith(f"test_{folder}_") for name in found)


def test_every_benchmark_and_every_file_that_they_share_is_documented() -> None:
    text = TEXTS["benchmarks/README.md"]
    asked = set(RUN.findall(text))
    names = {path.stem for path in BENCHMARKS.iterdir() if path.suffix == ".py" or (path / "__init__.py").is_file()}
    lost = [n for n in names if f"benchmarks.{n}" not in asked and f"`{n}.py`" not in text and f"`{n}/`" not in text]
    assert not lost


@pytest.mark.parametrize("path", READMES)
def test_every_benchmark_that_is_named_can_be_run(path: str) -> None:
    for name in RUN.findall(TEXTS[path]):
        place = ROOT / name.replace(".", "/")
        file = place / "__main__.py" if place.is_dir() else place.with_suffix(".py")
        assert '__name__ == "__main__"' in file.read_text(encoding="utf-8")


@pytest.mark.parametrize("path", READMES)
def test_every_file_that_is_named_is_there(path: str) -> None:
    named = [name for name in PATH.findall(TEXTS[path]) if "NAME" not in name]
    assert not [name for name in named if not any(ROOT.glob(name))]


@pytest.mark.parametrize("path", READMES)
def test_links_lead_to_files_and_headings(path: str) -> None:
    for file, anchor in links(path):
        assert file.exists(), file
        assert not anchor or anchor in anchors(file.relative_to(ROOT).as_posix()), f"{file}#{anchor}"


def test_the_main_readme_stays_short_and_links_to_every_room() -> None:
    assert len(TEXTS["README.md"].splitlines()) <= 250
    linked = {
        file.relative_to(ROOT).as_posix() for path in ("README.md", "signid/README.md") for file, _ in links(path)
    }
    assert {path for path in READMES if path.endswith("README.md")} - {"README.md"} <= linked
