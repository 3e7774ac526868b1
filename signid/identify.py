"""Recordings -> identification: base parameters, physically consistent standard parameters, held-out fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TYPE_CHECKING

import numpy as np

from .deadline import ends_in_time, seconds_left, steps_shown
from .errors import OptionError, RecordingError, shorten
from .estimation.estimators import ESTIMATORS, Estimator, Given
from .estimation.excitation import ExcitationVerdict, judge_excitation
from .estimation.fit_quality import Fit, factor_rms, friction_at_rest, judge_fit
from .estimation.least_squares import estimate, with_spread
from .estimation.standard import STANDARD_METHODS, Search, choose_in_time
from .faults import IdentifiedData, described_evidence, identification_flags, naming_faults, under_found_gravity
from .model import Model, ModelSource, fitted_model, stated_parameters
from .recording import Recordings, as_recordings
from .regression.base_parameters import base_covariance
from .regression.factors import LAGS, Factors, Lack, Weigh, measure_misfit
from .regression.rows import Rows
from .regression.session import SELF_EVALUATION_NOTE, Options, Session, only_once, prepare, recordings_used
from .robot import as_robot, audit, described_gravity
from .robot.dynamics import shows_gravity
from .robot.joints import is_weightless
from .signs import Recovered, Signs, prepare_and_recover
from .signs.torque_constants import UnknownConstants
from .typed import typed
from .types import Array, BaseMap, Estimate, Input, Law, Parameters, Progress, Recording, Result, Robot

if TYPE_CHECKING:
    from .estimation.repeats import VaryingNumber
    from .simulation.refine import Refinement

HUBER_DEVIATIONS = 1.345  # residual, in standard deviations, beyond which a row counts less
ROBUST_ROUNDS = 3
# [1] held-out rms over training rms from which on the held-out rows are not learned from: another load or regime.
# Measured, split of one recording or whole recordings apart: see tests/test_identify.py
MAX_REFIT_RMS_RATIO = 2.0


@dataclass(frozen=True, eq=False)
class Identification(Result):
    """A robot's dynamics, identified from recordings. `flags` say what not to rely on; empty if nothing is suspect."""

    robot: Robot
    base: BaseMap
    estimate: Estimate  # by least squares, before any physical constraint
    base_value: Array  # (b,) [units of base] of the standard parameters below
    parameters: Parameters
    model: Model
    fit: Fit
    excitation: ExcitationVerdict
    method: str
    moved: float  # standard deviations by which physical consistency moved the estimate at most
    inputs: tuple[Input, ...]  # the recordings
    signs: Signs | None  # where torque was recorded without them
    recordings: tuple[Recording, ...]  # all, with the signs found
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    cutoff: float  # [Hz]
    position_cutoff: float  # [Hz]
    seed: int
    session: Session  # its recordings, ready to be reduced
    judged: Model  # fitted to the training rows alone, the model that `fit` is about; `model` if `fit.refit` is false
    refinement: Refinement | None = None  # by roll-outs, if asked for; its windows are held out as those of `fit`
    lacks: tuple[Lack, ...] = ()  # laws that explain most of what the fit leaves of a joint on held-out rows; flagged
    currents: tuple[tuple[Law, Array], ...] = ()  # without a torque constant: law, std (k,) [A, A.s/rad] of its numbers
    refined: Model | None = None  # the model with refined numbers, fitted to all windows; None if it is not better

    @property
    def best(self) -> Model:
        """The model to write and simulate: refined by roll-outs where these predict better, else `model`."""
        return self.refined or self.model

    @cached_property
    def varies(self) -> tuple[VaryingNumber, ...]:
        """Numbers that differ between recordings by more than their intervals, which contain this spread."""
        if self.estimate.spread is None:
            return ()
        from .estimation.repeats import varying_numbers  # imported here, because most fits are of one recording

        return varying_numbers(self.robot, self.base, self.session.task.laws, self.estimate.spread)

    @property
    def physically_consistent(self) -> bool:
        """Whether a real robot could have the standard parameters; proved, not assumed."""
        return self.parameters.is_feasible()


