"""Model and recordings of a session -> filtered rows of measured torque and residual."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..diagnose.data.motions import pieces, row_filter
from ..diagnose.extend.holdout import filtered
from ..errors import RecordingError
from ..model import Model
from ..regression.session import Session
from ..types import Array, Indices


class ValidationRows(NamedTuple):
    """Filtered rows: M rows of n joints; NaN where no torque is recorded or the joint stands still."""

    recording: Indices  # (M,) number of the recording
    stretch: Indices  # (M,) number of the stretch without gaps
    t: Array  # (M,) [s]
    torque: Array  # (M, n) [N.m or N] measured
    residual: Array  # (M, n) [N.m or N] measured - predicted


def model_rows(model: Model, session: Session) -> tuple[ValidationRows, tuple[str, ...]]:
    """Rows of all recordings of a session, and the joints whose predicted torque is not finite: these have no residual.

    Rows are computed piece by piece: memory grows with their rate, twice the cut-off, not with the sampling rate. The
    choice of valid rows does not depend on the model.

    Args:
        model: model of the session's joints.
        session: session by `prepare` with the recordings.

    Raises:
        RecordingError: every stretch of the recordings is shorter than the filter.
    """
    thin, found, finite = row_filter(session.task), list[ValidationRows](), np.ones(len(model.robot.joints), dtype=bool)
    with np.errstate(all="ignore"):
        for k, piece in enumerate(pieces(session.task, model, session.held_out)):
            residual, torque = filtered(piece, thin)
            finite &= np.isfinite(np.asarray(piece.motion.predicted)).all(axis=0)
            t = thin.at(piece.motion.t)
            found.append(ValidationRows(np.full(len(t), piece.recording), np.full(len(t), k), t, torque, residual))
    if not found:
        band = session.task.band
        raise RecordingError(
            f"every stretch of the recordings is shorter than the filter for {band.cutoff:.3g} Hz "
            f"({len(band.taps) / band.rate:.2g} s); record longer, or raise the cut-off"
        )
    rows = ValidationRows(*(np.concatenate(column) for column in zip(*found, strict=True)))
    measured = np.any([[bool(column) for column in r.columns["tau"]] for r, _ in session.held_out], axis=0)
    lost = tuple(model.robot.joints[j] for j in np.flatnonzero(measured & ~finite))
    return rows._replace(residual=np.where(finite, rows.residual, np.nan)), lost
