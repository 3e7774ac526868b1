"""Factors -> base parameters: weighted least squares with autocorrelation-robust covariance and model discrepancy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..regression.factors import Factors, JointFactors, RowSample
from ..types import Array, BaseMap, Estimate, Indices, Mask

PROCESS_STATES = ("v", "l", "q", "vl", "qv")  # states of each process: velocity, load, position
# Length, thresholds and number of processes were chosen on the recordings of tests/test_estimation_real_intervals.py
# and on simulations of `benchmarks.coverage`: intervals contain the truth as often as their nominal coverage on both.
CORRELATION_LENGTH = 0.3  # [standard deviations of the state] correlation length of a process
NOISE_TIME, NOISE_ROWS = 0.6, 6.0  # [s], [rows] distance in time from which on noise is uncorrelated
VARIANCE_REDUCTION = 1.0  # [standard errors under noise] subtracted from each variance
MIN_JOINT_ROWS = 10  # smallest number of rows of a joint
MIN_VARIANCE = 1e-100  # [N2.m2 or N2] of noise, of a torque without any; products of its inverse are finite
BLOCK_ROWS = 64  # rows of which those that are close in time are taken together
# Relative standard deviation of friction between recordings. Measured on joints 4 to 6 of a UR10e, five recordings
# within three weeks, variance of noise subtracted (data: Mamedov, Mikhel, Frontiers in Robotics and AI 7, 2020). Their
# residuals show almost no discrepancy: one recording alone cannot show this change. Temperature is the likely cause.
VISCOUS_DRIFT, COULOMB_DRIFT = 0.05, 0.02  # [1] of the coefficient
DRIFTS = {"N.m.s/rad": VISCOUS_DRIFT, "N.s/m": VISCOUS_DRIFT, "N.m": COULOMB_DRIFT, "N": COULOMB_DRIFT}
MAX_NOISE_ROUNDS = 8  # largest number of iterations between noise model and solution
AUTOCOVARIANCE_TOLERANCE = 1e-6  # [1] relative change of the autocovariances at convergence
MIN_EIGENVALUE = 1e-10  # [1] of an identifiable direction, over the largest of the scaled Gram matrix
MIN_NOISE_SHARE = 1e-14  # [1] smallest noise variance over the torque's power: rounding
MIN_COLUMN_ROWS = 2.0  # [rows per column] below this a fit hides the noise
FEW_ROWS_NOISE_SHARE = 1e-3  # [1] smallest noise variance of joints with so few rows, over the torque's power
ORDER_PENALTY = 2.0  # [1] penalty per order of the noise model: Akaike's criterion
MIN_VARIANCE_RATIO = 0.05  # [1] smallest variance over that under white noise
MAX_REFLECTION = 0.98  # [1] largest reflection coefficient
MAX_DEVIATION_RATIO = 3.0  # [1] median standard deviation over that of least squares from which on instruments are weak


class _Joint(NamedTuple):
    """Valid sample rows of one joint, K' of them, by time."""

    columns: Indices  # (m,) base parameters
    x: Array  # (K', m) [torque per unit of base]
    rest: Array  # (K',) residual [N.m or N]
    slope: Array  # (K',) derivative of the torque [N.m/s or N/s]
    state: dict[str, NDArray[np.float32]]  # (K',) each, in standard deviations
    close: list[tuple[slice, slice, Mask]]  # rows, the others that may be close in time, and whether they are
    weight: float  # weight of a row of the sample [1/N2.m2]
    turn: Array  # (m, m) of x onto `taken`
    taken: Array  # (K', m) taken @ x' projects a process onto the fit
    stride: int  # rows that one sample row represents


