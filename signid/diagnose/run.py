"""Diagnose a simulation with recordings of the robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..deadline import OutOfTimeError, ends_in_time, seconds_left, steps_shown, time_is_up
from ..effects import EFFECT_NAMES, EFFECTS, LISTED_LAWS
from ..errors import InputError, OptionError, RecordingError
from ..faults import REFUSE, SAMPLE_KINDS, RecordingFault, RecordingFaults, examine, is_sole, naming_faults
from ..model import Model, ModelSource, as_model, stated_inertials, torque_model
from ..recording import Recordings, as_recordings
from ..regression.base_parameters import build_base
from ..regression.session import Options, Session, longest_piece, rearrange, recordings_used
from ..robot import Audit, audit, with_gravity
from ..robot.dynamics import own_body
from ..signs import Recovered, prepare_and_recover
from ..signs.torque_constants import UnknownConstants
from ..simulation.rollout import RollOut, restrict_joints, roll_out
from ..typed import typed
from ..types import Array, Law, Progress, Recording
from .data.dataset import Dataset, whitened
from .data.estimated_gains import with_estimated_gains
from .data.hypotheses import GRAVITY_EFFECT, VARIABLE_NAMES, is_transient, pooled, propose
from .data.locate import locate
from .data.motions import pieces, row_filter, subsample
from .data.noise import find_period, measure_noise, noise_of_misfit
from .data.rows import build_groups, build_table, dry_friction
from .detectable import detectable
from .evidence.bayes_factors import Evidence
from .evidence.prior import stated_prior
from .evidence.selection import Posterior, Selection, StatedBodies
from .findings.alternatives import limit_in_step, replace_weak
from .findings.findings import (
    Conclusions,
    add_empirical_torque,
    conclude,
    holdout_warnings,
    keep_given_if_worse,
    rollout_warnings,
)
from .findings.stated import MAX_LOG_ODDS, impossible, pinned, torque_share, with_ordinary, without
from .findings.verdict import decide_verdict
from .holdout import Comparison, Prediction, compare, predict
from .result import Diagnosis, Finding
from .search.iterate import SearchResult, select
from .search.shapes import CONTACT_EFFECT as CONTACT
from .search.stepwise import LAW_SEARCH, prune
from .thresholds import FIRST_LOG_ODDS

HORIZON = 0.5  # length of the roll-outs [s]
NOTHING_MISSING, UNDECIDED = "nothing_missing", "undecided"  # verdicts
MAX_CUTOFF = 8.0  # cut-off if encoder noise allows it [Hz]: laws differ most in fast torque; heuristic
MAX_CUTOFF_RATIO = 1.5  # largest cut-off over the one that the noisiest encoder allows [1]; heuristic
PREPARED_CUTOFF_RATIO = 0.95  # over the allowed one, below which recordings are prepared again [1]; heuristic
CLEAR_KINDS = ("torque sign", "torque order")  # recording faults that few rows show
CLEAR_FAULT_SHARE = 0.9  # share of the torque's sum of squares that such a fault explains, at least [1]; heuristic
SHORT_FAULT = "too little data"  # recording fault that priors compensate from MIN_JOINT_ROWS rows a joint on
MIN_JOINT_ROWS = 12  # rows of a joint, and of all joints held out; heuristic
LOG_ODDS_PER_NAT = 4.0  # of log unexplained shares [-]: half of the blocks, as if each were one independent row
WEIGHTLESS_REASON = (
    "the recorded torque carries no weight of the robot, so masses are not identifiable; log the whole torque, or "
    "state it with --gravity 0,0,0"
)


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

    >>> signid.diagnose("3r", "robots/3r/recording.parquet").verdict
    'named'

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
    model = torque_model(as_model(model, "diagnose"))
    recordings, held_out, reference = (
        as_recordings(given, model.robot, "diagnose") for given in (recordings, held_out, reference)
    )
    model, described = audited(model)
    _check(recordings, reference, skip)
    show, options = progress or _no_progress, replace(options or Options(), effects=())
    healthy = diagnose(model, reference, skip=skip, options=options, progress=progress) if reference else None
    given, notes = restrict_joints(model, [*recordings, *held_out])
    recovered, unscaled = _recover(given, recordings, held_out, options, show)
    model = restrict_joints(_lasting(healthy.model), [*recordings, *held_out])[0] if healthy else given
    mounting = mount(model, *prepare_session(model, recovered, options, show), skip)
    mounting = mounting._replace(given=given, constants=recovered.gains.covariance if recovered.gains else None)
    with_block, ordinary = with_ordinary(mounting.model, mounting.session, skip)
    with_block, gains = with_estimated_gains(with_block, mounting.constants)
    block = (*ordinary, *gains)
    dataset = build_in_time(with_block, mounting.session, skip, show, block)
    start = _Start(mounting.model, dataset, ordinary, block)
    answer = _answer(start, mounting, skip, healthy, options.seed, show)
    known, lacked = mounting.model.misfit is not None, False
    if known and answer.result.verdict in (NOTHING_MISSING, UNDECIDED) and not time_is_up(LAW_SEARCH, answer=False):
        itself = _answer(start.without_misfit(), mounting, skip, healthy, options.seed, show)
        lacked = any(finding.role == "cause" for finding in itself.result.findings)
        answer = itself if lacked else answer
    result, comparison, session, faults = answer.result, answer.comparison, mounting.session, mounting.faults
    answered = (_question_note(lacked, result.verdict),) if known else ()
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
            *unscaled,
            *dict.fromkeys(flag for recording in recovered.session.recordings for flag in recording.flags),
            *recovered.flags,
            *faults.flags,
            *answer.flags,
            *result.flags,
            *holdout_warnings(*comparison[:2]),
            *rollout_warnings(*rolled[:2]),
        ),
        notes=(*described.notes, *recovered.notes, *notes, *session.notes, *faults.notes, *answered, *rolled[2]),
        cutoff=session.task.band.cutoff,
        seed=options.seed,
        recordings=recovered.session.recordings,
        informed=answer.selection.evidence.informed,
        detectable=detectable(answer.selection, session.robot) if seconds_left() > 0 else (),
        question=("lacked" if lacked else "changed") if known else "",
    )


class _Answer(NamedTuple):
    """Conclusions of one search for laws."""

    result: Conclusions
    comparison: Comparison
    selection: Selection
    flags: tuple[str, ...]


class _Start(NamedTuple):
    """State from which the search for laws begins."""

    given: Model
    dataset: Dataset  # rows under white noise
    ordinary: tuple[Law, ...]  # laws that the description does not state
    block: tuple[Law, ...]  # these, and gains of estimated torque constants

    def without_misfit(self) -> _Start:
        """The same rows, for the question what an identified model lacks."""
        given, model = (replace(one, misfit=None) for one in (self.given, self.dataset.model))
        return self._replace(given=given, dataset=replace(self.dataset, model=model))


def _answer(
    start: _Start, mounting: Mounting, skip: Sequence[str], healthy: Diagnosis | None, seed: int, show: Progress
) -> _Answer:
    """Search for laws that a simulation lacks, and conclude."""
    session, gravity, (given, first, ordinary, block) = mounting.session, mounting.gravity, start
    model = first.model
    if model.misfit is not None:
        first = replace(first, noise=noise_of_misfit(first.noise, model.misfit, session.task.band))
    data = whitened(first.table, first.noise)
    posterior = _posterior(model, Evidence(data, stated_prior(model, data.groups), bool(ordinary)), skip)
    dataset, selection, disagreement = _search(first, posterior, skip, healthy, show)
    if negative := impossible(selection, ordinary):
        posterior = replace(posterior, evidence=without(posterior.evidence, negative))
        dataset, selection, disagreement = _search(first, posterior, skip, healthy, show)
    selection, contenders = replace_weak(dataset, prune(dataset, session, pinned(selection, ordinary)))
    contenders = limit_in_step(dataset, contenders)
    verdict = decide_verdict(dataset, selection, contenders)
    conclusions = conclude(dataset, session, selection, contenders, verdict, seed=seed, given=given, ordinary=block)
    before, floor = predict(session, mounting.given), session.task.band.torque_floor
    result = keep_given_if_worse(before, add_empirical_torque(session, conclusions), dataset.noise, floor)
    if gravity is not None:
        result = with_gravity_finding(result, gravity, mounting.given, before, dataset)
    comparison = compare(before, result.prediction, dataset.noise, floor)
    return _Answer(result, comparison, selection, disagreement)


def _question_note(lacked: bool, verdict: str) -> str:
    """Answer on an identified model: what has changed, or, where that is nothing, what it lacked before."""
    nothing = "nothing has changed since the model was identified"
    if lacked:
        return f"{nothing}; what is found it lacked from the start"
    beyond = "beyond what its laws left of the torque then"
    if verdict == UNDECIDED:
        return f"whether something has changed since the model was identified is open: something is left {beyond}"
    if verdict == NOTHING_MISSING:
        return f"{nothing}, {beyond}"
    return f"what is found has changed since the model was identified: it is {beyond}"


def _recover(
    model: Model, recordings: Sequence[Recording], held_out: Sequence[Recording], options: Options, show: Progress
) -> tuple[Recovered, tuple[str, ...]]:
    """Session with recovered signs, whose search needs friction, and flags on currents that are left out."""
    signs = replace(options, effects=EFFECT_NAMES)
    try:
        return (
            prepare_and_recover(model.robot, recordings, held_out, options=options, unsigned=signs, progress=show),
            (),
        )
    except UnknownConstants as error:
        rest, k = error.left_out([*recordings, *held_out]), len(recordings)
        found, flags = _recover(model, rest[:k], rest[k:], options, show)
        return found, (error.flag, *flags)


def _search(
    dataset: Dataset, posterior: Posterior, skip: Sequence[str], healthy: Diagnosis | None, progress: Progress
) -> SearchResult:
    """Search for laws and show the steps; an early stop leaves the best selection so far."""
    progress("searching", 0.4)
    time_is_up(LAW_SEARCH)  # a stop from here on has a result: the given simulation
    with steps_shown(progress, 0.4, 0.7):
        result = select(dataset, posterior, skip, healthy)
    progress("evaluating", 0.7)
    return result


def _check(recordings: Sequence[Recording], reference: Sequence[Recording], skip: Sequence[str]) -> None:
    if not recordings:
        raise OptionError("no recording was given; at least one is needed")
    if same := [r.path for r in recordings if r.path and any(r.sha256 == other.sha256 for other in reference)]:
        raise OptionError(f"{same[0]} is its own reference; give another recording, of the robot in a healthy state")
    for name in skip:
        EFFECTS[name]


def _no_progress(what: str, share: float) -> None:
    """Show nothing."""


def _lasting(model: Model) -> Model:
    """Model without events of its own recordings, such as a contact."""
    return replace(model, laws=tuple(law for law in model.laws if not is_transient(law)))


def _posterior(model: Model, evidence: Evidence, skip: Sequence[str]) -> Posterior:
    """Evidence with the priors of the library."""
    bodies = tuple(own_body(model.robot, j) for j in range(len(model.robot.joints)))
    own = StatedBodies(build_base(model.robot), model.whole_inertials())
    return Posterior(evidence, len({*LISTED_LAWS} - {*skip, GRAVITY_EFFECT}), bodies, own)


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


def audited(model: Model) -> tuple[Model, Audit]:
    """Simulation with the recognised units of its description corrected, and the audit.

    An identified model, whose bodies are not those of the description, is unchanged.
    """
    if not np.array_equal(model.inertials, stated_inertials(model.robot)):
        return model, Audit(model.robot)
    found = audit(model.robot)
    return replace(model, robot=found.robot, inertials=stated_inertials(found.robot)), found


def prepare_session(
    model: Model, given: Recovered, options: Options, show: Progress
) -> tuple[Session, RecordingFaults]:
    """Session and recording faults; raises if the faults rule out a diagnosis.

    The band is as wide as encoder noise allows, since laws differ most in fast torque; a given cut-off is kept.

    Raises:
        RecordingError: a recording fault rules out a diagnosis.
    """
    with naming_faults(given.session):
        session = rearrange(model.robot, given.session, options)
        band = session.task.band
        allowed = min(MAX_CUTOFF, float(np.median(band.per_joint)), MAX_CUTOFF_RATIO * float(np.min(band.per_joint)))
        if options.cutoff is None and band.filtered and band.cutoff < PREPARED_CUTOFF_RATIO * allowed:
            session = rearrange(model.robot, session, replace(options, cutoff=allowed))
    session = subsample(session)
    show("looking for recording faults", 0.1)
    faults = examine(model, session)
    if broken := [fault for fault in faults.findings if fault.kind in SAMPLE_KINDS and fault.severity == REFUSE]:
        raise RecordingError(broken[0].sentence)
    if any(x.kind == SHORT_FAULT and x.measures["rows"] >= MIN_JOINT_ROWS for x in faults.findings):
        signs = [f for f in faults.findings if f.kind in CLEAR_KINDS and f.measures["agreement"] == 1]
        clear = [f for f in signs if f.measures["explained_after"] > CLEAR_FAULT_SHARE]  # few rows suffice for these
        faults = replace(faults, findings=tuple(f for f in faults.findings if f in clear or f.kind == SHORT_FAULT))
    elif faults.refusal:
        raise RecordingError(faults.refusal)
    thin = row_filter(session.task)
    if sum(len(thin.at(p.motion.t)) for p in pieces(session.task, model, session.held_out)) < MIN_JOINT_ROWS:
        note = "too short to hold rows out: held-out figures are those of the training rows, so optimistic"
        session = replace(session, held_out=session.train, notes=(*session.notes, f"{note}; record for longer"))
    return session, faults


class Mounting(NamedTuple):
    """Simulation and session under one gravity, and the finding if it is not the simulation's own."""

    model: Model
    session: Session
    faults: RecordingFaults
    given: Model  # the simulation as it was given
    gravity: RecordingFault | None = None
    constants: Array | None = None  # (n, n) [1] covariance of the logarithms of estimated torque constants


