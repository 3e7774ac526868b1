"""Factors -> base parameters: weighted least squares with a covariance for coloured noise and model discrepancy."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..regression.factors import Factors, JointFactors
from ..types import Array, BaseMap, Estimate, Indices, Mask
from .discrepancy import discrepancy_covariance

ROUNDS = 8  # largest number of iterations between noise model and solution
SETTLED = 1e-6  # [1] relative change of the autocovariances at convergence
SINGULAR = 1e-10  # [1] smallest eigenvalue of an identifiable direction, over the largest of the scaled Gram matrix
FLOOR = 1e-14  # [1] smallest noise variance over the torque's power: rounding
FEW = 2.0  # [rows per column] below this a fit hides the noise
FEW_ROWS_NOISE = 1e-3  # [1] smallest noise variance of joints with so few rows, over the torque's power
PENALTY = 2.0  # [1] penalty per order of the noise model: Akaike's criterion
LEAST = 0.05  # [1] smallest variance over that under white noise
STABLE = 0.98  # [1] largest reflection coefficient
WEAK_INSTRUMENT = 3.0  # [1] median standard deviation over that of least squares from which on instruments are weak


class _Solution(NamedTuple):
    value: Array  # (b,) [units of base]
    information: Array  # (b, b) [1 / units of base]
    inverse: Array  # (b, b) [units of base] of the information, 0 in unidentifiable directions
    unknown: Mask  # (b,) whether a parameter is unidentifiable


class _Noise(NamedTuple):
    """Autoregressive noise of one joint."""

    order: int
    colour: Array  # (d,) autocovariances [N2.m2]


def estimate(
    factors: Factors,
    base: BaseMap,
    prior: Array | None = None,
    whiten: bool = True,
    noise_grams: Sequence[Array] | None = None,
    weakest: float = WEAK_INSTRUMENT,
) -> Estimate:
    """Estimate base parameters by weighted least squares, with a covariance for coloured noise.

    Three steps are iterated: weighted least squares; the autocovariances of each joint's residual, corrected for the
    fitted parameters; an autoregressive model of them, its order by Akaike's criterion. The covariance is that of
    weighted least squares under this noise, plus that of model discrepancy (`signid.estimation.discrepancy`).
    Generalised least squares is no more accurate, and relies on frequencies where the model is wrong. With instruments,
    the columns along the desired motion, the estimate is the instrumental-variable one, unless its standard deviations
    exceed `weakest` times those of least squares.

    Unidentifiable parameters are those of prior (b,) [units of base], or 0. Without `whiten`, white noise and no model
    discrepancy are assumed. The Gram matrices noise_grams (m, m) [products of the units of the columns] of the noise in
    each joint's columns are subtracted from the normal equations.

    Source: Gautier, ICRA 1997 (weighted least squares); Patterson, Thompson, Biometrika 58, 1971 (correction for
    fitted parameters); Janot, Vandanjon, Gautier, IEEE T-CST 22(1), 2014 (instruments).
    """
    start = np.zeros(base.rank) if prior is None else prior
    noise = _first_noise(factors)
    for _ in range(ROUNDS):
        solution = _solve(factors, noise, start, noise_grams)
        covariance = _covariance(factors, noise, solution)
        before = noise
        noise = [
            _model_noise(joint, columns, old.colour, solution, covariance, whiten)
            for (joint, columns), old in zip(_each(factors), before, strict=True)
        ]
        changes = ((new.colour, old.colour) for new, old in zip(noise, before, strict=True))
        if all(np.allclose(new, old, SETTLED, SETTLED * old[0]) for new, old in changes):
            break
    solution = _solve(factors, noise, start, noise_grams)
    covariance = _positive(_covariance(factors, noise, solution), solution.inverse)
    covariance[solution.unknown, solution.unknown] = np.inf
    scales = np.array([np.sqrt(n.colour[0]) for n in noise])
    found = Estimate(solution.value, covariance, solution.information, scales, tuple(n.order for n in noise))
    if factors.instruments:
        found = _with_instruments(factors, noise, found, weakest)
    if not whiten or factors.sample is None:
        return found
    white = solution.inverse
    added = discrepancy_covariance(factors.sample, factors.columns, base, found.value, found.noise**2, white)
    return replace(found, covariance=found.covariance + added)


def _each(factors: Factors) -> Sequence[tuple[JointFactors, Indices]]:
    return list(zip(factors.joints, factors.columns, strict=True))


def _own(gram: Array, columns: Indices) -> Array:
    """The part of a Gram matrix that belongs to [x y], without instruments."""
    return gram[-len(columns) - 1 :, -len(columns) - 1 :]


def _first_noise(factors: Factors) -> list[_Noise]:
    """White noise of the size of each joint's own least-squares residual."""
    found = []
    for joint, columns in _each(factors):
        gram = _own(joint.grams[0], columns)
        size = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
        inverse = np.linalg.pinv(gram[:-1, :-1] / np.outer(size, size), rcond=SINGULAR, hermitian=True)
        rest = gram[-1, -1] - (gram[:-1, -1] / size) @ inverse @ (gram[:-1, -1] / size)
        variance = max(float(rest), _least(joint, columns) * gram[-1, -1], 1e-300) / max(joint.counts[0], 1)
        found.append(_Noise(0, variance * (np.arange(len(joint.grams)) == 0)))
    return found


