"""Plant of the benchmark of watches: pushes and changes act when and where they are planned."""

from __future__ import annotations

import numpy as np
import pytest

import signid
from benchmarks.arms import ARMS, load
from benchmarks.plants.bodies import Body
from benchmarks.plants.control import Table, draw_motion
from benchmarks.watch.__main__ import CHANGES, _stopping
from benchmarks.watch.damage import damaged
from benchmarks.watch.plain import residual
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


def test_the_plain_observer_follows_an_external_torque() -> None:
    model, t = signid.load_model("3r"), np.arange(0.0, 2.0, 1e-3)
    angle = 3 * t[:, None] + np.arange(3)
    q, v, a = 0.4 * np.sin(angle), 1.2 * np.cos(angle), -3.6 * np.sin(angle)
    tau = model.torque(q, v, a) + np.where(t > 1.0, 1.0, 0.0)[:, None] * np.array([0.0, 2.0, -1.0])
    found = residual(model, t, q, tau)
    assert np.abs(found[(t > 0.2) & (t < 1.0)]).max() < 0.1
    assert np.allclose(np.median(found[t > 1.2], axis=0), [0.0, 2.0, -1.0], atol=0.1)


def test_damaged_columns_lack_rows_and_numbers_and_hold_others() -> None:
    t = np.arange(0.0, 20.0, 1e-3)
    columns = damaged({"t": t, "q_1": t.copy(), "tau_1": -t}, 1)
    assert (
        0.85 < len(columns["t"]) / len(t) < 0.98 and np.abs(columns["t"] - np.interp(columns["t"], t, t)).max() < 1e-3
    )
    assert 0.002 < np.isnan(np.column_stack([columns["q_1"], columns["tau_1"]])).any(axis=1).mean() < 0.01
    assert 0.01 < np.diff(columns["t"]).max() < 0.21 and (np.diff(columns["q_1"]) == 0).sum() > 50
    assert np.array_equal(columns["q_1"], damaged({"t": t, "q_1": t.copy(), "tau_1": -t}, 1)["q_1"], equal_nan=True)


def test_a_stop_is_abrupt_and_the_path_is_kept() -> None:
    t = np.arange(0.0, 20.0, 0.01)
    q = np.column_stack([np.sin(t)])
    made = _stopping(Table(t, q, np.column_stack([np.cos(t)]), -q))
    assert np.abs(made.v[(t > 7.4) & (t < 8.7)]).max() < 1e-9 < np.abs(made.a[(t > 7.3) & (t < 7.4)]).max()
    assert np.allclose(np.gradient(made.q[:, 0], t)[1:-1], made.v[1:-1, 0], atol=0.1)
