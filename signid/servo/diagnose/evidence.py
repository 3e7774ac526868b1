"""Evidence for hypotheses on drives: their likelihood over windows, their prior, odds of one over another."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...diagnose.evidence.bayes_factors import StackedPriors, log_bayes_factor
from ...types import Array
from .hypotheses import HYPOTHESES, DriveHypothesis
from .refine import Attempt, Setting, information

PER_WINDOW = 10  # samples of a window that count as independent, at most. Heuristic
SLACK = 1.0  # log odds that differences across windows always allow. Heuristic


@dataclass(frozen=True, eq=False)
class Offer:
    """A hypothesis with its fitted trial and log evidence."""

    law: DriveHypothesis
    joint: int
    trial: Attempt
    evidence: float = -np.inf  # log likelihood and prior
    prior: float = 0.0  # log prior probability, with that of its numbers


def rejected(last: Attempt, offers: Sequence[Offer]) -> list[tuple[str, int, float]]:
    """Laws of offers, their joints, and the share of the squared residual there that each explains [1]."""
    before = np.sum(last.squares, axis=0)
    return [(o.law.effect, o.joint, float(1 - o.trial.squares[:, o.joint].sum() / before[o.joint])) for o in offers]


def tempered(setting: Setting, best: Offer, rival: Offer) -> float:
    """Log odds of the best over a rival, at most what the differences across windows allow (Vuong 1989)."""
    prior = best.prior - rival.prior
    difference = np.sum((rival.trial.squares - best.trial.squares) / setting.sigma**2, axis=1)
    return limited(best.evidence - rival.evidence - prior, prior, difference)


def limited(odds: float, prior: float, difference: Array) -> float:
    """Log odds of likelihood and prior, at most what the differences of the windows allow.

    difference: (W,) [1] of the weighted squares of each window.
    """
    error = float(np.std(difference)) * np.sqrt(len(difference)) + 1e-300
    z = max(float(np.sum(difference)) / error, 0.0)
    return float(max(prior + min(odds, 0.5 * z * z + SLACK), 0.0))


def mean_sigma(setting: Setting, trial: Attempt, floor: Array) -> Array:
    """Weights of the joints: rms of the residual and noise, (n,) [rad or m]. floor: (n,) [rad or m]."""
    rows = setting.loop.rows + 1
    return np.asarray(np.sqrt(np.mean(trial.squares, axis=0) / rows + floor**2))


def half_log(squares: Array, floor: Array, setting: Setting) -> float:
    """Negative log likelihood: half the number of independent samples times the log of the mean square, all joints.

    squares: (W, n) [rad2 or m2]; floor: (n,) [rad or m].
    """
    rows = setting.loop.rows + 1
    return half_log_of(squares / rows, floor, rows)


def half_log_of(mean: Array, floor: Array, rows: int) -> float:
    """The same by mean squares of windows of some rows.

    mean: (W, n) [rad2 or m2]; floor: (n,) [rad or m].
    """
    whole = np.log(np.mean(mean, axis=0) + 0.1 * floor**2)
    return float(0.5 * len(mean) * min(rows, PER_WINDOW) * np.sum(whole))


def price(setting: Setting, last: Attempt, trial: Attempt) -> float:
    """Log prior of the additional numbers, as in a diagnosis of torque: typical sizes times each effect size."""
    new = [k for k, slot in enumerate(trial.where.slots) if slot not in last.where.slots]
    if not new:
        return 0.0
    sizes = [trial.where.slots[k].typical for k in new]
    return price_of(information(setting, trial.where), new, sizes, setting.loop.rows + 1)


def price_of(whole: Array, new: Sequence[int], sizes: Sequence[float], rows: int) -> float:
    """The same by the information of all numbers, in windows of some rows, and typical sizes of the new ones.

    whole: (P, P) [inverse products of SERVO_UNITS].
    """
    whole = whole * min(rows, PER_WINDOW) / rows
    old = [k for k in range(len(whole)) if k not in new]
    across = whole[np.ix_(old, new)]
    own = whole[np.ix_(new, new)] - across.T @ np.linalg.pinv(whole[np.ix_(old, old)], hermitian=True) @ across
    nothing = np.zeros((1, len(new)))
    return float(
        log_bayes_factor(StackedPriors(np.diag(sizes)[None], nothing, nothing * np.nan), own[None], nothing)[0]
    )


def weighed(setting: Setting, last: Attempt, offer: Offer, floor: Array) -> Offer:
    """The offer with its log evidence and its log prior. floor: (n,) [rad or m]."""
    choices = len(HYPOTHESES) * len(last.where.servos)
    before, after = last.where.servos[offer.joint], offer.trial.where.servos[offer.joint]
    prior = float(np.log(offer.law.plausible(before, after) / choices)) + price(setting, last, offer.trial)
    return replace(offer, evidence=prior - half_log(offer.trial.squares, floor, setting), prior=prior)
