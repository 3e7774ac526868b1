"""Samples of rows: of bounded size, evenly spread, and the same in whatever order parts are added."""

from __future__ import annotations

from functools import reduce as fold

import numpy as np
import pytest
from factored import columns

import signid
from signid.regression.factors import ROWS, RowSample, sample_rows
from signid.regression.rows import read_rows
from signid.regression.session import Options, Session, prepare
from signid.types import Robot


@pytest.fixture(scope="module")
def robot() -> Robot:
    return signid.load_robot("3r")


def ready(robot: Robot, seconds: float) -> Session:
    recording = signid.read_recording(columns(robot, 0, seconds), robot)
    return prepare(robot, [recording], [recording], Options(cutoff=5.0))


def windows(session: Session) -> list[RowSample]:
    return [sample_rows(session.task, rows) for part in session.train for rows in read_rows(session.task, *part)]


def same(one: RowSample, other: RowSample) -> bool:
    names = ("number", "q", "v", "torque", "slope", "kept", "columns")
    return one.stride == other.stride and all(np.array_equal(getattr(one, n), getattr(other, n)) for n in names)


def test_order_of_addition_does_not_matter(robot: Robot) -> None:
    parts = windows(ready(robot, 400.0))
    assert len(parts) > 5
    forward = fold(lambda a, b: a + b, parts)
    backward = fold(lambda a, b: b + a, reversed(parts))
    half = len(parts) // 2
    pairs = fold(lambda a, b: a + b, parts[:half]) + fold(lambda a, b: a + b, parts[half:])
    assert same(forward, backward) and same(forward, pairs)


@pytest.mark.parametrize("seconds", [60.0, 400.0])
def test_size_is_bounded_and_rows_are_evenly_spread(robot: Robot, seconds: float) -> None:
    session = ready(robot, seconds)
    factors = session.reduce(session.train)
    sample = factors.sample
    assert sample is not None and ROWS // 2 < len(sample.number) <= ROWS
    steps = np.diff(np.sort(sample.number))
    assert np.median(steps) == sample.stride and abs(len(sample.number) * sample.stride / factors.rows - 1) < 0.05
    seen = [session.task.seen(j) for j in range(3)]
    assert [sample.of(j, seen).shape[1] for j in range(3)] == [len(own) for own in seen]
    assert not sample.columns[~sample.kept[:, 0]][:, : len(seen[0])].any()


def test_factors_for_white_noise_have_no_sample(robot: Robot) -> None:
    session = ready(robot, 60.0)
    assert session.reduce(session.train, lags=0).sample is None
