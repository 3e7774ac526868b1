"""Recordings -> grids to learn from, grids held out, and folds for cross-validation; noise of their positions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import OptionError, RecordingError
from ...regression.session import TRAINING_SHARE, recordings_used
from ...servos import ServoGrid
from ...types import Array, Input, Recording, Robot
from ..plant import servo_grids

BLOCK_SECONDS = 3.0  # [s] of the blocks that a single recording is cut into for cross-validation
MOST_BLOCKS = 8
MANY_GRIDS, SHORT_GRID_SECONDS = 20, 12.0  # grids of at most SHORT_GRID_SECONDS [s] of which some are left out whole
FOLDS = 4  # of whole recordings
HALVES = 2  # of blocks of the only recording
MIN_GRID_SECONDS = 1.0  # [s] of a grid that can be held out or validate
NORMAL_MEDIAN = 0.6745  # median of |x| of a standard normal variable
LEAST_WAY = 1e-3  # [rad or m] way of the commands below which a joint stands still
THIRD_DIFFERENCE_GAIN = np.sqrt(20.0)  # of third differences on white noise
LEAST_NOISE = 1e-5  # [rad or m]


@dataclass(frozen=True)
class ServoData:
    """Grids of one robot's recordings, all of the same joints and rate."""

    train: tuple[ServoGrid, ...]
    held_out: tuple[ServoGrid, ...]  # the same object as `train` where nothing is held out
    folds: tuple[tuple[tuple[ServoGrid, ...], tuple[ServoGrid, ...]], ...]  # to fit, to validate; all of `train`
    inputs: tuple[Input, ...]

    @property
    def joints(self) -> tuple[str, ...]:
        """Joints of the grids."""
        return self.train[0].joints

    @property
    def driven(self) -> tuple[str, ...]:
        """Joints with commands in every grid."""
        every = np.all([grid.driven for grid in (*self.train, *self.held_out)], axis=0)
        return tuple(joint for joint, yes in zip(self.joints, every, strict=True) if yes)


def servo_data(
    robot: Robot, recordings: Sequence[Recording], held_out: Sequence[Recording], rate: float | None = None
) -> ServoData:
    """Grids of recordings: the last of several is held out, or the last 30 % of the only one, unless some are given.

    Raises:
        OptionError: no recording.
        RecordingError: no joint has commands in all recordings, or they are too short.
    """
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    rate = rate or float(np.median([servo_grids(r, robot)[0].rate for r in (*recordings, *held_out)]))
    grids = [servo_grids(recording, robot, rate) for recording in recordings]
    if held_out:
        unseen = [grid for recording in held_out for grid in servo_grids(recording, robot, rate)]
    elif len(grids) > 1:
        *grids, last = grids
        unseen = list(last)
    else:
        left, first, unseen = round(TRAINING_SHARE * sum(map(len, grids[0]))), list[ServoGrid](), list[ServoGrid]()
        for grid in grids[0]:
            stop = min(max(left, 0), len(grid))
            first += [rows_of(grid, 0, stop)] if stop > 3 else []
            unseen += [rows_of(grid, stop, len(grid))] if len(grid) - stop > grid.rate * MIN_GRID_SECONDS else []
            left -= len(grid)
        grids = [tuple(first)]
    train = tuple(grid for of_recording in grids for grid in of_recording)
    data = ServoData(train, tuple(unseen) or train, _folds(grids), recordings_used(recordings, held_out))
    names = ", ".join(r.path or "a recording" for r in (*recordings, *held_out))
    if not data.driven:
        raise RecordingError(
            f"no joint has commands q_des_J in all of {names}; give recordings of the same joints with their commands"
        )
    seconds = sum(len(grid) / grid.rate for grid in train)
    if seconds < 2 * MIN_GRID_SECONDS:
        raise RecordingError(
            f"{names}: {seconds:.2g} s remain to learn from, and at least {2 * MIN_GRID_SECONDS:g} s are needed; "
            f"record for longer"
        )
    return data


def loop_error(data: ServoData, joint: str) -> float:
    """Rms difference of command and position of a joint [rad or m] while its drive is on."""
    j = data.joints.index(joint)
    return float(np.sqrt(np.mean(np.concatenate([(g.on * (g.command - g.q))[:, j] for g in data.train]) ** 2)))


