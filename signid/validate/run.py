"""Models and recordings -> how well each model predicts them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ..diagnose.data.motions import pieces, row_filter
from ..diagnose.extend.holdout import filtered
from ..errors import InputError, OptionError, RecordingError, shorten
from ..estimation.fit_quality import fit_rows
from ..model import Model, ModelSource
from ..recording import Recordings, as_recordings, same_joints
from ..recording_faults import NO_EXCITATION, RecordingFaults, examine
from ..regression.session import Options, Session, only_once, prepare
from ..simulation.rollout import RollOut, roll_out
from ..simulation.rollout.windows import restrict_joints
from ..typed import typed
from ..types import Input, Progress, Recording
from .flags import constant_flags, fault_flags, joint_flags, rollout_notes, row_notes, whole_notes
from .models import named_models
from .result import ModelCandidate, ValidatedModel, Validation

if TYPE_CHECKING:
    from ..simulation.rollout.whole import WholeRollOut

HORIZON = 0.5  # [s] of roll-outs, as in a diagnosis
WHOLE = "whole"  # horizon: from the first samples of a recording to its end


@typed
def validate(
    models: ModelSource | Sequence[ModelSource] | Mapping[str, ModelSource],
    recordings: Recordings,
    *,
    options: Options | None = None,
    rollout: bool = True,
    horizon: float | str = HORIZON,
    progress: Progress | None = None,
) -> Validation:
    """How well given models predict recordings; nothing is fitted.

    Per joint: rms of measured - predicted torque, noise floor, R2, and the error of roll-outs. All models are judged
    on the same rows: same band, same filter, and without the rows where a joint stands still.

    Args:
        models: one or several, as `load_model` gives them; a mapping names them, else they have the robot's name.
        recordings: with signed torque, one or several, all of the same joints.
        options: cut-off and the like; its effects do not count.
        rollout: whether to simulate horizons from measured states, too.
        horizon: length of these simulations [s], or `whole`: whole recordings, open loop under recorded torque.
        progress: called with what is being done and the share of it that is done.

    Raises:
        OptionError: a model or a recording is missing or was given twice, they have no joint in common, or the horizon
            is invalid.
        RecordingError: a recording cannot be used; the sentence says which and why.
    """
    _check_horizon(horizon)
    named = named_models(models, "validate")
    given = as_recordings(recordings, next(iter(named.values())).robot, "validate") if named else []
    _check(named, given)
    options = replace(options or Options(), effects=(), instruments=False)
    candidates = [_share_joints(name, model, given) for name, model in named.items()]
    sessions = _sessions(candidates, options)
    validated, faults, notes = list[ValidatedModel](), list[RecordingFaults](), list[str]()
    flags = [*joint_flags(candidates, same_joints(given)), *constant_flags(candidates)]
    for k, one in enumerate(candidates):
        if progress is not None:
            progress(f"validating {one.name}", k / len(candidates))
        session = sessions[one.model.robot.joints]
        faults.append(examine(one.model, session, NO_EXCITATION))
        model, lost = _validated(one, session)
        simulated, failures, remarks = _simulated(session, one, candidates, horizon) if rollout else (None, [], [])
        validated.append(_with(model, simulated))
        if lost:
            has = f"{one.name} predicts a torque of {shorten(lost)} that is not finite, so it has no rms"
            flags.append(f"{has}; correct the numbers of the model")
        flags += failures
        notes += [*one.notes, *session.notes, *faults[-1].notes, *remarks, *row_notes(model, lost)]
    band = sessions[candidates[0].model.robot.joints].task.band
    return Validation(
        models=tuple(validated),
        inputs=tuple(Input(r.path, r.sha256, "recording") for r in given),
        flags=(*fault_flags(list(named), faults), *flags),
        notes=tuple(dict.fromkeys(notes)),
        horizon=horizon if isinstance(horizon, str) else float(horizon),
        cutoff=band.cutoff,
        position_cutoff=band.position_cutoff,
        seed=options.seed,
    )


def _check(models: Mapping[str, Model], recordings: Sequence[Recording]) -> None:
    if not models:
        raise OptionError("no model was given; at least one is needed")
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    only_once(recordings)
    for recording in recordings:
        name, tau = recording.path or "the recording", recording.columns["tau"]
        if not any(tau):
            advice = "; closed loops from q_des_J: signid.validate_servos" if any(recording.columns["q_des"]) else ""
            raise RecordingError(
                f"{name} has no torque to validate a model on; give tau_J or current_J columns{advice}"
            )
        if unsigned := [joint for joint, known in zip(recording.joints, recording.signed, strict=True) if not known]:
            raise RecordingError(
                f"{name} has no sign of the torque of {shorten(unsigned)}, and validation does not recover signs; run "
                f"signid identify on it, and validate on the signed.csv that it writes"
            )


def _share_joints(name: str, model: Model, recordings: Sequence[Recording]) -> ModelCandidate:
    """Model and recordings of the joints that both have."""
    recorded = same_joints(recordings)
    shared = tuple(joint for joint in model.robot.joints if joint in recorded)
    if not shared:
        raise OptionError(
            f"{name} moves {shorten(model.robot.joints)}, the recordings {shorten(recorded)}; give a model and "
            f"recordings of the same joints"
        )
    given = tuple(r if r.joints == shared else _of_joints(r, shared) for r in recordings)
    restricted, notes = restrict_joints(model, given)
    return ModelCandidate(name, restricted, given, tuple(f"{name}: {note}" for note in notes))


def _of_joints(recording: Recording, joints: Sequence[str]) -> Recording:
    """Recording of some of its joints, in the given order."""
    kept = [recording.joints.index(joint) for joint in joints]
    columns = {key: c if key == "t" else tuple(c[k] for k in kept) for key, c in recording.columns.items() if c}
    return replace(
        recording,
        joints=tuple(joints),
        columns=columns,
        torque_per_unit=recording.torque_per_unit[kept],
        signed=recording.signed[kept],
        scaled=None if recording.scaled is None else recording.scaled[kept],
    )


def _sessions(candidates: Sequence[ModelCandidate], options: Options) -> dict[tuple[str, ...], Session]:
    """Recordings over the joints of each model; one band for all."""

    def made(options: Options) -> dict[tuple[str, ...], Session]:
        first = {one.model.robot.joints: one for one in reversed(candidates)}
        return {
            joints: prepare(one.model.robot, one.recordings, one.recordings, options) for joints, one in first.items()
        }

    sessions = made(options)
    if len(sessions) > 1 and options.cutoff is None:
        sessions = made(replace(options, cutoff=min(s.task.band.cutoff for s in sessions.values())))
    return sessions


def _check_horizon(horizon: float | str) -> None:
    if horizon != WHOLE and not (isinstance(horizon, float | int) and np.isfinite(horizon) and horizon > 0):
        raise OptionError(f"the horizon {horizon!r} is neither a time above 0 s nor {WHOLE!r}; give one, such as 0.5")


def _simulated(
    session: Session, one: ModelCandidate, candidates: Sequence[ModelCandidate], horizon: float | str
) -> tuple[RollOut | WholeRollOut | None, list[str], list[str]]:
    """Simulations, flags and notes; windows leave room for the laws of all models, so that all have the same."""
    laws = tuple(law for other in candidates for law in other.model.laws)
    try:
        if isinstance(horizon, str):
            from ..simulation.rollout.whole import roll_out_whole  # compiled code, needed only here

            run = roll_out_whole(one.model, one.recordings)
            return run, [], list(whole_notes(one.name, run))
        found = roll_out(one.model, session, (horizon,), beside=replace(one.model, laws=laws))
    except RecordingError as error:
        return None, [], [f"no roll-out was made: {error}"]
    except InputError as error:
        return None, [f"{one.name} cannot be simulated: {error}"], []
    return found, [], list(rollout_notes(one.name, found, horizon))


def _with(model: ValidatedModel, found: RollOut | WholeRollOut | None) -> ValidatedModel:
    return replace(model, rollout=found) if found is None or isinstance(found, RollOut) else replace(model, whole=found)


def _validated(one: ModelCandidate, session: Session) -> tuple[ValidatedModel, tuple[str, ...]]:
    """A model on all recordings, and the joints whose predicted torque is not finite: these have no residual.

    Rows are computed piece by piece: memory grows with their rate, twice the cut-off, not with the sampling rate. The
    choice of valid rows does not depend on the model.
    """
    model, band, found = one.model, session.task.band, []
    thin, finite = row_filter(session.task), np.ones(len(model.robot.joints), dtype=bool)
    with np.errstate(all="ignore"):
        for k, piece in enumerate(pieces(session.task, model, session.held_out)):
            residual, torque = filtered(piece, thin)
            finite &= np.isfinite(np.asarray(piece.motion.predicted)).all(axis=0)
            t = thin.at(piece.motion.t) - piece.origin
            found.append((np.full(len(t), piece.recording), np.full(len(t), k), t, torque, residual))
    if not found:
        raise RecordingError(
            f"every stretch of the recordings is shorter than the filter for {band.cutoff:.3g} Hz "
            f"({len(band.taps) / band.rate:.2g} s); record longer, or raise the cut-off"
        )
    recording, stretch, t, torque, residual = (np.concatenate(column) for column in zip(*found, strict=True))
    residual = np.where(finite, residual, np.nan)
    measured = np.any([[bool(column) for column in r.columns["tau"]] for r, _ in session.held_out], axis=0)
    lost = tuple(model.robot.joints[j] for j in np.flatnonzero(measured & ~finite))
    fit = fit_rows(model.robot, residual, torque, band.torque_floor)
    return ValidatedModel(one.name, model, fit, None, recording, stretch, t, torque, residual), lost
