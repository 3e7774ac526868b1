"""Factors do not depend on how a recording is cut into pieces, and never need all of it at once."""

from __future__ import annotations

import tracemalloc
from collections.abc import Callable, Collection
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from factored import RATE, assert_close, desired, states, without

from signid.estimation.least_squares import estimate
from signid.recording import read_recording
from signid.recording.formats import parquet
from signid.recording.sampling import survey
from signid.regression import rows as rows_module
from signid.regression.factors import LAGS, reduce_rows
from signid.regression.motion import Motion, base_rows, regressor
from signid.regression.rows import Rows, read_rows
from signid.regression.session import Options, Part, Session, prepare
from signid.robot import hold, load_robot
from signid.types import Array, Robot

WHOLE = 10**9  # samples


@pytest.fixture(scope="module")
def arm() -> Robot:
    return load_robot("3r")


@pytest.fixture(scope="module")
def columns(arm: Robot) -> dict[str, Array]:
    """A minute of the arm with friction, encoder noise and torque noise."""
    t, q, v, a = states(0)
    noise = np.random.default_rng(1).standard_normal((3, *q.shape))
    torque = Motion(arm, t, q, v, a).load + 0.1 * a + 0.5 * v + 0.8 * np.sign(v) + 0.05 * noise[1]
    return {"t": t, "q": q + 1e-5 * noise[0], "tau": torque, "dq": v, "ddq": a}


def uneven(columns: dict[str, Array]) -> dict[str, Array]:
    shift = np.random.default_rng(2).uniform(-0.2, 0.2, len(columns["t"])) / RATE
    return {**without(columns, "dq", "ddq"), "t": columns["t"] + shift}


CASES: dict[str, tuple[Callable[[dict[str, Array]], dict[str, Array]], Options]] = {
    "computed": (lambda c: without(c, "dq", "ddq"), Options()),
    "recorded": (lambda c: c, Options(derivatives="recorded")),
    "unfiltered": (lambda c: c, Options(derivatives="recorded", cutoff=np.inf)),
    "up to Nyquist": (lambda c: c, Options(derivatives="recorded", cutoff=RATE / 2)),
    "instruments": (desired, Options()),
    "uneven": (uneven, Options()),
}


def ready(arm: Robot, columns: Any, options: Options | None = None) -> Session:
    recording = read_recording(columns, arm)
    return prepare(arm, [recording], [recording], options or Options())


def all_rows(session: Session) -> list[Rows]:
    return [rows for part in session.train for rows in read_rows(session.task, *part)]


def joined(rows: list[Rows]) -> dict[str, Array]:
    """Every signal of consecutive rows as one array."""
    out = {key: np.concatenate([getattr(r, key) for r in rows]) for key in ("t", "q", "v", "a", "torque", "steady")}
    for j in range(3):
        out[f"x{j}"] = np.concatenate([r.columns[j] for r in rows])
        if rows[0].instruments is not None:
            out[f"z{j}"] = np.concatenate([r.instruments[j] for r in rows if r.instruments is not None])
    return out


def cut(rows: Rows, span: slice) -> Rows:
    signals = {key: getattr(rows, key)[span] for key in ("t", "q", "v", "a", "torque", "slope", "steady")}
    return rows._replace(first=rows.first and not span.start, columns=[x[span] for x in rows.columns], **signals)