@typed
@ends_in_time
def identify(
    robot: ModelSource,
    recordings: Recordings,
    *,
    held_out: Recordings = (),
    method: str | None = None,
    signs: str = "exact",
    estimator: str | Estimator | None = None,
    search: Search | None = None,
    options: Options | None = None,
    refit: bool | None = None,
    refine: Sequence[str] | None = None,
    progress: Progress | None = None,
) -> Identification:
    """Identify a dynamics model from a description and recordings.

    >>> signid.identify("3r", "robots/3r/recording.parquet").model.gravity([0, 0, 0]).shape
    (3,)

    Where torque was recorded without its sign, the signs are recovered first and then count as measured. Where the
    recordings clearly show another gravity than the stated one, the model is identified with it, and a flag says so.
    Once its errors on held-out rows are known, the model is fitted again to all rows, except those of `held_out`.

    Args:
        robot: as `load_robot` gives it, or what it reads; a model counts as its robot.
        recordings: one recording or several to learn from, as `read_recording` gives them, or what it reads.
        held_out: held-out recordings; without any, the last of several recordings or the last 30 % of the only one.
        method: `convex`: physically consistent fit; `wls`: least-squares base parameters unchanged, with the nearest
            standard parameters; `pbrp`: penalty-based parameter retrieval. None: convex, or pbrp after `signs="tree"`.
        signs: how lost signs are recovered: `exact`, or `tree`, the classical tree of sign choices.
        estimator: `wls`, `iv`, `tls`, `oe` or one of another package. None: weighted least squares, with desired
            positions as instruments where they are recorded.
        search: options of penalty-based parameter retrieval.
        options: effects, cut-off and the like.
        refit: whether the model is fitted again to all rows after its held-out errors are known; None: unless
            held-out recordings are given. It is not if these errors are far above the training errors, since the
            held-out rows may show another load.
        refine: names of laws to choose from by roll-outs, which may be none; their numbers are then refined so that
            simulations under recorded torque follow the positions (`best`), if held-out windows agree. None: not.
        progress: called with the current step and the share that is done.

    Raises:
        OptionError: a method or an estimator is unknown, or the recordings lack what it needs.
        RecordingError: a recording cannot be used, or its signs cannot be found; the sentence says which and why.
    """
    robot = (described := audit(as_robot(robot, "identify"))).robot
    held_out = as_recordings(held_out, robot, "identify")
    way = ESTIMATORS[estimator or "wls"] if isinstance(estimator, str | None) else estimator
    options = way.options(options or Options()) if estimator else options or Options()
    search = search or Search()
    if method is not None and method not in STANDARD_METHODS:
        raise OptionError(f"method {method!r} is none of {', '.join(STANDARD_METHODS)}")
    recordings = as_recordings(recordings, robot, "identify")
    everything = (*recordings, *held_out)
    only_once(everything)
    repeat = partial(
        identify,
        method=method,
        signs=signs,
        estimator=estimator,
        search=search,
        options=options,
        refit=refit,
        refine=refine,
        progress=progress,
    )
    try:
        recovered = prepare_and_recover(robot, recordings, held_out, options=options, method=signs, progress=progress)
    except UnknownConstants as error:
        lost = error.left_out(everything)
        unscaled = [recordings[0].joints.index(joint) for joint in error.joints]
        if not all(recording.signed[unscaled].all() for recording in everything):
            raise
        found = repeat(robot, lost[: len(recordings)], held_out=lost[len(recordings) :])
        return _with_currents(found, recordings, held_out, error)
    method = method or STANDARD_METHODS[-1 if recovered.signs is not None and signs == "tree" else 0]
    session = recovered.session_to_fit(robot)
    signed = np.all([recording.signed for recording in everything], axis=0)
    evidence = described_evidence(session, signed)
    if mounted := under_found_gravity(robot, evidence):
        found = repeat(mounted.robot, recordings, held_out=held_out)
        sentence = f"{mounted.fault.sentence}; the model is identified with it"
        return replace(found, flags=described.before((sentence, *found.flags)))
    with naming_faults(session):
        train, test, weigh = _factors(session, options, progress)
    prior = np.asarray(session.task.base.combination @ stated_parameters(session.task).values)
    given = Given(session, train, prior, options.whiten, weigh, progress)
    found = _conclude(given, test, way, recovered, method, search)
    notes = (*described.notes, *recovered.notes, *_signs_of_the_model(recordings, held_out), *found.notes)
    rows, values = IdentifiedData(session, train, test, everything, evidence), (found.estimate.value, found.base_value)
    flags, lacks = identification_flags(rows, found.model, found.excitation, found.fit, *values)
    found = replace(found, flags=(*flags, *found.flags), notes=notes, lacks=lacks)
    again = not held_out if refit is None else refit
    found = _refit(found, given, test, way, recovered, search) if again else found
    found = found if refine is None else _refined(found, tuple(refine))
    return replace(found, inputs=recordings_used(recordings, held_out), flags=described.before(found.flags))


