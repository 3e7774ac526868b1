"""Given models and recordings -> how well each model predicts them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..errors import InputError, OptionError, RecordingError, shorten
from ..estimation.excitation import ExcitationVerdict
from ..estimation.fit_quality import fit_rows
from ..model import Model
from ..recording import same_joints
from ..recording_faults import RecordingFaults, examine
from ..regression.prepare import prepare
from ..regression.session import Options, Session, only_once
from ..simulation.rollout import RollOut, roll_out
from ..types import Input, Progress, Recording
from .flags import constant_flags, fault_flags, joint_flags, rollout_notes, row_flags, row_notes
from .joints import ModelCandidate, share_joints
from .result import ValidatedModel, Validation
from .rows import model_rows

HORIZON = 0.5  # [s] of roll-outs, as in a diagnosis
NO_EXCITATION = ExcitationVerdict(np.ones(1), np.ones(1), (), (), (), (), ())  # not judged: nothing is fitted


class _Rolled(NamedTuple):
    """The roll-out of a model, and what is to be said of it."""

    result: RollOut | None = None
    flags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()


def validate(
    models: Model | Sequence[Model] | Mapping[str, Model],
    recordings: Recording | Sequence[Recording],
    *,
    options: Options | None = None,
    rollout: bool = True,
    progress: Progress | None = None,
) -> Validation:
    """How well given models predict recordings; nothing is fitted.

    Per joint: rms of measured - predicted torque, noise floor, R2, and the error of roll-outs. All models are judged
    on the same rows: same band, same filter, and without the rows where a joint stands still.

    Args:
        models: one or several, as `load_model` gives them; a mapping names them, else they have the robot's name.
        recordings: with signed torque, one or several, all of the same joints.
        options: cut-off and the like; its effects do not count.
        rollout: whether to simulate short horizons from measured states, too.
        progress: called with what is being done and the share of it that is done.

    Raises:
        OptionError: a model or a recording is missing or was given twice, or they have no joint in common.
        RecordingError: a recording cannot be used; the sentence says which and why.
    """
    named, given = _named(models), [recordings] if isinstance(recordings, Recording) else list(recordings)
    _check(named, given)
    options = replace(options or Options(), effects=(), instruments=False)
    candidates = [share_joints(name, model, given) for name, model in named.items()]
    sessions = _sessions(candidates, options)
    validated, faults, notes = list[ValidatedModel](), list[RecordingFaults](), list[str]()
    flags = [*joint_flags(candidates, same_joints(given)), *constant_flags(candidates)]
    for k, one in enumerate(candidates):
        if progress is not None:
            progress(f"validating {one.name}", k / len(candidates))
        session = sessions[one.model.robot.joints]
        faults.append(examine(one.model, session, NO_EXCITATION))
        rolled = _roll_out(session, one, candidates) if rollout else _Rolled()
        rows, lost = model_rows(one.model, session)
        fit = fit_rows(one.model.robot, rows.residual, rows.torque, session.task.band.torque_floor)
        validated.append(ValidatedModel(one.name, one.model, fit, rolled.result, *rows))
        flags += [*row_flags(validated[-1], lost), *rolled.flags]
        notes += [*one.notes, *session.notes, *faults[-1].notes, *rolled.notes, *row_notes(validated[-1], lost)]
    band = sessions[candidates[0].model.robot.joints].task.band
    return Validation(
        models=tuple(validated),
        inputs=tuple(Input(r.path, r.sha256, "recording") for r in given),
        flags=(*fault_flags(list(named), faults), *flags),
        notes=tuple(dict.fromkeys(notes)),
        horizon=HORIZON,
        cutoff=band.cutoff,
        position_cutoff=band.position_cutoff,
        seed=options.seed,
    )


def _named(models: Model | Sequence[Model] | Mapping[str, Model]) -> dict[str, Model]:
    if isinstance(models, Mapping):
        return dict(models)
    named: dict[str, Model] = {}
    for model in [models] if isinstance(models, Model) else models:
        same = sum(other.robot.name == model.robot.name for other in named.values())
        named[f"{model.robot.name} ({same + 1})" if same else model.robot.name] = model
    return named


def _check(models: Mapping[str, Model], recordings: Sequence[Recording]) -> None:
    if not models:
        raise OptionError("no model was given; at least one is needed")
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    only_once(recordings)
    for recording in recordings:
        name, tau = recording.path or "the recording", recording.columns["tau"]
        if not any(tau):
            raise RecordingError(f"{name} has no torque to validate a model on; give tau_J or current_J columns")
        if unsigned := [joint for joint, known in zip(recording.joints, recording.signed, strict=True) if not known]:
            raise RecordingError(
                f"{name} has no sign of the torque of {shorten(unsigned)}, and validation does not recover signs; run "
                f"signid identify on it, and validate on the signed.csv that it writes"
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


def _roll_out(session: Session, one: ModelCandidate, candidates: Sequence[ModelCandidate]) -> _Rolled:
    """Short simulations in windows that leave room for the laws of all models, so that all have the same windows."""
    laws = tuple(law for other in candidates for law in other.model.laws)
    try:
        found = roll_out(one.model, session, (HORIZON,), beside=replace(one.model, laws=laws))
    except RecordingError as error:
        return _Rolled(notes=(f"no roll-out was made: {error}",))
    except InputError as error:
        return _Rolled(flags=(f"{one.name} cannot be simulated: {error}",))
    return _Rolled(found, notes=tuple(rollout_notes(one.name, found, HORIZON)))
