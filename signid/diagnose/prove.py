"""A simulation, recordings -> how much torque it predicts, on what was learned from and on what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..filters import Decimator
from ..fit import Fit
from ..model import Model
from ..rows import Task
from ..session import Part, Session
from ..types import Array
from .group import stated_friction
from .noise import Noise
from .sample import Piece, pieces, unsure_rows
from .table import stands_still


class Rows(NamedTuple):
    """M rows of some recordings, through the filter of the rows; NaN where none counts."""

    pieces: tuple[Piece, ...]
    thin: Decimator
    rest: Array  # (M, n) [N.m or N] measured - predicted
    torque: Array  # (M, n) [N.m or N] measured
    unsure: Array  # (M, n) [N.m or N] near reversals, standard deviation

    def unforeseen(self, noise: Noise, least: float = 0.0) -> Array:
        """(M, n) [N.m or N] standard deviation of all that no simulation could predict.

        Args:
            noise: of the rows.
            least: of what is presumed near reversals, where no more is seen [1].
        """
        return np.asarray(np.hypot(noise.floor, np.maximum(noise.late, least) * self.unsure))


class Shown(NamedTuple):
    """What a simulation predicts of the recordings of a session."""

    model: Model
    learned: Rows
    judged: Rows  # held out


def show(session: Session, model: Model) -> Shown:
    """Rows of a simulation in training and held out.

    Args:
        session: recordings and band.
        model: the simulation.
    """
    return Shown(model, *(residuals(session.task, model, parts) for parts in (session.train, session.held_out)))


def fit_of(shown: Shown, noise: Noise) -> Fit:
    """Residual rms of a simulation in training and held out, beside what no simulation could predict."""
    robot, residual, torque = shown.model.robot, shown.judged.rest, shown.judged.torque
    spread = np.nansum((torque - _mean(torque)) ** 2, axis=0)
    return Fit(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        train_rms=_rms(shown.learned.rest),
        held_out_rms=_rms(residual),
        noise_floor=_rms(shown.judged.unforeseen(noise)),
        held_out_r2=1 - np.nansum(residual**2, axis=0) / np.where(spread > 0, spread, np.nan),
    )


def residuals(task: Task, model: Model, parts: Sequence[Part]) -> Rows:
    """What a simulation leaves of some recordings. Where a joint stands still, friction may be anything.

    Args:
        task: gives the band and the width of a reversal.
        model: the simulation.
        parts: recordings and their sampling.
    """
    thin, found = Decimator(task.band.taps, task.band.factor), tuple(pieces(task, model, parts))
    rest = np.concatenate([thin(piece.residual) for piece in found])
    predicted = np.concatenate([thin(np.asarray(piece.motion.predicted)) for piece in found])
    still = [thin.at(stands_still(p.motion, thin)) for p in found]
    rest = np.where(np.concatenate(still) > 0, np.nan, rest)
    return Rows(found, thin, rest, rest + predicted, unsure_rows(thin, found, stated_friction(model)))


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(_mean(x**2)))


def _mean(x: Array) -> Array:
    """(n,) of the rows that count; NaN where none does."""
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x, axis=0) / np.where(count > 0, count, np.nan))
