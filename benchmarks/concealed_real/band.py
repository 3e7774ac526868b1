"""Residuals of a model in a given band, size of a change there, and comparison on a held-out recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signid.diagnose.extend.holdout import residual_rows
from signid.model import Model
from signid.regression.session import Options, prepare
from signid.simulation.rollout.windows import restrict_joints
from signid.types import Recording

Array = NDArray[np.float64]
BLOCKS, LEAST = 20, 4  # time blocks per recording, fewest blocks for a standard error
ROUNDING = 1e-9  # tolerance over the mean square [1]


@dataclass(frozen=True)
class Worse:
    """Both models at one joint of a held-out recording."""

    joint: str
    given: float  # rms [N.m or N]
    extended: float
    error: float  # standard error of the difference of mean squares, as a share of the given mean square [1]
    worse: bool  # the extended model is worse by more than the standard error


def residual(model: Model, recording: Recording, cutoff: float | None) -> Array:
    """Residual (M, n) [N.m or N], measured - predicted, in a band; NaN in excluded rows.

    Args:
        model: simulation model.
        recording: recording of the model's joints.
        cutoff: cut-off [Hz]; None: chosen from the recording.

    Raises:
        RecordingError: every stretch is shorter than the filter.
    """
    own = restrict_joints(model, [recording])[0]
    options = replace(Options(effects=()), cutoff=cutoff)
    session = prepare(own.robot, [recording], [recording], options)
    own = restrict_joints(own, [recording])[0]
    return np.asarray(residual_rows(session.task, own, session.held_out).residual)


def rms(x: Array) -> Array:
    """Root mean square (n,) over included rows; NaN without rows."""
    count = np.isfinite(x).sum(axis=0)
    return np.asarray(np.sqrt(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan)))


def ratios(changed: Array, control: Array) -> Array:
    """Rms torque of a change over the rms residual of the control (n,) [1].

    Args:
        changed: residual with the change (M, n).
        control: residual of the same rows without the change (M, n).
    """
    return np.nan_to_num(rms(changed - control) / rms(control))


def ratios_apart(changed: Array, control: Array) -> Array:
    """Rms excess residual over the rms residual of the control (n,) [1], for different recordings.

    Args:
        changed: residual on the changed recording (M, n).
        control: residual on the control recording (N, n).
    """
    total, plain = rms(changed), rms(control)
    return np.nan_to_num(np.sqrt(np.maximum(total**2 - plain**2, 0.0)) / plain)


def compare(given: Array, extended: Array, joints: Sequence[str]) -> list[Worse]:
    """Compare mean squares per joint, with a standard error from blocks in time.

    Args:
        given: residual of the given model (M, n).
        extended: residual of the extended model on the same rows (M, n).
        joints: joint names (n,).
    """
    found = []
    for j, joint in enumerate(joints):
        both = np.isfinite(given[:, j]) & np.isfinite(extended[:, j])
        before, after = given[both, j] ** 2, extended[both, j] ** 2
        if not len(before) or not before.any():
            continue
        blocks = [np.mean(x) for x in np.array_split(after - before, min(BLOCKS, len(before)))]
        error = float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))) if len(blocks) >= LEAST else np.inf
        gain = float(np.mean(after) - np.mean(before))
        worse = gain > error + ROUNDING * float(np.mean(before))
        small, large = (float(np.sqrt(np.mean(x))) for x in (before, after))
        found.append(Worse(joint, small, large, error / float(np.mean(before)), worse))
    return found