def discrepancy_covariance(
    sample: RowSample, seen: Sequence[Indices], base: BaseMap, value: Array, variance: Array, white: Array
) -> Array:
    """Covariance (b, b) [units of base] of discrepancy, delay and friction drift, to be added to that of noise.

    The torque of each joint depends on the base parameters seen (m,), estimated as value (b,) [units of base]
    with covariance white (b, b) [units of base] under white noise of variance (n,) [N2.m2 or N2].

    Source: Kennedy, O'Hagan, J. R. Statist. Soc. B 63(3), 2001 (discrepancy); Rao, Biometrics 27(1), 1971 (variance
    components by quadratic forms).
    """
    joints = {j: _joint(sample, j, seen, value, variance[j], white) for j in range(len(seen))}
    used = {j: joint for j, joint in joints.items() if len(joint.rest) >= MIN_JOINT_ROWS}
    spread, sizes = np.zeros_like(white), np.zeros(len(seen))
    for j, joint in used.items():
        own, sizes[j] = _process_covariance(joint)
        spread[np.ix_(joint.columns, joint.columns)] += own
    late = _delay_error(list(used.values()), white)
    drift = _drift_std(used, sizes, base, value)
    return white @ spread @ white + np.outer(late, late) + (base.combination * drift**2) @ base.combination.T


def _joint(sample: RowSample, j: int, seen: Sequence[Indices], value: Array, variance: float, white: Array) -> _Joint:
    here, columns = np.flatnonzero(sample.kept[:, j]), seen[j]
    here = here[np.argsort(sample.number[here], kind="stable")]
    x = sample.of(j, seen)[here]
    load, weight = x @ value[columns], sample.stride / max(variance, MIN_VARIANCE)
    turn = white[np.ix_(columns, columns)] * weight
    state = {"q": sample.q[here, j], "v": sample.v[here, j], "l": load}
    return _Joint(
        columns,
        x,
        sample.torque[here, j] - load,
        sample.slope[here, j],
        {k: ((x - x.mean()) / max(x.std(), 1e-300)).astype(np.float32) for k, x in state.items() if len(x)},
        list(_near_rows(np.asarray(sample.number[here] * sample.period), max(NOISE_TIME, NOISE_ROWS * sample.period))),
        weight,
        turn,
        x @ turn,
        sample.stride,
    )


def _near_rows(time: Array, apart: float) -> Iterator[tuple[slice, slice, Mask]]:
    """Rows (K,) at ascending times [s], `BLOCK_ROWS` at a time, with the rows less than `apart` [s] from any."""
    for start in range(0, len(time), BLOCK_ROWS):
        rows = time[start : start + BLOCK_ROWS]
        low, high = np.searchsorted(time, (rows[0] - 1.1 * apart, rows[-1] + 1.1 * apart))  # not to round there
        yield slice(start, start + BLOCK_ROWS), slice(low, high), np.abs(rows[:, None] - time[low:high]) < apart


def _process_covariance(joint: _Joint) -> tuple[Array, float]:
    """Covariance (m, m) of the normal equations' right-hand side due to discrepancy; its variance [N2.m2 or N2]."""
    spread, size = np.zeros((len(joint.columns),) * 2), 0.0
    signals, projected = (np.column_stack([x, joint.rest]) for x in (joint.x, joint.taken))
    single = {name: np.subtract.outer(x, x) for name, x in joint.state.items()}
    for like in single.values():  # correlations (K, K); samples have single precision as well
        np.exp(np.multiply(np.square(like, out=like), -0.5 / CORRELATION_LENGTH**2, out=like), out=like)
    single_signals = signals.astype(np.float32)
    for names in PROCESS_STATES:
        like = single[names] if len(names) == 1 else single[names[0]] * single[names[1]]
        reach = (like @ single_signals).astype(np.float64)
        right = joint.x.T @ reach[:, :-1]
        variance = _process_variance(joint, like, reach, right, projected)
        spread += variance * joint.weight**2 * right
        size += variance
    return spread, size


