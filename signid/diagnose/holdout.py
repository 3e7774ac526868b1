"""Residuals of a simulation on the training and the held-out recordings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..errors import RecordingError
from ..estimation.fit_quality import Course, Fit, fit_rows, rms_of
from ..model import Model
from ..regression.bandwidth import Decimator
from ..regression.rows import Task
from ..regression.session import Part, Session
from ..types import Array, Indices, Robot
from .data.motions import Piece, pieces, reversal_uncertainty, row_filter, standstill, stated_friction

if TYPE_CHECKING:
    from .data.noise import Noise


class ResidualRows(NamedTuple):
    """M low-passed and decimated rows of some recordings; NaN in rows that do not count."""

    pieces: tuple[Piece, ...]  # empty where they are not kept
    thin: Decimator
    stretch: Indices  # (M,) piece of each row
    recording: Indices  # (M,) recording of each row
    t: Array  # (M,) [s] from the origin of each recording
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    residual: Array  # (M, n) [N.m or N] measured - predicted
    torque: Array  # (M, n) [N.m or N] measured
    reversal_std: Array  # (M, n) [N.m or N] standard deviation near velocity reversals

    def irreducible_std(self, noise: Noise, least: float = 0.0) -> Array:
        """(M, n) [N.m or N] std that no simulation could predict; `least`: least multiple of `reversal_std` in it."""
        return np.asarray(np.hypot(noise.saturated_floor, np.maximum(noise.reversal_scale, least) * self.reversal_std))


class Prediction(NamedTuple):
    """A simulation and its residuals on the recordings of a session."""

    model: Model
    train: ResidualRows
    held_out: ResidualRows


class Comparison(NamedTuple):
    """Residuals before and after the extension."""

    before: Fit
    after: Fit
    train: Course
    held_out: Course


def predict(session: Session, model: Model) -> Prediction:
    """Predict the training and the held-out recordings."""
    return Prediction(model, *(residual_rows(session.task, model, own) for own in (session.train, session.held_out)))


def fit_of(prediction: Prediction, noise: Noise, floor: Array) -> Fit:
    """Residual rms in training and held out; floor: (n,) [N.m or N] rms of white measurement noise in the band."""
    rows, irreducible = prediction.held_out, rms_of(prediction.held_out.irreducible_std(noise))
    return fit_rows(prediction.model.robot, rows.residual, rows.torque, floor, prediction.train.residual, irreducible)


def compare(before: Prediction, after: Prediction, noise: Noise, floor: Array) -> Comparison:
    """Compare the given and the extended simulation; floor: (n,) [N.m or N] rms of white noise in the band."""
    robot = after.model.robot
    return Comparison(
        fit_of(before, noise, floor),
        fit_of(after, noise, floor),
        course_of(before.train, after.train, robot),
        course_of(before.held_out, after.held_out, robot),
    )


def course_of(before: ResidualRows, after: ResidualRows, robot: Robot) -> Course:
    """Residuals of two simulations over time, on the same recordings."""
    return Course(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        prismatic=tuple(map(bool, robot.prismatic)),
        before=before.residual,
        after=after.residual,
        **{key: getattr(before, key) for key in ("stretch", "recording", "t", "q", "v", "torque")},
    )


def residual_rows(task: Task, model: Model, parts: Sequence[Part], keep: bool = True) -> ResidualRows:
    """Residuals of a simulation; rows where a joint stands still do not count, since friction is undetermined there.

    Unless `keep`, pieces, whose memory grows with the recordings at their full rate, are dropped one by one.

    Raises:
        RecordingError: no stretch is as long as the filter.
    """
    thin, dry, kept, rows = row_filter(task), stated_friction(model), list[Piece](), list[tuple[Array, ...]]()
    for k, piece in enumerate(pieces(task, model, parts)):
        t, q, v = (thin.at(x).copy() for x in (piece.motion.t - piece.origin, piece.motion.q, piece.motion.v))
        which = (np.full(len(t), k), np.full(len(t), piece.recording))
        rows.append((*which, t, q, v, *filtered(piece, thin), reversal_uncertainty(thin, [piece], dry)))
        kept += [piece] if keep else []
    if not rows:
        raise RecordingError(
            f"no stretch of the held-out recordings is as long as the filter for {task.band.cutoff:.3g} Hz; hold out "
            f"more with --held-out, or raise the cut-off"
        )
    return ResidualRows(tuple(kept), thin, *(np.concatenate(x) for x in zip(*rows, strict=True)))


def filtered(piece: Piece, thin: Decimator) -> tuple[Array, Array]:
    """Rows of one piece: (M, n) residual and (M, n) measured torque [N.m or N]; NaN where a joint stands still."""
    still = (thin.at(standstill(piece.motion, thin)) > 0) & piece.motion.v.any()  # not of postures at rest
    residual = np.where(still, np.nan, thin(piece.residual))
    return residual, residual + thin(np.asarray(piece.motion.predicted))
