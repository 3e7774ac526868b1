"""A simulation, recordings -> how much torque it predicts, on what was learned from and on what was held out."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...estimation.fit_quality import Course, Fit, fit_rows, rms_of
from ...model import Model
from ...regression.filters import Decimator
from ...regression.rows import Task
from ...regression.session import Part, Session
from ...types import Array, Robot
from ..data.column_groups import stated_friction
from ..data.motions import Piece, pieces, reversal_uncertainty, row_filter
from ..data.noise import Noise
from ..data.rows import standstill


class Rows(NamedTuple):
    """M rows of some recordings, through the filter of the rows; NaN where none counts."""

    pieces: tuple[Piece, ...]
    thin: Decimator
    rest: Array  # (M, n) [N.m or N] measured - predicted
    torque: Array  # (M, n) [N.m or N] measured
    unsure: Array  # (M, n) [N.m or N] near reversals, standard deviation

    def irreducible_std(self, noise: Noise, least: float = 0.0) -> Array:
        """(M, n) [N.m or N] standard deviation of all that no simulation could predict.

        Args:
            noise: of the rows.
            least: of what is presumed near reversals, where no more is seen [1].
        """
        return np.asarray(np.hypot(noise.saturated_floor, np.maximum(noise.reversal_scale, least) * self.unsure))


class Shown(NamedTuple):
    """What a simulation predicts of the recordings of a session."""

    model: Model
    learned: Rows
    judged: Rows  # held out


class Proof(NamedTuple):
    """A simulation before and after."""

    before: Fit
    after: Fit
    learned: Course
    judged: Course  # held out


def show(session: Session, model: Model) -> Shown:
    """Rows of a simulation in training and held out.

    Args:
        session: recordings and band.
        model: the simulation.
    """
    return Shown(model, *(residuals(session.task, model, parts) for parts in (session.train, session.held_out)))


def fit_of(shown: Shown, noise: Noise, floor: Array) -> Fit:
    """Residual rms of a simulation in training and held out, beside what no simulation could predict.

    Args:
        shown: its rows.
        noise: noise of the rows.
        floor: (n,) [N.m or N] rms of white measurement noise in the band.
    """
    held = shown.judged
    irreducible = rms_of(held.irreducible_std(noise))
    return fit_rows(shown.model.robot, held.rest, held.torque, floor, shown.learned.rest, irreducible)


def prove(before: Shown, after: Shown, noise: Noise, floor: Array) -> Proof:
    """What a simulation left of the recordings, and what it leaves with what it lacked.

    Args:
        before: the simulation as it was.
        after: the extended one.
        noise: of the rows.
        floor: (n,) [N.m or N] rms of white measurement noise in the band.
    """
    robot = after.model.robot
    return Proof(
        fit_of(before, noise, floor),
        fit_of(after, noise, floor),
        course_of(before.learned, after.learned, robot),
        course_of(before.judged, after.judged, robot),
    )


def course_of(before: Rows, after: Rows, robot: Robot) -> Course:
    """What one simulation and another leave of the same recordings.

    Args:
        before: rows of the one.
        after: rows of the other.
        robot: gives the joints.
    """
    thin, motions = before.thin, [piece.motion for piece in before.pieces]
    lengths = [len(thin.at(motion.t)) for motion in motions]

    def joined(signals: Sequence[Array]) -> Array:
        return np.concatenate([thin.at(x) for x in signals])

    return Course(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        prismatic=tuple(map(bool, robot.prismatic)),
        stretch=np.repeat(np.arange(len(motions)), lengths),
        recording=np.repeat([piece.recording for piece in before.pieces], lengths),
        t=joined([motion.t for motion in motions]),
        q=joined([motion.q for motion in motions]),
        v=joined([motion.v for motion in motions]),
        torque=before.torque,
        before=before.rest,
        after=after.rest,
    )


def residuals(task: Task, model: Model, parts: Sequence[Part]) -> Rows:
    """What a simulation leaves of some recordings. Where a joint stands still, friction may be anything.

    Args:
        task: gives the band and the width of a reversal.
        model: the simulation.
        parts: recordings and their sampling.

    Raises:
        RecordingError: no stretch is as long as the filter.
    """
    thin, found = row_filter(task), tuple(pieces(task, model, parts))
    if not found:
        raise RecordingError(
            f"no stretch of the held-out recordings is as long as the filter for {task.band.cutoff:.3g} Hz; hold out "
            f"more with --held-out, or raise the cut-off"
        )
    rest, torque = (np.concatenate(x) for x in zip(*(filtered(piece, thin) for piece in found), strict=True))
    return Rows(found, thin, rest, torque, reversal_uncertainty(thin, found, stated_friction(model)))


def filtered(piece: Piece, thin: Decimator) -> tuple[Array, Array]:
    """Rows of one piece: (M, n) residual and (M, n) measured torque [N.m or N]; NaN where a joint stands still.

    Args:
        piece: a motion with its residual.
        thin: the filter of the rows.
    """
    still = thin.at(standstill(piece.motion, thin)) > 0
    rest = np.where(still, np.nan, thin(piece.residual))
    return rest, rest + thin(np.asarray(piece.motion.predicted))