def _process_variance(joint: _Joint, like: Array, reach: Array, right: Array, projected: Array) -> float:
    """Variance of a process [N2.m2 or N2], from products of residuals at similar states and distant times.

    The residual is (1 - P) (noise + process), P = taken @ x'; the expectations of both terms are traces. They follow
    from reach = like @ [x, residual] and right = x' like x, less the pairs of rows that are close in time.
    """
    near, squares = np.column_stack([reach[:, :-1] @ joint.turn, reach[:, -1]]), float(np.vdot(like, like))
    for rows, others, close in joint.close:
        own = like[rows, others] * close
        near[rows] -= own @ projected[others]
        squares -= float(np.vdot(own, own))
    pairs, x, taken = near[:, :-1], joint.x, joint.taken
    within = float(len(like) - 2 * np.vdot(joint.turn, right) + np.vdot(taken.T @ taken, right))  # E[residual'residual]
    across = float(squares - 2 * np.vdot(pairs, reach[:, :-1]) + np.vdot(taken.T @ pairs, right))
    if across <= 0 or within <= 0:
        return 0.0
    power = float(joint.rest @ joint.rest)
    noise = power / max(len(joint.rest) - float(np.vdot(taken, x)) / joint.stride, 1.0)
    products = float(joint.rest @ near[:, -1]) + noise * float(np.vdot(pairs, x)) / joint.stride
    error = noise * np.sqrt(2 * squares)
    return float(np.clip((products - VARIANCE_REDUCTION * error) / across, 0.0, power / within))


def _delay_error(joints: Sequence[_Joint], white: Array) -> Array:
    """Error (b,) [units of base], one standard deviation with signs, that a common delay of all torques causes."""
    turn, power, product = np.zeros(len(white)), 0.0, 0.0
    for joint in joints:
        turn[joint.columns] -= joint.weight * joint.x.T @ joint.slope
        product -= joint.weight * float(joint.slope @ joint.rest)
        power += joint.weight * float(joint.slope @ joint.slope)
    free = power - float(turn @ white @ turn)
    if free <= 1e-9 * power:
        return np.zeros(len(white))
    excess = (product / free) ** 2 - 1 / free  # squared delay less its expectation under noise [s2]
    return np.asarray(white @ turn * np.sqrt(max(excess, 0.0)))


