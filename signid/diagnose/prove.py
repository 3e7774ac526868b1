"""Two simulations -> how much of the torque each predicts, on what was learned from and on what was held out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ..filters import Decimator
from ..fit import Fit
from ..model import Model
from ..rows import Task
from ..session import Part, Session
from ..types import Array
from .sample import pieces
from .table import stands_still


def predict_fit(session: Session, model: Model, floor: Array) -> Fit:
    """Residual rms of a simulation in training and held out, through the filter of the rows.

    Args:
        session: recordings and band.
        model: the simulation.
        floor: (n,) noise of the rows [N.m or N].
    """
    robot = model.robot
    learned, judged = (residuals(session.task, model, parts) for parts in (session.train, session.held_out))
    residual, torque = judged
    spread = np.nansum((torque - _mean(torque)) ** 2, axis=0)
    return Fit(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        train_rms=_rms(learned[0]),
        held_out_rms=_rms(residual),
        noise_floor=floor,
        held_out_r2=1 - np.nansum(residual**2, axis=0) / np.where(spread > 0, spread, np.nan),
    )


def residuals(task: Task, model: Model, parts: Sequence[Part]) -> tuple[Array, Array]:
    """Measured - predicted torque and measured torque, (M, n) each [N.m or N]; NaN where none counts.

    Where a joint stands still, friction may be anything.
    """
    thin = Decimator(task.band.taps, task.band.factor)
    found = [piece for piece in pieces(task, model, parts) if len(piece.motion) > 2 * thin.half]
    rest = np.concatenate([thin(piece.residual) for piece in found])
    predicted = np.concatenate([thin(np.asarray(piece.motion.predicted)) for piece in found])
    still = [stands_still(p.motion, thin)[thin.half : len(p.motion) - thin.half : thin.factor] for p in found]
    rest = np.where(np.concatenate(still) > 0, np.nan, rest)
    return rest, rest + predicted


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(_mean(x**2)))


def _mean(x: Array) -> Array:
    """(n,) of the rows that count; NaN where none does."""
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x, axis=0) / np.where(count > 0, count, np.nan))
