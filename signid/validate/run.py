"""Models and recordings -> how well each model predicts them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ..diagnose.data.motions import pieces, row_filter
from ..diagnose.holdout import filtered
from ..effects import EFFECT_NAMES
from ..errors import InputError, OptionError, RecordingError, shorten
from ..estimation.fit_quality import MIN_R2, Fit, fit_rows
from ..faults import NO_EXCITATION, OF_A_FIT, RecordingFaults, examine
from ..model import Model, ModelSource, as_model
from ..recording import Recordings, as_recordings, same_joints
from ..regression.session import Options, Session, only_once, prepare
from ..signs.torque_constants import UnknownConstants, find_gains
from ..simulation.rollout import RollOut, restrict_joints, roll_out
from ..typed import typed
from ..types import Array, Indices, Input, Progress, Recording, Result

if TYPE_CHECKING:
    from ..simulation.whole_rollout import WholeRollOut

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

    >>> signid.validate("3r", "robots/3r/recording.parquet", rollout=False).models[0].fit.held_out_r2.shape
    (3,)

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
    if horizon != WHOLE and not (isinstance(horizon, float | int) and np.isfinite(horizon) and horizon > 0):
        raise OptionError(f"the horizon {horizon!r} is neither a time above 0 s nor {WHOLE!r}; give one, such as 0.5")
    named = named_models(models, "validate")
    given = as_recordings(recordings, next(iter(named.values())).robot, "validate") if named else []
    _check(named, given)
    options = replace(options or Options(), effects=(), instruments=False)
    unscaled, constants = tuple[str, ...](), tuple[str, ...]()
    if any(recording.scaled is not None for recording in given):
        given, unscaled, constants = _scaled(next(iter(named.values())), given, options)
    candidates = [_share_joints(name, model, given) for name, model in named.items()]
    sessions = _sessions(candidates, options)
    validated, faults, notes = list[ValidatedModel](), list[RecordingFaults](), [*constants]
    flags = [*unscaled, *joint_flags(candidates, same_joints(given)), *constant_flags(candidates)]
    for k, candidate in enumerate(candidates):
        if progress is not None:
            progress(f"validating {candidate.name}", k / len(candidates))
        session = sessions[candidate.model.robot.joints]
        faults.append(examine(candidate.model, session, NO_EXCITATION))
        model, lost = _validated(candidate, session)
        simulated, failures, remarks = (
            _simulated(session, candidate, candidates, horizon) if rollout else (None, [], [])
        )
        if simulated is None or isinstance(simulated, RollOut):
            validated.append(replace(model, rollout=simulated))
        else:
            validated.append(replace(model, whole=simulated))
        if lost:
            has = f"{candidate.name} predicts a torque of {shorten(lost)} that is not finite, so it has no rms"
            flags.append(f"{has}; correct the numbers of the model")
        flags += failures
        notes += [*candidate.notes, *session.notes, *faults[-1].notes, *remarks, *row_notes(model, lost)]
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


def _scaled(
    model: Model, recordings: list[Recording], options: Options
) -> tuple[list[Recording], tuple[str, ...], tuple[str, ...]]:
    """Recordings with currents as torques, flags and notes; constants that are not stated are estimated.

    Currents of joints whose constants cannot be estimated are left out.
    """
    session = prepare(model.robot, recordings, recordings, replace(options, effects=EFFECT_NAMES), scaled=False)
    try:
        gains = find_gains(session)
    except UnknownConstants as error:
        rest, flags, notes = _scaled(model, error.left_out(recordings), options)
        return rest, (error.flag, *flags), notes
    return (recordings, (), ()) if gains is None else ([*map(gains.scale, recordings)], gains.flags, gains.notes)


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
        first = {candidate.model.robot.joints: candidate for candidate in reversed(candidates)}
        return {
            joints: prepare(candidate.model.robot, candidate.recordings, candidate.recordings, options)
            for joints, candidate in first.items()
        }

    sessions = made(options)
    if len(sessions) > 1 and options.cutoff is None:
        sessions = made(replace(options, cutoff=min(s.task.band.cutoff for s in sessions.values())))
    return sessions


def _simulated(
    session: Session, candidate: ModelCandidate, candidates: Sequence[ModelCandidate], horizon: float | str
) -> tuple[RollOut | WholeRollOut | None, list[str], list[str]]:
    """Simulations, flags and notes; windows leave room for the laws of all models, so that all have the same."""
    laws = tuple(law for other in candidates for law in other.model.laws)
    try:
        if isinstance(horizon, str):
            from ..simulation.whole_rollout import roll_out_whole  # compiled code, needed only here

            run = roll_out_whole(candidate.model, candidate.recordings)
            return run, [], list(whole_notes(candidate.name, run))
        found = roll_out(candidate.model, session, (horizon,), beside=replace(candidate.model, laws=laws))
    except RecordingError as error:
        return None, [], [f"no roll-out was made: {error}"]
    except InputError as error:
        return None, [f"{candidate.name} cannot be simulated: {error}"], []
    return found, [], list(rollout_notes(candidate.name, found, horizon))


def _validated(candidate: ModelCandidate, session: Session) -> tuple[ValidatedModel, tuple[str, ...]]:
    """A model on all recordings, and the joints whose predicted torque is not finite: these have no residual.

    Rows are computed piece by piece: memory grows with their rate, twice the cut-off, not with the sampling rate. The
    choice of valid rows does not depend on the model.
    """
    model, band, found = candidate.model, session.task.band, []
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
    return ValidatedModel(candidate.name, model, fit, None, recording, stretch, t, torque, residual), lost


def named_models(
    models: ModelSource | Sequence[ModelSource] | Mapping[str, ModelSource], verb: str
) -> dict[str, Model]:
    """Models by the names that are given, else by those of their robots, numbered where they are equal.

    Raises:
        OptionError: something else than a model was given to the verb.
        RobotError: invalid file.
    """
    if isinstance(models, Mapping):
        return {name: as_model(model, verb) for name, model in models.items()}
    named: dict[str, Model] = {}
    for each in models if isinstance(models, list | tuple) else [models]:
        model = as_model(each, verb)
        same = sum(other.robot.name == model.robot.name for other in named.values())
        named[f"{model.robot.name} ({same + 1})" if same else model.robot.name] = model
    return named


def joint_flags(candidates: Sequence[ModelCandidate], recorded: Sequence[str]) -> Iterator[str]:
    """A sentence on each model that does not move all joints that the recordings move."""
    for candidate in candidates:
        if lacking := [joint for joint in recorded if joint not in candidate.model.robot.joints]:
            yield (
                f"{candidate.name} lacks or holds {shorten(lacking)}, which the recordings move: its results are those "
                f"of a robot at rest there; give a model of all recorded joints"
            )


def constant_flags(candidates: Sequence[ModelCandidate]) -> Iterator[str]:
    """A sentence on each model whose torque constants differ from those that converted the recorded currents."""
    for candidate in candidates:
        stated = np.abs(candidate.model.robot.actuators.torque_constant)
        for recording in candidate.recordings:
            used = recording.torque_per_unit
            other = (used != 1) & np.isfinite(stated) & ~np.isclose(stated, np.abs(used), rtol=1e-6)
            if other.any():
                names = [recording.joints[j] for j in np.flatnonzero(other)]
                yield (
                    f"{candidate.name} states another torque constant of {shorten(names)} than the one that converted "
                    f"the current in {recording.path or 'the recording'}: its residual contains the difference; state "
                    f"the same constants for all models"
                )
                break


def fault_flags(names: Sequence[str], faults: Sequence[RecordingFaults]) -> Iterator[str]:
    """The sentence of each recording fault, once; with the models that find it unless all do."""
    shown: dict[tuple[str, tuple[str, ...]], tuple[str, list[str]]] = {}
    for name, found in zip(names, faults, strict=True):
        for fault in found.severe:
            if fault.kind not in OF_A_FIT:
                shown.setdefault((fault.kind, fault.joints), (fault.sentence, []))[1].append(name)
    for sentence, by in shown.values():
        yield sentence if len(by) == len(names) else f"found with {shorten(by)}: {sentence}"


def row_notes(validated: ValidatedModel, lost: Sequence[str]) -> Iterator[str]:
    """A sentence on each joint whose torque is poorly predicted, or that has no rows for another reason than `lost`."""
    fit = validated.fit
    if poor := [f"{joint} (R2 {r2:.2f})" for joint, r2 in zip(fit.joints, fit.held_out_r2, strict=True) if r2 < MIN_R2]:
        yield f"{validated.name} predicts little of the torque of {shorten(poor)}"
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