def _drift_std(joints: dict[int, _Joint], sizes: Array, base: BaseMap, value: Array) -> Array:
    """Standard deviation (p,) [units of the labels] of each standard parameter between recordings.

    It is proportional to the discrepancy relative to friction, averaged over all joints, up to the measured drift.
    Robots whose friction follows its laws exactly are simulated, or their friction does not depend on temperature.
    """
    place = {int(k): row for row, k in enumerate(base.independent)}
    drift, shares = np.zeros(len(base.labels)), []
    for j, joint in joints.items():
        own = [k for k, x in enumerate(base.labels) if k in place and x.joint == j and x.positive and x.unit in DRIFTS]
        rows = np.isin(joint.columns, [place[k] for k in own])
        power = float(np.mean((joint.x[:, rows] @ value[joint.columns[rows]]) ** 2))
        shares += [sizes[j] / power] if power > 0 else []
        for k in own:
            drift[k] = DRIFTS[base.labels[k].unit] * abs(value[place[k]])
    share = float(np.sqrt(np.mean(shares))) if shares else 0.0
    return np.asarray(min(1.0, share / VISCOUS_DRIFT) * drift)


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
    weakest: float = MAX_DEVIATION_RATIO,
) -> Estimate:
    """Estimate base parameters by weighted least squares, with a covariance for coloured noise.

    Three steps are iterated: weighted least squares; the autocovariances of each joint's residual, corrected for the
    fitted parameters; an autoregressive model of them, its order by Akaike's criterion. The covariance is that of
    weighted least squares under this noise, plus that of model discrepancy (`discrepancy_covariance`).
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
    for _ in range(MAX_NOISE_ROUNDS):
        solution = _solve_weighted(factors, noise, start, noise_grams)
        covariance = _coloured_covariance(factors, noise, solution)
        before = noise
        noise = [
            _model_noise(joint, columns, old.colour, solution, covariance, whiten)
            for (joint, columns), old in zip(_joint_columns(factors), before, strict=True)
        ]
        changes = ((new.colour, old.colour) for new, old in zip(noise, before, strict=True))
        if all((np.abs(new - old) <= AUTOCOVARIANCE_TOLERANCE * (old[0] + np.abs(old))).all() for new, old in changes):
            break
    solution = _solve_weighted(factors, noise, start, noise_grams)
    covariance = _positive_definite(_coloured_covariance(factors, noise, solution), solution.inverse)
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


def with_spread(found: Estimate, factors: Factors, base: BaseMap, whiten: bool = True) -> Estimate:
    """The estimate from factors of several recordings, whose covariance contains how much these differ.

    Each recording is estimated alone, from its own factors (`repeats.spread_between`).
    """
    if len(factors.parts) < 2:
        return found
    from .repeats import spread_between, spread_covariance  # imported here, because most fits are of one recording

    alone = [estimate(part, base, found.value, whiten) for _, part in factors.parts]
    values, variances = (np.array(x) for x in zip(*((x.value, np.diag(x.covariance)) for x in alone), strict=True))
    spread = spread_between(values, variances)
    noise = [_Noise(0, np.array([size**2])) for size in found.noise]
    parts = np.array([_solve_weighted(part, noise, found.value).information for _, part in factors.parts])
    added = spread_covariance(spread, parts, _solve_weighted(factors, noise, found.value).inverse)
    return replace(found, covariance=found.covariance + added, spread=spread)


def _joint_columns(factors: Factors) -> Sequence[tuple[JointFactors, Indices]]:
    return list(zip(factors.joints, factors.columns, strict=True))


def _plain_gram(gram: Array, columns: Indices) -> Array:
    """The part of Gram matrices (..., c, c) that belongs to [x y], without instruments."""
    return gram[..., -len(columns) - 1 :, -len(columns) - 1 :]


def _first_noise(factors: Factors) -> list[_Noise]:
    """White noise of the size of each joint's own least-squares residual."""
    noise = []
    for joint, columns in _joint_columns(factors):
        gram = _plain_gram(joint.grams[0], columns)
        size = np.sqrt(np.maximum(np.diag(gram)[:-1], 1e-300))
        inverse = np.linalg.pinv(gram[:-1, :-1] / np.outer(size, size), rcond=MIN_EIGENVALUE, hermitian=True)
        rest = gram[-1, -1] - (gram[:-1, -1] / size) @ inverse @ (gram[:-1, -1] / size)
        variance = max(float(rest), _min_noise_share(joint, columns) * gram[-1, -1], 1e-300) / max(joint.counts[0], 1)
        noise.append(_Noise(0, variance * (np.arange(len(joint.grams)) == 0)))
    return noise


def _min_noise_share(joint: JointFactors, columns: Indices) -> float:
    """Smallest noise variance, over the torque's power."""
    return MIN_NOISE_SHARE if joint.counts[0] >= MIN_COLUMN_ROWS * len(columns) else FEW_ROWS_NOISE_SHARE


def _solve_weighted(
    factors: Factors, noise: Sequence[_Noise], prior: Array, noise_grams: Sequence[Array] | None = None
) -> _Solution:
    information, right = np.zeros((len(prior), len(prior))), np.zeros(len(prior))
    for j, ((joint, columns), model) in enumerate(zip(_joint_columns(factors), noise, strict=True)):
        gram = _plain_gram(joint.grams[0], columns) / model.colour[0]
        information[np.ix_(columns, columns)] += gram[:-1, :-1]
        if noise_grams is not None:
            information[np.ix_(columns, columns)] -= noise_grams[j] / model.colour[0]
        right[columns] += gram[:-1, -1]
    size = np.sqrt(np.maximum(np.diag(information), 0))
    scale = np.divide(1, size, out=np.zeros_like(size), where=size > 0)
    values, vectors = np.linalg.eigh(information * np.outer(scale, scale))
    known = values > MIN_EIGENVALUE * max(values[-1], 1e-300)
    inverse = (vectors[:, known] / values[known]) @ vectors[:, known].T * np.outer(scale, scale)
    unknown = (np.sum(vectors[:, ~known] ** 2, axis=1) > 1e-8) | (size == 0)
    return _Solution(prior + inverse @ (right - information @ prior), information, inverse, unknown)


