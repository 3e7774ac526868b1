"""Windows with forgetting: sums of frames, and the laws that they could show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..effects.bodies import INERTIA, point_inertia
from ..types import Array
from .frames import FRAME_COLUMNS, JOINT_COLUMNS, PAYLOAD_COLUMNS, Frames
from .quiet import QuietNoise

FRICTION_PAIR = (0, 1)  # of JOINT_COLUMNS: viscous and Coulomb friction, which grow together when it gets cold or dry
TIP_JOINT = -1  # joint of the payload
PAYLOAD_ROUNDS = 4  # of the inertia of a payload
FRICTION_EIGENVALUE_RATIO, PAYLOAD_EIGENVALUE_RATIO = 1e-3, 1e-9  # [1] smallest over largest, of normal equations


class Suspect(NamedTuple):
    """A law, or two of friction, with their numbers and their evidence."""

    joint: int  # or TIP_JOINT
    columns: tuple[int, ...]  # of the frames
    value: Array  # (m,) [units of the laws]
    covariance: Array  # (k, k) [products of the units], without an inertia that follows from others
    gain: float  # [1] reduction of the squared residual in units of its variance, inflation included
    raw: float  # [1] the same without inflation
    score: float  # [1] log of the evidence: Schwarz, Annals of Statistics 6(2), 1978

    @property
    def std(self) -> Array:
        """Standard deviations (k,) [units of the laws]."""
        return np.asarray(np.sqrt(np.diag(self.covariance)))


class Sums(NamedTuple):
    """Sums over frames of n joints."""

    products: Array  # (n, 15, 15) [1] of columns and residual over the noise
    frames: Array  # (n,) [1] number
    model: Array  # (n,) [1] squared error of the model over the variance of the noise


class Window:
    """Sums (n, 15, 15) of products of columns and residual, each over the noise of its joint."""

    def __init__(self, joints: int, memory: float = np.inf) -> None:
        self.sums = np.zeros((joints, FRAME_COLUMNS + 1, FRAME_COLUMNS + 1))
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

    def inflation(self, noise: QuietNoise) -> Array:
        """Variance (n, 14) of the sums of each column over that of white noise, with the error of the model [1]."""
        return np.asarray(noise.inflation * (1 + self.model)[:, None])

    def narrowed(self, one: Suspect, noise: QuietNoise) -> tuple[Array, Array]:
        """Change (k,) of the numbers of a known law by this window, and their covariance (k, k) with both.

        Where the law leaves more than the noise of the quiet stretch, the window counts less by that misfit.
        """
        c = list(one.columns[: len(one.covariance)])
        tip = one.joint == TIP_JOINT
        at = slice(None) if tip else slice(one.joint, one.joint + 1)
        sums, count = self.sums[at].sum(axis=0), float(self.count[at].sum())
        power = np.maximum(np.einsum("nkk->n", self.sums[at][:, c][:, :, c]), 1e-300)
        whole = self.inflation(noise)[at][:, c].mean(axis=1)
        alone = np.linalg.lstsq(sums[np.ix_(c, c)], sums[c, -1], rcond=None)[0]
        misfit = max(1.0, float(sums[-1, -1] - alone @ sums[c, -1]) / max(count, 1.0))
        inflated = misfit * float(power @ whole / power.sum())
        covariance = np.linalg.inv(np.linalg.inv(one.covariance) + sums[np.ix_(c, c)] / inflated)
        return covariance @ sums[c, -1] / inflated, covariance

    @property
    def excess(self) -> float:
        """Squared residual [1], in units of its variance, beyond that of noise, over all joints."""
        return float(np.maximum(self.sums[:, -1, -1] - self.count, 0.0).sum())

    def candidates(self, noise: QuietNoise) -> list[Suspect]:
        """All laws that act in the window, the best first.

        An error of the model lasts for the whole window, so its square is not divided by the number of frames.
        """
        whole = self.inflation(noise)
        excess = np.maximum(self.sums[:, -1, -1] - self.count, 1e-9)
        common = float(excess @ whole.mean(axis=1) / excess.sum())  # or the score prefers noisy joints
        found, count = [], float(self.count.sum())
        for j, sums in enumerate(self.sums):
            for columns in ((0,), (1,), (2,), (3,), FRICTION_PAIR):
                if one := _fit(sums, columns, j):
                    own = float(np.mean(whole[j, list(columns)]))
                    found.append(_scaled(one, own, common, self.count[j]))
        if one := _payload(self.sums.sum(axis=0)):
            found.append(_scaled(one, common, common, count))
        return sorted(found, key=lambda one: -one.score)


def products(frames: Frames, base: Array, noise: QuietNoise) -> Sums:
    """Sums of usable frames; base: (n, 4) coefficients of JOINT_COLUMNS that are known already [units of the laws]."""
    known = np.einsum("fnk,nk->fn", frames.columns[:, :, : len(JOINT_COLUMNS)], base)
    whole = np.concatenate([frames.columns, (frames.residual - known)[:, :, None]], axis=2)
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
    cost = min(len(one.columns), len(PAYLOAD_COLUMNS)) * np.log(max(count, 2.0))
    return one._replace(covariance=one.covariance * own, gain=one.raw / own, score=0.5 * (one.raw / common - cost))


def _payload(sums: Array) -> Suspect | None:
    """Point mass at the last link: mass and first moment, and the inertia that follows from them."""
    first, columns = len(JOINT_COLUMNS), tuple(range(len(JOINT_COLUMNS), len(JOINT_COLUMNS) + len(PAYLOAD_COLUMNS)))
    inertia, shifted, one = np.zeros(len(INERTIA)), sums, None
    turning = list(range(first + len(PAYLOAD_COLUMNS), FRAME_COLUMNS))
    for _ in range(PAYLOAD_ROUNDS):
        one = _fit(shifted, columns, TIP_JOINT)
        if one is None or not one.value[0] > 0:
            return one
        inertia = np.array(point_inertia(float(one.value[0]), one.value[1:].tolist()))
        shifted = sums.copy()
        shifted[:, -1] -= sums[:, turning] @ inertia
    assert one is not None, "there is a round"
    whole = one._replace(columns=tuple(range(first, FRAME_COLUMNS)), value=np.concatenate([one.value, inertia]))
    return whole._replace(raw=gain(sums, whole))


def _fit(sums: Array, columns: tuple[int, ...], joint: int) -> Suspect | None:
    """Least squares of the columns, without evidence; None if the window does not excite them."""
    c = list(columns)
    normal, right = sums[np.ix_(c, c)], sums[c, -1]
    size = np.sqrt(np.diag(normal))
    if not size.max() > 0 or (joint != TIP_JOINT and not (size > 0).all()):
        return None
    size = np.maximum(size, PAYLOAD_EIGENVALUE_RATIO * size.max())
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    seen = values > (PAYLOAD_EIGENVALUE_RATIO if joint == TIP_JOINT else FRICTION_EIGENVALUE_RATIO) * values[-1]
    if joint != TIP_JOINT and not seen.all():
        return None
    root = vectors[:, seen] / np.sqrt(values[seen])
    inverse = (root @ root.T) / np.outer(size, size)
    value = inverse @ right
    return Suspect(joint, columns, value, inverse, 0.0, float(right @ value), 0.0)
