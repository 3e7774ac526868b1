"""Agreement of parameter intervals between real recordings of one robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from rich.console import Console

from benchmarks.intervals_real import SETS, TARGET, Row, evaluate, share, show


def test_share_counts_differences_within_joint_intervals() -> None:
    values, stds = [np.array([0.0, 0.0, 0.0]), np.array([1.0, 3.0, 9.0])], [np.array([1.0, 1.0, np.inf])] * 2
    every = np.ones(3, bool)
    assert share([(0, 1)], values, stds, every) == 50.0
    assert share([(0, 1)], values, stds, every & [True, False, False]) == 100.0
    assert np.isnan(share([], values, stds, every))


def test_a_row_with_one_small_share_misses_the_target() -> None:
    numbers = dict.fromkeys(("noise_base", "noise_friction", "wider", "seconds"), 1.0)
    good = dict.fromkeys(("base", "friction", "consistent", "consistent_friction"), 95.0)
    assert Row("arm", 2, 0, 1, **good, **numbers).holds
    assert not Row("arm", 2, 0, 1, **{**good, "friction": 92.0}, **numbers).holds
    assert Row("arm", 1, 1, 0, **dict.fromkeys(good, float("nan")), **numbers).holds
    table = show([Row("arm", 1, 1, 0, **dict.fromkeys(good, float("nan")), **numbers)])
    console = Console(width=200, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    console.print(table)
    assert "arm" in console.export_text()


@pytest.mark.parametrize("group", [group for group in SETS if group.name != "pendulum"], ids=lambda group: group.name)
def test_recordings_of_a_real_robot_agree(group: object, data: Path) -> None:
    row = evaluate(group)  # type: ignore[arg-type]
    assert row.pairs >= 1 and row.refused == 0
    assert min(row.base, row.friction, row.consistent, row.consistent_friction) >= TARGET
    assert min(row.noise_base, row.noise_friction) < TARGET  # noise alone does not explain the differences
