"""API pages from the README's command: all public names, with units and sources, without warnings."""

from __future__ import annotations

import ast
import importlib
import os
import re
import shlex
import subprocess
import sys
from html import unescape
from pathlib import Path

import pytest
from readmes import FENCED, TEXTS, links

import signid
from signid.effects import EFFECTS

pytestmark = pytest.mark.slow

pytest.importorskip("pdoc", reason="pdoc makes the API pages; it comes with signid[dev]")
ROOT = Path(__file__).parents[1]
PACKAGE = ROOT / "signid"
ROOMS = [path for path in TEXTS if path.startswith("signid/") and path.endswith("/README.md")]
PUBLIC = [(name, home[1:].replace(".", "/")) for name, home in signid.NAMES.items()]


@pytest.fixture(scope="module")
def pages(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Pages by name, as they were written."""
    found = re.findall(r"`python -m (pdoc .*) -o api`", (ROOT / "README.md").read_text())
    assert len(found) == 1, "the README has the command once"
    folder = tmp_path_factory.mktemp("api")
    there = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", *shlex.split(found[0]), "-o", str(folder)]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, env=there, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", ""), "no warnings"
    return {path.relative_to(folder).with_suffix("").as_posix(): path.read_text() for path in folder.rglob("*.html")}


def words(page: str, start: str = "", end: str = "") -> str:
    """Text of a page without source listings, from one place to another."""
    page = page[page.index(start) :] if start else page
    page = page[: page.index(end, 1)] if end and end in page[1:] else page
    page = re.sub(r'<div class="pdoc-code codehilite">.*?</pre>\s*</div>', " ", page, flags=re.DOTALL)
    return " ".join(unescape(re.sub(r"<[^>]*>", "", page)).replace("\xa0", " ").split())


def test_every_public_name_has_its_place(pages: dict[str, str]) -> None:
    face = pages["signid"]
    for name, home in PUBLIC:
        assert f'<section id="{name}">' in face and f'<a href="#{name}">' in face
        assert f'<section id="{name}">' in pages[f"signid/{home}"], f"{name} has a page of its own module"
        first = (getattr(signid, name).__doc__ or "").splitlines()[0].replace("`", "")
        assert first in words(face, f'<section id="{name}">', '<section id="'), name
    assert "estimates a model with confidence intervals" in words(face), "the docstring introduces"


def test_pages_begin_with_the_verbs_and_end_with_the_rooms(pages: dict[str, str]) -> None:
    first = ["load_robot", "read_recording", "identify", "diagnose", "simulate", "validate"]
    assert list(signid.NAMES)[:6] == first
    sections = re.findall(r'<section id="([^".]+)">', pages["signid"])
    assert sections[:6] == first and sections[-1] == "rooms"
    types = [name for name in signid.NAMES if isinstance(getattr(signid, name), type)]
    assert sections[-len(types) - 2 : -1] == ["results", *types]
    shown = words(pages["signid"], '<section id="results">', '<section id="')
    assert all(name in shown for name in ("Robot", "Recording", "Identification", "Diagnosis", "Model", "Validation"))
    assert not [name for name in pages if "test" in name]


def test_every_module_and_package_is_introduced(pages: dict[str, str]) -> None:
    names = [path.stem if path.is_file() else path.name for path in PACKAGE.iterdir() if path.name[0] not in "._"]
    modules = [name for name in names if (PACKAGE / name).is_dir() or (PACKAGE / f"{name}.py").is_file()]
    for name in (name for name in modules if name != "robots"):
        first = (importlib.import_module(f"signid.{name}").__doc__ or "").splitlines()[0]
        assert first.replace("`", "") in words(pages[f"signid/{name}"]), name


@pytest.mark.parametrize(
    ("page", "file", "least"),
    [("diagnose", "diagnose/result.py", 15), ("identify", "identify.py", 5), ("types", "types.py", 25),
     ("signs", "signs/result.py", 15), ("estimation/fit_quality", "estimation/fit_quality.py", 4),
     ("regression/session", "regression/session.py", 5)],
)  # fmt: skip
def test_fields_have_their_shapes_and_units(page: str, file: str, least: int, pages: dict[str, str]) -> None:
    source, read, found = (PACKAGE / file).read_text(), words(pages[f"signid/{page}"]), 0
    for node in ast.walk(ast.parse(source)):
        for field in getattr(node, "body", []) if isinstance(node, ast.ClassDef) else ():
            line = source.splitlines()[field.lineno - 1]
            if isinstance(field, ast.AnnAssign) and "  # " in line:
                assert " ".join(line.partition("  # ")[2].split()) in read, line
                found += 1
    assert found >= least


def test_folders_show_their_readmes_and_link_to_each_other(pages: dict[str, str]) -> None:
    for path in ROOMS:
        name = path.removesuffix("/README.md")
        page, shown = pages[name], [words(heading) for heading in re.findall(r"<h[1-6].*?</h[1-6]>", pages[name])]
        for heading in re.findall(r"^#+ (.+)$", FENCED.sub("", TEXTS[path]), re.MULTILINE):
            assert heading.replace("`", "") in shown, f"{name}: {heading}"
        for file, _ in links(path):
            if file.is_relative_to(PACKAGE) and file.name == "README.md":
                target = file.parent.relative_to(ROOT).as_posix()
                relative = os.path.relpath(target, Path(name).parent) + ".html"
                assert target in pages and relative in map(os.path.normpath, re.findall(r'href="([^"#]+)', page))


def test_every_law_has_its_equation_units_and_source(pages: dict[str, str]) -> None:
    table = words(pages["signid/effects"])
    for law in EFFECTS:
        card = words(pages[f"signid/effects/{law.name}"])
        assert law.source and law.equation
        for text in (law.equation, law.source, *(f"{key} [{number.unit}]" for key, number in law.parameters.items())):
            assert " ".join(text.split()) in card and " ".join(text.split()) in table, f"{law.name}: {text}"
    assert '<a href="effects/spring.html">' in pages["signid/effects"]


def test_pages_read_well_and_need_no_network(pages: dict[str, str]) -> None:
    for name, page in pages.items():
        assert not re.search(r'(?:src|<link[^>]*href)="https?:', page), name
        assert "&lt;span" not in page and "|---" not in words(page), name
    assert ") -> Array:" in words(pages["signid/model"]) and "numpy.float64" not in words(pages["signid"])
