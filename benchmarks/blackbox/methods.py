"""Methods: signid models and black boxes for the residual of least squares."""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import signid
from signid.model import Model
from signid.types import Recording, Robot

from ..concealed_real.run import ONCE, attempt
from .task import Answer, Array, Fitted, Table, Task, UnavailableError, identified, table, together

LIMIT = 60.0  # time limit of one diagnosis [s]


def least_squares(robot: Robot, recordings: Sequence[Recording]) -> Fitted:
    """Estimate base parameters, viscous and Coulomb friction, offsets and rotors by weighted least squares.

    Uses signid's regressor and filter, one weight per joint, no instruments and no physical constraints.
    """
    start = time.process_time()
    found = identified(robot, recordings, method="wls", options=signid.Options(instruments=False, whiten=False))
    seconds, period = time.process_time() - start, found.session.train[0][1].period
    return Fitted(found.model, found.cutoff, found.position_cutoff, period, seconds)


def description(task: Task) -> Answer:
    """Predict with the description and its friction, without fit."""
    return _answer(task, task.described, 0.0)


def least_squares_answer(task: Task) -> Answer:
    """Return the least-squares fit of the task."""
    return Answer(task.held_out.rest, task.fitted.seconds)


def identify(task: Task, first: bool = False) -> Answer:
    """Run `signid identify` with its defaults on A and B, or on A alone, the model of `diagnose`."""
    start = time.process_time()
    model = identified(task.robot, list(task.a) if first else together(task)).model
    return _answer(task, model, time.process_time() - start)


def diagnose(task: Task, first: bool = False, limit: float = LIMIT) -> Answer:
    """Predict with the extended model of `signid diagnose`: A and B identified and diagnosed, or A and B; limit in s.

    Raises:
        UnavailableError: the diagnosis refused, crashed or was stopped.
    """
    both = together(task)
    start = time.process_time()
    model = identified(task.robot, list(task.a) if first else both).model
    found = attempt(model, [task.b] if first else both, limit)
    seconds = time.process_time() - start
    if found.diagnosis is None:
        raise UnavailableError(f"{found.answer.verdict}: {' '.join(found.answer.sentences)}")
    extended = found.diagnosis.model
    kept = tuple(law for law in extended.laws if not set(law.parameters) >= ONCE)
    names = dict.fromkeys(x.law.effect.name for x in found.diagnosis.causes)
    return _answer(task, replace(extended, laws=kept), seconds, ", ".join(names) or found.answer.verdict)


def _answer(task: Task, model: Model, seconds: float, note: str = "") -> Answer:
    return Answer(table(model, task.c, task.cutoff).rest, seconds, note)


Mask = NDArray[np.bool_]
BLOCKS, EVERY = 15, 5  # time blocks per recording; every fifth is validation data
TREES, PATIENCE, LEAF = 2000, 30, 20  # most trees; trees without gain before early stopping; fewest rows per leaf
POINTS, LENGTHS = 500, (0.05, 1e3)  # rows of a Gaussian process; bounds of length scales [feature standard deviations]
LEAST = 60  # fewest rows for a fit
SEED = 0


def missing() -> str:
    """Error message if scikit-learn is not installed, otherwise an empty string."""
    try:
        import sklearn  # noqa: F401
    except ImportError:
        return "scikit-learn is not installed; run pip install 'signid[bench]'"
    return ""


def validates(tables: Sequence[Table]) -> Mask:
    """Mask (M,) of validation rows: whole time blocks of each recording."""
    blocks = [np.arange(len(x.rest)) * BLOCKS // max(len(x.rest), 1) for x in tables]
    return np.concatenate([x % EVERY == EVERY // 2 for x in blocks])


def boosted(task: Task) -> Answer:
    """Fit gradient-boosted trees on q, v, a of all joints: one ensemble per joint, size chosen by validation."""
    start = time.process_time()
    check, used = validates(task.training), []
    added = np.zeros_like(task.held_out.rest)
    x, y, new = (*_stacked(task.training), task.held_out.motion)
    for j in range(y.shape[1]):
        own = np.isfinite(y[:, j])
        count, predicted = boost(x[own], y[own, j], check[own], new)
        added[:, j] = predicted
        used.append(count)
    note = f"{min(used)} to {max(used)} trees per joint"
    return Answer(task.held_out.rest - added, time.process_time() - start, note)


def boost(x: Array, y: Array, check: Mask, new: Array) -> tuple[int, Array]:
    """Choose the number of trees by validation, then fit this number to all rows.

    Args:
        x: features (M, k).
        y: residual (M,) [N.m or N].
        check: mask of validation rows (M,).
        new: features of the prediction (N, k).

    Returns:
        Number of trees (0 without improvement) and prediction (N,) [N.m or N].
    """
    from sklearn.ensemble import HistGradientBoostingRegressor as Trees

    if np.count_nonzero(~check) < LEAST or not check.any():
        return 0, np.zeros(len(new))
    fixed = {"min_samples_leaf": LEAF, "random_state": SEED}
    search = Trees(max_iter=TREES, early_stopping=True, n_iter_no_change=PATIENCE, scoring="loss", **fixed)
    search.fit(x[~check], y[~check], X_val=x[check], y_val=y[check])
    count = int(np.argmax(search.validation_score_))  # the first score is that of a constant
    if not count:
        return 0, np.zeros(len(new))
    return count, Trees(max_iter=count, early_stopping=False, **fixed).fit(x, y).predict(new)


def gaussian(task: Task) -> Answer:
    """Fit Gaussian processes on q, v, a of each joint: squared-exponential kernel, one length per feature, white noise.

    Features of all joints with the same number of rows were worse on a UR10e and a TX40.
    """
    start = time.process_time()
    added = np.zeros_like(task.held_out.rest)
    x, y, new = (*_stacked(task.training), task.held_out.motion)
    for j in range(y.shape[1]):
        own = np.isfinite(y[:, j])
        features = np.arange(j, x.shape[1], y.shape[1])
        added[:, j] = interpolate(x[own][:, features], y[own, j], new[:, features])
    return Answer(task.held_out.rest - added, time.process_time() - start, f"at most {POINTS} rows per joint")


def interpolate(x: Array, y: Array, new: Array) -> Array:
    """Predict the mean (N,) [N.m or N] of a zero-mean Gaussian process.

    Args:
        x: features (M, k).
        y: residual (M,) [N.m or N].
        new: features of the prediction (N, k).
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
        warnings.simplefilter("ignore")  # a length scale at its bound is acceptable
        process = GaussianProcessRegressor(kernel, random_state=SEED).fit((x[some] - centre) / spread, y[some] / size)
    return np.asarray(size * process.predict((new - centre) / spread))


def _stacked(tables: Sequence[Table]) -> tuple[Array, Array]:
    return np.concatenate([x.motion for x in tables]), np.concatenate([x.rest for x in tables])
