"""A fit -> the noise model that its residual shows: coloured noise and model discrepancy of each joint."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from ..types import Array
from .discrepancy import FLAT, discrepancy_size, features
from .found import Found
from .linear import Linear
from .noise import Noise, noise_of_rest
from .setting import Setting
from .whitened import Whitening

ROUNDS = 2  # of coloured noise and discrepancy in turn


def update_noise(setting: Setting, linear: Linear, found: Found) -> Noise:
    """Noise and discrepancy of each joint with the selected laws fitted.

    In turn: the size of the discrepancy that makes the rows likeliest; an autoregressive model of what the fit and the
    discrepancy's posterior mean leave.

    Args:
        setting: rows.
        linear: the rows' columns.
        found: the selected laws.
    """
    noise = setting.noise
    for _ in range(ROUNDS):
        whitening = Whitening(setting.table, noise)
        noise = _stacked([_of_joint(setting, linear, found, whitening, j) for j in range(setting.table.joints)], noise)
    return noise


def _stacked(found: list[tuple[float, Array, float, float]], noise: Noise) -> Noise:
    floor, coefficients, innovation, size = (np.array(x) for x in zip(*found, strict=True))
    return replace(noise, floor=floor, coefficients=coefficients, innovation=innovation, discrepancy=size)


def _of_joint(
    setting: Setting, linear: Linear, found: Found, whitening: Whitening, joint: int
) -> tuple[float, Array, float, float]:
    """Floor [N.m or N], coefficients, innovation and size of the discrepancy [N.m or N]."""
    table, data = setting.table, linear.data
    groups = [g for g in (*linear.refitted(found.trust), *found.true) if joint in data.rows(g)]
    raw = np.concatenate([np.zeros((len(table), 0)), *(data.raw(joint, g) for g in groups)], axis=1)
    shape, y = features(table, joint), table.residual[:, joint]
    white = whitening.local({joint: np.column_stack([raw, shape, y])})[joint]
    k = raw.shape[1]
    precision = linear.prior_precision(groups, found.trust)
    size = discrepancy_size(white[:, k:-1], white[:, :k], precision, white[:, -1], float(table.scale[joint]))
    value, free = _fit(white, precision, size)
    rest = y - np.column_stack([raw, shape])[:, : len(value)] @ value
    return *noise_of_rest(table, joint, rest, free), size


def _fit(white: Array, precision: Array, size: float) -> tuple[Array, float]:
    """Posterior mean of the coefficients, and by how much the fit makes the noise smaller than it is [1]."""
    k = len(precision)
    x, y = white[:, : -1 if size > 0 else k], white[:, -1]
    gram = x.T @ x
    prior = np.diag(np.full(len(gram), max(size, 1e-12) ** -2.0))
    prior[:k, :k] = precision + np.diag(np.where(np.diag(precision) > 0, 0.0, FLAT * np.diag(gram)[:k]))
    scale = np.sqrt(np.maximum(np.diag(gram + prior), 1e-300))
    factor = cho_factor((gram + prior) / scale / scale[:, None] + 1e-10 * np.eye(len(gram)), lower=True)
    value = cho_solve(factor, x.T @ y / scale) / scale
    used = float(np.trace(cho_solve(factor, gram / scale / scale[:, None])))
    return value, float(np.sqrt(len(y) / max(len(y) - used, 0.1 * len(y))))
