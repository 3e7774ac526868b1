"""Evidence -> factors between recorded and predicted torques: wrong units of all joints, wrong gains of some."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..regression.projection import least_squares
from ..types import Array, Mask
from .correction import Correction
from .evidence import FaultEvidence, Signals
from .fits import FitColumns

# [1] largest unexplained share of a good fit; smallest unexplained share without the prediction, over that with it, and
# absolute
FITS, RIGID, LEAST = 0.15, 3.0, 0.03
SURE = 0.1  # [1] largest standard error of a factor's logarithm
# [1] smallest predicted torque over the strongest, and smallest speed over the fastest, that friction cannot explain
SMALL, MOVES = 0.03, 0.05
ALL, LONE = 1.9, 3.0  # [1] factor of several joints, and of a single one, from which on the model is not the cause
BEYOND = 5.0  # [1] factor from which on no change of a single body is the cause
ALIKE = 1.5  # [1] ratio to the median up to which factors count as equal
ROTOR = 300.0  # [1] largest factor without gravity: geared rotors can dominate the links
ONE = 1.65  # [1] ratio of one joint's factor to the median, from which on it is an error
RIVAL = 0.6  # [1] largest residual with factors, over that with the best change of one body


class Gains(NamedTuple):
    """Factors of the torques, and those that are faults."""

    factor: Array  # (n,) [1] recorded over predicted torque; NaN if it is not identifiable
    spread: Array  # (n,) [1] standard error of its logarithm
    common: float  # [1] factor of all joints; 1 if the model may be the cause
    lone: tuple[int, ...]  # joints with a wrong gain of their own


def judge_gains(evidence: FaultEvidence, done: Correction) -> Gains:
    """Estimate factors of the corrected torques.

    Args:
        evidence: evidence of the recordings.
        done: correction found so far.
    """
    x, n = evidence.corrected(done), len(done.lag)
    factor, spread = np.full(n, np.nan), np.full(n, np.nan)
    strongest = np.sqrt(np.mean(x.predicted**2, axis=0)).max(initial=0.0)
    speed = np.sqrt(np.mean(x.v**2, axis=0))
    usable = evidence.signed & (np.std(x.predicted, axis=0) >= SMALL * strongest) & (speed >= MOVES * speed.max())
    for j in np.flatnonzero(usable).tolist():
        rotor = not evidence.rotors[j]
        fit, without = (FitColumns(x, j, own, rotor).fit(x.torque[:, j]) for own in (True, False))
        if fit.unexplained <= FITS and without.unexplained >= max(LEAST, RIGID * fit.unexplained):
            spread[j] = _spread(evidence, x, j, fit.gain, rotor)
            factor[j] = fit.gain if spread[j] <= SURE else np.nan
    known = np.isfinite(factor)
    if not known.any():
        return Gains(factor, spread, _inertial(evidence, x), ())
    middle, least = float(np.median(factor[known])), ALL if known.sum() > 1 else LONE
    rivals = _Rivals(evidence, done, x, factor)
    alike = np.mean(np.abs(np.log(factor[known] / middle)) <= np.log(ALIKE)) > 0.5
    off = abs(np.log(middle))
    common = alike and (off >= np.log(BEYOND) or (off >= np.log(least) and rivals.beaten(1.0, np.full(n, middle))))
    apart = known & (np.abs(np.log(np.where(known, factor, 1.0) / middle)) >= np.log(ONE))
    lone = apart.any() and known.sum() > 1 and apart.sum() <= known.sum() / 2
    own = np.where(apart, factor, middle)
    chosen = np.flatnonzero(apart).tolist() if lone and rivals.beaten(middle, own) else []
    return Gains(factor, spread, middle if common else 1.0, tuple(chosen))


class _Rivals(NamedTuple):
    """Changed inertials of a single body as the rival explanation of factors."""

    evidence: FaultEvidence
    done: Correction
    x: Signals
    factor: Array  # (n,) [1]

    def beaten(self, factor: float, own: Array) -> bool:
        """Whether one factor per joint (n,) explains far more than a common factor with a change of any one body."""
        x, known = self.x, np.isfinite(self.factor)
        motion = self.evidence.along(self.done)
        scaled = x._replace(predicted=x.predicted * factor)
        rival = min(_residual(scaled, known, motion.body_columns(body)) for body in range(len(own)))
        return _residual(x._replace(predicted=x.predicted * own), known) <= RIVAL * rival


def _spread(evidence: FaultEvidence, x: Signals, joint: int, gain: float, rotor: bool) -> float:
    """Standard error of a gain's logarithm, by the jackknife over blocks."""
    blocks = np.unique(evidence.block)
    gains = []
    for k in blocks:
        kept = evidence.block != k
        rows = Signals(*(signal[kept] for signal in x))
        gains.append(FitColumns(rows, joint, rotor=rotor).fit(rows.torque[:, joint]).gain)
    return float(np.sqrt((len(blocks) - 1) * np.mean((np.array(gains) - gain) ** 2)) / max(gain, 1e-300))


def _inertial(evidence: FaultEvidence, x: Signals) -> float:
    """Factor of the strongest joint without a rotor, for a robot whose factors gravity does not show; else 1."""
    size = np.where(evidence.signed, np.std(x.predicted, axis=0), 0.0)
    joint = int(np.argmax(size))
    if size[joint] == 0:
        return 1.0
    fit = FitColumns(x, joint, rotor=False).fit(x.torque[:, joint])
    without = FitColumns(x, joint, predicted=False, rotor=False).fit(x.torque[:, joint])
    informative = fit.unexplained <= FITS and without.unexplained >= max(LEAST, RIGID * fit.unexplained)
    return fit.gain if informative and not 1 / LONE < fit.gain < ROTOR else 1.0


def _residual(x: Signals, known: Mask, shared: Array | None = None) -> float:
    """Sum of unexplained shares [1] with prediction, friction and a change of one body, columns (K, n, 10)."""
    rows = []
    for j in np.flatnonzero(known):
        own = np.stack([x.v[:, j], x.direction[:, j], x.a[:, j], np.ones(len(x.v))], axis=1)
        rest = (x.torque[:, j] - x.predicted[:, j])[:, None]
        free = rest if shared is None else np.column_stack([shared[:, j], rest])
        basis = np.linalg.qr(own)[0]
        rows.append((free - basis @ (basis.T @ free)) / np.std(x.torque[:, j]))
    columns, y = np.split(np.concatenate(rows), [-1], axis=1)
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    fitted = scaled @ least_squares(scaled, y, 1e-6) if scaled.shape[1] else 0.0
    return float(np.sum((y - fitted) ** 2)) / len(x.v)
