"""Signs of rows -> their expectations, for a fit without the bias of guessed signs around zero torque."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...recording.sampling.grid import Stretch
from ...regression.rows import Task
from ...regression.session import Part
from ...types import Array
from ..rows.observations import motion_windows, predict
from .markov_chain import CLEAR_ODDS, coupling, expected_signs

CHUNK = 65_536  # [rows] read at a time; bounds memory
INFLATION = 4.0  # [rows per independent row] kappa of the residual at full rate; heuristic
CONTRADICTS = 0.96  # [1] |expectation| of the opposite sign from which the sign found before stays; heuristic

Weights = NDArray[np.float32]


def expect_signs(task: Task, part: Part, value: Array, sigma: Array, signs: NDArray[np.int8]) -> Weights:
    """Expectation (rows, n) of the sign of each row, from the torque of a model and the rows around it.

    A torque below its noise that is given the sign of the model is biased towards the model; with the expectation of
    the sign it is not. Near reversals, and where the chain clearly contradicts a sign, the sign stays.

    Args:
        task: robot, laws, base map and band.
        part: recording and its sampling.
        value: (b,) base parameters [units of base].
        sigma: (n,) standard deviation of the model's residual [N.m or N].
        signs: (rows, n) signs found for the rows of the file, 0 where there is none.

    Source: E step of Dempster, Laird, Rubin, J. Royal Statistical Society B 39(1), 1977.
    """
    recording, sampling = part
    pieces = iter(_expected(task, part, value, sigma))
    found = signs.astype(np.float32)
    for stretch in sampling.stretches:
        expected = [next(pieces)]
        while sum(map(len, expected)) < stretch.count:
            expected.append(next(pieces))
        _assign(found, part, stretch, np.concatenate(expected))
    found[:, recording.signed] = signs[:, recording.signed]
    return found


def _expected(task: Task, part: Part, value: Array, sigma: Array) -> list[Weights]:
    """Expectations of the samples of the grid, window by window; NaN near reversals."""
    found: list[Weights] = []
    variance = np.where(sigma > 0, INFLATION * sigma**2, np.inf)
    for _, motion, steady in motion_windows(task, part, 1):
        assert motion.recorded is not None, "windows carry torque"
        magnitude = np.abs(np.nan_to_num(motion.recorded))
        odds = np.clip(2 * predict(task, motion, value) * magnitude / variance, -CLEAR_ODDS, CLEAR_ODDS)
        expected = expected_signs(odds, coupling(magnitude, np.arange(len(odds)) == 0, 0.0))
        found.append(np.where(steady, expected, np.nan).astype(np.float32))
    return found


def _assign(found: Weights, part: Part, stretch: Stretch, expected: Weights) -> None:
    """Assign to each row of a stretch the expectation of the nearest sample of the grid."""
    recording, sampling = part
    for start in range(stretch.start, stretch.stop, CHUNK):
        rows = slice(start, min(start + CHUNK, stretch.stop))
        stamps = recording.table.read(recording.columns["t"], rows.start, rows.stop)[:, 0]
        place = np.round((stamps - stretch.stamps[0]) / sampling.period).astype(np.intp) - stretch.first
        inside = (place >= 0) & (place < len(expected))
        soft, hard = expected[np.clip(place, 0, len(expected) - 1)], found[rows]
        clash = (np.sign(soft) != hard) & (np.abs(soft) > CONTRADICTS)
        keep = ~inside[:, None] | np.isnan(soft) | (soft == 0) | (hard == 0) | clash
        found[rows] = np.where(keep, hard, soft)