def mount(model: Model, session: Session, faults: RecordingFaults, skip: Sequence[str]) -> Mounting:
    """Put simulation and session under the gravity that the recordings clearly show, else that of the simulation."""
    given, shown = model, next((fault for fault in faults.findings if fault.kind == GRAVITY_EFFECT), None)
    if shown is not None and (GRAVITY_EFFECT in skip or not is_sole(shown)):
        shown = None
    if shown is not None:
        faults = replace(faults, findings=tuple(fault for fault in faults.findings if fault is not shown))
        model = replace(model, robot=with_gravity(model.robot, [shown.measures[key] for key in "xyz"]))
    task = replace(session.task, robot=with_gravity(session.robot, model.robot.model.gravity.linear))
    return Mounting(model, replace(session, task=task), faults, given, shown)


def build_in_time(
    model: Model, session: Session, skip: Sequence[str], progress: Progress, free: Sequence[Law] = ()
) -> Dataset:
    """Build motions and rows of all hypotheses, or of none if time is up before."""
    try:
        with steps_shown(progress, 0.2, 0.4):
            return build(model, session, skip, progress, free)
    except OutOfTimeError:
        return build(model, session, None, progress, free)


def build(
    model: Model, session: Session, skip: Sequence[str] | None, show: Progress, free: Sequence[Law] = ()
) -> Dataset:
    """Build motions and rows; if `skip` is None, of the simulation's own numbers alone; laws `free` have flat priors.

    Raises:
        RecordingError: no stretch of the recordings is as long as the filter.
    """
    show("building hypotheses", 0.2)
    task, parts = session.task, session.train
    made = tuple(pieces(task, model, parts))
    if not made:
        raise RecordingError(
            f"no stretch of the recordings is as long as the filter for {task.band.cutoff:.3g} Hz; record for longer, "
            f"or raise the cut-off"
        )
    motion = pooled([p.motion for p in made])
    hypotheses = [] if skip is None else propose(model, motion, (*skip, CONTACT, GRAVITY_EFFECT))
    hypotheses = [hypothesis for hypothesis in hypotheses if hypothesis.stated not in free]
    dry = dry_friction(model, made)
    table = build_table(task, model, build_groups(model, made[0].motion, hypotheses, dry, free), made, dry)
    periods = tuple(find_period(longest_piece(part).q, 1 / part[1].period) for part in parts)
    noise = measure_noise(table, periods, task.band.rate / task.band.factor).white()
    return Dataset(task, model, made, periods, table, noise)


