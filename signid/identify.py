"""Session -> identification: base parameters, a physically consistent set, the fit on what was held out."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from .deadline import ends_in_time, steps_shown
from .errors import OptionError, shorten
from .estimation.estimators import ESTIMATORS, Estimator, Given
from .estimation.excitation import ExcitationVerdict, judge_excitation
from .estimation.fit_quality import Fit, judge_fit
from .estimation.least_squares import estimate
from .estimation.standard import METHODS, Search, choose_in_time
from .model import Model, fitted_model, stated_parameters
from .recording_faults import IdentifiedData, identification_flags
from .regression.covariance import base_covariance
from .regression.factors import LAGS, Factors, Weigh
from .regression.prepare import ITSELF, only_once, prepare, recordings_used
from .regression.reduced import Reduced
from .regression.rows import Rows
from .regression.session import Options, Session
from .signs import Recovered, Signs, recover
from .types import Array, BaseMap, Estimate, Frozen, Input, Parameters, Progress, Recording, Robot

HUBER = 1.345  # residual, in standard deviations, beyond which a row counts less
ROBUST_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class Identification(Frozen):
    """A robot's dynamics as its recordings tell them. `flags` say what is not to be trusted; empty when all is well."""

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

    @property
    def physically_consistent(self) -> bool:
        """Whether a real robot could have the standard parameters; proved, not believed."""
        return self.parameters.is_feasible()


