"""Rigid-body columns of a fast recording come from sparse samples; the rows equal those of all samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import signid
from signid.recording import read_recording
from signid.regression.bandwidth import Band
from signid.regression.motion import Motion
from signid.regression.rows import Rows, read_rows
from signid.regression.session import Options, Session, prepare
from signid.types import Array

RATE, SECONDS = 1000.0, 20.0


class Dense(Band):
    """A band that uses every sample."""

    @property
    def parts(self) -> int:  # type: ignore[override]
        """All."""
        return 1


def recording(derivatives: bool = False) -> dict[str, Array]:
    """The 3R arm with friction, encoder noise and torque noise."""
    t = np.arange(0, SECONDS, 1 / RATE)
    w = 2 * np.pi * np.array([0.23, 0.71, 1.37])
    rng = np.random.default_rng(0)
    size, phase = rng.uniform(0.1, 0.5, (3, 3)), rng.uniform(0, 6, (3, 3))
    angle = np.multiply.outer(t, w)[:, :, None] + phase
    q, v, a = (
        np.sum(x, axis=1)
        for x in (size * np.sin(angle), w[:, None] * size * np.cos(angle), -(w**2)[:, None] * size * np.sin(angle))
    )
    torque = Motion(signid.load_robot("3r"), t, q, v, a).load + 0.1 * a + 0.5 * v + 0.8 * np.sign(v)
    noise = rng.standard_normal((2, *q.shape))
    columns = {"t": t, "q": q + 1e-5 * noise[0], "tau": torque + 0.05 * noise[1]}
    return columns | ({"dq": v, "ddq": a} if derivatives else {})


def session(columns: dict[str, Array], **options: float | str) -> Session:
    robot = signid.load_robot("3r")
    return prepare(robot, [read_recording(columns, robot)], (), Options(**options))


def rows(found: Session, dense: bool = False) -> Rows:
    """All training rows, joined."""
    task, band = found.task, found.task.band
    if dense:
        fields = {name: getattr(band, name) for name in band.__dataclass_fields__}
        task = replace(task, band=Dense(**fields))
    made = [row for part in found.train for row in read_rows(task, *part)]
    columns = [np.concatenate([row.columns[j] for row in made]) for j in range(3)]
    signals = {name: np.concatenate([getattr(row, name) for row in made]) for name in ("t", "q", "torque", "steady")}
    return made[0]._replace(columns=columns, **signals)


@pytest.mark.parametrize("cutoff", [5.0, 12.5, 15.2, 40.0])
def test_sparse_rows_are_those_of_all_samples(cutoff: float) -> None:
    found = session(recording(), cutoff=cutoff)
    assert found.task.band.parts == {5.0: 4, 12.5: 4, 15.2: 3, 40.0: 1}[cutoff]
    sparse, dense = rows(found), rows(found, dense=True)
    for name in ("t", "q", "torque", "steady"):
        assert np.array_equal(getattr(sparse, name), getattr(dense, name)), name
    for one, other in zip(sparse.columns, dense.columns, strict=True):
        assert one.shape == other.shape
        assert np.abs(one - other).max() < 2e-4 * np.abs(other).max()


def test_answers_are_the_same_to_a_small_share_of_their_intervals() -> None:
    robot, columns = signid.load_robot("3r"), recording()
    found = signid.identify(robot, [read_recording(columns, robot)])
    assert found.session.task.band.parts > 1
    slow = {name: x[::4] for name, x in columns.items()}  # the torque's noise folds over: more of it, and other
    other = signid.identify(robot, [read_recording(slow, robot)])
    assert other.session.task.band.parts == 1
    apart = np.abs(found.estimate.value - other.estimate.value)
    assert np.all(apart < 4 * np.hypot(found.estimate.std, other.estimate.std))