def _least(joint: JointFactors, columns: Indices) -> float:
    """Smallest noise variance, over the torque's power."""
    return FLOOR if joint.counts[0] >= FEW * len(columns) else FEW_ROWS_NOISE


def _solve(
    factors: Factors, noise: Sequence[_Noise], prior: Array, noise_grams: Sequence[Array] | None = None
) -> _Solution:
    information, right = np.zeros((len(prior), len(prior))), np.zeros(len(prior))
    for j, ((joint, columns), model) in enumerate(zip(_each(factors), noise, strict=True)):
        gram = _own(joint.grams[0], columns) / model.colour[0]
        information[np.ix_(columns, columns)] += gram[:-1, :-1]
        if noise_grams is not None:
            information[np.ix_(columns, columns)] -= noise_grams[j] / model.colour[0]
        right[columns] += gram[:-1, -1]
    size = np.sqrt(np.maximum(np.diag(information), 0))
    scale = np.divide(1, size, out=np.zeros_like(size), where=size > 0)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    known = values > SINGULAR * max(values[-1], 1e-300)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T * np.outer(scale, scale)
    unknown = (np.sum(vectors[:, ~known] ** 2, axis=1) > 1e-8) | (size == 0)
    return _Solution(prior + inverse @ (right - information @ prior), information, inverse, unknown)


def _covariance(factors: Factors, noise: Sequence[_Noise], solution: _Solution) -> Array:
    """Covariance (b, b) of weighted least squares under coloured noise."""
    spread = np.zeros_like(solution.inverse)
    for (joint, columns), model in zip(_each(factors), noise, strict=True):
        spread[np.ix_(columns, columns)] += _own(_spread(joint, model.colour), columns)[:-1, :-1]
    return solution.inverse @ spread @ solution.inverse


def _positive(covariance: Array, white: Array) -> Array:
    """Covariance made positive definite, with at least a share of the white one; few lags miss slow noise."""
    size = np.sqrt(np.maximum(np.diag(white), 1e-300))
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2 / np.outer(size, size))
    least = LEAST * np.einsum("ik,ij,jk->k", vectors, white / np.outer(size, size), vectors)
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T * np.outer(size, size))


def _spread(joint: JointFactors, r: Array) -> Array:
    """Covariance (c, c) of the weighted sums of rows times noise of autocovariance r."""
    out = joint.grams[0] / r[0]
    for d in np.flatnonzero(r[1:]) + 1:
        out = out + r[d] / r[0] / r[0] * (joint.grams[d] + joint.grams[d].T)
    return np.asarray(out)


