"""Recording -> rows: regressor columns and torque, equally filtered and decimated, in windows of bounded memory."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import lcm
from typing import NamedTuple

import numpy as np

from ..recording.sampling import Sampling, samples
from ..types import Array, BaseMap, Frozen, Indices, Law, Mask, Recording, Robot, Samples
from .bandwidth import Band, Decimator, moving_minimum
from .motion import Motion, base_rows, build_motion, margin

MIN_WINDOW_SAMPLES = 8192  # smallest number of samples of a window
STEADY_WIDTHS = 5.0  # [widths of a reversal] speed below which a joint is near a reversal
REVERSAL_DISTANCES = (1.5, 1.0, 0.75)  # [periods of the cut-off] candidates for that of rows from reversals
MIN_ROW_SHARE = 0.7  # [1] share of a joint's rows that the first suitable candidate keeps; the last one needs no share


@dataclass(frozen=True, eq=False)
class Task(Frozen):
    """Definition of the rows: the same for all recordings of one identification."""

    robot: Robot
    laws: tuple[Law, ...]
    base: BaseMap
    band: Band
    slow: Array  # (n,) [rad/s or m/s] width of a reversal: speed below which the direction of motion is uncertain
    reach: tuple[int, ...]  # (n,) samples on either side of a row that must be free of reversals
    recorded_derivatives: bool = False
    instruments: bool = False

    @property
    def reverses(self) -> tuple[bool, ...]:
        """Whether a law of each of the n joints jumps with the direction of motion."""
        at = {j for law in self.laws if law.effect.reverses for j in law.joints}
        return tuple(j in at for j in range(len(self.robot.joints)))

    def seen(self, joint: int) -> Indices:
        """Base parameters (m,) that the torque of a joint depends on."""
        return np.flatnonzero(self.base.sees[joint])

    @property
    def parts(self) -> int:
        """Decimation for the columns of bodies; 1 for recorded derivatives, which are not as smooth as positions."""
        return 1 if self.recorded_derivatives else self.band.parts

    @property
    def wanted(self) -> list[Indices]:
        """Standard parameters (m,) of each joint's columns, the argument `wanted` of `base_rows`."""
        return [self.base.independent[self.seen(j)] for j in range(len(self.robot.joints))]


class Rows(NamedTuple):
    """M consecutive filtered rows of one span."""

    first: bool  # whether a span begins here
    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    a: Array  # (M, n) [rad/s2 or m/s2]
    columns: list[Array]  # per joint (M, m) [torque per unit of the base parameter]
    torque: Array  # (M, n) [N.m or N], 0 where absent
    slope: Array  # (M, n) [N.m/s or N/s] derivative of the torque
    recorded: Mask  # (n,) whether the joint's torque is recorded at all
    steady: Mask  # (M, n) whether no reversal of the joint is near
    instruments: list[Array] | None = None  # per joint (M, m) [as columns] columns along the desired motion


def read_rows(task: Task, recording: Recording, sampling: Sampling) -> Iterator[Rows]:
    """All rows of a recording, window by window; their values do not depend on the windows.

    Columns of the regressor pass the same symmetric FIR low-pass as the torque, and are kept at twice its cut-off.
    Rigid-body columns of fast recordings are computed on a decimated grid, since positions are low-passed before.

    Source: parallel filtering: Gautier, IEEE ICRA 1997; Khalil, Dombre, Modeling, Identification and Control of
    Robots, 2002, section 12.6.
    """
    thin, sparse = task.band.decimator(), task.band.decimator(task.parts)
    reach = consumed(task.band, task.recorded_derivatives)
    block = lcm(thin.block, sparse.block)
    size = max(MIN_WINDOW_SAMPLES, 8 * reach) // (block * thin.factor) + 1
    grid = _Grid(thin, sparse, task.parts, reach, size * block)
    for first, window in grid.read(recording, sampling):
        yield _window_rows(task, window, sampling.period, grid, first)


