"""Load of joints whose recorded positions have other signs and zeros, and the loop's errors that it leaves."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ...frozen import Frozen
from ...types import Array, Mask
from .chain import Chain
from .rows import FEWEST, ZeroRows, fixed_columns

FLOOR = 1e-5  # [rad or m] rms error that counts as none
MOST = 1.5  # largest friction by load, of the load; gears of servos hold their load without current (SO-101)
OWN = 0.004  # [rad or m] standard deviation of a loop's error at rest without load: q and q_des share their zero
SAME = 20  # rows whose errors count as one in the weight of that knowledge
TINY = 1e-30


@dataclass(frozen=True, eq=False)
class LoopLine(Frozen):
    """Errors of one joint without what needs no load: M rows, times their weights; the last one is knowledge."""

    joint: int
    use: Mask  # (N,) rows
    weight: Array  # (M - 1,) [1] square root of the weights
    error: Array  # (M,) [rad or m] error, without its part in the fixed columns
    basis: Array  # (M, 5) [1] orthonormal basis of the fixed columns
    slide: Array  # (M,) direction of dry friction [1]

    def of(self, load: Array) -> Array:
        """Weighted load of the joint, (M, K) [N.m or N]; load: (N, n, K) [N.m or N] of all joints in K trials."""
        own = load[self.use, self.joint] * self.weight[:, None]
        return np.concatenate([own, np.zeros_like(own[:1])])

    def without(self, x: Array) -> Array:
        """Columns without their part in the fixed columns; x: (M, ...) [any unit]."""
        return np.asarray(x - self.basis @ (self.basis.T @ x))


@dataclass(frozen=True, eq=False)
class Loads:
    """Rows of recordings with the bodies that they move."""

    chain: Chain
    rows: ZeroRows
    weights: Array | None = None  # (N, n) [1]
    lines: tuple[LoopLine, ...] = field(init=False)

    def __post_init__(self) -> None:
        weights = np.ones_like(self.rows.q) if self.weights is None else self.weights
        lines = [_line(self.rows, j, np.sqrt(weights[:, j])) for j in range(len(self.rows.joints))]
        object.__setattr__(self, "lines", tuple(line for line in lines if line is not None))

    def part(self, use: Mask) -> Loads:
        """Some of the rows: a mask (N,)."""
        weights = None if self.weights is None else self.weights[use]
        return replace(self, rows=self.rows.part(use), weights=weights)

    def gravity(self, signs: Array, zeros: Array) -> Array:
        """Load at rest (N, n) [N.m or N] at positions sign q + zero, in the direction of the recorded positions.

        signs: (n,) [1] 1 or -1; zeros: (n,) [rad or m].
        """
        still = np.zeros_like(self.rows.q)
        return self.chain.torque(signs * self.rows.q + zeros, still, still) * signs

    def torque(self, signs: Array, zeros: Array) -> Array:
        """Load of the motion (N, n) [N.m or N] with positions sign q + zero.

        signs: (n,) [1] 1 or -1; zeros: (n,) [rad or m].
        """
        q, v, a = (signs * x for x in (self.rows.q, self.rows.v, self.rows.a))
        return self.chain.torque(q + zeros, v, a) * signs


def responses(line: LoopLine, load: Array) -> tuple[Array, Array]:
    """Compliance (2, K) [rad/(N.m) or m/N] of load and of friction by load, and the squared errors (K,) that are left.

    load: (M, K) [N.m or N] in the rows of the line, for K trials.
    """
    a, b = line.without(load), line.without(np.abs(load) * line.slide[:, None])
    y = line.error
    ay, by, aa, bb, ab = y @ a, y @ b, *(np.einsum("mk,mk->k", p, q) for p, q in ((a, a), (b, b), (a, b)))
    det = np.maximum(aa * bb - ab**2, 1e-9 * aa * bb + TINY)
    both = np.array([(bb * ay - ab * by) / det, (aa * by - ab * ay) / det])
    alone = np.array([ay / np.maximum(aa, TINY), 0 * ay])
    most = (ay + MOST * by) / np.maximum(aa + 2 * MOST * ab + MOST**2 * bb, TINY)
    c = np.where(both[1] < 0, alone, np.where(both[1] > MOST * both[0], np.array([most, MOST * most]), both))
    c = np.where(c[0] > 0, c, 0.0)  # a drive does not push along its load
    left = y @ y - 2 * (c[0] * ay + c[1] * by) + c[0] ** 2 * aa + 2 * c[0] * c[1] * ab + c[1] ** 2 * bb
    return c, np.maximum(left, 0.0)


def unexplained(line: LoopLine, load: Array) -> Array:
    """Weighted error (M - 1,) [rad or m] of a line without its response to the load (N, n) [N.m or N]."""
    own = line.of(load[..., None])
    (a, b), _ = responses(line, own)
    return np.asarray(line.error - line.without(a * own[:, 0] + b * line.slide * np.abs(own[:, 0])))[:-1]


def foreseen(here: Loads, line: LoopLine, load: Array, there: Loads, other: Array) -> tuple[Array, Mask]:
    """Errors in other rows (M,) [rad or m] of what one joint's line predicts there, weighted; and these rows (N,).

    load: (N, n) [N.m or N] in the rows of `here`; other: (N, n) [N.m or N] in those of `there`.
    """
    j, use = line.joint, np.isfinite(there.rows.error[:, line.joint])
    (a, b), _ = responses(line, line.of(load[..., None]))
    pull = a[0] * load + b[0] * here.rows.slide * np.abs(load)
    x, y, _ = _stacked(here.rows, j, line.use, line.weight)
    y[:-1] -= line.weight * pull[line.use, j]
    numbers = np.linalg.lstsq(x, y, rcond=None)[0]
    pull = a[0] * other + b[0] * there.rows.slide * np.abs(other)
    left = there.rows.error[use, j] - pull[use, j] - fixed_columns(there.rows, j, use) @ numbers
    return left * (1.0 if there.weights is None else np.sqrt(there.weights[use, j])), use


def _stacked(rows: ZeroRows, j: int, use: Mask, weight: Array) -> tuple[Array, Array, Array]:
    """Fixed columns (M, 5), error (M,) [rad or m] and direction of friction (M,) of a line.

    The last row says that a loop without load rests without error; use: (N,); weight: (M - 1,) [1].
    """
    error, columns = rows.error[use, j] * weight, fixed_columns(rows, j, use) * weight[:, None]
    free = np.column_stack([columns, columns[:, 1] * np.abs(rows.q[use, j])])
    noise = np.std(error - free @ np.linalg.lstsq(free, error, rcond=None)[0]) + FLOOR
    columns = np.vstack([columns, [0, 0, 0, 0, noise * np.sqrt(SAME) / OWN]])
    return columns, np.append(error, 0.0), np.append(rows.slide[use, j], 0.0)


def _line(rows: ZeroRows, j: int, weight: Array) -> LoopLine | None:
    """Line of a joint; None if too few rows are usable."""
    use = np.isfinite(rows.error[:, j])
    if use.sum() < FEWEST:
        return None
    columns, error, slide = _stacked(rows, j, use, weight[use])
    basis = np.linalg.qr(columns / (np.linalg.norm(columns, axis=0) + 1e-12))[0]
    error = error - basis @ (basis.T @ error)
    if not np.sqrt(np.mean(error**2)) > FLOOR:
        return None
    return LoopLine(j, use, weight[use], error, basis, slide)