@ends_in_time
def identify(
    robot: Robot,
    recordings: Sequence[Recording] | Reduced,
    *,
    held_out: Sequence[Recording] = (),
    method: str | None = None,
    signs: str = "exact",
    estimator: str | Estimator | None = None,
    search: Search | None = None,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Identification:
    """A dynamics model from a description and recordings.

    Where torque was recorded without its sign, the signs are recovered first; then they count as measured.

    Args:
        robot: as `load_robot` gives it.
        recordings: to learn from, as `read_recording` gives them; or their factors, as `reduce` or `load_factors` gives
            them, which hold what is held out, too.
        held_out: to judge by; without any, the last of several recordings or the last 30 % of the only one.
        method: `convex`: physically consistent fit; `wls`: the least-squares base parameters as they are, with the
            nearest standard parameters; `pbrp`: penalty-based parameter retrieval. None: convex, or pbrp after a tree.
        signs: how lost signs are recovered: `exact`, or `tree`, the classical tree of sign choices.
        estimator: `wls`, `iv`, `tls`, `oe` or one of another package. None: weighted least squares, with desired
            positions as instruments where they are recorded.
        search: how penalty-based parameter retrieval searches.
        options: effects, cut-off and the like.
        progress: told what is being done and how far it is.

    Raises:
        OptionError: a method or an estimator is unknown, or the recordings lack what it needs.
        RecordingError: a recording cannot be used, or no sign can be found in it; the sentence says which and why.
    """
    way = ESTIMATORS[estimator or "wls"] if isinstance(estimator, str | None) else estimator
    options = way.options(options or Options()) if estimator else options or Options()
    search = search or Search()
    if method is not None and method not in METHODS:
        raise OptionError(f"method {method!r} is none of {', '.join(METHODS)}")
    if isinstance(recordings, Reduced):
        if estimator not in (None, "wls"):
            raise OptionError(f"factors answer by weighted least squares alone; give recordings for {way.name!r}")
        return _from_factors(robot, recordings, held_out, method or METHODS[0], search, options)
    only_once((*recordings, *held_out))
    recovered = recover(robot, recordings, held_out, method=signs, options=options, progress=progress)
    method = method or METHODS[-1 if recovered.signs is not None and signs == "tree" else 0]
    session = prepare(robot, recovered.expected, recovered.held_out, options)
    train, test, weigh = _factors(session, options, progress)
    given = Given(session, train, _prior(session), options.whiten, weigh, progress)
    found = _conclude(given, test, way, recovered, method, search, options.seed)
    notes = (*recovered.notes, *_judged_by_itself(recordings, held_out), *found.notes)
    found = _judged(found, train, test, (*recordings, *held_out))
    return replace(found, inputs=recordings_used(recordings, held_out), notes=notes)


def _from_factors(
    robot: Robot, reduced: Reduced, held_out: Sequence[Recording], method: str, search: Search, options: Options
) -> Identification:
    """What recordings tell whose samples are not there any more."""
    if held_out or options.robust:
        what = "weights against outliers need samples" if options.robust else "factors hold what is held out themselves"
        raise OptionError(f"{what}; give recordings instead of their factors")
    if robot.sha256 != reduced.robot.sha256:
        raise OptionError(f"the factors are not of {robot.name} as it is described; give the robot they were made with")
    if reduced.share[1] > 1:
        raise OptionError(f"the factors are one part of {reduced.share[1]}; add all of them first")
    session = Session(reduced.task, (), (), reduced.notes)
    given = Given(session, reduced.train[0].factors, _prior(session), options.whiten)
    nothing = Recovered((), (), ())
    found = _conclude(given, reduced.held_out[0].factors, ESTIMATORS["wls"], nothing, method, search, options.seed)
    return replace(_judged(found, given.factors, reduced.held_out[0].factors, ()), inputs=reduced.inputs)


def _judged(found: Identification, train: Factors, test: Factors, recordings: Sequence[Recording]) -> Identification:
    """With flags on the recordings and on joints that fit badly."""
    rows = IdentifiedData(found.session, train, test, recordings)
    own = identification_flags(rows, found.model, found.excitation, found.fit, found.estimate.value)
    return replace(found, flags=(*own, *found.flags))


def _prior(session: Session) -> Array:
    return np.asarray(session.task.base.combination @ stated_parameters(session.task).values)


def _conclude(
    given: Given, test: Factors, way: Estimator, recovered: Recovered, method: str, search: Search, seed: int
) -> Identification:
    """All that factors tell."""
    session, train = given.session, given.factors
    found = way.estimate(given)
    excitation = judge_excitation(session.task, train, found, seed)
    with steps_shown(given.progress):
        chosen, method = choose_in_time(session, train, found, method, search, seed)
    parameters = chosen.parameters
    base_value = session.task.base.combination @ parameters.values
    fit = judge_fit(session, train, test, base_value)
    widened = recovered.widen(found, train, session.task.base, given.whiten)
    model = replace(
        fitted_model(session.task, parameters),
        covariance=base_covariance(session.task.base, base_value, widened.covariance),
    )
    return Identification(
        robot=session.robot,
        base=session.task.base,
        estimate=widened,
        base_value=base_value,
        parameters=parameters,
        model=model,
        fit=fit,
        excitation=excitation,
        method=method,
        moved=chosen.moved,
        inputs=(),
        signs=recovered.signs,
        recordings=(*recovered.recordings, *recovered.held_out),
        flags=(*recovered.flags, *found.flags, *excitation.sentences, *_untold(given, found), *chosen.flags),
        notes=(*(note for note in session.notes if note != ITSELF), *found.notes, *chosen.notes, *fit.sentences),
        cutoff=session.task.band.cutoff,
        position_cutoff=session.task.band.position_cutoff,
        seed=seed,
        session=session,
    )


def _untold(given: Given, found: Estimate) -> Iterator[str]:
    """Where rows are too few to judge by, or to learn from, however exciting the motion is."""
    if ITSELF in given.session.notes:
        yield ITSELF
    joints = zip(given.session.robot.joints, given.factors.joints, strict=True)
    if masked := [name for name, own in joints if own.rows and not own.counts[0]]:
        yield (
            f"all filtered rows of {shorten(masked)} lie near reversals of the motion, where friction is not certain, "
            f"and do not count: move farther or faster at a time, or raise the cut-off"
        )
    if lost := int(np.isinf(found.std).sum()):
        yield (
            f"the rows that count tell nothing of {lost} of {len(found.std)} base parameters: these keep what the "
            f"description states; record for longer, or more varied motion"
        )


def _factors(session: Session, options: Options, progress: Progress | None) -> tuple[Factors, Factors, Weigh | None]:
    lags = LAGS if options.whiten else 0
    train, weigh = session.reduce(session.train, progress=progress, lags=lags), None
    if options.robust:
        for _ in range(ROBUST_ROUNDS):
            found = estimate(train, session.task.base, whiten=False)
            weigh = _huber(found, train)
            train = session.reduce(session.train, weigh=weigh, progress=progress, purpose="weighing", lags=lags)
    return train, session.reduce(session.held_out, progress=progress, purpose="judging by", lags=0), weigh


def _huber(found: Estimate, factors: Factors) -> Weigh:
    def weigh(joint: int, rows: Rows) -> Array:
        residual = rows.torque[:, joint] - rows.columns[joint] @ found.value[factors.columns[joint]]
        size = np.abs(residual) / max(found.noise[joint], 1e-300)
        return np.asarray(np.minimum(1.0, HUBER / np.maximum(size, 1e-12)))

    return weigh


def _judged_by_itself(recordings: Sequence[Recording], held_out: Sequence[Recording]) -> Iterator[str]:
    """Where the model chose the signs of the torque that it is judged by."""
    if not all(r.signed.all() for r in held_out or recordings[-1:]):
        whole = "" if held_out or len(recordings) > 1 else ", in a search that saw it"
        yield (
            f"the model itself gave the torque that is held out its signs{whole}: R2 held out is too good where they "
            f"are wrong; give --held-out a recording with signs if there is one"
        )