class _Grid(NamedTuple):
    """Grid of rows over samples, and of windows over rows."""

    thin: Decimator
    sparse: Decimator  # for every `parts`-th sample
    parts: int  # decimation for the columns of bodies
    reach: int  # samples that filters consume
    step: int  # rows of a window

    def rows(self, length: int) -> int:
        """Number of rows of `length` samples."""
        return max(0, (length - self.reach - 1) // self.thin.factor + 1)

    def windows(self, rows: int) -> int:
        """Number of windows of some rows."""
        return -(-rows // self.step)

    def columns(self, task: Task, motion: Motion) -> list[Array]:
        """Columns (M, m) of each joint; the decimated samples are aligned with the rows."""
        edge = self.thin.half % self.parts
        sparse = None if self.parts == 1 else (motion[edge : len(motion) - edge : self.parts], self.sparse)
        return base_rows(motion, task.laws, task.wanted, self.thin, sparse)

    def samples(self, start: int, stop: int) -> tuple[int, int]:
        """Range of samples, end exclusive, that rows start..stop need."""
        return start * self.thin.factor, (stop - 1) * self.thin.factor + self.reach + 1

    def read(self, recording: Recording, sampling: Sampling) -> Iterator[tuple[bool, Samples]]:
        """Whether a span begins with a window of rows, and the samples that the window needs."""
        for span in sampling.spans:
            total = self.rows(sampling.length(span))
            for k in range(0, total, self.step):
                yield k == 0, samples(recording, sampling, span, *self.samples(k, min(total, k + self.step)))


def consumed(band: Band, recorded_derivatives: bool = False) -> int:
    """Number of samples that derivatives and low-pass remove from both ends of a stretch together."""
    return 2 * (margin(band, recorded_derivatives) + len(band.taps) // 2)


def _window_rows(task: Task, window: Samples, period: float, grid: _Grid, first: bool) -> Rows:
    thin, instruments = grid.thin, None
    motion = build_motion(task.robot, window, task.band, period, task.recorded_derivatives, task.slow)
    assert motion.recorded is not None, "windows carry torque"
    columns = grid.columns(task, motion)
    if task.instruments:
        assert window.q_des is not None, "instruments are used only if every joint has q_des"
        desired = build_motion(task.robot, window._replace(q=window.q_des), task.band, period, slow=task.slow)
        instruments = grid.columns(task, desired)
    known = np.asarray(~np.isnan(motion.recorded).all(0))
    torque = np.where(known, motion.recorded, 0.0)
    slope = np.gradient(torque, period, axis=0) if len(torque) > 1 else np.zeros_like(torque)
    torque, slope, v, a = np.split(thin(np.concatenate([torque, slope, motion.v, motion.a], axis=1)), 4, axis=1)
    far = np.array(task.reach)
    moving = np.empty(motion.v.shape, bool)
    for reach in np.unique(far):
        here = far == reach
        moving[:, here] = away_from_reversals(motion.v[:, here], int(reach), task.slow[here])
    t, q, steady = thin.at(motion.t), thin.at(motion.q), thin.at(np.asarray(moving | ~np.array(task.reverses)))
    return Rows(first, t, q, v, a, columns, torque, slope, known, steady, instruments)


def choose_reach(motions: Sequence[Motion], band: Band, slow: Array) -> tuple[int, ...]:
    """Per joint, the largest distance of rows from reversals, slow (n,) [rad/s or m/s] wide, that keeps enough rows."""
    reaches = [min(int(np.ceil(share * band.rate / band.cutoff)), len(band.taps) // 2) for share in REVERSAL_DISTANCES]
    if not motions:
        return (reaches[-1],) * len(slow)
    away = [np.concatenate([away_from_reversals(motion.v, reach, slow) for motion in motions]) for reach in reaches]
    enough = np.mean(away, axis=1) >= MIN_ROW_SHARE  # (reaches, n)
    return tuple(reaches[int(np.argmax(joint))] if joint.any() else reaches[-1] for joint in enough.T)


def away_from_reversals(v: Array, reach: int, slow: Array) -> Mask:
    """Mask (N, n) of samples within `reach` of which the speed stays above `STEADY_WIDTHS` widths of a reversal.

    Velocity: v (N, n) [rad/s or m/s]; width: slow (n,) [rad/s or m/s].
    """
    return np.asarray(moving_minimum(np.abs(v), reach) >= STEADY_WIDTHS * slow)
