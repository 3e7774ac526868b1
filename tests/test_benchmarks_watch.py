"""Plant of the benchmark of watches: pushes and changes act when and where they are planned."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.arms import ARMS, load
from benchmarks.plants.bodies import Body
from benchmarks.plants.control import draw_motion
from benchmarks.watch.__main__ import CHANGES
from benchmarks.watch.plant import PERIOD, Alteration, Push, record

ARM = ARMS[0]


def tau(*events: Push | Alteration) -> np.ndarray:
    robot = load(ARM)
    body = Body(robot.document, robot.joints)
    columns = record(body, ARM.drives, draw_motion(ARM.centre, 2), 2.0, events, 1, noise=0.0)
    return np.column_stack([columns[f"tau_{j + 1}"] for j in range(3)])


@pytest.fixture(scope="module")
def still() -> np.ndarray:
    return tau()


@pytest.mark.parametrize(
    "event",
    [
        Push(1.0, 0.2, 2, (5.0, 5.0, 5.0)),
        Alteration(1.0, "payload", 2, 0.5),
        Alteration(1.0, "viscous_friction", 1, 1.0),
        Alteration(1.0, "coulomb_friction", 0, 1.0),
        Alteration(1.0, "torque_gain", 1, 0.1),
    ],
)
def test_an_event_begins_at_its_time(event: Push | Alteration, still: np.ndarray) -> None:
    change = np.abs(tau(event) - still).max(axis=1)
    begin = round(1.0 / PERIOD)
    assert change[: begin - 1].max() < 1e-9 < 1e-2 < change[begin:].max()


def test_a_ramp_ends_at_its_size() -> None:
    growing = Alteration(10.0, "coulomb_friction", 0, 0.5, 4.0)
    assert [growing.at(t) for t in (9.0, 12.0, 20.0)] == [0.0, 0.25, 0.5]
    assert len(CHANGES) >= 15 and {change.effect for _, change in CHANGES} >= {"payload", "torque_gain"}
