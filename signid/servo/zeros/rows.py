"""Rows of recordings for signs and zeros: smooth motion, loads, errors of the loops, and what else explains these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numba import njit
from scipy.signal import butter, filtfilt

from ...frozen import Frozen
from ...servos import Servo, ServoGrid
from ...types import Array, Mask
from ..plant.course import smooth
from ..plant.grid import commands_at
from ..plant.roll_out import Tree, torques
from ..plant.torque import FAST

CUTOFF = 10.0  # [Hz] of motion and errors; at 6 Hz, zeros of a simulated SO-101 are biased by up to two std
EDGE = 0.3  # [s] left out beside ends and switched drives
BLOCK = 3.0  # [s] of a block; residuals of different blocks count as independent
PLAY = 0.012  # [rad or m] over which dry friction turns (SO-101: least residual of 0.003 to 0.025)
MIN_SLIDING_SPEED = 0.03  # [rad/s or m/s] slower joints may stick, and dry friction is then unknown
TURNING = 0.2  # share of the usual speed of a joint below which it turns round (zeros of a simulated Go2: no bias)
FULL = 0.97  # share of the largest error that a drive answers from which a row counts as saturated
MIN_USABLE_ROWS = 40  # usable rows of a joint; a joint with fewer is not used
RECORDINGS = 6  # least number of recordings of which each is one block
FLOOR = 1e-5  # [rad or m] rms error that counts as none
MAX_MU = 1.5  # largest friction by load, of the load; gears of servos hold their load without current (SO-101)
REST_ERROR_STD = 0.004  # [rad or m] of the error of a loop at rest without load: q and q_des share their zero
ROWS_PER_SAMPLE = 20  # rows whose errors count as one in the weight of that knowledge
TINY = 1e-30


@dataclass(frozen=True, eq=False)
class ZeroRows(Frozen):
    """N rows of all recordings, n joints. A joint whose error is not usable in a row has NaN there."""

    joints: tuple[str, ...]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]
    error: Array  # (N, n) [rad or m] of the loop, filtered
    rush: Array  # (N, n) [rad/s or m/s] speed of the command: an error of the delay
    slide: Array  # (N, n) [1] direction of dry friction, -1 to 1; at rest that of the last motion
    block: Array  # (N,) [1] number of the block
    recording: Array  # (N,) [1] number of the recording

    def __len__(self) -> int:
        return len(self.q)

    def part(self, use: Mask | slice) -> ZeroRows:
        """Some rows: a mask (N,), or a slice."""
        names = ("q", "v", "a", "error", "rush", "slide", "block", "recording")
        return replace(self, **{name: getattr(self, name)[use] for name in names})

    def thinned(self, most: int) -> ZeroRows:
        """About `most` rows, evenly."""
        return self.part(slice(0, None, max(round(len(self) / most), 1)))


def zero_rows(grids: Sequence[ServoGrid], servos: Mapping[str, Servo], most: int) -> ZeroRows:
    """Rows of grids in which a joint slides, evenly, about `most`; delays and limits are those of drives."""
    paths = list(dict.fromkeys(grid.path or f"{k}" for k, grid in enumerate(grids)))
    motions = [smooth(grid.q, grid.rate, CUTOFF) for grid in grids]
    speed = np.abs(np.concatenate([motion.v for motion in motions]))
    moving = speed > MIN_SLIDING_SPEED
    usual = np.sqrt(np.sum(np.where(moving, speed, 0.0) ** 2, axis=0) / np.maximum(moving.sum(axis=0), 1))
    slow = np.asarray(np.maximum(MIN_SLIDING_SPEED, TURNING * usual))
    parts, blocks = [], 0
    for k, (grid, motion) in enumerate(zip(grids, motions, strict=True)):
        error = np.column_stack([_error(grid, j, servos.get(joint)) for j, joint in enumerate(grid.joints)])
        slide = slides(motion.q)
        unknown = np.cumsum(np.abs(slide) == 1, axis=0) == 0  # before a joint has slid for the first time
        error[unknown | (np.abs(motion.v) < slow)] = np.nan
        block = blocks + (np.arange(len(grid)) * grid.step / BLOCK).astype(int)
        blocks = int(block[-1]) + 1
        number = np.full(len(grid), paths.index(grid.path or f"{k}"))
        rush = _filtered(np.gradient(grid.command, grid.step, axis=0), grid.rate)
        parts.append((*motion, error, rush, _filtered(slide, grid.rate), block, number))
    rows = ZeroRows(grids[0].joints, *(np.concatenate(some) for some in zip(*parts, strict=True)))
    return rows.part(np.asarray(np.isfinite(rows.error).any(axis=1))).thinned(most)


def fixed_columns(rows: ZeroRows, j: int, use: Mask) -> Array:
    """Damping, dry friction, armature, delay and constant of one joint in the rows `use` (N,): (M, 5) [any unit]."""
    v = rows.v[use, j]
    return np.column_stack([v, rows.slide[use, j], rows.a[use, j], rows.rush[use, j], np.ones_like(v)])


@njit(cache=True)
def slides(q):  # type: ignore[no-untyped-def]
    """Direction of dry friction (N, n) [1] along positions q (N, n) [rad or m], kept at rest."""
    out = np.zeros_like(q)
    for i in range(1, len(q)):
        for j in range(q.shape[1]):
            out[i, j] = min(max(out[i - 1, j] + (q[i, j] - q[i - 1, j]) / PLAY, -1.0), 1.0)
    return out


def _error(grid: ServoGrid, j: int, servo: Servo | None) -> Array:
    """Filtered error (N,) [rad or m] of a joint; NaN while its drive is off or gives its limit, and near that."""
    nothing = np.full(len(grid), np.nan)
    edge = max(int(EDGE * grid.rate), 1)
    if servo is None or not grid.driven[j] or len(grid) < 4 * edge:
        return nothing
    command = commands_at(grid, j, "velocity", servo.delay, np.inf, 1)[0]
    error = grid.gain[j] * (command - grid.q[:, j])
    usable = _away_from(grid.on[:, j] < 0.5, edge)
    most = servo.effort_limit / servo.kp if servo.kp > 0 else np.inf
    unsaturated = usable & _away_from(np.abs(error) > FULL * most, edge // 2)
    usable = unsaturated if 2 * unsaturated.sum() > usable.sum() else usable
    usable[:edge] = usable[-edge:] = False
    return np.where(usable, _filtered(error, grid.rate), np.nan)


def _filtered(x: Array, rate: float) -> Array:
    b, a = butter(3, min(2 * CUTOFF / rate, 0.8))
    return np.asarray(filtfilt(b, a, x, axis=0))


def _away_from(bad: Mask, edge: int) -> Mask:
    """Rows (N,) that are further than `edge` rows from every bad one."""
    near = np.convolve(bad.astype(float), np.ones(2 * edge + 1), mode="full")[edge : edge + len(bad)]
    return np.asarray(near < 0.5)


@dataclass(frozen=True, eq=False)
class LoopLine(Frozen):
    """Errors of one joint without what needs no load: M rows, times their weights; the last one is knowledge."""

    joint: int
    use: Mask  # (N,) rows
    weight: Array  # (M - 1,) [1] square root of the weights
    error: Array  # (M,) [rad or m] error, without its part in the fixed columns
    basis: Array  # (5, M) [1] orthonormal basis of the fixed columns
    slide: Array  # (M,) direction of dry friction [1]

    def of(self, load: Array) -> Array:
        """Weighted load of the joint, (K, M) [N.m or N]; load: (N, n, K) [N.m or N] of all joints in K trials."""
        own = load[self.use, self.joint] * self.weight[:, None]
        return np.ascontiguousarray(np.concatenate([own, np.zeros_like(own[:1])]).T)

    def responses(self, load: Array) -> tuple[Array, Array]:
        """As `respond`; load: (K, M) [N.m or N]."""
        return respond(self.error, self.basis, self.slide, load)  # type: ignore[no-any-return]


@dataclass(frozen=True, eq=False)
class Loads:
    """Rows of recordings with the bodies that they move."""

    tree: Tree
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
        return np.asarray(torques(self.tree, signs * self.rows.q + zeros, still, still) * signs)

    def torque(self, signs: Array, zeros: Array) -> Array:
        """Load of the motion (N, n) [N.m or N] with positions sign q + zero.

        signs: (n,) [1] 1 or -1; zeros: (n,) [rad or m].
        """
        q, v, a = (signs * x for x in (self.rows.q, self.rows.v, self.rows.a))
        return np.asarray(torques(self.tree, q + zeros, v, a) * signs)


@njit(cache=True, error_model="numpy", fastmath=FAST)
def respond(error, basis, slide, load):  # type: ignore[no-untyped-def]
    """Compliance (2, K) [rad/(N.m) or m/N] of load and of friction by load, and the errors (K, M) that are left.

    error, basis and slide are those of a `LoopLine`; load: (K, M) [N.m or N] in its rows, for K trials.
    """
    (trials, rows), count = load.shape, len(basis)
    c, left, pull, drag = np.zeros((2, trials)), np.empty(load.shape), np.empty(rows), np.empty(rows)
    for k in range(trials):
        for m in range(rows):
            pull[m], drag[m] = load[k, m], abs(load[k, m]) * slide[m]
        for i in range(count):  # without what needs no load
            p, d = 0.0, 0.0
            for m in range(rows):
                p += basis[i, m] * pull[m]
                d += basis[i, m] * drag[m]
            for m in range(rows):
                pull[m] -= basis[i, m] * p
                drag[m] -= basis[i, m] * d
        ay, by, aa, bb, ab = 0.0, 0.0, 0.0, 0.0, 0.0
        for m in range(rows):
            ay, by = ay + error[m] * pull[m], by + error[m] * drag[m]
            aa, bb, ab = aa + pull[m] ** 2, bb + drag[m] ** 2, ab + pull[m] * drag[m]
        det = max(aa * bb - ab**2, 1e-9 * aa * bb + TINY)
        a, b = (bb * ay - ab * by) / det, (aa * by - ab * ay) / det
        if b < 0.0:
            a, b = ay / max(aa, TINY), 0.0
        elif b > MAX_MU * a:
            a = (ay + MAX_MU * by) / max(aa + 2 * MAX_MU * ab + MAX_MU**2 * bb, TINY)
            b = MAX_MU * a
        if a > 0.0:  # a drive does not push along its load
            c[0, k], c[1, k] = a, b
        for m in range(rows):
            left[k, m] = error[m] - c[0, k] * pull[m] - c[1, k] * drag[m]
    return c, left


def unexplained(line: LoopLine, load: Array) -> Array:
    """Weighted error (M - 1,) [rad or m] of a line without its response to the load (N, n) [N.m or N]."""
    return line.responses(line.of(load[..., None]))[1][0, :-1]


def foreseen(here: Loads, line: LoopLine, load: Array, there: Loads, other: Array) -> tuple[Array, Mask]:
    """Errors in other rows (M,) [rad or m] of what one joint's line predicts there, weighted; and these rows (N,).

    load: (N, n) [N.m or N] in the rows of `here`; other: (N, n) [N.m or N] in those of `there`.
    """
    j, use = line.joint, np.isfinite(there.rows.error[:, line.joint])
    (a, b), _ = line.responses(line.of(load[..., None]))
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
    columns = np.vstack([columns, [0, 0, 0, 0, noise * np.sqrt(ROWS_PER_SAMPLE) / REST_ERROR_STD]])
    return columns, np.append(error, 0.0), np.append(rows.slide[use, j], 0.0)


def _line(rows: ZeroRows, j: int, weight: Array) -> LoopLine | None:
    """Line of a joint; None if too few rows are usable."""
    use = np.isfinite(rows.error[:, j])
    if use.sum() < MIN_USABLE_ROWS:
        return None
    columns, error, slide = _stacked(rows, j, use, weight[use])
    basis = np.ascontiguousarray(np.linalg.qr(columns / (np.linalg.norm(columns, axis=0) + 1e-12))[0].T)
    error = error - basis.T @ (basis @ error)
    if not np.sqrt(np.mean(error**2)) > FLOOR:
        return None
    return LoopLine(j, use, weight[use], error, basis, slide)
