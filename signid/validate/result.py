"""Result of a validation: fit, roll-out and rows of each model."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

from ..estimation.fit_quality import Fit
from ..model import Model
from ..simulation.rollout import RollOut
from ..types import Array, Indices, Input, Recording, Result

if TYPE_CHECKING:
    from ..simulation.rollout.whole import WholeRollOut


class ModelCandidate(NamedTuple):
    """Model to be validated, and the recordings of its joints."""

    name: str
    model: Model
    recordings: tuple[Recording, ...]
    notes: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class ValidatedModel(Result):
    """One model on all recordings: M rows of n joints, NaN where no torque is recorded or the joint stands still."""

    name: str  # path of the model, or its given name
    model: Model  # restricted to the joints of the recordings
    fit: Fit  # nothing is fitted: `train_rms` is NaN, `held_out_rms` is the rms on the recordings
    rollout: RollOut | None  # None if not requested, or if no stretch of a recording is long enough
    recording: Indices  # (M,) number of the recording
    stretch: Indices  # (M,) number of the stretch without gaps
    t: Array  # (M,) [s] since the start of the recording if its stamps begin far from 0
    torque: Array  # (M, n) [N.m or N] measured, low-passed
    residual: Array  # (M, n) [N.m or N] measured - predicted, low-passed
    whole: WholeRollOut | None = None  # simulation of whole recordings, instead of `rollout`


@dataclass(frozen=True, eq=False)
class Validation(Result):
    """Comparison of models with recordings. `flags` name unreliable results; empty if there are none."""

    models: tuple[ValidatedModel, ...]
    inputs: tuple[Input, ...]  # the recordings
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    horizon: float | str  # [s] of the roll-outs, or whole: of whole recordings
    cutoff: float  # [Hz] of the torque
    position_cutoff: float  # [Hz] of the positions
    seed: int
