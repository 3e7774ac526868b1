"""Parameters -> signs of single samples: a Markov chain over each joint's signs, refined together with the parameters.

It restores the samples below the threshold, and mends segments in which the torque changed its sign after all.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Array, Frozen, Mask
from ..rows.observations import Observed
from ..rows.segments import place_sign_changes
from ..search.problem import KnownRows, orthonormalise, signed_rows

INFLATION = 10.0  # samples for one whose residual is independent of the others
MOST = 30.0  # of them: with more, signs would follow the chain alone
SAME = 2.0  # log-odds that neighbours have the same sign, whatever their torques
WINDOW = 31  # samples over which torque changes alike
CALM = 0.25  # of the median squared change: no stretch counts as calmer
SURE, TIED = 200.0, 60.0  # log-odds of a sample and of neighbours, at most
EXACT = 1e-9  # of the rms torque: no residual and no change counts as smaller
SETTLED = 1e-10  # relative change of the coordinates


@dataclass(frozen=True, eq=False)
class RefinedSigns(Frozen):
    """Signs of N samples of n joints, and the parameters that go with them."""

    signs: Array  # (N, n) [1] the likeliest: -1 or 1; as recorded where torque has its sign, 0 where there is none
    expected: Array  # (N, n) [1] their expectation
    value: Array  # (b,) base parameters, fitted to expected signs [units of base]
    sigma: Array  # (n,) standard deviation of the residual of the steady samples [N.m or N], 0 where no torque is
    loss: float  # expected sum of the squared weighted residuals of the steady samples, and of rows that are known
    rounds: int
    change: float  # relative, of the parameters' coordinates in the last round


def refine_signs(
    observed: Observed,
    weights: Array,
    value: Array,
    *,
    inflation: Array | None = None,
    known: KnownRows | None = None,
    same: float = SAME,
    rounds: int = 12,
) -> RefinedSigns:
    """Signs of all samples by expectation maximisation, from parameters that are nearly right.

    Samples near reversals do not teach the parameters; their own residual says what they tell of signs. Parameters are
    fitted to expected signs: a fit to the likeliest ones would take noise for torque where torque is small.

    Args:
        observed: the rows.
        weights: (n,) [1/N.m or 1/N] of each joint's torque.
        value: (b,) base parameters to begin with [units of base].
        inflation: (n,) samples for one that is independent of the others [1]; 10 by default, 30 at most.
        known: rows with a known right side, beside the torques that have their sign.
        same: log-odds that neighbours have the same sign, whatever their torques.
        rounds: at most.

    Source: Dempster, Laird, Rubin, J. Royal Statistical Society B 39(1), 1977; Rabiner, Proc. IEEE 77(2), 1989.
    """
    hidden = list(observed.hidden)
    fit = _ParameterFit.of(observed, weights, known)
    magnitude = np.abs(observed.torque[:, hidden])
    tied = coupling(magnitude, observed.first, same)
    kappa = np.full(len(weights), INFLATION) if inflation is None else np.minimum(inflation, MOST)
    z, done, change = np.zeros(fit.back.shape[1]), 0, np.inf
    expected = odds = np.zeros_like(magnitude)
    while done < rounds:
        done += 1
        predicted = observed.predict(value)[:, hidden]
        variance = _variance((np.abs(predicted) - magnitude) ** 2, magnitude, fit.taught, kappa[hidden])
        odds = np.clip(2 * predicted * magnitude / variance, -SURE, SURE)
        expected = expected_signs(odds, tied)
        before, z = z, fit.coordinates(expected * magnitude)
        value = fit.back @ z
        change = float(np.linalg.norm(z - before) / max(float(np.linalg.norm(z)), 1e-300))
        if change <= SETTLED:
            break
    signs = np.sign(observed.torque) * (observed.known & observed.signed)
    mean = signs.copy()
    signs[:, hidden], mean[:, hidden] = likeliest_signs(odds, tied), expected
    signs = place_sign_changes(observed, signs, observed.predict(value))
    sigma = _deviation(observed, mean, value)
    return RefinedSigns(signs, mean, value, sigma, max(fit.energy - float(z @ z), 0.0), done, change)


def coupling(magnitude: Array, first: Mask, same: float = SAME) -> Array:
    """Log-odds that a sample has the sign of the one before it: (N, h) [1], 0 where a span begins.

    Torque counts as a random walk whose steps are those of |torque| nearby: two neighbours that are large beside them
    have one sign, of two that are small either may have any.

    Args:
        magnitude: (N, h) absolute torque [N.m or N].
        first: (N,) whether a span begins with a sample.
        same: log-odds whatever the torques.
    """
    inside = np.broadcast_to(~first[:, None], magnitude.shape)
    step = np.diff(magnitude, axis=0, prepend=magnitude[:1]) ** 2 * inside
    from scipy.ndimage import uniform_filter1d  # here, because it takes longer to import than to use

    size = min(WINDOW, len(magnitude))
    share = uniform_filter1d(inside.astype(np.float64), size, axis=0, mode="nearest")
    local = uniform_filter1d(step, size, axis=0, mode="nearest") / np.maximum(share, 1 / size)
    calm = np.median(step[~first], axis=0) if not first.all() else 0.0
    before = np.concatenate([magnitude[:1], magnitude[:-1]])
    odds = 2 * before * magnitude / np.maximum(local, np.maximum(CALM * calm, _least(magnitude))) + same
    return np.where(inside, np.minimum(odds, TIED), 0.0)


def expected_signs(odds: Array, tied: Array) -> Array:
    """Expectation of the signs of h chains: (N, h) [1].

    Args:
        odds: (N, h) [1] log-odds of + that each sample tells.
        tied: (N, h) [1] log-odds that a sample has the sign of the one before it.

    Source: forward and backward messages of Rabiner, Proc. IEEE 77(2), 1989, as odds.
    """
    own, same = np.exp(odds), np.exp(tied)
    after = np.concatenate([same[1:], np.ones_like(same[:1])])
    return np.tanh(0.5 * (_messages(own, same) + _messages(own[::-1], after[::-1])[::-1] - odds))


def likeliest_signs(odds: Array, tied: Array) -> Array:
    """The likeliest signs of h whole chains: (N, h) [1], -1 or 1.

    Args:
        odds: (N, h) [1] log-odds of + that each sample tells.
        tied: (N, h) [1] log-odds that a sample has the sign of the one before it, at least 0.

    Source: Viterbi, IEEE Trans. Information Theory 13(2), 1967.
    """
    paths = [_path(o, t) for o, t in zip(odds.T.tolist(), tied.T.tolist(), strict=True)]
    return np.array(paths).reshape(odds.T.shape).T


def _messages(own: Array, same: Array) -> Array:
    """(N, h) log-odds of + by each sample and all before it."""
    out = [_forward(o, s) for o, s in zip(own.T.tolist(), same.T.tolist(), strict=True)]
    return np.asarray(np.log(np.array(out).reshape(own.T.shape)).T)


def _forward(own: list[float], same: list[float]) -> list[float]:
    out, odds = [], 1.0
    for told, tie in zip(own, same, strict=True):
        odds = told * (odds * tie + 1.0) / (odds + tie)
        out.append(odds)
    return out


def _path(odds: list[float], tied: list[float]) -> list[float]:
    best, gain = [], 0.0
    for told, tie in zip(odds, tied, strict=True):
        gain = told + min(max(gain, -tie), tie)
        best.append(gain)
    sign, out = 1.0, []
    for gain, tie in zip(best[::-1], [0.0, *tied[:0:-1]], strict=True):
        sign = 1.0 if gain + tie * sign >= 0 else -1.0
        out.append(sign)
    return out[::-1]


def _variance(squares: Array, magnitude: Array, taught: Mask, kappa: Array) -> Array:
    """(N, h) of the residual [squared N.m or N], inflated; near reversals at least that of all samples there."""
    calm = kappa * _mean(squares, taught)
    return np.maximum(np.where(taught, calm, np.maximum(calm, _mean(squares, ~taught))), _least(magnitude))


def _mean(squares: Array, which: Mask) -> Array:
    return np.asarray(np.sum(squares * which, axis=0) / np.maximum(which.sum(0), 1))


def _least(torque: Array) -> Array:
    return np.asarray(EXACT**2 * np.mean(torque**2, axis=0) + 1e-300)


def _deviation(observed: Observed, mean: Array, value: Array) -> Array:
    """(n,) [N.m or N] root of the expected squared residual."""
    torque, predicted = np.abs(observed.torque), observed.predict(value)
    squares = np.maximum(torque**2 - 2 * mean * torque * predicted + predicted**2, 0)
    return np.where(observed.known, np.sqrt(_mean(squares, _taught(observed))), 0.0)


def _taught(observed: Observed) -> Mask:
    """(N, n) samples that teach the parameters: the steady ones, or all of a joint that has none."""
    return observed.steady | ~observed.steady.any(0)


@dataclass(frozen=True, eq=False)
class _ParameterFit:
    """Least squares of the samples that teach: one product for any right side."""

    orthonormal: Array  # (M, r) of the rows whose sign is hidden
    given: Array  # (r,) what the rows with a known right side add
    back: Array  # (b, r)
    weights: Array  # (h,)
    taught: Mask  # (N, h)
    energy: float  # of all right sides

    @classmethod
    def of(cls, observed: Observed, weights: Array, known: KnownRows | None) -> _ParameterFit:
        hidden = list(observed.hidden)
        taught = _taught(observed)
        rows = [observed.rows(j, taught[:, j]) * weights[j] for j in hidden]
        right = [signed_rows(observed, weights), *([] if known is None else [known])]
        told = (observed.torque * weights)[:, hidden][taught[:, hidden]]
        target = np.concatenate([r.target for r in right])
        orthonormal, back = orthonormalise(np.concatenate([*rows, *(r.matrix for r in right)]))
        return cls(
            orthonormal[: len(told)],
            orthonormal[len(told) :].T @ target,
            back,
            weights[hidden],
            taught[:, hidden],
            float(told @ told + target @ target),
        )

    def coordinates(self, torque: Array) -> Array:
        """(r,) best for a torque (N, h) [N.m or N]."""
        return np.asarray(self.orthonormal.T @ (torque * self.weights).T[self.taught.T] + self.given)
