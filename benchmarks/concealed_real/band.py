"""Residuals of a model in a given band, the size of a change there, and the comparison on an unseen recording."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from signid.diagnose.extend.holdout import residual_rows
from signid.model import Model
from signid.regression.prepare import prepare
from signid.regression.session import Options
from signid.simulation.rollout.joints import restrict_joints
from signid.types import Recording

Array = NDArray[np.float64]
BLOCKS, LEAST = 20, 4  # blocks in time of a recording, and the fewest for a standard error
ROUNDING = 1e-9  # share of the mean square


@dataclass(frozen=True)
class Worse:
    """Both models at one joint of an unseen recording."""

    joint: str
    given: float  # rms [N.m or N]
    extended: float
    error: float  # standard error of the difference of mean squares, as a share of the given mean square [1]
    worse: bool  # by more than that


def residual(model: Model, recording: Recording, cutoff: float | None) -> Array:
    """(M, n) [N.m or N] measured - predicted in a band; NaN where a row does not count.

    Args:
        model: the simulation.
        recording: of its joints.
        cutoff: [Hz]; None: chosen from the recording.

    Raises:
        RecordingError: no stretch is as long as the filter.
    """
    own = restrict_joints(model, [recording])[0]
    options = replace(Options(effects=()), cutoff=cutoff)
    session = prepare(own.robot, [recording], [recording], options)
    own = restrict_joints(own, [recording])[0]
    return np.asarray(residual_rows(session.task, own, session.held_out).residual)


def rms(x: Array) -> Array:
    """(n,) root mean square of the rows that count; NaN where none does."""
    count = np.isfinite(x).sum(axis=0)
    return np.asarray(np.sqrt(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan)))


def ratios(changed: Array, control: Array) -> Array:
    """(n,) rms of the torque that a change makes over the rms residual of the control [1].

    Args:
        changed: (M, n) residual with the change.
        control: (M, n) residual without it, of the same rows.
    """
    return np.nan_to_num(rms(changed - control) / rms(control))


def ratios_apart(changed: Array, control: Array) -> Array:
    """(n,) the same for two recordings whose rows cannot be compared: rms of the excess residual [1].

    Args:
        changed: (M, n) residual on the one.
        control: (N, n) residual on the other.
    """
    ours, plain = rms(changed), rms(control)
    return np.nan_to_num(np.sqrt(np.maximum(ours**2 - plain**2, 0.0)) / plain)


def compare(given: Array, extended: Array, joints: Sequence[str]) -> list[Worse]:
    """Compare mean squares per joint, with a standard error from blocks in time.

    Args:
        given: (M, n) residual of the given model.
        extended: (M, n) residual of the extended model, same rows.
        joints: n names.
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
