"""Filtered rows of recordings: motion, measured torque, and the residual of a model."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signid.diagnose.extend.holdout import ResidualRows, residual_rows
from signid.model import Model
from signid.recording import same_joints
from signid.recording.sampling import survey
from signid.regression.session import SAME_RATE, Options, prepare
from signid.robot import hold, resting
from signid.simulation.rollout.windows import restrict_joints
from signid.types import Recording, Robot

from ..concealed_real.sets import columns_of, rebuilt

Array = NDArray[np.float64]


class Table(NamedTuple):
    """M rows of one recording; NaN in excluded rows."""

    motion: Array  # (M, 3 n) q, v, a of all joints, filtered like the rows
    rest: Array  # (M, n) [N.m or N] measured - predicted
    torque: Array  # (M, n) [N.m or N] measured


def table(model: Model, recording: Recording, cutoff: float) -> Table:
    """Filtered rows of a recording.

    Args:
        model: simulation model; for features, one without recording laws, which change the motion.
        recording: recording of the model's joints.
        cutoff: cut-off of the filter [Hz].

    Raises:
        RecordingError: every stretch is shorter than the filter.
    """
    rows = filtered(model, recording, cutoff)
    moved = (np.hstack([x.motion.q, x.motion.v, x.motion.a]) for x in rows.pieces)
    return Table(np.concatenate([rows.thin(x) for x in moved]), rows.residual, rows.torque)


def filtered(model: Model, recording: Recording, cutoff: float) -> ResidualRows:
    """Filtered rows of a recording with their motions and filter.

    Args:
        model: the simulation.
        recording: recording of the model's joints.
        cutoff: cut-off of the filter [Hz].

    Raises:
        RecordingError: every stretch is shorter than the filter.
    """
    own = restrict_joints(model, [recording])[0]
    session = prepare(own.robot, [recording], [recording], replace(Options(effects=()), cutoff=cutoff))
    return residual_rows(session.task, restrict_joints(own, [recording])[0], session.held_out)


def one_rate(robot: Robot, recordings: Sequence[Recording]) -> list[Recording]:
    """Resample recordings at the lowest of their sampling rates; unchanged if the rates are equal.

    Linear interpolation suffices, because the rates are far above the cut-off of the rows.

    Args:
        robot: robot of the recordings.
        recordings: recordings with positions and torques.
    """
    moving = hold(robot, resting(robot, but=same_joints(recordings)))
    periods = [survey(recording, moving).period for recording in recordings]
    longest = max(periods)
    return [
        x if longest / period - 1 <= SAME_RATE else _slower(robot, x, longest)
        for x, period in zip(recordings, periods, strict=True)
    ]


def _slower(robot: Robot, recording: Recording, period: float) -> Recording:
    columns = columns_of(recording)
    t = columns["t"]
    coarse = np.arange(t[0], t[-1], period)
    found = {k: np.column_stack([np.interp(coarse, t, x) for x in columns[k].T]) for k in ("q", "tau")}
    return rebuilt(robot, {"t": coarse, **found})