def _coloured_covariance(factors: Factors, noise: Sequence[_Noise], solution: _Solution) -> Array:
    """Covariance (b, b) of weighted least squares under coloured noise."""
    spread = np.zeros_like(solution.inverse)
    for (joint, columns), model in zip(_joint_columns(factors), noise, strict=True):
        spread[np.ix_(columns, columns)] += _plain_gram(_sum_covariance(joint, model.colour), columns)[:-1, :-1]
    return solution.inverse @ spread @ solution.inverse


def _positive_definite(covariance: Array, white: Array) -> Array:
    """Covariance made positive definite, with at least a share of the white one; few lags miss slow noise."""
    size = np.sqrt(np.maximum(np.diag(white), 1e-300))
    values, vectors = np.linalg.eigh((covariance + covariance.T) / 2 / np.outer(size, size))
    least = MIN_VARIANCE_RATIO * np.einsum("ik,ij,jk->k", vectors, white / np.outer(size, size), vectors)
    return np.asarray((vectors * np.maximum(values, least)) @ vectors.T * np.outer(size, size))


def _sum_covariance(joint: JointFactors, r: Array) -> Array:
    """Covariance (c, c) of the weighted sums of rows times noise of autocovariance r."""
    lagged = np.tensordot(r[1:] / r[0] / r[0], joint.grams[1:], 1)
    return np.asarray(joint.grams[0] / r[0] + lagged + lagged.T)


def _model_noise(
    joint: JointFactors, columns: Indices, old: Array, solution: _Solution, covariance: Array, whiten: bool
) -> _Noise:
    """Autoregressive model by Levinson's recursion, stable since every reflection coefficient is below 1."""
    r = _autocovariances(joint, columns, old, solution, covariance)
    count, phi, variance = max(joint.counts[0], 1), np.zeros(0), float(r[0])
    best, chosen = np.inf, phi
    for order in range(1, len(r) if whiten else 1):
        reflection = (r[order] - phi @ r[order - 1 : 0 : -1]) / variance
        if abs(reflection) >= MAX_REFLECTION:
            break
        phi = np.append(phi - reflection * phi[::-1], reflection)
        variance *= 1 - reflection**2
        criterion = count * np.log(variance) + order * ORDER_PENALTY
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
    grams = _plain_gram(joint.grams, columns)  # (d, m + 1, m + 1)
    c, part, lags = np.append(-solution.value[columns], 1.0), np.ix_(columns, columns), len(grams)
    traces, given = np.tensordot([solution.inverse[part], covariance[part]], grams[:, :-1, :-1], ((1, 2), (1, 2)))
    both = np.concatenate([traces[:0:-1], traces]) / old[0]  # trace at lags -(lags - 1) .. lags - 1
    colour = np.concatenate([old[:0:-1], old])
    taken = 2 * np.convolve(colour, both)[2 * (lags - 1) :][:lags]
    r = (grams @ c @ c + taken - given) / np.maximum(joint.counts, 1)
    r[0] = max(r[0], _min_noise_share(joint, columns) * grams[0][-1, -1] / max(joint.counts[0], 1), 1e-300)
    return np.asarray(r)


def _with_instruments(factors: Factors, noise: Sequence[_Noise], plain: Estimate, weakest: float) -> Estimate:
    """Instrumental-variable estimate, or least squares if the instruments are weak."""
    b = len(plain.value)
    zx, zz, zy = np.zeros((b, b)), np.zeros((b, b)), np.zeros(b)
    for (joint, columns), model in zip(_joint_columns(factors), noise, strict=True):
        gram, m = joint.grams[0] / model.colour[0], len(columns)
        zx[np.ix_(columns, columns)] += gram[:m, m : 2 * m]
        zz[np.ix_(columns, columns)] += _sum_covariance(joint, model.colour)[:m, :m]
        zy[columns] += gram[:m, -1]
    size = np.sqrt(np.maximum(np.diag(plain.information), 1e-300))
    if not np.all(np.isfinite(plain.covariance)) or np.linalg.cond(zx / np.outer(size, size)) > 1 / MIN_EIGENVALUE:
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
