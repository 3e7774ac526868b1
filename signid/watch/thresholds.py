"""Quiet stretch -> size of the residual at each state, and from which multiple of it on a contact is sure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..types import Array, Mask
from .observer import Observed

SIGMAS = 4.5  # [1] threshold over the size of the residual
PEAK = 2.0  # [1] threshold over the largest residual of the quiet stretch, in units of its size
SHARE, STRANGE = 0.03, 0.1  # [1] error of friction over its size; the same of a joint that has not moved yet
USUAL = 99.9  # [%] of the squared residuals of the quiet stretch that give its size; those above are its largest ones
LITTLE = 0.05  # [1] smallest variance that counts, over the mean squared residual
ROUNDS = 4  # of the weights


@dataclass(frozen=True, eq=False)
class Discrepancy:
    """Size of the residual of n joints: noise, misfit of the model, error of friction, and torque that is late.

    At starts, stops and reversals torque changes quickly, and the error is that of a torque that is some milliseconds
    early or late: samples at different instants, delays, and links and gears that swing.
    """

    noise: Array  # (n,) [N.m or N]
    delay: Array  # (n,) [s]
    share: Array  # (n,) [1] of the friction
    factor: Array  # (n,) [1] threshold over size

    def threshold(self, seen: Observed, std: Array) -> Array:
        """Thresholds (K, n) [N.m or N]; std: (n,) of the predicted torque by model and named changes [N.m or N]."""
        late, friction = self.delay * seen.rate, self.share * seen.friction
        return np.asarray(self.factor * np.sqrt(self.noise**2 + late**2 + friction**2 + std**2))


def learn(seen: Observed, beyond: Array, moved: Mask, misfit: Array, period: float) -> Discrepancy:
    """Size of the residual from the K blocks of the quiet stretch.

    beyond: (K, n) residual that friction cannot explain [N.m or N]; moved: (n,) whether a joint moved long enough;
    misfit: (n,) rms that the model left when it was identified [N.m or N]; period: of the samples [s], the shortest
    delay that is assumed. A joint that has not moved takes the delay of the others.
    """
    n = beyond.shape[1]
    share = np.where(moved, SHARE, STRANGE)
    least = misfit**2 + (share * seen.friction) ** 2 + (period * seen.rate) ** 2
    noise, delay = np.empty(n), np.empty(n)
    for j in range(n):
        noise[j], delay[j] = _noise_and_delay(beyond[:, j] ** 2, seen.rate[:, j] ** 2, least[:, j])
    if moved.any():
        delay[~moved] = np.median(delay[moved])
    sized = Discrepancy(np.hypot(noise, misfit), np.hypot(delay, period), share, np.ones(n))
    ratio = (beyond / np.maximum(sized.threshold(seen, np.zeros(n)), 1e-12)).max(axis=0)
    if moved.any():
        ratio[~moved] = np.maximum(ratio[~moved], np.median(ratio[moved]))
    return Discrepancy(sized.noise, sized.delay, share, np.maximum(SIGMAS, PEAK * ratio))


def _noise_and_delay(power: Array, rate: Array, least: Array) -> tuple[float, float]:
    """Noise [N.m or N] and delay [s] of a joint by weighted least squares: power = noise^2 + delay^2 rate."""
    from scipy.optimize import nnls  # slow to import

    power = np.minimum(power, np.percentile(power, USUAL))
    floor = LITTLE * float(power.mean()) + 1e-24
    columns, weight = np.column_stack([np.ones_like(rate), rate / max(float(rate.max()), 1e-300)]), np.ones_like(rate)
    found = np.zeros(2)
    for _ in range(ROUNDS):
        found = nnls(columns * weight[:, None], power * weight)[0]
        weight = 1.0 / np.maximum(columns @ found + least, floor)
        weight /= weight.max()
    return float(np.sqrt(found[0])), float(np.sqrt(found[1] / max(float(rate.max()), 1e-300)))
