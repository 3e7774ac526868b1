"""Signs of rows -> their expectation, for a fit without bias: noise around zero has no sign that could be known."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...recording.sampling.stretch import Stretch
from ...regression.rows import Task
from ...regression.session import Part
from ...types import Array
from ..rows.observations import motion_windows, predict
from .markov_chain import SURE, coupling, expected_signs

CHUNK = 65_536  # rows
INFLATION = 4.0  # rows for one whose residual is independent of the others
CLEAR = 0.96  # expectation from which on the chain contradicts a sign

Weights = NDArray[np.float32]


def expect_signs(task: Task, part: Part, value: Array, sigma: Array, signs: NDArray[np.int8]) -> Weights:
    """(rows, n) expectation of the sign of each row, by a model's torque and by the rows around it.

    A sign given by force to torque below its noise makes it too large, always on the side of the model; expectations
    do not. Near reversals, and where the chain clearly contradicts a sign, the sign stays.

    Args:
        task: what rows are made for.
        part: the recording.
        value: (b,) base parameters [units of base].
        sigma: (n,) standard deviation of the model's residual [N.m or N].
        signs: (rows, n) found for the rows of the file, 0 where there is none.

    Source: E step of Dempster, Laird, Rubin, J. Royal Statistical Society B 39(1), 1977.
    """
    recording, sampling = part
    pieces = iter(_expected(task, part, value, sigma))
    found = signs.astype(np.float32)
    for stretch in sampling.stretches:
        expected = [next(pieces)]
        while sum(map(len, expected)) < stretch.count:
            expected.append(next(pieces))
        _lay(found, part, stretch, np.concatenate(expected))
    found[:, recording.signed] = signs[:, recording.signed]
    return found


def _expected(task: Task, part: Part, value: Array, sigma: Array) -> list[Weights]:
    """Of the samples of the grid, window by window; NaN near reversals."""
    found: list[Weights] = []
    variance = np.where(sigma > 0, INFLATION * sigma**2, np.inf)
    for _, motion, steady in motion_windows(task, part, 1):
        assert motion.recorded is not None, "windows carry torque"
        magnitude = np.abs(np.nan_to_num(motion.recorded))
        odds = np.clip(2 * predict(task, motion, value) * magnitude / variance, -SURE, SURE)
        expected = expected_signs(odds, coupling(magnitude, np.arange(len(odds)) == 0, 0.0))
        found.append(np.where(steady, expected, np.nan).astype(np.float32))
    return found


def _lay(found: Weights, part: Part, stretch: Stretch, expected: Weights) -> None:
    """Onto the rows of a stretch, each from the sample of the grid that is nearest in time."""
    recording, sampling = part
    for start in range(stretch.start, stretch.stop, CHUNK):
        rows = slice(start, min(start + CHUNK, stretch.stop))
        stamps = recording.table.read(recording.columns["t"], rows.start, rows.stop)[:, 0]
        place = np.round((stamps - stretch.stamps[0]) / sampling.period).astype(np.intp) - stretch.first
        inside = (place >= 0) & (place < len(expected))
        told = expected[np.clip(place, 0, len(expected) - 1)]
        hard = found[rows]
        clash = (np.sign(told) != hard) & (np.abs(told) > CLEAR)
        keep = ~inside[:, None] | np.isnan(told) | (told == 0) | (hard == 0) | clash
        found[rows] = np.where(keep, hard, told)
