"""Contents of the wheel and the source archive; files that describe the package agree."""

from __future__ import annotations

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from hatchling.builders.sdist import SdistBuilder
from hatchling.builders.wheel import WheelBuilder

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
EXTRAS = PROJECT["optional-dependencies"]
# pin's own metadata names no module; the viewers need not be installed
CARRIERS = {"pinocchio": ["pin"], "rerun": ["rerun-sdk"], **packages_distributions()}
OF_ROS = {"rclpy", "sensor_msgs"}  # come with ROS 2, from no index of packages


def distributions(requirements: list[str]) -> set[str]:
    """Plain lower-case names of some requirements."""
    return {re.split(r"[\[<>=~! ;]", item)[0].lower().replace("_", "-") for item in requirements}


def imported(path: Path) -> Iterator[tuple[str, bool]]:
    """Top-level module of each absolute import, and whether it is imported as soon as the file is."""
    tree = ast.parse(path.read_text())
    inner = {id(node) for part in ast.walk(tree) if isinstance(part, ast.FunctionDef) for node in ast.walk(part)}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from ((alias.name.split(".")[0], id(node) not in inner) for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.split(".")[0], id(node) not in inner


@pytest.fixture(scope="module")
def wheel() -> list[str]:
    """The files of the wheel, by their place in it."""
    return [file.distribution_path for file in WheelBuilder(str(ROOT)).recurse_included_files()]


def test_the_wheel_holds_the_package_alone(wheel: list[str]) -> None:
    assert [path for path in wheel if not path.startswith("signid/")] == []
    assert {f"signid/{room}README.md" for room in ("", "recording/", "cli/fleet/")} <= set(wheel), "pdoc includes them"
    assert {"signid/py.typed", "signid/__main__.py", "signid/types.py"} <= set(wheel)
    assert [path for path in wheel if "test" in path or path.endswith((".pyc", ".log"))] == []


def test_the_wheel_carries_the_robots(wheel: list[str]) -> None:
    robots = {path.parent.name for path in (ROOT / "robots").glob("*/robot.urdf")}
    assert {f"signid/robots/{robot}/robot.urdf" for robot in robots} <= set(wheel)


def test_the_source_archive_holds_all_that_tests_read() -> None:
    held = {file.distribution_path for file in SdistBuilder(str(ROOT)).recurse_included_files()}
    folders = ("signid", "robots", "tests", "benchmarks", ".pdoc")
    wanted = {path.relative_to(ROOT) for folder in folders for path in (ROOT / folder).rglob("*.*") if path.is_file()}
    kept = {path.as_posix() for path in wanted if "__pycache__" not in path.parts}
    assert {*kept, ".ci/run", ".ci/versions", "README.md", "CHANGELOG.md", "CITATION.cff", "LICENSE"} == held


def test_the_versions_of_python_that_are_tested_are_listed() -> None:
    listed = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)]
    assert listed == re.findall(r'"(3\.\d+) (?:lowest-direct|highest)"', (ROOT / ".ci" / "versions").read_text())
    assert PROJECT["requires-python"] == f">={listed[0]}"
    assert "Operating System :: OS Independent" in PROJECT["classifiers"]


@pytest.mark.slow
def test_imported_packages_are_required() -> None:
    core = distributions(PROJECT["dependencies"])
    optional = core | distributions(
        [item for name in ("ros", "hdf5", "fleet", "viewers", "bench") for item in EXTRAS[name]]
    )
    found = []
    for path in sorted((ROOT / "signid").rglob("*.py")):
        for module, at_once in imported(path):
            names = {name.lower().replace("_", "-") for name in CARRIERS.get(module, [module])}
            if module in OF_ROS and not at_once:
                continue
            if module not in sys.stdlib_module_names and not names & (core if at_once else optional):
                found.append(f"{path.relative_to(ROOT)}: {module} is not required by pyproject.toml")
    assert not found, "\n" + "\n".join(found)


def test_every_requirement_has_a_lower_bound() -> None:
    everything = PROJECT["dependencies"] + [item for items in EXTRAS.values() for item in items]
    assert [item for item in everything if ">=" not in item and not item.startswith("signid[")] == []


def test_version_and_licence_agree() -> None:
    citation = (ROOT / "CITATION.cff").read_text()
    assert f"\nversion: {PROJECT['version']}\n" in citation
    assert f'\n__version__ = "{PROJECT["version"]}"\n' in (ROOT / "signid" / "version.py").read_text()
    assert f"\nlicense: {PROJECT['license']}\n" in citation
    assert (ROOT / "LICENSE").read_text().startswith("BSD 3-Clause License")
    changes = (ROOT / "CHANGELOG.md").read_text()
    assert changes.startswith("# Changelog\n")
    unreleased, *releases = re.split(r"^## ", changes, flags=re.MULTILINE)[1:]
    assert unreleased.startswith("[Unreleased]\n") and releases[0].startswith(f"[{PROJECT['version']}] - ")
    for release in releases:
        kinds = re.findall(r"^### (\w+)$", release, flags=re.MULTILINE)
        assert sorted(set(kinds)) == sorted(kinds), "a release has one section of each kind"


def test_the_command_is_installed() -> None:
    assert PROJECT["scripts"] == {"signid": "signid.__main__:main"}


@pytest.mark.parametrize("mark", ["run", "test"])
def test_the_readme_has_its_set_up_lines(mark: str) -> None:
    blocks = re.findall(rf"^<!-- {mark} line -->\n```\w*\n(.+)\n```$", (ROOT / "README.md").read_text(), re.MULTILINE)
    assert len(blocks) == 1, f"one fenced line after <!-- {mark} line -->"
    assert blocks[0].startswith("python3 -m venv ")
    environment = blocks[0].split()[3]
    assert f"&& {environment}/bin/pip install -q " in blocks[0], "it installs into the environment that it makes"
