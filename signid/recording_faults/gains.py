"""Evidence -> factors between recorded torques and the model's: units of all, a gain of one."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..regression.projection import least_squares
from ..types import Array, Mask
from .correction import Correction
from .evidence import Evidence, Signals
from .fits import Columns

FITS, RIGID, LEAST = 0.15, 3.0, 0.03  # unexplained at most; times as much, and at least, without the prediction
SURE = 0.1  # standard error of a factor's logarithm
SMALL, MOVES = 0.03, 0.05  # of the strongest predicted torque, of the fastest joint: less is not told from friction
ALL, LONE = 1.9, 3.0  # times: a factor of several joints, or of the only one, that no model is off by
BEYOND = 5.0  # times: no single body is off by so much
ALIKE = 1.5  # times that factors may differ from their median and be called one
ROTOR = 300.0  # times a torque without gravity may be too large: geared rotors weigh more than what they move
ONE = 1.65  # times that one joint's factor may differ from the others'
RIVAL = 0.6  # of what the best change of one body leaves: what the gain may leave


class Gains(NamedTuple):
    """Factors, and which of them are gross."""

    factor: Array  # (n,) [1] recorded over predicted torque; NaN where it is not told
    spread: Array  # (n,) [1] standard error of its logarithm
    common: float  # [1] of all joints; 1 where it may be the model
    lone: tuple[int, ...]  # joints whose factor is theirs alone


def judge_gains(evidence: Evidence, done: Correction) -> Gains:
    """Factors of the torques after what was corrected.

    Args:
        evidence: the recordings.
        done: what was corrected.
    """
    x, n = evidence.corrected(done), len(done.lag)
    factor, spread = np.full(n, np.nan), np.full(n, np.nan)
    strongest = np.sqrt(np.mean(x.predicted**2, axis=0)).max(initial=0.0)
    speed = np.sqrt(np.mean(x.v**2, axis=0))
    tells = evidence.signed & (np.std(x.predicted, axis=0) >= SMALL * strongest) & (speed >= MOVES * speed.max())
    for j in np.flatnonzero(tells).tolist():
        rotor = not evidence.rotors[j]
        fit, without = (Columns(x, j, own, rotor).fit(x.torque[:, j]) for own in (True, False))
        if fit.unexplained <= FITS and without.unexplained >= max(LEAST, RIGID * fit.unexplained):
            spread[j] = _spread(evidence, x, j, fit.gain, rotor)
            factor[j] = fit.gain if spread[j] <= SURE else np.nan
    told = np.isfinite(factor)
    if not told.any():
        return Gains(factor, spread, _inertial(evidence, x), ())
    middle, least = float(np.median(factor[told])), ALL if told.sum() > 1 else LONE
    rivals = _Rivals(evidence, done, x, factor)
    alike = np.mean(np.abs(np.log(factor[told] / middle)) <= np.log(ALIKE)) > 0.5
    off = abs(np.log(middle))
    common = alike and (off >= np.log(BEYOND) or (off >= np.log(least) and rivals.beaten(1.0, np.full(n, middle))))
    apart = told & (np.abs(np.log(np.where(told, factor, 1.0) / middle)) >= np.log(ONE))
    lone = apart.any() and told.sum() > 1 and apart.sum() <= told.sum() / 2
    own = np.where(apart, factor, middle)
    chosen = np.flatnonzero(apart).tolist() if lone and rivals.beaten(middle, own) else []
    return Gains(factor, spread, middle if common else 1.0, tuple(chosen))


class _Rivals(NamedTuple):
    """Other inertials of a single body, that may explain what a factor does."""

    evidence: Evidence
    done: Correction
    x: Signals
    factor: Array  # (n,) [1]

    def beaten(self, factor: float, own: Array) -> bool:
        """Whether factors of the joints' own (n,) leave far less than one factor and other inertials of any body."""
        x, told = self.x, np.isfinite(self.factor)
        motion = self.evidence.along(self.done)
        scaled = x._replace(predicted=x.predicted * factor)
        rival = min(_left(scaled, told, motion.body_columns(body)) for body in range(len(own)))
        return _left(x._replace(predicted=x.predicted * own), told) <= RIVAL * rival


def _spread(evidence: Evidence, x: Signals, joint: int, gain: float, rotor: bool) -> float:
    """Standard error of a gain's logarithm, from leaving out one block after another."""
    blocks = np.unique(evidence.block)
    gains = []
    for k in blocks:
        kept = evidence.block != k
        rows = Signals(*(signal[kept] for signal in x))
        gains.append(Columns(rows, joint, rotor=rotor).fit(rows.torque[:, joint]).gain)
    return float(np.sqrt((len(blocks) - 1) * np.mean((np.array(gains) - gain) ** 2)) / max(gain, 1e-300))


def _inertial(evidence: Evidence, x: Signals) -> float:
    """The factor of a robot that gravity does not tell of: of its strongest joint, rotors taken for none."""
    size = np.where(evidence.signed, np.std(x.predicted, axis=0), 0.0)
    joint = int(np.argmax(size))
    if size[joint] == 0:
        return 1.0
    fit = Columns(x, joint, rotor=False).fit(x.torque[:, joint])
    without = Columns(x, joint, predicted=False, rotor=False).fit(x.torque[:, joint])
    tells = fit.unexplained <= FITS and without.unexplained >= max(LEAST, RIGID * fit.unexplained)
    return fit.gain if tells and not 1 / LONE < fit.gain < ROTOR else 1.0


def _left(x: Signals, told: Mask, shared: Array | None = None) -> float:
    """[1] what prediction, friction and other inertials of a body, columns (K, n, 10), leave unexplained, summed."""
    rows = []
    for j in np.flatnonzero(told):
        own = np.stack([x.v[:, j], x.direction[:, j], x.a[:, j], np.ones(len(x.v))], axis=1)
        rest = (x.torque[:, j] - x.predicted[:, j])[:, None]
        free = rest if shared is None else np.column_stack([shared[:, j], rest])
        basis = np.linalg.qr(own)[0]
        rows.append((free - basis @ (basis.T @ free)) / np.std(x.torque[:, j]))
    columns, y = np.split(np.concatenate(rows), [-1], axis=1)
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    fitted = scaled @ least_squares(scaled, y, 1e-6) if scaled.shape[1] else 0.0
    return float(np.sum((y - fitted) ** 2)) / len(x.v)