@pytest.mark.parametrize("case", CASES)
def test_rows_and_factors_are_the_same_whatever_the_window(
    case: str, arm: Robot, columns: dict[str, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    change, options = CASES[case]
    session = ready(arm, change(columns), options)
    monkeypatch.setattr(rows_module, "MIN_WINDOW_SAMPLES", WHOLE)
    expected = all_rows(session)
    assert len(expected) == 1
    reference, whole = joined(expected), session.reduce(session.train)
    for window in (400, 1777, 8192):
        monkeypatch.setattr(rows_module, "MIN_WINDOW_SAMPLES", window)
        found = all_rows(session)
        assert len(found) > 1 and [r.first for r in found] == [True] + [False] * (len(found) - 1)
        for key, values in joined(found).items():
            assert np.array_equal(values, reference[key]), key
        assert_close(session.reduce(session.train), whole, 1e-12)


@pytest.mark.parametrize("case", ["computed", "uneven"])
def test_streaming_from_a_file_changes_nothing(
    case: str, arm: Robot, columns: dict[str, Array], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given = CASES[case][0](columns)
    flat = {"t": given["t"]} | {f"{k}_{j + 1}": given[k][:, j] for k in ("q", "tau") for j in range(3)}
    pl.DataFrame(flat).write_parquet(tmp_path / "arm.parquet")
    monkeypatch.setattr(parquet, "SLAB", 1000)
    memory, stream = ready(arm, given), ready(arm, tmp_path / "arm.parquet")
    expected, found = joined(all_rows(memory)), joined(all_rows(stream))
    assert all(np.array_equal(found[key], expected[key]) for key in expected)
    assert_close(stream.reduce(stream.train), memory.reduce(memory.train), 0.0)


def test_windows_may_be_shorter_than_the_lags(
    arm: Robot, columns: dict[str, Array], monkeypatch: pytest.MonkeyPatch
) -> None:
    session = ready(arm, CASES["computed"][0](columns))
    monkeypatch.setattr(rows_module, "MIN_WINDOW_SAMPLES", WHOLE)
    (rows,) = all_rows(session)
    edges = np.cumsum([0, *(1 + np.arange(len(rows.t)) % 4)])
    pieces = [cut(rows, slice(a, b)) for a, b in zip(edges, edges[1:], strict=False) if a < len(rows.t)]
    assert len(pieces) > 200
    assert_close(reduce_rows(session.task, pieces), session.reduce(session.train), 1e-12)


def test_lags_do_not_reach_across_a_gap(arm: Robot, columns: dict[str, Array]) -> None:
    given, half = CASES["computed"][0](columns), len(columns["t"]) // 2
    torn = {**given, "t": given["t"] + np.where(np.arange(2 * half) < half, 0.0, 1.0)}
    session = ready(arm, torn)
    assert len(session.train[0][1].spans) == 2
    halves = [read_recording({k: x[cut] for k, x in given.items()}, arm) for cut in (slice(half), slice(half, None))]
    parts: list[Part] = [(recording, survey(recording, arm)) for recording in halves]
    both = session.reduce(parts)
    assert_close(both, session.reduce(session.train), 1e-12)
    assert_close(session.reduce(parts[:1]) + session.reduce(parts[1:]), both, 1e-12)


@pytest.mark.parametrize("case", ["computed", "unfiltered", "instruments"])
def test_factors_are_sums_over_the_rows(case: str, arm: Robot, columns: dict[str, Array]) -> None:
    change, options = CASES[case]
    session = ready(arm, change(columns), options)
    got, rows = session.reduce(session.train), joined(all_rows(session))
    assert not rows["steady"].all(), "some rows are masked"
    without_lags = reduce_rows(session.task, all_rows(session), lags=0)
    for j, joint in enumerate(got.joints):
        assert np.array_equal(without_lags.joints[j].grams, joint.grams[:1])
        keep, y = rows["steady"][:, j], rows["torque"][:, j, None]
        plain = np.hstack([rows[f"x{j}"], y])
        z = np.hstack([rows[f"z{j}"], plain] if got.instruments else [plain]) * keep[:, None]
        assert np.allclose(joint.whole, plain.T @ plain, rtol=1e-10, atol=1e-10 * np.abs(joint.whole).max())
        assert joint.total == pytest.approx(y.sum())
        for d in range(LAGS + 1):
            direct = z[d:].T @ z[: len(z) - d]
            assert np.allclose(joint.grams[d], direct, rtol=1e-10, atol=1e-10 * np.abs(direct).max())
            assert joint.counts[d] == np.sum(keep[d:] & keep[: len(keep) - d])


def test_weights_of_rows_leave_the_measure_of_fit_alone(arm: Robot, columns: dict[str, Array]) -> None:
    session = ready(arm, CASES["computed"][0](columns))
    whole = session.reduce(session.train)
    assert_close(session.reduce(session.train, weigh=lambda j, rows: np.ones(len(rows.t))), whole, 1e-12)
    quarter = session.reduce(session.train, weigh=lambda j, rows: np.full(len(rows.t), 0.25))
    for light, full in zip(quarter.joints, whole.joints, strict=True):
        for ours, theirs in ((light.grams, 0.25 * full.grams), (light.whole, full.whole)):
            assert np.abs(ours - theirs).max() <= 1e-12 * np.abs(theirs).max()


@pytest.mark.parametrize("case", ["computed", "unfiltered"])
def test_factors_agree_with_least_squares_on_the_rows(case: str, arm: Robot, columns: dict[str, Array]) -> None:
    change, options = CASES[case]
    session = ready(arm, change(columns), options)
    base, rows = session.task.base, joined(all_rows(session))
    found = estimate(session.reduce(session.train), base)
    stacked, right = [], []
    for j in range(3):
        keep = rows["steady"][:, j]
        wide = np.zeros((int(keep.sum()), base.rank))
        wide[:, session.task.seen(j)] = rows[f"x{j}"][keep]
        stacked.append(wide / found.noise[j])
        right.append(rows["torque"][keep, j] / found.noise[j])
    x = np.vstack(stacked)
    size = np.linalg.norm(x, axis=0)
    direct = np.linalg.lstsq(x / size, np.concatenate(right), rcond=None)[0] / size
    assert np.abs(found.value - direct).max() <= 1e-9 * np.abs(direct).max()


@pytest.mark.parametrize(("name", "joints"), [("panda", range(7)), ("talos_arm", (1, 3, 4)), ("kinova", (0, 3))])
def test_joints_that_are_held_change_no_row(name: str, joints: Collection[int]) -> None:
    robot = load_robot(name)
    still = {joint: 0.02 + 0.01 * k for k, joint in enumerate(robot.joints) if k not in joints}
    robot = hold(robot, still)
    rng = np.random.default_rng(3)
    motion = Motion(robot, np.arange(300.0), *rng.standard_normal((3, 300, len(joints))))
    whole = regressor(motion)
    moving = np.repeat([bool(robot.drive[i].any()) for i in range(robot.model.nv)], 10)
    for wanted in (np.flatnonzero(moving), np.arange(0, whole.shape[2], 3)):
        for j, rows in enumerate(base_rows(motion, (), [wanted] * len(joints))):
            assert np.allclose(rows, whole[:, j, wanted], rtol=1e-12, atol=1e-12 * np.abs(whole).max())


@pytest.mark.slow
def test_memory_does_not_hold_all_rows(
    arm: Robot, columns: dict[str, Array], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(parquet, "SLAB", 2**15)
    given, many = CASES["computed"][0](columns), 25  # minutes
    turns = {"t": np.arange(many * len(given["t"])) / RATE}
    turns |= {f"{k}_{j + 1}": np.tile(given[k][:, j], many) for k in ("q", "tau") for j in range(3)}
    pl.DataFrame(turns).write_parquet(tmp_path / "long.parquet", row_group_size=50_000)
    tracemalloc.start()
    session = ready(arm, tmp_path / "long.parquet")
    factors = session.reduce(session.train)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    every = sum(len(joint.whole) for joint in factors.joints) * 300_000 * 8  # bytes of all rows
    assert session.train[0][1].rows == 300_000
    assert peak < 0.25 * every, f"{peak / 1e6:.0f} MB of {every / 1e6:.0f} MB"
