"""A simulation and recordings -> what the simulation lacks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..deadline import OutOfTimeError, ends_in_time, steps_shown, time_is_up
from ..effects import EFFECT_NAMES, EFFECTS
from ..errors import InputError, OptionError, RecordingError
from ..model import Model
from ..recording_faults import Finding, RecordingFaults, examine
from ..regression.base_parameters import build_base
from ..regression.prepare import prepare, rearrange
from ..regression.session import Options, Part, Session, longest_piece, recordings_used
from ..robot.dynamics import own_body
from ..signs import Recovered, recover
from ..simulation.rollout import RollOut, roll_out
from ..simulation.rollout.joints import restrict_joints
from ..types import Progress, Recording
from .data.column_groups import build_groups, dry_friction
from .data.dataset import Dataset
from .data.hypotheses import is_transient, pooled, propose
from .data.motions import pieces, row_filter, subsample
from .data.noise import measure_noise
from .data.periodicity import find_period
from .data.rows import build_table
from .data.whitened_rows import Whitened, whitened
from .evidence.bayes_factors import Evidence
from .evidence.knowledge import stated_prior
from .evidence.posterior_odds import Posterior, StatedBodies
from .extend.holdout import prove, show
from .findings.alternatives import limit_in_step, replace_weak
from .findings.empirical import model_rest
from .findings.findings import find
from .findings.holdout_warnings import holdout_warnings
from .findings.never_worse import never_worse
from .findings.verdict import decide
from .result import Diagnosis
from .search.contact_window import NAME as CONTACT
from .search.iterate import Selected, select
from .search.prune import prune
from .search.stepwise import SEARCH

WIDE = 8.0  # [Hz] to which the band goes if encoder noise allows it
SPARE = 1.5  # times the cut-off that the noisiest encoder allows, if most others allow it
HORIZON = 0.5  # [s] of roll-outs
CLEAR_KINDS, CLEARLY = ("torque sign", "torque order"), 0.9  # faults that few rows tell; share of torque explained
SHORT, FEW_ROWS = "too little data", 12  # a gross fault that priors mend, from so many rows a joint on


@ends_in_time
def diagnose(
    model: Model,
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[Recording] = (),
    reference: Sequence[Recording] = (),
    skip: Sequence[str] = (),
    options: Options | None = None,
    progress: Progress | None = None,
) -> Diagnosis:
    """Where a simulation and recordings differ: located, named, modelled, and judged on held-out recordings.

    Args:
        model: the simulation, as `load_model` gives it.
        recordings: of the robot.
        held_out: to judge by; without any, the last of several recordings or the last 30 % of the only one.
        reference: recordings of the same robot without the mismatch: what the simulation lacks there is no finding.
        skip: effects that are left out of the library.
        options: cut-off and the like; its effects do not count.
        progress: told what is being done and how far it is.

    Raises:
        OptionError: an effect that is left out does not exist, or an option is unknown.
        RecordingError: a recording cannot be used; the sentence says which and why.
    """
    _check(recordings, reference, skip)
    told, options = progress or _silent, replace(options or Options(), effects=())
    known = diagnose(model, reference, skip=skip, options=options, progress=progress) if reference else None
    given, notes = restrict_joints(model, [*recordings, *held_out])
    recovered = _recovered(given, recordings, held_out, options, progress)
    model = restrict_joints(_lasting(known.model), [*recordings, *held_out])[0] if known else given
    session, gross = _prepare(model, recovered, options, told)
    session = _judged_by_itself(model, session)
    dataset, data = _build_in_time(model, session, skip, told)
    evidence = Evidence(data, stated_prior(model, data.groups))
    dataset, found, tangled = _search(dataset, _posterior(model, evidence, skip), skip, known, told)
    found, contenders = replace_weak(dataset, prune(dataset, session, found))
    contenders = limit_in_step(dataset, contenders)
    verdict = decide(dataset, found, contenders)
    result = model_rest(session, find(dataset, session, found, contenders, verdict, options.seed))
    first, floor = show(session, given), session.task.band.torque_floor
    result = never_worse(first, result, dataset.noise, floor)
    proof = prove(first, result.shown, dataset.noise, floor)
    rolled = _roll_out(session, given, result.shown.model, told)
    return Diagnosis(
        robot=session.robot,
        verdict=result.verdict,
        findings=result.findings,
        unexplained=result.unexplained,
        located=result.located,
        tolerance=result.tolerance,
        **proof._asdict(),
        rollout_before=rolled[0],
        rollout_after=rolled[1],
        model=result.shown.model,
        prior_scale=found.prior_scale,
        signs=recovered.signs,
        inputs=recordings_used(recordings, held_out, reference),
        flags=(*_flags(recovered, gross), *tangled, *result.flags, *holdout_warnings(proof.before, proof.after)),
        notes=(*recovered.notes, *notes, *session.notes, *gross.notes, *rolled[2]),
        cutoff=session.task.band.cutoff,
        seed=options.seed,
        recordings=recovered.session.recordings,
        informed=found.evidence.informed,
    )


def _check(recordings: Sequence[Recording], reference: Sequence[Recording], skip: Sequence[str]) -> None:
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    if same := [r.path for r in recordings if r.path and any(r.sha256 == other.sha256 for other in reference)]:
        raise OptionError(f"{same[0]} is its own reference; give a recording of the robot when all was well")
    for name in skip:
        EFFECTS[name]


def _search(
    dataset: Dataset, posterior: Posterior, skip: Sequence[str], known: Diagnosis | None, progress: Progress
) -> Selected:
    """Everything from the first search on, with its steps shown; a stop leaves the best found until then."""
    progress("searching", 0.4)
    time_is_up(SEARCH)  # from here on there is an answer: the simulation as it was given
    with steps_shown(progress, 0.4, 0.7):
        found = select(dataset, posterior, skip, known)
    progress("judging", 0.7)
    return found


def _recovered(
    model: Model,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording],
    options: Options,
    told: Progress | None,
) -> Recovered:
    """The recordings, prepared once, with the signs of all torques."""
    signed = all(recording.signed.all() for recording in (*recordings, *held_out))
    own = options if signed else replace(options, effects=EFFECT_NAMES)
    return recover(prepare(model.robot, recordings, held_out, own, scaled=signed), progress=told)


def _flags(given: Recovered, gross: RecordingFaults) -> tuple[str, ...]:
    """Sentences on the recordings: doubtful columns, doubtful signs, gross faults."""
    columns = dict.fromkeys(flag for one in given.session.recordings for flag in one.flags)
    return (*columns, *given.flags, *gross.flags)


def _silent(what: str, share: float) -> None:
    """Nobody is told."""


def _prepare(model: Model, given: Recovered, options: Options, told: Progress) -> tuple[Session, RecordingFaults]:
    """A session, and gross faults of its recordings if they can be diagnosed all the same.

    Its band is wide where encoder noise allows it: laws differ most where torque is fast.
    """
    session = rearrange(model.robot, given.session, options)
    band = session.task.band
    allowed = min(WIDE, float(np.median(band.per_joint)), SPARE * float(np.min(band.per_joint)))
    if options.cutoff is None and band.filtered and band.cutoff < 0.95 * allowed:
        session = rearrange(model.robot, session, replace(options, cutoff=allowed))
    session = subsample(session)
    told("looking for gross faults", 0.1)
    gross = examine(model, session)
    if any(one.kind == SHORT and one.measures["rows"] >= FEW_ROWS for one in gross.findings):  # priors mend the rest
        gross = replace(gross, findings=tuple(one for one in gross.findings if one.kind == SHORT or _is_clear(one)))
    elif gross.refusal:
        raise RecordingError(gross.refusal)
    return session, gross


def _is_clear(fault: Finding) -> bool:
    """Whether a few rows tell a gross fault of the torques: a sign or an order that all parts agree on."""
    measured = fault.measures
    return fault.kind in CLEAR_KINDS and measured["agreement"] == 1 and measured["explained_after"] > CLEARLY


def _judged_by_itself(model: Model, session: Session) -> Session:
    """The session; what is too short to hold enough out is judged by itself, and a note says so."""
    thin = row_filter(session.task)
    if sum(len(thin.at(p.motion.t)) for p in pieces(session.task, model, session.held_out)) >= FEW_ROWS:
        return session
    note = "too short to hold anything out: the extended simulation is judged by the rows that it was learned from"
    return replace(session, held_out=session.train, notes=(*session.notes, note))


def _build_in_time(model: Model, session: Session, skip: Sequence[str], progress: Progress) -> tuple[Dataset, Whitened]:
    """Motions and rows of all hypotheses, or of none where time is up before they are made."""
    try:
        with steps_shown(progress, 0.2, 0.4):
            return _build(model, session, skip, progress)
    except OutOfTimeError:
        return _build(model, session, None, progress)


def _build(model: Model, session: Session, skip: Sequence[str] | None, told: Progress) -> tuple[Dataset, Whitened]:
    """Motions and rows; without `skip` those of the simulation's own numbers alone, where time is up."""
    told("building hypotheses", 0.2)
    task, parts = session.task, session.train
    made = tuple(pieces(task, model, parts))
    if not made:
        raise RecordingError(
            f"no stretch of the recordings is as long as the filter for {task.band.cutoff:.3g} Hz; record for longer, "
            f"or raise the cut-off"
        )
    motion = pooled([p.motion for p in made])
    hypotheses = [] if skip is None else propose(model, motion, (*skip, CONTACT))
    dry = dry_friction(model, made)
    table = build_table(task, model, build_groups(model, made[0].motion, hypotheses, dry), made, dry)
    periods = tuple(_period(part) for part in parts)
    noise = measure_noise(table, periods, task.band.rate / task.band.factor).white()
    return Dataset(task, model, made, periods, table, noise), whitened(table, noise)


def _lasting(model: Model) -> Model:
    """Without what happened once, in the recordings that it was learned from."""
    return replace(model, laws=tuple(law for law in model.laws if not is_transient(law)))


def _posterior(model: Model, evidence: Evidence, skip: Sequence[str]) -> Posterior:
    bodies = tuple(own_body(model.robot, j) for j in range(len(model.robot.joints)))
    own = StatedBodies(build_base(model.robot), model.whole_inertials())
    return Posterior(evidence, len(list(EFFECTS)), len(skip), bodies, own)


def _period(part: Part) -> float | None:
    return find_period(longest_piece(part).q, 1 / part[1].period)


def _roll_out(
    session: Session, before: Model, after: Model, told: Progress
) -> tuple[RollOut | None, RollOut | None, tuple[str, ...]]:
    told("rolling out", 0.9)
    try:
        first, last = (
            roll_out(m, session, (HORIZON,), beside=other) for m, other in ((before, after), (after, before))
        )
    except InputError as error:
        return None, None, (f"no roll-out was made: {error}",)
    return first, last, ()