def thinned(grids: Sequence[ServoGrid], most: int) -> tuple[ServoGrid, ...]:
    """Blocks of a few seconds in which joints move, from all parts of all grids; the grids if they are shorter.

    They have about `most` rows in all, and are those of their part with the longest way of the commands, each joint's
    way over that in all grids: joints that move one after another all move there. Of many short grids, some are kept
    whole.
    """
    share = most / max(sum(map(len, grids)), 1)
    if share >= 1:
        return tuple(grids)
    if share * len(grids) > MANY_GRIDS and max(len(grid) / grid.rate for grid in grids) <= SHORT_GRID_SECONDS:
        before = np.floor(share * np.arange(len(grids) + 1))
        return tuple(grid for grid, new in zip(grids, np.diff(before), strict=True) if new)
    blocks, ways = [], [np.abs(np.diff(grid.command, axis=0, prepend=grid.command[:1])) for grid in grids]
    whole = np.maximum(np.sum([way.sum(0) for way in ways], axis=0), LEAST_WAY)
    for grid, way in zip(grids, ways, strict=True):
        count = max(int(len(grid) / grid.rate / BLOCK_SECONDS * share), 1)
        edges = np.linspace(0, len(grid), count + 1).astype(int).tolist()
        for start, stop in zip(edges[:-1], edges[1:], strict=True):
            kept = max(int((stop - start) * share), min(round(MIN_GRID_SECONDS * grid.rate), stop - start))
            moved = np.convolve((way[start:stop] / whole).sum(1), np.ones(kept), mode="valid")
            first = start + int(np.argmax(moved))
            blocks.append(rows_of(grid, first, first + kept))
    return tuple(blocks)


def rows_of(grid: ServoGrid, start: int, stop: int) -> ServoGrid:
    """Rows start..stop of a grid."""
    rows, speed, forward = slice(start, stop), grid.command_speed, grid.feed_forward
    return replace(
        grid,
        origin=grid.origin + start / grid.rate,
        q=grid.q[rows],
        command=grid.command[rows],
        command_speed=None if speed is None else speed[rows],
        feed_forward=None if forward is None else forward[rows],
        on=grid.on[rows],
        voltage=grid.voltage[rows],
    )


def _folds(grids: Sequence[Sequence[ServoGrid]]) -> tuple[tuple[tuple[ServoGrid, ...], tuple[ServoGrid, ...]], ...]:
    """Folds of whole recordings; of blocks of the only one."""
    units = [list(unit) for unit in grids] if len(grids) > 1 else [[grid] for grid in grids[0]]
    if len(grids) == len(units) == 1:
        (grid,) = grids[0]
        blocks = int(np.clip(len(grid) / grid.rate / BLOCK_SECONDS, 1, MOST_BLOCKS))
        edges = np.linspace(0, len(grid), blocks + 1).astype(int).tolist()
        units = [[rows_of(grid, a, b)] for a, b in zip(edges[:-1], edges[1:], strict=True)]
    count = min(FOLDS if len(grids) > 1 else HALVES, len(units))
    turn = [*range(count), *reversed(range(count))]  # back and forth: neighbours in the order of names are often alike
    fold = [turn[i % len(turn)] for i in range(len(units))]
    folds = []
    for k in range(count):
        fit = tuple(grid for i, unit in zip(fold, units, strict=True) if i != k for grid in unit)
        unseen = tuple(grid for i, unit in zip(fold, units, strict=True) if i == k for grid in unit)
        unseen = tuple(grid for grid in unseen if len(grid) > MIN_GRID_SECONDS * grid.rate)
        if fit and unseen:
            folds.append((fit, unseen))
    return tuple(folds)


def position_noise(grids: Sequence[ServoGrid]) -> Array:
    """Standard deviation (n,) of the noise of measured positions [rad or m]."""
    out = []
    for j in range(len(grids[0].joints)):
        third = np.concatenate([np.diff(grid.q[:, j], 3) for grid in grids])
        steps = np.abs(np.concatenate([np.diff(grid.q[:, j]) for grid in grids]))
        jumps = steps[steps > 1e-9]
        tick = float(np.quantile(jumps, 0.02)) if len(jumps) else 0.0
        counted = np.mean(np.abs(jumps / tick - np.round(jumps / tick)) < 0.05) if tick else 0.0
        encoder = tick / np.sqrt(12) if counted > 0.9 else 0.0
        white = float(np.median(np.abs(third))) / NORMAL_MEDIAN / THIRD_DIFFERENCE_GAIN
        low = float(np.sqrt(np.mean(np.sort(third**2)[: max(len(third) // 2, 1)]))) / THIRD_DIFFERENCE_GAIN
        out.append(max(min(white, 3 * low + encoder), encoder, LEAST_NOISE))
    return np.array(out)
