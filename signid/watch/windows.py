"""Normal equations of the residual in windows with forgetting, and the laws that they could show."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..types import Array
from .frames import COLUMNS, LOCAL, Frames
from .quiet import Noise

FRICTION = (0, 1)  # of LOCAL: viscous and Coulomb friction, which grow together when it gets cold or dry
TIP = -1  # joint of the payload
LEAST = 1e-9  # [1] smallest eigenvalue of the payload's normal equations that counts, over the largest


class Candidate(NamedTuple):
    """A law, or two of friction, with their numbers and their evidence."""

    joint: int  # or TIP
    columns: tuple[int, ...]  # of the frames
    value: Array  # (m,)
    std: Array  # (m,)
    gain: float  # [1] reduction of the squared residual in units of its variance, inflation included
    raw: float  # [1] the same without inflation
    score: float  # [1] log of the evidence: Schwarz, Annals of Statistics 6(2), 1978


class Window:
    """Sums (n, 9, 9) of products of columns and residual, each over the noise of its joint."""

    def __init__(self, joints: int, memory: float = np.inf) -> None:
        self.sums = np.zeros((joints, COLUMNS + 1, COLUMNS + 1))
        self.count = np.zeros(joints)  # frames
        self.memory = memory  # [s]

    def restart(self) -> None:
        """Forget everything."""
        self.sums[:], self.count[:] = 0.0, 0.0

    def add(self, products: Array, usable: Array, seconds: float) -> None:
        """Add sums (n, 9, 9) and counts (n,) of frames that last for some seconds."""
        keep = float(np.exp(-seconds / self.memory))
        self.sums *= keep
        self.count *= keep
        self.sums += products
        self.count += usable

    @property
    def excess(self) -> float:
        """Squared residual [1], in units of its variance, beyond that of noise, over all joints."""
        return float(np.maximum(self.sums[:, -1, -1] - self.count, 0.0).sum())

    def candidates(self, noise: Noise) -> list[Candidate]:
        """All laws that act in the window, the best first."""
        found = []
        for j, sums in enumerate(self.sums):
            for columns in ((0,), (1,), (2,), (3,), FRICTION):
                if one := _fit(sums, columns, noise.inflation[j], self.count[j], j):
                    found.append(one)
        weight = 1 / noise.inflation[:, len(LOCAL) :].mean(axis=1)
        whole, raw = np.tensordot(weight, self.sums, 1), self.sums.sum(axis=0)
        count = float(self.count.sum())
        if one := _fit(whole, tuple(range(len(LOCAL), COLUMNS)), np.ones(COLUMNS), count, TIP):
            found.append(one._replace(raw=_gain(raw, one.columns, one.value)))
        return sorted(found, key=lambda one: -one.score)


def products(frames: Frames, base: Array, noise: Noise) -> tuple[Array, Array]:
    """Sums (n, 9, 9) and counts (n,) of usable frames; base (n, 8): coefficients that are known already."""
    rest = frames.residual - np.einsum("fnk,nk->fn", frames.columns, base)
    whole = np.concatenate([frames.columns, rest[:, :, None]], axis=2)
    whole *= (frames.usable / noise.frame)[:, :, None]
    by_joint = whole.transpose(1, 0, 2)
    return by_joint.transpose(0, 2, 1) @ by_joint, frames.usable.sum(axis=0)


def _gain(sums: Array, columns: tuple[int, ...], value: Array) -> float:
    """Reduction of the squared residual by coefficients (m,)."""
    c = list(columns)
    return float(2 * value @ sums[c, -1] - value @ sums[np.ix_(c, c)] @ value)


def _fit(sums: Array, columns: tuple[int, ...], inflation: Array, count: float, joint: int) -> Candidate | None:
    """Least squares of the columns; None if the window does not excite them."""
    c = list(columns)
    normal, right = sums[np.ix_(c, c)], sums[c, -1]
    size = np.sqrt(np.diag(normal))
    if not (size > 0).all():
        if joint != TIP:
            return None
        size = np.maximum(size, 1e-300)
    values, vectors = np.linalg.eigh(normal / np.outer(size, size))
    seen = values > (LEAST if joint == TIP else 1e-3) * values[-1]
    if joint != TIP and not seen.all():
        return None
    root = vectors[:, seen] / np.sqrt(values[seen])
    inverse = (root @ root.T) / np.outer(size, size)
    value = inverse @ right
    scale = np.sqrt(inflation[c])
    gain = float(right @ value)
    own = float(np.mean(inflation[c]))
    rows = max(count / own, 2.0)
    return Candidate(
        joint,
        columns,
        value,
        np.sqrt(np.diag(inverse)) * scale,
        gain / own,
        gain,
        0.5 * (gain / own - int(seen.sum()) * np.log(rows)),
    )
