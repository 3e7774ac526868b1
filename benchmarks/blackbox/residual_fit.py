"""Black boxes for the residual of least squares: boosted trees and Gaussian processes on positions and derivatives."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .rows import Array, Table
from .task import Answer, Task, UnavailableError

Mask = NDArray[np.bool_]
BLOCKS, EVERY = 15, 5  # blocks in time of a recording; each fifth validates
TREES, PATIENCE, LEAF = 2000, 30, 20  # trees at most; so many without gain end the search; rows of a leaf at least
POINTS, LENGTHS = 500, (0.05, 1e3)  # rows of a Gaussian process; bounds of its lengths, in deviations of a feature
LEAST = 60  # rows below which nothing is learned
SEED = 0


def missing() -> str:
    """The sentence on scikit-learn where it is not installed; empty where it is."""
    try:
        import sklearn  # noqa: F401
    except ImportError:
        return "scikit-learn is not installed; run pip install 'signid[bench]'"
    return ""


def validates(tables: Sequence[Table]) -> Mask:
    """(M,) whether a row validates: whole blocks in time of each recording, so that neighbours stay together.

    Args:
        tables: of recordings, M rows together.
    """
    blocks = [np.arange(len(x.rest)) * BLOCKS // max(len(x.rest), 1) for x in tables]
    return np.concatenate([x % EVERY == EVERY // 2 for x in blocks])


def boosted(task: Task) -> Answer:
    """Gradient-boosted trees on q, v, a of all joints, one ensemble a joint, as many as validate best.

    Args:
        task: the data.

    Raises:
        UnavailableError: scikit-learn is missing.
    """
    _need()
    start = time.process_time()
    check, used = validates(task.learned), []
    added = np.zeros_like(task.judged.rest)
    x, y, new = (*_stacked(task.learned), task.judged.motion)
    for j in range(y.shape[1]):
        own = np.isfinite(y[:, j])
        count, predicted = boost(x[own], y[own, j], check[own], new)
        added[:, j] = predicted
        used.append(count)
    note = f"{min(used)} to {max(used)} trees a joint"
    return Answer(task.judged.rest - added, time.process_time() - start, note)


def boost(x: Array, y: Array, check: Mask, new: Array) -> tuple[int, Array]:
    """Trees fitted to rows that do not validate, as many as validate best; then as many fitted to all rows.

    Args:
        x: (M, k) features.
        y: (M,) [N.m or N] residual.
        check: (M,) whether a row validates.
        new: (N, k) features to predict for.

    Returns:
        Number of trees, 0 where none helps, and (N,) [N.m or N] prediction.
    """
    from sklearn.ensemble import HistGradientBoostingRegressor as Trees

    if np.count_nonzero(~check) < LEAST or not check.any():
        return 0, np.zeros(len(new))
    fixed = {"min_samples_leaf": LEAF, "random_state": SEED}
    search = Trees(max_iter=TREES, early_stopping=True, n_iter_no_change=PATIENCE, scoring="loss", **fixed)
    search.fit(x[~check], y[~check], X_val=x[check], y_val=y[check])
    count = int(np.argmax(search.validation_score_))  # the first is that of a constant
    return count, Trees(max_iter=count, early_stopping=False, **fixed).fit(x, y).predict(new) if count else np.zeros(
        len(new)
    )


def gaussian(task: Task) -> Answer:
    """Gaussian processes on q, v, a of the joint itself: squared-exponential kernel, a length each, white noise.

    With q, v, a of all joints and as many rows they were worse on a UR10e and a TX40.

    Args:
        task: the data.

    Raises:
        UnavailableError: scikit-learn is missing.
    """
    _need()
    start = time.process_time()
    added = np.zeros_like(task.judged.rest)
    x, y, new = (*_stacked(task.learned), task.judged.motion)
    for j in range(y.shape[1]):
        own = np.isfinite(y[:, j])
        features = np.arange(j, x.shape[1], y.shape[1])
        added[:, j] = interpolate(x[own][:, features], y[own, j], new[:, features])
    return Answer(task.judged.rest - added, time.process_time() - start, f"at most {POINTS} rows a joint")


def interpolate(x: Array, y: Array, new: Array) -> Array:
    """(N,) [N.m or N] mean of a Gaussian process about zero.

    Args:
        x: (M, k) features.
        y: (M,) [N.m or N] residual.
        new: (N, k) features to predict for.
    """
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    if len(y) < LEAST:
        return np.zeros(len(new))
    some = np.linspace(0, len(y) - 1, min(POINTS, len(y))).astype(int)
    centre, spread, size = x[some].mean(axis=0), x[some].std(axis=0), float(np.sqrt(np.mean(y[some] ** 2)))
    spread[spread == 0] = 1.0
    kernel = ConstantKernel(0.5) * RBF(np.ones(x.shape[1]), LENGTHS) + WhiteKernel(0.5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # a length at its bound is no failure
        process = GaussianProcessRegressor(kernel, random_state=SEED).fit((x[some] - centre) / spread, y[some] / size)
    return np.asarray(size * process.predict((new - centre) / spread))


def _stacked(tables: Sequence[Table]) -> tuple[Array, Array]:
    return np.concatenate([x.motion for x in tables]), np.concatenate([x.rest for x in tables])


def _need() -> None:
    if sentence := missing():
        raise UnavailableError(sentence)
