"""Black-box benchmark: validation rows, residual fits on toy data, figures, means and data for peers."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import signid
from benchmarks.blackbox import methods
from benchmarks.blackbox.methods import bridge, uniform
from benchmarks.blackbox.run import BASE, Score, SetResult, evaluate, figures, geometric, set_table, summary, totals
from benchmarks.blackbox.task import Answer, Table, Task, one_rate
from benchmarks.concealed_real.sets import columns_of
from signid.robot import robot_from_text

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0 0 -0.3"/>
<mass value="1"/><inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 1 0"/>
<limit lower="-3" upper="3" effort="9" velocity="9"/></joint></robot>"""
NOISE = 0.05


def toy(rows: int, seed: int, size: float = 1.0) -> Table:
    """Rows of one joint with a residual that is a hidden function of its position plus noise."""
    rng = np.random.default_rng(seed)
    motion = rng.uniform(-2, 2, (rows, 3))
    rest = size * np.sin(2 * motion[:, :1]) + NOISE * rng.standard_normal((rows, 1))
    return Table(motion, rest, rest + 5 * motion[:, :1])


def task(training: list[Table], held_out: Table) -> Task:
    robot = SimpleNamespace(prismatic=np.array([False]))
    fields: dict[str, Any] = {"training": training, "held_out": held_out, "name": "toy", "cutoff": 5.0}
    return cast(Task, SimpleNamespace(**fields, joints=("j",), least_squares=SimpleNamespace(robot=robot)))


def rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.nanmean(x**2)))


def needs_trees() -> None:
    pytest.importorskip("sklearn", reason="scikit-learn is not installed; pip install 'signid[bench]'")


def test_validation_rows_are_whole_blocks_of_each_recording() -> None:
    check = methods.validates([toy(300, 0), toy(30, 1)])
    assert len(check) == 330 and 0.15 < check[:300].mean() < 0.25 and 0.15 < check[300:].mean() < 0.25
    assert np.count_nonzero(np.diff(check[:300].astype(int))) == 6  # three blocks, none at an end


@pytest.mark.parametrize("method", [methods.boosted, methods.gaussian])
def test_a_black_box_learns_a_hidden_function(method: Any) -> None:
    needs_trees()
    one = task([toy(900, 0), toy(600, 1)], toy(400, 2))
    assert rms(method(one).residual) < 0.3 * rms(one.held_out.rest)


def test_a_black_box_does_not_fit_noise_and_keeps_missing_rows() -> None:
    needs_trees()
    training, held_out = [toy(900, 0, 0.0), toy(600, 1, 0.0)], toy(400, 2, 0.0)
    training[0].rest[:50], held_out.rest[:7] = np.nan, np.nan
    for method in (methods.boosted, methods.gaussian):
        found = method(task(training, held_out)).residual
        assert np.array_equal(np.isnan(found), np.isnan(held_out.rest))
        assert rms(found) < 1.05 * rms(held_out.rest)


def test_too_few_rows_give_no_fit() -> None:
    needs_trees()
    one = task([toy(methods.LEAST // 2, 0)], toy(100, 1))
    assert np.array_equal(methods.boosted(one).residual, one.held_out.rest)
    assert np.array_equal(methods.gaussian(one).residual, one.held_out.rest)


def test_all_methods_are_evaluated_on_the_same_rows() -> None:
    held_out = toy(100, 0)
    short, lost = held_out.rest.copy(), np.full_like(held_out.rest, np.nan)
    short[:40] = np.nan
    answers = {BASE: Answer(held_out.rest, 1.0), "short": Answer(2 * short, 2.0), "lost": Answer(lost, 3.0)}
    found = evaluate(task([], held_out), answers | {"no": "why"})
    assert found.rows == (60,)
    base, other, nothing, missing = found.scores
    assert base.rms[0] == pytest.approx(rms(held_out.rest[40:])) and other.rms[0] == pytest.approx(2 * base.rms[0])
    assert not nothing.rms and "no finite torque" in nothing.note
    assert not missing.rms and missing.note == "why"


def test_figures() -> None:
    measured = np.array([[1.0], [-1.0], [1.0], [-1.0], [9.0]])
    counts = np.array([[True]] * 4 + [[False]])
    (size,), (r2,) = figures(0.5 * measured, measured, counts)
    assert (size, r2) == pytest.approx((0.5, 0.75))
    assert np.isnan(figures(measured, measured, ~counts & False)[0][0])


def test_means_are_geometric_and_relative_to_least_squares() -> None:
    scores = (Score(BASE, (1.0, 2.0), (0.9, 0.9), 1.0), Score("better", (0.5, 1.0), (0.9, 0.9), 2.0))
    scores = (*scores, Score("partly", (0.5, 8.0), (1.0, 0.0)))
    one = SetResult("one", ("a", "b"), ("N.m", "N.m"), (10, 12), 5.0, scores)
    two = replace(one, name="two", scores=(*scores[:2], Score("partly", note="refused: a reason")))
    found = {x.method: x for x in totals([one, two])}
    assert found[BASE].ratio == 1 and found["better"].ratio == pytest.approx(0.5)
    assert (found["better"].better, found["better"].joints, found["better"].seconds) == (4, 4, 4.0)
    assert found["partly"].ratio == pytest.approx(np.sqrt(0.5 * 4)) and found["partly"].sets == 1
    assert found["better"].shared == pytest.approx(0.5)  # joints of the first set alone
    assert np.isnan(geometric([np.nan, 0.0]))
    assert set_table(two).row_count == 3 and summary(list(found.values())).row_count == 3


def test_recordings_are_resampled_to_one_rate() -> None:
    robot = robot_from_text(PENDULUM, "urdf", "pendulum")
    fast, slow = (np.arange(0, 4, step) for step in (0.002, 0.005))
    given = [signid.read_recording({"t": t, "q": np.sin(t)[:, None], "tau": t[:, None]}, robot) for t in (fast, slow)]
    first, second = one_rate(robot, given)
    columns = columns_of(first)
    assert second is given[1] and np.diff(columns["t"]) == pytest.approx(0.005)
    assert columns["q"][:, 0] == pytest.approx(np.sin(columns["t"]), abs=1e-5)
    assert one_rate(robot, given[:1]) == given[:1]


def test_peers_get_uniform_samples_and_smooth_bridges() -> None:
    t = np.array([0.0, 0.1, 0.35, 0.4, 0.5])
    q, tau = uniform({"t": t, "q": 2 * t[:, None], "tau": np.where(t == 0.1, np.nan, t)[:, None]}, 0.1)
    assert q[:, 0] == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8]) and tau[:, 0] == pytest.approx([0, 0.1, 0.2, 0.3, 0.4])
    between = bridge(np.array([1.0]), np.array([3.0]), 99)[:, 0]
    whole = np.concatenate([[1.0], between, [3.0]])
    assert np.all(np.diff(whole) > 0) and np.diff(whole)[[0, -1]].max() < 1e-4 and between[49] == pytest.approx(2)
