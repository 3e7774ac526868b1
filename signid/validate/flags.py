"""Sentences on unreliable or incomparable results of a validation."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ..errors import shorten
from ..estimation.fit_quality import LITTLE
from ..faults import OF_A_FIT, RecordingFaults
from ..faults.result import REFUSE, WARN
from ..simulation.rollout import RollOut
from .result import ModelCandidate, ValidatedModel

if TYPE_CHECKING:
    from ..simulation.rollout.whole import WholeRollOut


def joint_flags(candidates: Sequence[ModelCandidate], recorded: Sequence[str]) -> Iterator[str]:
    """A sentence on each model that does not move all joints that the recordings move."""
    for one in candidates:
        if lacking := [joint for joint in recorded if joint not in one.model.robot.joints]:
            yield (
                f"{one.name} lacks or holds {shorten(lacking)}, which the recordings move: its results are those of a "
                f"robot at rest there; give a model of all recorded joints"
            )


def constant_flags(candidates: Sequence[ModelCandidate]) -> Iterator[str]:
    """A sentence on each model whose torque constants differ from those that converted the recorded currents."""
    for one in candidates:
        stated = np.abs(one.model.robot.actuators.torque_constant)
        for recording in one.recordings:
            used = recording.torque_per_unit
            other = (used != 1) & np.isfinite(stated) & ~np.isclose(stated, np.abs(used), rtol=1e-6)
            if other.any():
                names = [recording.joints[j] for j in np.flatnonzero(other)]
                yield (
                    f"{one.name} states another torque constant of {shorten(names)} than the one that converted the "
                    f"current in {recording.path or 'the recording'}: its residual contains the difference; state the "
                    f"same constants for all models"
                )
                break


def fault_flags(names: Sequence[str], faults: Sequence[RecordingFaults]) -> Iterator[str]:
    """The sentence of each recording fault, once; with the models that find it unless all do."""
    shown: dict[tuple[str, tuple[str, ...]], tuple[str, list[str]]] = {}
    for name, found in zip(names, faults, strict=True):
        for fault in (f for severity in (REFUSE, WARN) for f in found.findings if f.severity == severity):
            if fault.kind not in OF_A_FIT:
                shown.setdefault((fault.kind, fault.joints), (fault.sentence, []))[1].append(name)
    for sentence, by in shown.values():
        yield sentence if len(by) == len(names) else f"found with {shorten(by)}: {sentence}"


def row_notes(one: ValidatedModel, lost: Sequence[str]) -> Iterator[str]:
    """A sentence on each joint whose torque is poorly predicted, or that has no rows for another reason than `lost`."""
    fit = one.fit
    if poor := [f"{joint} (R2 {r2:.2f})" for joint, r2 in zip(fit.joints, fit.held_out_r2, strict=True) if r2 < LITTLE]:
        yield f"{one.name} predicts little of the torque of {shorten(poor)}"
    for joint, rms in zip(fit.joints, fit.held_out_rms, strict=True):
        if np.isnan(rms) and joint not in lost:
            yield f"{joint} has no rows: its torque is not recorded, or it always stands still"


def rollout_notes(name: str, found: RollOut, horizon: float) -> Iterator[str]:
    """A sentence on a simulation that diverges within the horizon [s], with infinite errors."""
    diverged = np.isinf(found.end(horizon)).any(axis=1)
    if diverged.any():
        share = diverged.mean()
        yield f"{name} diverges within {horizon:g} s in {share:.0%} of the simulations: their error is infinite"


def whole_notes(name: str, found: WholeRollOut) -> Iterator[str]:
    """A sentence on joints whose simulation over whole recordings leaves the motion, so that its error means little."""
    far = [joint for joint, rms, size in zip(found.joints, found.rms, found.motion, strict=True) if not rms <= size]
    if far:
        yield (
            f"{name}, simulated over {found.seconds:.3g} s, leaves the motion ({shorten(far)}: error above the "
            f"standard deviation of the position); short horizons say more about these joints"
        )