def with_gravity_finding(
    result: Conclusions, fault: RecordingFault, given: Model, before: Prediction, dataset: Dataset
) -> Conclusions:
    """Put gravity before the other findings.

    given: the simulation with its own gravity, and `before` its prediction; the dataset has the gravity that was found.
    """
    effect, joints = EFFECTS[GRAVITY_EFFECT], tuple(range(len(given.robot.joints)))
    value = {key: fault.measures[key] for key in "xyz"}
    stated = dict(zip("xyz", map(float, given.robot.model.gravity.linear), strict=True))
    torque = dataset.torque(Law(effect, joints, stated))  # what the simulation had instead
    scale = np.sqrt(np.nanmean(before.train.torque**2, axis=0))
    share = torque_share(torque, np.maximum(scale, 1e-300))
    joint = int(np.argmax(share))
    after = result.prediction.held_out.residual[:, joint]
    odds = min(LOG_ODDS_PER_NAT * fault.measures["gain"] - float(np.log(len(LISTED_LAWS))), MAX_LOG_ODDS)
    finding = Finding(
        law=Law(effect, joints, value),
        std={key: fault.measures[f"std_{key}"] for key in "xyz"},
        role="cause",
        probability=float(1 / (1 + np.exp(-odds))),
        torque_share=share,
        where=locate(dataset.table, joint, torque[joint], bool(given.robot.prismatic[joint]), VARIABLE_NAMES[:-1]),
        statistic=odds,
        threshold=FIRST_LOG_ODDS,
        held_out_gain=1 - float(np.nanmean(after**2) / np.nanmean(before.held_out.residual[:, joint] ** 2)),
        alternatives=(),
        stated=stated,
        in_model=bool(np.allclose(result.prediction.model.robot.model.gravity.linear, list(value.values()))),
    )
    verdict = "unknown" if result.verdict == "unknown" else "named"
    flags = (*result.flags, *(() if any(value.values()) else (WEIGHTLESS_REASON,)))
    return result._replace(verdict=verdict, findings=(finding, *result.findings), flags=flags)
