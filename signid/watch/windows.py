"""Quiet stretch and windows with forgetting: noise of the residual, and the laws that it could show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..effects.bodies import INERTIA, point_inertia
from ..regression.covariance import Misfit
from ..types import Array, Indices, Mask
from .frames import COLUMNS, LOCAL, PAYLOAD, Frames

BATCH = 1.0  # [s] residuals of different batches count as independent
SHRINK = 2.0  # [batches] without correlation that are added to those measured
NEAREST = 1e-9  # [1] smallest noise over the rms of the predicted torque
MOVED = 2.0  # [s] of motion of a joint that give its noise
CHANGE, LITTLE, GAIN = 0.1, 0.01, 0.02  # [1] usual change since the identification: of friction, over torque, of gain
FRICTION = (0, 1)  # of LOCAL: viscous and Coulomb friction, which grow together when it gets cold or dry
TIP = -1  # joint of the payload
ROUNDS = 4  # of the inertia of a payload
APART = 1e-3  # [1] the same for two laws of friction
LEAST = 1e-9  # [1] smallest eigenvalue of the payload's normal equations that counts, over the largest


@dataclass(frozen=True, eq=False)
class QuietNoise:
    """Noise of n joints in the quiet stretch."""

    frame: Array  # (n,) [N.m or N] standard deviation of the residual of a frame
    inflation: Array  # (n, 14) [1] variance of the score of a column over that of white noise
    base: Array  # (n, 4) [units of the laws] coefficients of LOCAL that the quiet stretch has already


class Quiet:
    """Sums over the quiet stretch; memory grows with its duration, which is limited."""

    def __init__(self, joints: int) -> None:
        self.frames: list[tuple[Array, Array, Array, Array]] = []  # t, residual, columns, usable
        self.moved = 0.0  # [s] with a moving joint
        self.total = 0.0  # [s]

    def add(self, frames: Frames, step: float) -> None:
        """Count frames of `step` [s]."""
        self.frames.append((frames.t, frames.residual, frames.columns, frames.usable))
        self.moved += step * float(frames.moving.any(axis=1).sum())
        self.total += step * len(frames.t)

    def moved_long(self) -> Mask:
        """Joints (n,) that moved for at least `MOVED`."""
        frame = self.total / sum(len(t) for t, *_ in self.frames)
        return np.asarray(sum(usable.sum(axis=0) for *_, usable in self.frames) * frame >= MOVED)

    def noise(self, friction: Array, misfit: Misfit) -> QuietNoise:
        """Changes of a joint's own laws since the model was identified, and the noise of frames without them.

        friction: (n, 2) viscous [N.m.s/rad or N.s/m] and Coulomb friction [N.m or N] of the model. The changes are the
        most likely ones with a prior of the usual size; their residual counts once in the correlation time of the
        misfit. A joint that has not moved takes the misfit as noise.
        """
        t, residual, columns, usable = (np.concatenate(x) for x in zip(*self.frames, strict=True))
        n, moved = residual.shape[1], self.moved_long()
        base, noise, inflation = np.zeros((n, len(LOCAL))), np.zeros(n), np.ones((n, COLUMNS))
        batch = ((t - t[0]) // BATCH).astype(int)
        for j in range(n):
            here = usable[:, j] if moved[j] else np.ones(len(t), dtype=bool)
            x, e = columns[here, j], residual[here, j]
            own = x[:, : len(LOCAL)]
            if moved[j]:
                base[j] = _changed(own, e, friction[j], max(1.0, misfit.length[j] * len(t) / self.total))
            rest = e - own @ base[j]
            least = NEAREST * float(np.sqrt(np.mean(columns[:, j, 2] ** 2))) + 1e-12
            rms = float(np.sqrt(np.sum(rest**2) / max(len(rest) - len(LOCAL), 1)))
            noise[j] = max(rms, least, misfit.size[j])
            inflation[j] = _inflation(x, rest / noise[j], batch[here])
        return QuietNoise(noise, inflation, base)


def _changed(own: Array, e: Array, friction: Array, correlated: float) -> Array:
    """Most likely changes (4,) of a joint's laws [units of the laws] by its residual e (F,) [N.m or N].

    own: (F, 4) columns of LOCAL; friction: (2,) of the model; correlated: frames that count as one.
    """
    speed, torque = (float(np.sqrt(np.mean(own[:, k] ** 2))) for k in (0, 2))
    little = LITTLE * torque
    usual = np.array([little / max(speed, 1e-9), little, GAIN, little]) + 1e-12
    usual[:2] += CHANGE * np.abs(friction)
    variance, found = float(np.mean(e**2)) + 1e-24, np.zeros(len(LOCAL))
    for _ in range(ROUNDS):
        normal = own.T @ own / (variance * correlated)
        found = np.linalg.solve(normal + np.diag(usual**-2), own.T @ e / (variance * correlated))
        variance = float(np.mean((e - own @ found) ** 2)) + 1e-24
    return np.asarray(found)


def _inflation(x: Array, rest: Array, batch: Indices) -> Array:
    """Variance (14,) of the sums of columns times white residual over batches, over that of white noise [1]."""
    sums = np.zeros((batch.max() + 1, x.shape[1]))
    np.add.at(sums, batch, x * rest[:, None])
    power = np.sum(x**2, axis=0)
    count = len(np.unique(batch))
    measured = np.sum(sums**2, axis=0) / np.maximum(power, 1e-300)
    return np.asarray(np.maximum((measured * count + SHRINK) / (count + SHRINK), 1.0))


class Suspect(NamedTuple):
    """A law, or two of friction, with their numbers and their evidence."""

    joint: int  # or TIP
    columns: tuple[int, ...]  # of the frames
    value: Array  # (m,) [units of the laws]
    std: Array  # (m,) [units of the laws], without an inertia that follows from others
    gain: float  # [1] reduction of the squared residual in units of its variance, inflation included
    raw: float  # [1] the same without inflation
    score: float  # [1] log of the evidence: Schwarz, Annals of Statistics 6(2), 1978


class Sums(NamedTuple):
    """Sums over frames of n joints."""

    products: Array  # (n, 15, 15) [1] of columns and residual over the noise
    frames: Array  # (n,) [1] number
    model: Array  # (n,) [1] squared error of the model over the variance of the noise


class Window:
    """Sums (n, 15, 15) of products of columns and residual, each over the noise of its joint."""

    def __init__(self, joints: int, memory: float = np.inf) -> None:
        self.sums = np.zeros((joints, COLUMNS + 1, COLUMNS + 1))
        self.count = np.zeros(joints)  # frames
        self.model = np.zeros(joints)  # squared error of the model by its covariance, over the variance of the noise
        self.memory = memory  # [s]

    def restart(self) -> None:
        """Forget everything."""
        self.sums[:], self.count[:], self.model[:] = 0.0, 0.0, 0.0

    def add(self, sums: Sums, seconds: float) -> None:
        """Add sums of frames that last for some seconds."""
        keep = float(np.exp(-seconds / self.memory))
        for mine, more in zip((self.sums, self.count, self.model), sums, strict=True):
            mine *= keep
            mine += more

    @property
    def excess(self) -> float:
        """Squared residual [1], in units of its variance, beyond that of noise, over all joints."""
        return float(np.maximum(self.sums[:, -1, -1] - self.count, 0.0).sum())

    def candidates(self, noise: QuietNoise) -> list[Suspect]:
        """All laws that act in the window, the best first.

        An error of the model lasts for the whole window, so its square is not divided by the number of frames.
        """
        whole = noise.inflation * (1 + self.model)[:, None]
        excess = np.maximum(self.sums[:, -1, -1] - self.count, 1e-9)
        common = float(
            excess @ whole.mean(axis=1) / excess.sum()
        )  # one for all laws, or the score prefers noisy joints
        found, count = [], float(self.count.sum())
        for j, sums in enumerate(self.sums):
            for columns in ((0,), (1,), (2,), (3,), FRICTION):
                if one := _fit(sums, columns, j):
                    own = float(np.mean(whole[j, list(columns)]))
                    found.append(_scaled(one, own, common, self.count[j]))
        if one := _payload(self.sums.sum(axis=0)):
            found.append(_scaled(one, common, common, count))
        return sorted(found, key=lambda one: -one.score)


def products(frames: Frames, base: Array, noise: QuietNoise) -> Sums:
    """Sums of usable frames; base: (n, 4) coefficients of LOCAL that are known already [units of the laws]."""
    rest = frames.residual - np.einsum("fnk,nk->fn", frames.columns[:, :, : len(LOCAL)], base)
    whole = np.concatenate([frames.columns, rest[:, :, None]], axis=2)
    whole *= (frames.usable / noise.frame)[:, :, None]
    by_joint = whole.transpose(1, 0, 2)
    model = np.sum(frames.usable * np.minimum(frames.std / noise.frame, 1.0) ** 2, axis=0)  # at most what was measured
    return Sums(by_joint.transpose(0, 2, 1) @ by_joint, frames.usable.sum(axis=0).astype(float), model)


def gain(sums: Array, one: Suspect) -> float:
    """Reduction of the squared residual [1] by a candidate; sums: (15, 15) [1] of its joint, or of all joints."""
    c, value = list(one.columns), one.value
    return float(2 * value @ sums[c, -1] - value @ sums[np.ix_(c, c)] @ value)


def effect(sums: Array, one: Suspect) -> float:
    """Squared torque [1] of a candidate in units of the variance of the noise; sums: (15, 15) [1]."""
    c = list(one.columns)
    return float(one.value @ sums[np.ix_(c, c)] @ one.value)


def _scaled(one: Suspect, own: float, common: float, count: float) -> Suspect:
    """Suspect with its evidence: variances inflated by its own factor, the score by a common one."""
    cost = min(len(one.columns), len(PAYLOAD)) * np.log(max(count, 2.0))
    return one._replace(std=one.std * np.sqrt(own), gain=one.raw / own, score=0.5 * (one.raw / common - cost))


def _payload(sums: Array) -> Suspect | None:
    """Point mass at the last link: mass and first moment, and the inertia that follows from them."""
    first, columns = len(LOCAL), tuple(range(len(LOCAL), len(LOCAL) + len(PAYLOAD)))
    inertia, shifted, one = np.zeros(len(INERTIA)), sums, None
    turning = list(range(first + len(PAYLOAD), COLUMNS))
    for _ in range(ROUNDS):
        one = _fit(shifted, columns, TIP)
        if one is None or not one.value[0] > 0:
            return one
        inertia = np.array(point_inertia(float(one.value[0]), one.value[1:].tolist()))
        shifted = sums.copy()
        shifted[:, -1] -= sums[:, turning] @ inertia
    assert one is not None, "there is a round"
    whole = one._replace(columns=tuple(range(first, COLUMNS)), value=np.concatenate([one.value, inertia]))
    return whole._replace(raw=gain(sums, whole))


def _fit(sums: Array, columns: tuple[int, ...], joint: int) -> Suspect | None:
    """Least squares of the columns, without evidence; None if the window does not excite them."""
    c = list(columns)
    normal, right = sums[np.ix_(c, c)], sums[c, -1]
    size = np.sqrt(np.diag(normal))
    if not size.max() > 0 or (joint != TIP and not (size > 0).all()):
        return None
    size = np.maximum(size, LEAST * size.max())
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    seen = values > (LEAST if joint == TIP else APART) * values[-1]
    if joint != TIP and not seen.all():
        return None
    root = vectors[:, seen] / np.sqrt(values[seen])
    inverse = (root @ root.T) / np.outer(size, size)
    value = inverse @ right
    return Suspect(joint, columns, value, np.sqrt(np.diag(inverse)), 0.0, float(right @ value), 0.0)
