"""Results agree to the digits that signid/README.md states, whatever BLAS kernel the processor gets."""

from __future__ import annotations

import json
import re
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from kernels import available, run_python, several

from signid.cli import run

AGREE = 1e-6  # difference over the largest number of its kind, and over the standard deviation of an estimate
RECORD = "simulate 3r --duration 10 --inject coulomb_friction@2:level=1.2 --noise 0.02 --encoder-bits 17 -o r.csv"
COMMANDS = {"identify": "identify 3r ../r.csv -o .", "diagnose": "diagnose 3r ../r.csv -o ."}


@pytest.fixture(scope="module")
def results(tmp_path_factory: pytest.TempPathFactory) -> dict[tuple[str, str], Path]:
    """Folder of the results of each command under each kernel."""
    folder = tmp_path_factory.mktemp("kernels")
    assert run([*RECORD.split()[:-1], str(folder / "r.csv")]) == 0
    made = {}
    for kernel in available()[-2:]:
        for name, command in COMMANDS.items():
            made[name, kernel] = place = folder / f"{name}_{kernel}"
            place.mkdir()
            run_python(kernel, ["-m", "signid", *command.split()], place)
    return made


def leaves(content: Any, place: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(content, dict | list):
        pairs = content.items() if isinstance(content, dict) else enumerate(content)
        for key, value in pairs:
            yield from leaves(value, f"{place}/{key}")
    else:
        yield place, content


def is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def kind(place: str) -> str:
    return re.sub(r"/(\d+|link_\d+)(?=/|$)", "/", place)


@pytest.mark.slow
@several
@pytest.mark.parametrize("command", COMMANDS)
def test_all_numbers_agree(command: str, results: dict[tuple[str, str], Path]) -> None:
    first, second = (folder for (name, _), folder in results.items() if name == command)
    files = sorted(path.name for path in first.glob("*.json"))
    assert len(files) == 2 and files == sorted(path.name for path in second.glob("*.json"))
    for file in files:
        one, other = (dict(leaves(json.loads((folder / file).read_text()))) for folder in (first, second))
        largest: dict[str, float] = defaultdict(float)
        for place, value in one.items():
            if is_number(value):
                largest[kind(place)] = max(largest[kind(place)], abs(value))
        assert one.keys() == other.keys() and len(largest) > 10, file
        for place, value in one.items():
            if not is_number(value):
                assert other[place] == value, (file, place)
                continue
            assert abs(other[place] - value) <= AGREE * largest[kind(place)], (file, place, value, other[place])
            std = one.get(re.sub(r"/(value|estimate)$", "/std", place))
            if std and place.endswith(("/value", "/estimate")):
                assert abs(other[place] - value) <= AGREE * std, (file, place, value, other[place])
