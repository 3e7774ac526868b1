"""Diagnose a simulation with recordings of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ..deadline import ends_in_time, seconds_left, steps_shown, time_is_up
from ..effects import EFFECT_NAMES, EFFECTS
from ..errors import InputError, OptionError
from ..faults import RecordingFaults
from ..model import Model, ModelSource, as_model, torque_model
from ..recording import Recordings, as_recordings
from ..regression.base_parameters import build_base
from ..regression.session import Options, Session, recordings_used
from ..robot.dynamics import own_body
from ..signs import Recovered, prepare_and_recover
from ..simulation.rollout import RollOut, roll_out
from ..simulation.rollout.run import restrict_joints
from ..typed import typed
from ..types import Progress, Recording
from .data.dataset import Dataset
from .data.hypotheses import GRAVITY, is_transient
from .detectable import detectable
from .evidence.bayes_factors import Evidence
from .evidence.prior import stated_prior
from .evidence.selection import Posterior, Selection, StatedBodies
from .extend.holdout import Comparison, compare, predict
from .findings.alternatives import limit_in_step, replace_weak
from .findings.findings import Conclusions, conclude
from .findings.gravity import with_gravity_finding
from .findings.held_out_prediction import add_empirical_torque, holdout_warnings, keep_given_if_worse, rollout_warnings
from .findings.ordinary import pinned, with_ordinary
from .findings.verdict import decide_verdict
from .preparation import Mounting, audited, build_in_time, mount, prepare_session
from .result import Diagnosis
from .search.iterate import SearchResult, select
from .search.stepwise import SEARCH, prune

HORIZON = 0.5  # length of the roll-outs [s]
NOTHING_MISSING = "nothing_missing"  # verdict


@typed
@ends_in_time
def diagnose(
    model: ModelSource,
    recordings: Recordings,
    *,
    held_out: Recordings = (),
    reference: Recordings = (),
    skip: Sequence[str] = (),
    options: Options | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Locate, name and model the differences between a simulation and recordings; evaluate on held-out recordings.

    Args:
        model: simulation, from `load_model`, or what it reads.
        recordings: one recording or several of the robot, from `read_recording`, or what it reads.
        held_out: held-out recordings; default: the last of several recordings, or the last 30 % of a single one.
        reference: recordings of the same robot in a healthy state; differences that are present there are no findings.
        skip: effects to exclude from the search.
        options: preparation options such as the cut-off; its effects are ignored.
        progress: called with the current step and the share that is done.

    Raises:
        OptionError: an excluded effect does not exist, or an option is unknown.
        RecordingError: a recording cannot be used; the message says which and why.
    """
    model, recordings, held_out, reference = _given(model, recordings, held_out, reference)
    model, described = audited(model)
    _check(recordings, reference, skip)
    show, options = progress or _no_progress, replace(options or Options(), effects=())
    healthy = diagnose(model, reference, skip=skip, options=options, progress=progress) if reference else None
    given, notes = restrict_joints(model, [*recordings, *held_out])
    recovered = _recover(given, recordings, held_out, options, show)
    model = restrict_joints(_lasting(healthy.model), [*recordings, *held_out])[0] if healthy else given
    mounting = mount(model, *prepare_session(model, recovered, options, show), skip)._replace(given=given)
    answer = _answer(mounting.model, mounting, skip, healthy, options.seed, show)
    known, lacked = mounting.model.misfit is not None, False
    if known and answer.result.verdict == NOTHING_MISSING and not time_is_up(SEARCH, answer=False):
        itself = _answer(replace(mounting.model, misfit=None), mounting, skip, healthy, options.seed, show)
        lacked = any(finding.role == "cause" for finding in itself.result.findings)
        answer = itself if lacked else answer
    result, comparison, session, faults = answer.result, answer.comparison, mounting.session, mounting.faults
    question = _question(lacked, result.verdict) if known else _Question()
    rolled = _roll_out(session, given, result.prediction.model, show)
    return Diagnosis(
        robot=session.robot,
        verdict=result.verdict,
        findings=result.findings,
        unexplained=result.unexplained,
        located=result.located,
        tolerance=result.tolerance,
        **comparison._asdict(),
        rollout_before=rolled[0],
        rollout_after=rolled[1],
        model=result.prediction.model,
        prior_scale=answer.selection.prior_scale,
        signs=recovered.signs,
        inputs=recordings_used(recordings, held_out, reference),
        flags=(
            *described.before(),
            *_flags(recovered, faults),
            *answer.flags,
            *result.flags,
            *holdout_warnings(*comparison[:2]),
            *rollout_warnings(*rolled[:2]),
        ),
        notes=(*described.notes, *recovered.notes, *notes, *session.notes, *faults.notes, *question.notes, *rolled[2]),
        cutoff=session.task.band.cutoff,
        seed=options.seed,
        recordings=recovered.session.recordings,
        informed=answer.selection.evidence.informed,
        detectable=detectable(answer.selection, session.robot) if seconds_left() > 0 else (),
        question=question.name,
    )


class _Answer(NamedTuple):
    """Conclusions of one search for laws."""

    result: Conclusions
    comparison: Comparison
    selection: Selection
    flags: tuple[str, ...]


