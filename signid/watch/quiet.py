"""Quiet stretch -> noise of frames, changes since the identification, and errors of the model that it shows."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..regression.factors import Misfit
from ..types import Array, Indices, Mask
from .observer import FRAME_COLUMNS, JOINT_COLUMNS, Frames, Observed

BATCH_DURATION = 1.0  # [s] residuals of different batches count as independent
SHRINKAGE_BATCHES = 2.0  # [batches] without correlation that are added to those measured
MIN_NOISE_RATIO = 1e-9  # [1] smallest noise over the rms of the predicted torque
MIN_MOTION_TIME = 2.0  # [s] of motion of a joint that give its noise
FRICTION_CHANGE_SHARE, TORQUE_CHANGE_SHARE, GAIN_CHANGE = 0.1, 0.01, 0.02  # [1] since the identification
QUIET_NOISE_ROUNDS = 4  # of the noise
THRESHOLD_RATIO = 4.5  # [1] threshold over the size of the residual
PEAK_THRESHOLD_RATIO = 2.0  # [1] threshold over the largest residual of the quiet stretch, in units of its size
FRICTION_ERROR_SHARE, UNMOVED_ERROR_SHARE = 0.03, 0.1  # [1] of friction; of a joint that has not moved yet
USUAL_RESIDUAL_PERCENTILE = 99.9  # [%] of the squared residuals of the quiet stretch give its size
MIN_VARIANCE_RATIO = 0.05  # [1] smallest variance that counts, over the mean squared residual
WEIGHT_ROUNDS = 4  # of the weights


@dataclass(frozen=True, eq=False)
class QuietNoise:
    """Noise of n joints in the quiet stretch."""

    frame: Array  # (n,) [N.m or N] standard deviation of the residual of a frame
    inflation: Array  # (n, 14) [1] variance of the score of a column over that of white noise
    base: Array  # (n, 4) [units of the laws] coefficients of JOINT_COLUMNS that the quiet stretch has already
    spread: Array  # (b, b) [standard deviations] factor of the covariance that is left of the errors of the model


class Quiet:
    """Sums over the quiet stretch; memory grows with its duration, which is limited."""

    def __init__(self, joints: int) -> None:
        self.frames: list[tuple[Array, ...]] = []  # t, residual, columns, usable, errors
        self.moved = 0.0  # [s] with a moving joint
        self.total = 0.0  # [s]

    def add(self, frames: Frames, step: float) -> None:
        """Count frames of `step` [s]."""
        self.frames.append((frames.t, frames.residual, frames.columns, frames.usable, frames.errors))
        self.moved += step * float(frames.moving.any(axis=1).sum())
        self.total += step * len(frames.t)

    def moved_long(self) -> Mask:
        """Joints (n,) that moved for at least `MIN_MOTION_TIME`."""
        frame = self.total / sum(len(t) for t, *_ in self.frames)
        return np.asarray(sum(usable.sum(axis=0) for _, _, _, usable, _ in self.frames) * frame >= MIN_MOTION_TIME)

    def noise(self, friction: Array, misfit: Misfit) -> QuietNoise:
        """Changes of a joint's own laws since the model was identified, and the noise of frames without them.

        friction: (n, 2) viscous [N.m.s/rad or N.s/m] and Coulomb friction [N.m or N] of the model. The changes are the
        most likely ones with a prior of the usual size; their residual counts once in the correlation time of the
        misfit. A joint that has not moved takes the misfit as noise.
        """
        t, residual, columns, usable, errors = (np.concatenate(x) for x in zip(*self.frames, strict=True))
        n, moved = residual.shape[1], self.moved_long()
        base, noise, inflation = np.zeros((n, len(JOINT_COLUMNS))), np.zeros(n), np.ones((n, FRAME_COLUMNS))
        precision: Array = np.eye(errors.shape[2])
        batch = ((t - t[0]) // BATCH_DURATION).astype(int)
        for j in range(n):
            here = usable[:, j] if moved[j] else np.ones(len(t), dtype=bool)
            x, e = columns[here, j], residual[here, j]
            own = x[:, : len(JOINT_COLUMNS)]
            correlated = max(1.0, misfit.length[j] * len(t) / self.total)
            if moved[j]:
                base[j] = _changed(own, e, friction[j], correlated)
            rest = e - own @ base[j]
            least = MIN_NOISE_RATIO * float(np.sqrt(np.mean(columns[:, j, 2] ** 2))) + 1e-12
            rms = float(np.sqrt(np.sum(rest**2) / max(len(rest) - len(JOINT_COLUMNS), 1)))
            noise[j] = max(rms, least, misfit.size[j])
            inflation[j] = _inflation(x, rest / noise[j], batch[here])
            if moved[j]:
                precision = precision + errors[here, j].T @ errors[here, j] / (noise[j] ** 2 * correlated)
        return QuietNoise(noise, inflation, base, np.linalg.inv(np.linalg.cholesky(precision)).T)


def _changed(own: Array, e: Array, friction: Array, correlated: float) -> Array:
    """Most likely changes (4,) of a joint's laws [units of the laws] by its residual e (F,) [N.m or N].

    own: (F, 4) columns of JOINT_COLUMNS; friction: (2,) of the model; correlated: frames that count as one.
    """
    speed, torque = (float(np.sqrt(np.mean(own[:, k] ** 2))) for k in (0, 2))
    little = TORQUE_CHANGE_SHARE * torque
    usual = np.array([little / max(speed, 1e-9), little, GAIN_CHANGE, little]) + 1e-12
    usual[:2] += FRICTION_CHANGE_SHARE * np.abs(friction)
    found: Array = np.zeros(len(JOINT_COLUMNS))
    variance = float(np.mean(e**2)) + 1e-24
    for _ in range(QUIET_NOISE_ROUNDS):
        normal = own.T @ own / (variance * correlated)
        found = np.asarray(np.linalg.solve(normal + np.diag(usual**-2), own.T @ e / (variance * correlated)))
        variance = float(np.mean((e - own @ found) ** 2)) + 1e-24
    return found


def _inflation(x: Array, rest: Array, batch: Indices) -> Array:
    """Variance (14,) of the sums of columns times white residual over batches, over that of white noise [1]."""
    sums = np.zeros((batch.max() + 1, x.shape[1]))
    np.add.at(sums, batch, x * rest[:, None])
    power = np.sum(x**2, axis=0)
    count = len(np.unique(batch))
    measured = np.sum(sums**2, axis=0) / np.maximum(power, 1e-300)
    return np.asarray(np.maximum((measured * count + SHRINKAGE_BATCHES) / (count + SHRINKAGE_BATCHES), 1.0))


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
    share = np.where(moved, FRICTION_ERROR_SHARE, UNMOVED_ERROR_SHARE)
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
    return Discrepancy(sized.noise, sized.delay, share, np.maximum(THRESHOLD_RATIO, PEAK_THRESHOLD_RATIO * ratio))


def _noise_and_delay(power: Array, rate: Array, least: Array) -> tuple[float, float]:
    """Noise [N.m or N] and delay [s] of a joint by weighted least squares: power = noise^2 + delay^2 rate."""
    from scipy.optimize import nnls  # slow to import

    power = np.minimum(power, np.percentile(power, USUAL_RESIDUAL_PERCENTILE))
    floor = MIN_VARIANCE_RATIO * float(power.mean()) + 1e-24
    columns, weight = np.column_stack([np.ones_like(rate), rate / max(float(rate.max()), 1e-300)]), np.ones_like(rate)
    found = np.zeros(2)
    for _ in range(WEIGHT_ROUNDS):
        found = nnls(columns * weight[:, None], power * weight)[0]
        weight = 1.0 / np.maximum(columns @ found + least, floor)
        weight /= weight.max()
    return float(np.sqrt(found[0])), float(np.sqrt(found[1] / max(float(rate.max()), 1e-300)))
