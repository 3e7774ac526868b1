"""Factors -> base parameters: weighted least squares with intervals that hold."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from scipy.signal import lfilter

from .factors import Factors, JointFactors
from .types import Array, BaseMap, Estimate, Indices

ROUNDS = 6  # of noise model and solution in turn
SINGULAR = 1e-10  # of the largest eigenvalue of the scaled Gram matrix
FLOOR = 1e-14  # of the torque's power: rounding
PENALTY = 2.0  # per order: Akaike's
STABLE = 0.98  # largest reflection coefficient
IMPULSE = 400  # rows after which an autoregressive noise has forgotten
WEAK_INSTRUMENT = 3.0  # times the standard deviation of least squares, in the median


class _Noise(NamedTuple):
    """An autoregressive noise model of one joint: (1, -phi) / sigma."""

    filter: Array  # (order + 1,)
    sigma: float


class _Solution(NamedTuple):
    value: Array  # (b,)
    information: Array  # (b, b)
    covariance: Array  # (b, b), infinite where nothing is told
    finite: Array  # (b, b) the same without the infinities


def estimate(factors: Factors, base: BaseMap, prior: Array | None = None, whiten: bool = True) -> Estimate:
    """Base parameters by weighted least squares, with a covariance that knows how the noise is coloured.

    A generalised least-squares fit and an autoregressive model of each joint's residual (order by BIC,
    autocovariances corrected for the fitted parameters) are found in turn. The parameters themselves come from
    weighted least squares, which is as accurate and does not trust frequencies where the model is wrong; their
    covariance uses the noise model's autocovariances, over leverage-corrected degrees of freedom. With instruments
    (the same columns along the desired motion) the estimate is the instrumental-variable one.

    Args:
        factors: of the recordings to learn from.
        base: what the columns are.
        prior: (b,) [units of base] values kept where the recordings tell nothing; default 0.
        whiten: False: the noise is taken to be white.

    Source: Gautier, ICRA 1997 (weighted least squares); Patterson, Thompson, Biometrika 58, 1971 (correction for
    fitted parameters); Janot, Vandanjon, Gautier, IEEE T-CST 22(1), 2014 (instruments).
    """
    start = np.zeros(base.rank) if prior is None else prior
    noise = [_Noise(np.ones(1), s) for s in _first_scales(factors)]
    solution = _solve(factors, noise, start)
    for _ in range(ROUNDS):
        noise = [_model_noise(g, c, solution, whiten) for g, c in _each(factors)]
        solution = _solve(factors, noise, start)
    noise = [_rescale(n, g, c, solution) for n, (g, c) in zip(noise, _each(factors), strict=True)]
    colours = [_autocovariances(n, len(g.grams)) for n, g in zip(noise, factors.joints, strict=True)]
    white = [_Noise(np.ones(1), float(np.sqrt(r[0]))) for r in colours]
    solution = _solve(factors, white, start)
    found = Estimate(
        solution.value,
        _coloured_covariance(factors, colours, solution),
        solution.information,
        np.array([w.sigma for w in white]),
        tuple(len(n.filter) - 1 for n in noise),
    )
    return _with_instruments(factors, colours, found) if factors.instruments else found


def _autocovariances(noise: _Noise, lags: int) -> Array:
    """(lags,) [N2.m2] of an autoregressive noise, from its impulse response."""
    impulse = np.zeros(IMPULSE)
    impulse[0] = 1
    response = noise.sigma * np.asarray(lfilter([1.0], noise.filter, impulse))
    return np.array([response[: IMPULSE - d] @ response[d:] for d in range(lags)])


def _coloured_covariance(factors: Factors, colours: Sequence[Array], solution: _Solution) -> Array:
    """(b, b) of weighted least squares under coloured noise; infinite where the recordings tell nothing."""
    spread = np.zeros_like(solution.finite)
    for (joint, columns), r in zip(_each(factors), colours, strict=True):
        spread[np.ix_(columns, columns)] += _spread(joint, r)[-len(columns) - 1 : -1, -len(columns) - 1 : -1]
    covariance = solution.finite @ spread @ solution.finite
    unknown = ~np.isfinite(np.diag(solution.covariance))
    covariance[unknown, unknown] = np.inf
    return np.asarray(covariance)


def _spread(joint: JointFactors, r: Array) -> Array:
    """Covariance (c, c) of the weighted sums of rows times noise of autocovariance r."""
    out = joint.grams[0] / r[0]
    for d in range(1, len(r)):
        out = out + r[d] / r[0] / r[0] * (joint.grams[d] + joint.grams[d].T)
    return np.asarray(out)


def whitened(joint: JointFactors, noise_filter: Array) -> Array:
    """Gram matrix (c, c) of the rows after the noise filter, from the lagged ones.

    Args:
        joint: lagged Gram matrices.
        noise_filter: (order + 1,) [1 / unit of torque] autoregressive polynomial over sigma.
    """
    order = len(noise_filter) - 1
    out = noise_filter @ noise_filter * joint.grams[0]
    for d in range(1, order + 1):
        weight = noise_filter[d:] @ noise_filter[: order + 1 - d]
        out = out + weight * (joint.grams[d] + joint.grams[d].T)
    return np.asarray(out)


def _each(factors: Factors) -> Sequence[tuple[JointFactors, Indices]]:
    return list(zip(factors.joints, factors.columns, strict=True))


def _first_scales(factors: Factors) -> list[float]:
    """Standard deviation of each joint's own least-squares residual."""
    scales = []
    for joint, columns in _each(factors):
        gram = joint.grams[0][-len(columns) - 1 :, -len(columns) - 1 :]
        power = gram[-1, -1]
        size = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
        inverse = np.linalg.pinv(gram[:-1, :-1] / np.outer(size, size), rcond=SINGULAR, hermitian=True)
        rest = power - (gram[:-1, -1] / size) @ inverse @ (gram[:-1, -1] / size)
        scales.append(float(np.sqrt(max(rest, FLOOR * power, 1e-300) / max(joint.counts[0], 1))))
    return scales