def _answer(
    model: Model, mounting: Mounting, skip: Sequence[str], healthy: Diagnosis | None, seed: int, show: Progress
) -> _Answer:
    """Search for laws that a simulation lacks, and conclude."""
    session, gravity = mounting.session, mounting.gravity
    given, (model, ordinary) = model, with_ordinary(model, session, skip)
    dataset, data = build_in_time(model, session, skip, show, ordinary)
    evidence = Evidence(data, stated_prior(model, data.groups), bool(ordinary))
    dataset, selection, disagreement = _search(dataset, _posterior(model, evidence, skip), skip, healthy, show)
    selection, contenders = replace_weak(dataset, prune(dataset, session, pinned(selection, ordinary)))
    contenders = limit_in_step(dataset, contenders)
    verdict = decide_verdict(dataset, selection, contenders)
    conclusions = conclude(dataset, session, selection, contenders, verdict, seed, given, ordinary)
    before, floor = predict(session, mounting.given), session.task.band.torque_floor
    result = keep_given_if_worse(before, add_empirical_torque(session, conclusions), dataset.noise, floor)
    if gravity is not None:
        result = with_gravity_finding(result, gravity, mounting.given, before, dataset)
    comparison = compare(before, result.prediction, dataset.noise, floor)
    return _Answer(result, comparison, selection, disagreement)


class _Question(NamedTuple):
    """Question that the diagnosis of an identified model answers; empty for a description."""

    name: str = ""  # "changed" or "lacked"
    notes: tuple[str, ...] = ()


def _question(lacked: bool, verdict: str) -> _Question:
    """Question that was answered at last: what has changed, or, where that is nothing, what the model lacked before."""
    nothing = "nothing has changed since the model was identified"
    if lacked:
        return _Question("lacked", (f"{nothing}; what is found it lacked from the start",))
    left = "what its laws left of the torque then"
    if verdict == NOTHING_MISSING:
        return _Question("changed", (f"{nothing}, beyond {left}",))
    return _Question("changed", (f"what is found has changed since the model was identified: it is beyond {left}",))


def _given(model: ModelSource, *some: Recordings) -> tuple[Model, list[Recording], list[Recording], list[Recording]]:
    """Model and recordings as they are given to the verb, read where they are paths."""
    loaded = torque_model(as_model(model, "diagnose"))
    recordings, held_out, reference = (as_recordings(each, loaded.robot, "diagnose") for each in some)
    return loaded, recordings, held_out, reference


def _recover(
    model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording], options: Options, show: Progress
) -> Recovered:
    """Session with recovered signs; their search needs friction."""
    signs = replace(options, effects=EFFECT_NAMES)
    return prepare_and_recover(model.robot, recordings, held_out, options=options, unsigned=signs, progress=show)


def _check(recordings: Sequence[Recording], reference: Sequence[Recording], skip: Sequence[str]) -> None:
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    if same := [r.path for r in recordings if r.path and any(r.sha256 == other.sha256 for other in reference)]:
        raise OptionError(f"{same[0]} is its own reference; give another recording, of the robot in a healthy state")
    for name in skip:
        EFFECTS[name]


def _search(
    dataset: Dataset, posterior: Posterior, skip: Sequence[str], healthy: Diagnosis | None, progress: Progress
) -> SearchResult:
    """Search for laws and show the steps; an early stop leaves the best selection so far."""
    progress("searching", 0.4)
    time_is_up(SEARCH)  # a stop from here on has a result: the given simulation
    with steps_shown(progress, 0.4, 0.7):
        result = select(dataset, posterior, skip, healthy)
    progress("evaluating", 0.7)
    return result


def _flags(given: Recovered, faults: RecordingFaults) -> tuple[str, ...]:
    """Warnings on the recordings: uncertain columns, uncertain signs, recording faults."""
    columns = dict.fromkeys(flag for one in given.session.recordings for flag in one.flags)
    return (*columns, *given.flags, *faults.flags)


def _no_progress(what: str, share: float) -> None:
    """Show nothing."""


def _lasting(model: Model) -> Model:
    """Model without events of its own recordings, such as a contact."""
    return replace(model, laws=tuple(law for law in model.laws if not is_transient(law)))


def _posterior(model: Model, evidence: Evidence, skip: Sequence[str]) -> Posterior:
    """Evidence with the priors of the library."""
    bodies = tuple(own_body(model.robot, j) for j in range(len(model.robot.joints)))
    own = StatedBodies(build_base(model.robot), model.whole_inertials())
    return Posterior(evidence, len(list(EFFECTS)) - len({*skip, GRAVITY}), bodies, own)


def _roll_out(
    session: Session, before: Model, after: Model, show: Progress
) -> tuple[RollOut | None, RollOut | None, tuple[str, ...]]:
    """Roll out both simulations; without a roll-out, as after the time limit, a note says why."""
    if seconds_left() <= 0:
        return None, None, ("no roll-out was made: the time limit had passed, or the search was stopped",)
    show("rolling out", 0.9)
    pairs = (before, after), (after, before)
    try:
        first, last = (roll_out(model, session, (HORIZON,), beside=other) for model, other in pairs)
    except InputError as error:
        return None, None, (f"no roll-out was made: {error}",)
    return first, last, ()