def _with_currents(
    found: Identification, recordings: Sequence[Recording], held_out: Sequence[Recording], error: UnknownConstants
) -> Identification:
    """With laws and fit, in A, of joints whose torque constant is not known; each is fitted alone to its current.

    Bodies are fitted beside them, in A as well, and left out of the result.
    """
    learned, judging = ([replace(recording, scaled=None) for recording in group] for group in (recordings, held_out))
    session = prepare(found.robot, learned, judging, found.session.options)
    train, test = session.reduce(session.train), session.reduce(session.held_out)
    base, terms = session.task.base, np.count_nonzero(session.task.base.combination, axis=1)
    fit, currents = found.fit, list[tuple[Law, Array]]()
    for j in (found.robot.index(joint) for joint in error.joints):
        seen = train.columns[j]
        alone, beside = (
            replace(x, joints=(x.joints[j],), columns=(np.arange(len(seen)),), sample=None) for x in (train, test)
        )
        fitted = estimate(alone, base, np.zeros(len(seen)))
        (trained, _), (judged, r2) = factor_rms(alone, fitted.value), factor_rms(beside, fitted.value)
        fit = fit.in_amperes(j, (trained[0], judged[0], session.task.band.torque_floor[j], r2[0]))
        for law in (law for law in session.task.laws if law.joints == (j,)):
            at = [k for k, x in enumerate(base.labels) if x.law is not None and session.task.laws[x.law] is law]
            rows = [np.flatnonzero((base.combination[seen][:, k] != 0) & (terms[seen] == 1)) for k in at]
            if all(len(places) == 1 for places in rows):  # not in combination with other parameters
                row = np.concatenate(rows)
                parameters = law.effect.physical(fitted.value[row].tolist(), law.effect.shape(law.parameters))
                currents.append((replace(law, parameters=parameters), fitted.std[row]))
    names = shorten(list(error.joints))
    flag = f"{error}; friction and residual of {names} are in A, and masses and inertias leave its current out"
    notes = tuple(note for note in found.notes if "has no torque column" not in note)
    return replace(found, fit=fit, currents=tuple(currents), flags=(flag, *found.flags), notes=notes)


def _refit(
    found: Identification, given: Given, test: Factors, way: Estimator, recovered: Recovered, search: Search
) -> Identification:
    """The same fitted again to all rows, with the fit on held-out rows as it was; unchanged where it must not be."""
    session = given.session
    without_lags = len(test.joints[0].grams) < len(given.factors.joints[0].grams)  # of given held-out recordings
    if test is given.factors or session.judges_itself or without_lags:
        return found
    if seconds_left() <= 0 and found.method != "wls":
        return found
    if why := _unlike(found, recovered):
        return replace(found, notes=(*found.notes, f"the model was not fitted again to the held-out rows: {why}"))
    everything = replace(session, train=(*session.train, *session.held_out), held_out=())
    again = replace(given, session=everything, factors=given.factors + test)
    whole = _conclude(again, test, way, recovered, found.method, search)
    if seconds_left() <= 0 and whole.method != "wls":
        return found
    return replace(
        whole,
        model=replace(whole.model, misfit=found.model.misfit),
        fit=replace(found.fit, refit=True),
        **{key: getattr(found, key) for key in ("flags", "notes", "lacks", "session", "judged")},
    )


def _refined(found: Identification, candidates: Sequence[str]) -> Identification:
    """With numbers refined by roll-outs: judged on held-out windows, then fitted to all where the model was."""
    from .simulation.refine import refine_parts  # with the simulator and compiled code, needed only here

    session = found.session
    try:
        judge = () if session.judges_itself else session.held_out
        result = refine_parts(found.judged, session.train, judge, session.task.band, candidates=candidates)
        model = result.model if result.kept else None
        if model is not None and found.fit.refit:
            if len(session.robot.joints) > 1:  # whose bodies roll-outs do not refine
                model = replace(model, inertials=found.model.inertials)
            model = refine_parts(model, (*session.train, *session.held_out), (), session.task.band).model
    except RecordingError as error:
        return replace(found, notes=(*found.notes, f"numbers were not refined by roll-outs: {error}"))
    more = "model.json has these numbers, the base parameters and the table of laws those of least squares"
    notes = (*found.notes, more if model is not None else result.sentence)
    return replace(found, refinement=result, refined=model, notes=notes)


def _unlike(fitted: Identification, recovered: Recovered) -> str:
    """Why held-out rows must not be learned from; empty if they may."""
    fit = fitted.fit
    far = fit.held_out_rms > MAX_REFIT_RMS_RATIO * np.maximum(fit.train_rms, fit.noise_floor)
    if far.any():
        worst = shorten([fit.joints[j] for j in np.flatnonzero(far)])
        return f"its errors there are more than {MAX_REFIT_RMS_RATIO:g} times those of the training rows ({worst})"
    learned = {recording for recording, _ in fitted.session.learned}
    if recovered.signs is not None and any(recording not in learned for recording, _ in fitted.session.held_out):
        return "the signs of their torque follow from this model"
    return ""


