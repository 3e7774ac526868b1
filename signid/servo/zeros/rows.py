"""Rows of recordings for signs and zeros: smooth motion, errors of the loops, and what besides load explains these."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from scipy.signal import butter, filtfilt

from ...frozen import Frozen
from ...servos import Servo, ServoGrid
from ...types import Array, Mask
from ..plant.commands import commands_at
from ..plant.course import smooth

CUTOFF = 10.0  # [Hz] of motion and errors; at 6 Hz, zeros of a simulated SO-101 are biased by up to two std
EDGE = 0.3  # [s] left out beside ends and switched drives
BLOCK = 3.0  # [s] of a block; residuals of different blocks count as independent
PLAY = 0.012  # [rad or m] over which dry friction turns (SO-101: least residual of 0.003 to 0.025)
SLOW = 0.03  # [rad/s or m/s] slower joints may stick, and dry friction is then unknown
TURNING = 0.2  # share of the usual speed of a joint below which it turns round (zeros of a simulated Go2: no bias)
FULL = 0.97  # share of the largest error that a drive answers from which a row counts as saturated
FEWEST = 40  # usable rows of a joint; a joint with fewer is not used
RECORDINGS = 6  # least number of recordings of which each is one block


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
    slow = _slow(np.abs(np.concatenate([motion.v for motion in motions])))
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


def _slow(speed: Array) -> Array:
    """Speed (n,) [rad/s or m/s] below which joints may stick or turn round, from their speeds (N, n)."""
    moving = speed > SLOW
    usual = np.sqrt(np.sum(np.where(moving, speed, 0.0) ** 2, axis=0) / np.maximum(moving.sum(axis=0), 1))
    return np.asarray(np.maximum(SLOW, TURNING * usual))


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
