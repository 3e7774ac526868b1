"""Inspection of a description: base parameters and unidentifiable parameters."""

from __future__ import annotations

import pytest

from signid.errors import RobotError
from signid.inspect import inspect
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
