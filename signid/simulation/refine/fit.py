"""Least-squares fit of a model's free numbers to the positions of windows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np
from scipy.optimize import least_squares

from ...deadline import seconds_left
from ...errors import InputError
from ...model import Model
from ...types import Array, Indices
from ..rollout.whole import position_errors
from ..rollout.windows import Windows
from .coordinates import coordinates_of, with_coordinates

# [1] of a number's size, differences of successive fits: errors are rough where a joint stops, and coarse steps see
# past that (EMPS: whole runs fitted from four starts end between 2.73 and 2.84 mm, with 1e-5 alone at 2.8 to 3.4 mm)
STEPS = (1e-2, 1e-3, 1e-4)
ROWS = 6_000  # residuals per joint at most; further samples are left out evenly
EVALUATIONS, GAIN = 20, 1e-4  # steps of a fit at most; relative gain of a step that ends it
MARGIN = 1e-6  # [1] by which bounds lie beyond the start value, which must be inside
WORST = 1e3  # [1] error of a simulation that diverged, over the scale


def fit_windows(
    model: Model, windows: Sequence[Windows], scale: Array, steps: Sequence[float] = STEPS, most: int = EVALUATIONS
) -> Model:
    """The model with the free numbers that make roll-outs of these windows follow the recorded positions.

    Args:
        model: start values.
        windows: of all recordings.
        scale: (n,) [rad or m] size of the errors of each joint, as weights; or (G, n), one row for each of the windows.
        steps: [1] of a number's size, differences of successive fits.
        most: iterations of each fit at most.
    """
    best, cost = model, np.inf
    for step in steps:
        if seconds_left() <= 0:  # the best so far
            break
        found, now = _fit(best, windows, scale, step, most)
        if now < cost:
            best, cost = found, now
    return best


def _fit(model: Model, windows: Sequence[Windows], scale: Array, step: float, most: int) -> tuple[Model, float]:
    """One fit with differences of one size, and its sum of squares."""
    start = coordinates_of(model)
    x0 = np.maximum(start.value, start.lower) / start.size

    def residuals(x: Array) -> Array:
        return _residuals(with_coordinates(model, x * start.size), windows, scale)

    def jacobian(x: Array) -> Array:
        here = residuals(x)
        return np.column_stack([(residuals(x + e) - here) / step for e in np.eye(len(x)) * step])

    low = start.lower / start.size - MARGIN * np.isfinite(start.lower)
    found = least_squares(
        residuals, x0, jac=jacobian, bounds=(low, np.inf), x_scale="jac", max_nfev=most, ftol=GAIN, xtol=GAIN
    )
    x = np.maximum(found.x, start.lower / start.size)
    return with_coordinates(model, x * start.size), float(np.sum(residuals(x) ** 2))


def window_rms(model: Model, windows: Sequence[Windows]) -> Array:
    """Root mean square (W, n) [rad or m] of the position error of each window; infinite where it diverges."""
    return np.concatenate([np.sqrt(np.mean(position_errors(model, one) ** 2, axis=1)) for one in windows])


def subset(windows: Windows, rows: Indices) -> Windows:
    """Some of the windows."""
    each = {f.name for f in fields(windows)} & {"t", "q", "v", "torque", "before"}
    changed = {name: getattr(windows, name)[rows] for name in each}
    return replace(windows, **changed, flex=windows.flex[:, rows])


def _residuals(model: Model, windows: Sequence[Windows], scale: Array) -> Array:
    out, total = [], sum(one.q.shape[0] * one.q.shape[1] for one in windows)
    scales = np.broadcast_to(scale, (len(windows), scale.shape[-1]))
    for one, size in zip(windows, scales, strict=True):
        try:
            errors = position_errors(model, one)
        except InputError:  # numbers with which the model cannot be simulated
            errors = np.full_like(one.q[:, 1:], np.inf)
        thin = max(1, total // ROWS)
        measured = errors[:, ::-1][:, ::thin][..., one.measured] / size[one.measured]
        out.append(np.clip(np.nan_to_num(measured, nan=WORST, posinf=WORST, neginf=-WORST), -WORST, WORST).ravel())
    return np.concatenate(out)