def _model_noise(
    joint: JointFactors, columns: Indices, old: Array, solution: _Solution, covariance: Array, whiten: bool
) -> _Noise:
    """Autoregressive model by Levinson's recursion, stable since every reflection coefficient is below 1."""
    r = _autocovariances(joint, columns, old, solution, covariance)
    count, phi, variance = max(joint.counts[0], 1), np.zeros(0), float(r[0])
    best, chosen = np.inf, phi
    for order in range(1, len(r) if whiten else 1):
        reflection = (r[order] - phi @ r[order - 1 : 0 : -1]) / variance
        if abs(reflection) >= STABLE:
            break
        phi = np.append(phi - reflection * phi[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = count * np.log(variance) + order * PENALTY
        if criterion < best:
            best, chosen = criterion, phi
    colour = r.copy()
    for d in range(len(chosen) + 1, len(r)):  # beyond the order they follow from the model
        colour[d] = chosen @ colour[d - len(chosen) : d][::-1]
    return _Noise(len(chosen), colour)


def _autocovariances(
    joint: JointFactors, columns: Indices, old: Array, solution: _Solution, covariance: Array
) -> Array:
    """Autocovariances (d,) [N2.m2] of the noise: those of the residual, corrected for the fit.

    For noise of covariance O and the projection P of weighted least squares, the residual has
    (1 - P) O (1 - P)' = O - P O - O P' + P O P'; each term's sum along a diagonal is a trace with a lagged Gram matrix.
    """
    grams = [_own(gram, columns) for gram in joint.grams]
    c, part = np.append(-solution.value[columns], 1.0), np.ix_(columns, columns)
    lags = len(grams)
    forward = np.array([np.sum(solution.inverse[part] * gram[:-1, :-1]) for gram in grams]) / old[0]
    both = np.concatenate([forward[:0:-1], forward])  # trace at lags -(lags - 1) .. lags - 1
    colour = np.concatenate([old[:0:-1], old])
    taken = 2 * np.convolve(colour, both)[2 * (lags - 1) :][:lags]
    given = np.array([np.sum(covariance[part] * gram[:-1, :-1]) for gram in grams])
    found = np.array([c @ gram @ c for gram in grams]) + taken - given
    r = found / np.maximum(joint.counts, 1)
    r[0] = max(r[0], _least(joint, columns) * grams[0][-1, -1] / max(joint.counts[0], 1), 1e-300)
    return np.asarray(r)


def _with_instruments(factors: Factors, noise: Sequence[_Noise], plain: Estimate, weakest: float) -> Estimate:
    """Instrumental-variable estimate, or least squares if the instruments are weak."""
    b = len(plain.value)
    zx, zz, zy = np.zeros((b, b)), np.zeros((b, b)), np.zeros(b)
    for (joint, columns), model in zip(_each(factors), noise, strict=True):
        gram, m = joint.grams[0] / model.colour[0], len(columns)
        zx[np.ix_(columns, columns)] += gram[:m, m : 2 * m]
        zz[np.ix_(columns, columns)] += _spread(joint, model.colour)[:m, :m]
        zy[columns] += gram[:m, -1]
    size = np.sqrt(np.maximum(np.diag(plain.information), 1e-300))
    if not np.all(np.isfinite(plain.covariance)) or np.linalg.cond(zx / np.outer(size, size)) > 1 / SINGULAR:
        return plain
    inverse = np.linalg.inv(zx / np.outer(size, size)) / np.outer(size, size)
    value, covariance = inverse @ zy, inverse @ zz @ inverse.T
    wider = float(np.median(np.sqrt(np.diag(covariance)) / plain.std))
    if wider > weakest:
        note = f"the desired motion is a weak instrument (intervals {wider:.0f} times wider); least squares is kept"
        return replace(plain, notes=(note,))
    shift = float(np.max(np.abs(value - plain.value) / plain.std))
    note = (
        f"desired positions served as instruments; they changed the estimate by up to {shift:.1f} standard deviations"
    )
    return replace(plain, value=value, covariance=covariance, method="instrumental variables", notes=(note,))