def _conclude(
    given: Given, test: Factors, way: Estimator, recovered: Recovered, method: str, search: Search
) -> Identification:
    """Estimate, standard parameters, fit and flags from factors."""
    session, train, seed = given.session, given.factors, given.session.options.seed
    base = session.task.base
    found = with_spread(way.estimate(given), train, base, given.whiten)
    excitation = judge_excitation(session.task, train, found, seed)
    with steps_shown(given.progress):
        chosen, method = choose_in_time(session, train, found, method, search, seed)
    parameters = chosen.parameters
    base_value = base.combination @ parameters.values
    fit = judge_fit(session, train, test, base_value)
    widened = recovered.widen(found, train, base, given.whiten)
    model = replace(
        fitted_model(session.task, parameters),
        covariance=base_covariance(base, base_value, widened.covariance),
        misfit=None if session.judges_itself else measure_misfit(session.task, test, base_value),
    )
    result = Identification(
        robot=session.robot,
        base=base,
        estimate=replace(widened, names=base.expressions, units=base.units),
        base_value=base_value,
        parameters=parameters,
        model=model,
        fit=fit,
        excitation=excitation,
        method=method,
        moved=chosen.moved,
        inputs=(),
        signs=recovered.signs,
        recordings=recovered.session.recordings,
        flags=(*recovered.flags, *found.flags, *excitation.sentences, *_left_out(given, found), *chosen.flags),
        notes=(
            *(note for note in session.notes if note != SELF_EVALUATION_NOTE),
            *found.notes,
            *chosen.notes,
            *fit.sentences,
            *friction_at_rest(session, fit),
        ),
        cutoff=session.task.band.cutoff,
        position_cutoff=session.task.band.position_cutoff,
        seed=seed,
        session=session,
        judged=model,
    )
    if not result.varies:
        return result
    from .estimation.repeats import varying_sentence

    return replace(result, notes=(*result.notes, *varying_sentence(result.varies)))


def _left_out(given: Given, found: Estimate) -> Iterator[str]:
    """Flags for springs and weight that the fit does not contain, and for too few rows to learn from or to judge by."""
    fitted = any(law.effect.name == "spring" for law in given.session.task.laws)
    if (springs := given.session.robot.springs) and not fitted:
        yield (
            f"no springs are fitted, so those that the description states at {shorten(list(springs))} distort other "
            f"numbers there; signid diagnose keeps them, and --effects with spring fits them"
        )
    robot = given.session.robot
    if is_weightless(robot.model) and shows_gravity(robot, described_gravity(robot)):
        yield (
            "the recorded torque carries no weight, so masses are not identifiable: those that inertia does not show "
            "are those of the description; inertia and friction are identified"
        )
    if SELF_EVALUATION_NOTE in given.session.notes:
        yield SELF_EVALUATION_NOTE
    joints = zip(given.session.robot.joints, given.factors.joints, strict=True)
    if masked := [name for name, own in joints if own.rows and not own.counts[0]]:
        yield (
            f"all filtered rows of {shorten(masked)} lie near reversals of the motion, where friction is uncertain, "
            f"and are not used: move farther or faster at a time, or raise the cut-off"
        )
    if lost := int(np.isinf(found.std).sum()):
        yield (
            f"{lost} of {len(found.std)} base parameters are not identifiable from the rows that are used and keep the "
            f"values of the description; record for longer, or more varied motion"
        )


def _factors(session: Session, options: Options, progress: Progress | None) -> tuple[Factors, Factors, Weigh | None]:
    lags = LAGS if options.whiten else 0
    train, weigh = session.reduce(session.train, progress=progress, lags=lags), None
    if options.robust:
        for _ in range(ROBUST_ROUNDS):
            found = estimate(train, session.task.base, whiten=False)
            weigh = _huber(found, train)
            train = session.reduce(session.train, weigh=weigh, progress=progress, purpose="weighing", lags=lags)
    return (
        train,
        session.reduce(session.held_out, weigh=weigh, progress=progress, purpose="judging by", lags=lags),
        weigh,
    )


def _huber(found: Estimate, factors: Factors) -> Weigh:
    def weigh(joint: int, rows: Rows) -> Array:
        residual = rows.torque[:, joint] - rows.columns[joint] @ found.value[factors.columns[joint]]
        size = np.abs(residual) / max(found.noise[joint], 1e-300)
        return np.asarray(np.minimum(1.0, HUBER_DEVIATIONS / np.maximum(size, 1e-12)))

    return weigh


def _signs_of_the_model(recordings: Sequence[Recording], held_out: Sequence[Recording]) -> Iterator[str]:
    """A note where the model itself chose the signs of the held-out torque."""
    if not all(r.signed.all() for r in held_out or recordings[-1:]):
        whole = "" if held_out or len(recordings) > 1 else " and data"
        yield (
            f"the signs of the held-out torque were recovered with this model{whole}, so held-out R2 is optimistic "
            f"where a sign is wrong; give --held-out a recording with signs if there is one"
        )
