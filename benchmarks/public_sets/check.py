"""Simple models for IdentiBench, and the comparison of its score with `benchmarks.blackbox`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from signid.regression.motion import Motion
from signid.simulation.rollout.windows import restrict_joints

from ..blackbox.task import Task
from .specification import Model, read
from .stretches import SetFiles

Builder = Callable[[Any], Model]  # context of IdentiBench -> model


@dataclass(frozen=True)
class Checked:
    """Scores of a set by IdentiBench."""

    zero: float  # headline of a model that predicts no torque
    affine: float  # headline of a fit of an affine function
    least_squares: float  # headline of signid's least squares; 1 if all rows agree
    difference: float  # largest relative difference of its rms from `benchmarks.blackbox`, over joints


def zero(context: Any) -> Model:
    """Build the model that predicts zero torque.

    Args:
        context: training context of IdentiBench.
    """
    width = len(context.spec.y_cols)
    return lambda u, y_init, attributes: np.zeros((len(u), width))


def affine(context: Any) -> Model:
    """Fit torque by an affine function of q, dq, ddq and the signs of dq, on training and validation rows.

    Args:
        context: training context of IdentiBench.
    """
    spec = context.spec
    columns, targets = [], []
    for path in (*spec.train_files(), *spec.valid_files()):
        u, y, rows, _ = read(path, spec.task.joints)
        columns.append(rows(_features(u)))
        targets.append(np.where(rows.counts, rows(y), np.nan))
    x, tau = np.concatenate(columns), np.concatenate(targets)
    counts = np.isfinite(tau).T
    weights = np.column_stack([np.linalg.lstsq(x[own], t[own])[0] for t, own in zip(tau.T, counts, strict=True)])
    return lambda u, y_init, attributes: _features(u) @ weights


def least_squares(task: Task) -> Builder:
    """Builder of the least-squares model of a task; it is fitted to the recordings, not to the files.

    Args:
        task: data of the set.
    """
    own = restrict_joints(task.least_squares, [task.c])[0]

    def model(u: Any, y_init: Any, attributes: dict[str, Any]) -> Any:
        q, v, a = np.split(np.asarray(u, float), 3, axis=1)
        t = np.arange(len(u)) / float(attributes["fs"])
        return own.inverse(Motion(own.robot, t, q, v, a, slow=np.asarray(attributes["slow"], float)))

    return lambda context: model


def check(spec: Any, found: SetFiles) -> Checked:
    """Run three models through IdentiBench.

    Args:
        spec: specification of the set.
        found: stretches of the same set.
    """
    from identibench import run_benchmark

    scores = [run_benchmark(spec, build, seed=0) for build in (zero, affine, least_squares(found.task))]
    here = np.array([scores[-1]["test_sets"]["test"][f"rms_{joint}"] for joint in found.task.joints])
    there = np.array(found.least_squares_rms)
    return Checked(*(x["metric_score"] for x in scores), float(np.nanmax(np.abs(here / there - 1))))


def size(place: Path) -> float:
    """Size of the files of a set [MB].

    Args:
        place: folder of the set.
    """
    return sum(x.stat().st_size for x in place.rglob("*.hdf5")) / 1e6


def _features(u: Any) -> np.ndarray:
    u = np.asarray(u, float)
    n = u.shape[1] // 3
    return np.column_stack([u, np.sign(u[:, n : 2 * n]), np.ones(len(u))])
