"""Times at which commands may change between the rows of a log, as far as the fit does not rule them out.

A command that is logged as often as it changes, or less often, may have changed between two rows. Then a shorter or no
hold acts like a longer delay: the average of what acts in a row moves by up to half a row.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.interpolate import CubicSpline

from ...model import Model
from ...servos import ServoGrid
from ...types import Array
from ..fit import ServoFit, fit_servos
from ..search.data import ServoData

PARTS = 4  # of a row
BETWEEN = {2: 0.25, 4: 0.5}  # changes of the command in a row, and shift of what acts in it [rows]; 4: all the time
EVERY = 0.5  # share of rows with a new command, of those while it moves, from which it may change between rows
NEAR = 5  # rows around a change of a command, in which it moves
GROWS, SURE = 1.05, 2.0  # rms, and its growth in standard errors over windows, that rule changes between rows out
STEPS = 4  # most iterations of a fit


def command_timing(model: Model, data: ServoData, fit: ServoFit, window: float) -> dict[str, float]:
    """Time [s] by which the delay of each joint may be longer, as its commands may change between rows; 0 if not."""
    suspects = [joint for joint in fit.servos if _changes(data.train, data.joints.index(joint)) > EVERY]
    found = dict.fromkeys(fit.servos, 0.0)
    if not suspects or not fit.names:
        return found
    held = _squares(model, data, fit, 1, window)
    for changes, shift in BETWEEN.items():
        worse = _squares(model, data, fit, changes, window) - held
        for joint in suspects:
            j = data.joints.index(joint)
            own, base = worse[:, j], float(np.mean(held[:, j]))
            error = own.std(ddof=1) / np.sqrt(len(own)) if len(own) > 1 else np.inf
            if not (own.mean() > SURE * error and own.mean() > (GROWS**2 - 1) * base):
                found[joint] = shift * data.train[0].step
    return found


def _squares(model: Model, data: ServoData, fit: ServoFit, changes: int, window: float) -> Array:
    """Mean squares (W, n) [rad2 or m2] of windows, fitted with a number of `changes` of the command in each row."""
    late = BETWEEN.get(changes, 0.0) * data.train[0].step
    servos = {joint: servo.with_(delay=servo.delay + late) for joint, servo in fit.servos.items()}
    grids = [_refined(grid, changes) for grid in data.train]
    new = fit_servos(
        model,
        grids,
        servos,
        fit.free,
        window=window,
        relinearise=False,
        iterations=STEPS,
        scales=False,
    )
    return new.window_squares


def _refined(grid: ServoGrid, changes: int) -> ServoGrid:
    """Grid with PARTS times the rows; positions and commands are interpolated by splines, commands are then held."""
    rows = np.arange(len(grid))
    at = np.arange((len(grid) - 1) * PARTS + 1) / PARTS
    held, kept = np.floor(at * changes + 1e-9) / changes, (at + 1e-9).astype(int)
    speed, forward = grid.command_speed, grid.feed_forward
    return replace(
        grid,
        rate=grid.rate * PARTS,
        q=CubicSpline(rows, grid.q)(at),
        command=grid.command[kept] if changes == 1 else CubicSpline(rows, grid.command)(held),
        on=grid.on[kept],
        voltage=grid.voltage[kept],
        command_speed=None if speed is None else speed[kept],
        feed_forward=None if forward is None else forward[kept],
    )


def _changes(grids: Sequence[ServoGrid], joint: int) -> float:
    """Share of rows with a new command, of those near a change [1]."""
    new = [np.diff(grid.command[:, joint]) != 0 for grid in grids]
    near = [np.convolve(x, np.ones(2 * NEAR + 1), "same") > 0.5 for x in new]
    return float(sum(x.sum() for x in new) / max(sum(x.sum() for x in near), 1))
