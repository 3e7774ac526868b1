"""Evidence for signs and zeros on blocks that took no part in their fit."""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from ...types import Array
from .fit import ZeroFit, fit_zeros
from .load import Loads, foreseen

PRIOR = np.log(4.0)  # nats that each changed sign or zero is less likely before
WHOLE = 4  # recordings from which they are held out whole
FEW = 0.5  # nats of errors of a block that count as none
MOST = 12.0  # nats that the evidence can reach; models of robots are not exact


def held_out(loads: Loads, noise: Array, fit: ZeroFit) -> Array:
    """Half the squared errors over their noise (B,) [nats] in each of B blocks, fitted without them.

    noise: (n,) [rad or m] of independent rows.
    """
    rows = loads.rows
    whole = len(np.unique(rows.recording)) >= WHOLE
    half = (rows.recording if whole else rows.block) % 2 == 0
    names, number = np.unique(rows.block, return_inverse=True)
    out = np.zeros(len(names))
    for mine in (half, ~half):
        here, there = loads.part(mine), loads.part(~mine)
        own = fit_zeros(here, noise, fit.signs, fit.zeros, fit.free)
        load, other = (x.torque(own.signs, own.zeros) for x in (here, there))
        for line in here.lines:
            left, use = foreseen(here, line, load, there, other)
            np.add.at(out, number[~mine][use], 0.5 * (left / noise[line.joint]) ** 2)
    return out


def log_odds(first: Array, second: Array, more: int) -> float:
    """Log odds of a first fit against a second one [nats], at most those by which its blocks are better on average.

    first: (B,) [nats] of its blocks; second: (B,) [nats] of the other's; more: changes of the first alone.
    """
    total, ratio = float(np.sum(second - first)), np.log((second + FEW) / (first + FEW))
    count = len(ratio)
    if count < 2 or total == 0.0:
        return float(-PRIOR * more)
    spread = float(np.std(ratio, ddof=1)) / np.sqrt(count)
    steady = float(np.sign(total) * np.mean(ratio)) / max(spread, 1e-12)
    sure = -float(student.logsf(max(steady, 0.0), count - 1))
    return float(np.clip(np.sign(total) * min(abs(total), sure), -MOST, MOST) - PRIOR * more)


def probability(odds: float) -> float:
    """Probability of log odds [nats]."""
    return float(1 / (1 + np.exp(-np.clip(odds, -30, 30))))