def _solve(factors: Factors, noise: Sequence[_Noise], prior: Array) -> _Solution:
    information, right = np.zeros((len(prior), len(prior))), np.zeros(len(prior))
    for (joint, columns), model in zip(_each(factors), noise, strict=True):
        gram = whitened(joint, model.filter / model.sigma)[-len(columns) - 1 :, -len(columns) - 1 :]
        information[np.ix_(columns, columns)] += gram[:-1, :-1]
        right[columns] += gram[:-1, -1]
    size = np.sqrt(np.maximum(np.diag(information), 0))
    scale = np.divide(1, size, out=np.zeros_like(size), where=size > 0)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    told = values > SINGULAR * max(values[-1], 1e-300)
    inverse = (vectors[:, told] / values[told]) @ vectors[:, told].T * np.outer(scale, scale)
    unknown = (np.sum(vectors[:, ~told] ** 2, axis=1) > 1e-8) | (size == 0)
    covariance = inverse.copy()
    covariance[unknown, unknown] = np.inf
    return _Solution(prior + inverse @ (right - information @ prior), information, covariance, inverse)


def _autocovariance(joint: JointFactors, columns: Indices, solution: _Solution, lag: int) -> float:
    """Of the residual at a lag, corrected for what the fitted parameters took away."""
    gram = joint.grams[lag][-len(columns) - 1 :, -len(columns) - 1 :]
    c = np.append(-solution.value[columns], 1.0)
    fitted = np.sum(solution.finite[np.ix_(columns, columns)] * gram[:-1, :-1])
    found = float((c @ gram @ c + fitted) / max(joint.counts[lag], 1))
    return max(found, FLOOR * gram[-1, -1] / max(joint.counts[0], 1), 1e-300) if lag == 0 else found


def _model_noise(joint: JointFactors, columns: Indices, solution: _Solution, whiten: bool) -> _Noise:
    highest = len(joint.grams) - 1 if whiten else 0
    r = np.array([_autocovariance(joint, columns, solution, lag) for lag in range(highest + 1)])
    count = max(joint.counts[0], 1)
    phi, variance = np.zeros(0), float(r[0])
    best, chosen = count * np.log(variance) + PENALTY, _Noise(np.ones(1), float(np.sqrt(variance)))
    for order in range(1, highest + 1):  # Levinson's recursion: stable as long as every reflection is below 1
        reflection = (r[order] - phi @ r[order - 1 : 0 : -1]) / variance
        if abs(reflection) >= STABLE:
            break
        phi = np.append(phi - reflection * phi[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = count * np.log(variance) + (order + 1) * PENALTY
        if criterion < best:
            best, chosen = criterion, _Noise(np.append(1.0, -phi), float(np.sqrt(variance)))
    return chosen


def _rescale(noise: _Noise, joint: JointFactors, columns: Indices, solution: _Solution) -> _Noise:
    """Sigma over the degrees of freedom that the joint has left."""
    gram = whitened(joint, noise.filter / noise.sigma)[-len(columns) - 1 :, -len(columns) - 1 :]
    c = np.append(-solution.value[columns], 1.0)
    used = np.sum(solution.finite[np.ix_(columns, columns)] * gram[:-1, :-1])
    freedom = joint.counts[0] - used
    if freedom < 1:
        return noise
    factor = max(float(c @ gram @ c), FLOOR * gram[-1, -1]) / freedom
    return _Noise(noise.filter, noise.sigma * float(np.sqrt(max(factor, 1e-300))))


def _with_instruments(factors: Factors, colours: Sequence[Array], plain: Estimate) -> Estimate:
    """The instrumental-variable estimate, unless the instruments hardly correlate with the columns."""
    b = len(plain.value)
    zx, zz, zy = np.zeros((b, b)), np.zeros((b, b)), np.zeros(b)
    for (joint, columns), r in zip(_each(factors), colours, strict=True):
        gram, m = joint.grams[0] / r[0], len(columns)
        zx[np.ix_(columns, columns)] += gram[:m, m : 2 * m]
        zz[np.ix_(columns, columns)] += _spread(joint, r)[:m, :m]
        zy[columns] += gram[:m, -1]
    size = np.sqrt(np.maximum(np.diag(plain.information), 1e-300))
    if not np.all(np.isfinite(plain.covariance)) or np.linalg.cond(zx / np.outer(size, size)) > 1 / SINGULAR:
        return plain
    inverse = np.linalg.inv(zx / np.outer(size, size)) / np.outer(size, size)
    value, covariance = inverse @ zy, inverse @ zz @ inverse.T
    wider = float(np.median(np.sqrt(np.diag(covariance)) / plain.std))
    if wider > WEAK_INSTRUMENT:
        note = f"the desired motion is a weak instrument (intervals {wider:.0f} times wider); least squares is kept"
        return replace(plain, notes=(note,))
    shift = float(np.max(np.abs(value - plain.value) / plain.std))
    note = f"desired positions served as instruments; they moved the estimate by up to {shift:.1f} standard deviations"
    return replace(plain, value=value, covariance=covariance, method="instrumental variables", notes=(note,))
