"""Inspection of a description: base parameters and unidentifiable parameters."""

from __future__ import annotations

from io import StringIO

import pytest
from rich.console import Console

from signid.errors import RobotError
from signid.inspect import inspect
from signid.output.report.results.inspection import joint_table
from signid.robot import load_robot, names


def test_inspection_names_unidentifiable_parameters() -> None:
    found = inspect(load_robot("3r"))
    assert {"m_1", "mz_2", "Ixx_1"} <= set(found.invisible)
    assert "Izz_1" in found.combined
    assert not set(found.invisible) & set(found.combined)


@pytest.mark.parametrize("name", sorted(names()))
def test_every_robot_is_inspected_or_refused_in_one_sentence(name: str) -> None:
    try:
        found = inspect(load_robot(name))
    except RobotError as error:
        assert "\n" not in str(error)
        return
    base = found.base
    assert 0 < base.rank <= len(base.labels)
    assert base.condition < 5e3
    assert base.singular_values[base.rank - 1] > 1e3 * (
        base.singular_values[base.rank] if base.rank < len(base.labels) else 0
    )


def test_long_names_of_links_lose_their_middle_and_keep_one_line() -> None:
    robot, console = load_robot("g1"), Console(width=100, file=StringIO(), record=True)
    console.print(joint_table(robot))
    lines = console.export_text().splitlines()
    assert len(lines) == len(robot.joints) + 1
    assert any("…" in line.split()[3] for line in lines)
