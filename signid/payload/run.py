"""Recordings without and with a load, or one in which it is picked up -> mass, centre and inertia of the load."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..deadline import ends_in_time
from ..errors import OptionError, RecordingError, shorten
from ..estimation.least_squares import estimate
from ..faults import recording_flags
from ..model import Model, ModelSource, as_model, load_model, stated_parameters
from ..recording import Recordings, as_recordings
from ..recording.sampling import between, time_origin
from ..regression.session import Options, Part, Session, prepare
from ..robot.dynamics import own_body
from ..typed import typed
from ..types import INERTIAL, Array, Input, Progress, Recording, Robot
from .moment import (
    MIN_LOAD_REDUCTION,
    ChangeSums,
    Pieces,
    cut,
    edge_scores,
    explain,
    inflation,
    piece_rows,
    plausible,
    posterior,
    residual_std,
    rival,
    search,
    sums,
)
from .weigh import CERTAIN_MASS_DEVIATIONS, LoadMoment, Payload, changes, weigh

ROLES = ("recording, without the load", "recording, with the load")
WITHIN_ROLE = "recording, in which the load is picked up"
NOISE_ROUNDS_OF_MOMENT = 3  # of noise and moments
MOMENT_CUTOFF_RATIO = 3.0  # [1] cut-off for the moment over that for the load
MOMENT_REACH = 4.0  # [s] rows on either side of the plausible moments
MIN_HANDLING_TIME = 0.5  # [s] on either side of a moment that is left out: gripping and lifting
HANDLING_DEVIATIONS = 2.0  # [standard deviations] of the moment, the same
BEYOND_RECORDINGS = 1e300  # [s] beyond every recording
LOAD_RANK_TOLERANCE = 1e-8  # [1] smallest singular value of the load's columns, over the largest


@typed
@ends_in_time
def payload(
    robot: ModelSource,
    without: Recordings,
    carrying: Recordings | None = None,
    *,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Payload:
    """Identify the load of the last link from recordings without it and with it, or from one that has both.

    Base parameters are estimated without and with the load. Parameters of the robot itself are equal in both and cancel
    in the difference; friction and offsets may have changed a little. The difference is projected onto the nearest
    physically possible body. Misfit beyond noise and such changes widens the intervals.

    A single recording is searched for the moments at which the load is picked up and put down (`moments` of the
    result). If there is none, the result has `found` False, a flag with the reason, and no numbers.

    Args:
        robot: as `load_robot` or `load_model` gives it; `model` of the result is it with the load.
        without: recordings of the robot alone, or the one in which it picks the load up.
        carrying: recordings of the robot with the load; None: the load is picked up in the other recording.
        options: effects, cut-off and the like.
        progress: called with the current step and the share that is done.

    Raises:
        RecordingError: a recording cannot be used, or lacks signs of torque.
        OptionError: one side has no recording, or one was given twice.

    Source: Khalil, Gautier, Lemoine, IEEE ICRA 2007; feasible bodies: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
    """
    model, options = as_model(robot, "payload"), options or Options()
    robot = model.robot
    without = as_recordings(without, robot, "payload")
    if carrying is None:
        if len(without) != 1:
            raise OptionError(
                f"a load that is picked up is sought in one recording, not in {len(without)}; give one of them, or "
                "recordings without and with the load"
            )
        _check_signs(without)
        session = prepare(robot, without, without, options)
        bare = _bare(model, session.robot)
        return replace(weigh_within(session, _inputs((without, WITHIN_ROLE)), progress), bare=bare)
    carrying = as_recordings(carrying, robot, "payload")
    both = [*without, *carrying]
    for name, side in (("without", without), ("with", carrying)):
        if not side:
            raise OptionError(f"no recording {name} the load was given; the load is the difference of the two")
    if len({recording.sha256 for recording in both}) < len(both):
        raise OptionError("the same samples were given twice; give each recording once, without the load or with it")
    _check_signs(both)
    session = prepare(robot, both, both, options)
    sides = session.train[: len(without)], session.train[len(without) :]
    bare = _bare(model, session.robot)
    found = weigh(session, sides, _inputs((without, ROLES[0]), (carrying, ROLES[1])), progress)
    loaded = replace(bare, laws=(*bare.laws, found.law))
    pairs = ((bare, without), (loaded, carrying))
    faults = dict.fromkeys(flag for known, side in pairs for flag in recording_flags(known, side))
    return replace(found, flags=(*faults, *found.flags), bare=bare)


def _bare(model: Model, moving: Robot) -> Model:
    """The given model; of a description, with the joints held that the recordings do not move.

    Raises:
        OptionError: the model was identified, and the recordings do not move all of its joints.
    """
    if moving.joints == model.robot.joints:
        return model
    described = load_model(model.robot)
    if not (np.array_equal(model.inertials, described.inertials) and len(model.laws) == len(described.laws)):
        lacking = shorten([joint for joint in model.robot.joints if joint not in moving.joints])
        raise OptionError(
            f"the recordings have no position of {lacking}, and the model moves all of its joints; give the description"
        )
    return load_model(moving)


def _inputs(*sides: tuple[Sequence[Recording], str]) -> tuple[Input, ...]:
    return tuple(Input(r.path, r.sha256, role) for side, role in sides for r in side)


def _check_signs(recordings: Sequence[Recording]) -> None:
    for recording in recordings:
        if not recording.signed.all():
            name = recording.path or "a recording"
            raise RecordingError(f"{name} lacks signs of torque; a load is found from torque that has its sign")


class _Change(NamedTuple):
    """The pieces that differ, and what explains them."""

    pieces: Pieces
    known: ChangeSums
    noise: Array  # (n,) [N.m or N]
    low: int
    high: int
    inflated: float  # [1] variance of the residual's sums over that of white noise
    gain: float  # [1] reduction of the squared residual by a load, over its variance
    mass: float  # [kg] of the pieces low..high over that of the others
    other: tuple[int, float] | None  # joint whose own change explains more, and by how much


def weigh_within(session: Session, inputs: tuple[Input, ...], progress: Progress | None = None) -> Payload:
    """Find the moments, and weigh the load by what lies before and after them.

    Raises:
        RecordingError: the recording is too short.
    """
    parts = session.whole
    change = _find(session, parts)
    start = time_origin(parts[0][0])
    if (reason := _refuted(change, session, start)) or change is None:
        return _nothing(session, inputs, reason)
    moments = tuple[LoadMoment, ...]()
    for k, begins in ((change.low, True), (change.high, False)):
        if 0 < k < len(change.pieces.start):
            t, std = _refined(session, parts, change, k, begins)
            moments = (*moments, LoadMoment(t, std, begins == (change.mass > 0)))  # picked up where mass begins
    sides = [
        tuple((recording, between(sampling, some)) for recording, sampling in parts)
        for some in _intervals(change, moments)
    ]
    try:
        found = weigh(session, sides, inputs, progress)
    except RecordingError:
        where = _times(moments, start)
        return _nothing(session, inputs, f"{where}, but too little motion is left on one side; record for longer")
    mass, std = found.mass
    if np.isfinite(std) and not mass > CERTAIN_MASS_DEVIATIONS * std:
        return _nothing(session, inputs, f"{_times(moments, start)} with a mass of {mass:.2g} ± {1.96 * std:.2g} kg")
    return replace(found, moments=moments)


def _find(session: Session, parts: Sequence[Part]) -> _Change | None:
    """The change that fits a load best; None if the recording is too short for one."""
    task, base = session.task, session.task.base
    factors = session.reduce(parts)
    prior = base.combination @ stated_parameters(task).values
    whole = estimate(replace(factors, sample=None), base, prior)
    body = own_body(session.robot, len(session.robot.joints) - 1)
    columns = base.combination[:, len(INERTIAL) * body : len(INERTIAL) * (body + 1)]
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    left, s, right = np.linalg.svd(columns / size, full_matrices=False)
    kept = s > LOAD_RANK_TOLERANCE * s[0]
    columns, inertial = left[:, kept] * s[kept], right[kept].T / size[:, None]  # independent ones, (10, r) of each
    friction, sizes = changes(base, whole, factors)
    pieces = cut(session, parts, piece_rows(session, parts))
    noise, inflated, low, high = whole.noise, 1.0, 0, 0
    for _ in range(NOISE_ROUNDS_OF_MOMENT):
        known = sums(pieces, noise, columns, friction, sizes)
        low, high = search(known, pieces, inflated)
        if high == 0:
            return None
        noise = residual_std(pieces, known, low, high)
        known = sums(pieces, noise, columns, friction, sizes)
        inflated = inflation(pieces, known, low, high)
    full, bare = explain(known, low, high), explain(known, low, high, load=False)
    mass = float((inertial @ full.change[: known.load])[0])
    joint, power = rival(pieces, known, noise, (low, high), friction)
    penalty = columns.shape[1] * np.log(
        max(float(pieces.counts.sum()), 2.0)
    )  # Schwarz, Annals of Statistics 6(2), 1978
    other = (joint, power) if power > full.power - penalty * inflated else None
    return _Change(pieces, known, noise, low, high, inflated, (full.power - bare.power) / inflated, mass, other)


def _refuted(change: _Change | None, session: Session, start: float) -> str:
    """Why there is no load; "" if there is one."""
    if change is None:
        return "the recording is too short to have parts without and with a load"
    if change.gain <= MIN_LOAD_REDUCTION:
        return f"no load explains the torque better (evidence {change.gain:.3g}, needed {MIN_LOAD_REDUCTION:g})"
    if change.other is not None:
        k = change.low or change.high
        name = session.robot.joints[change.other[0]]
        return f"the change at {change.pieces.edges[k] - start:.4g} s is one of {name}: friction, offset or gain"
    return ""


def _nothing(session: Session, inputs: tuple[Input, ...], reason: str) -> Payload:
    """Result without a load."""
    body = own_body(session.robot, len(session.robot.joints) - 1)
    return Payload(
        robot=session.robot,
        link=session.robot.links[body],
        inertial=np.full(len(INERTIAL), np.nan),
        covariance=np.full((len(INERTIAL),) * 2, np.inf),
        unidentified=("mass", "centre of mass", "inertia"),
        moved=0.0,
        misfit=1.0,
        drifted=0.0,
        inputs=inputs,
        cutoff=session.task.band.cutoff,
        seed=session.options.seed,
        flags=(f"no load picked up: {reason}",),
        notes=session.notes,
    )


def _refined(session: Session, parts: Sequence[Part], change: _Change, k: int, begins: bool) -> tuple[float, float]:
    """Moment and its standard deviation [s] from rows of a higher cut-off around the edge of a piece."""
    full = explain(change.known, change.low, change.high)
    after = full.base + change.known.changes @ full.change
    bases = (full.base, after) if begins else (after, full.base)
    first, last = (change.low, len(change.pieces.start)) if not begins else (0, change.high)
    coarse = change.pieces.part(first, last)
    earliest, latest = plausible(coarse, edge_scores(coarse, change.noise, *bases, change.inflated))
    edge, around = float(change.pieces.edges[k]), (earliest - MOMENT_REACH, latest + MOMENT_REACH)
    for there in (_finer(session, parts), session):
        near = tuple((recording, between(sampling, [around])) for recording, sampling in parts)
        try:
            fine = cut(there, near, 1)
        except RecordingError:
            continue
        if len(fine.start) > 2:
            noise = np.maximum(_noise(fine, bases, edge), change.noise)
            return posterior(fine, edge_scores(fine, noise, *bases, change.inflated))
    return (earliest + latest) / 2, max(latest - earliest, 1.0) / np.sqrt(12)


def _finer(session: Session, parts: Sequence[Part]) -> Session:
    """The same recording with a higher cut-off, whose filter is shorter."""
    band = session.task.band
    cutoff = min(MOMENT_CUTOFF_RATIO * band.cutoff, band.rate / 8)
    given = [recording for recording, _ in parts]
    try:
        return prepare(session.robot, given, given, replace(session.options, cutoff=cutoff))
    except OptionError:
        return session


def _noise(fine: Pieces, bases: tuple[Array, Array], edge: float) -> Array:
    """Standard deviation (n,) [N.m or N] of the residual of each joint before and after an edge."""
    late = fine.start > edge
    left = np.zeros(len(fine.grams))
    for j, (gram, columns) in enumerate(zip(fine.grams, fine.columns, strict=True)):
        for which, base in ((~late, bases[0]), (late, bases[1])):
            x = np.append(-base[columns], 1.0)
            left[j] += x @ gram[which].sum(axis=0) @ x
    return np.asarray(np.sqrt(np.maximum(left, 0.0) / np.maximum(fine.counts.sum(axis=0), 1.0)))


def _intervals(change: _Change, moments: Sequence[LoadMoment]) -> tuple[list[tuple[float, float]], ...]:
    """Intervals [s] without the load, and with it, away from the moments."""
    first, last = -BEYOND_RECORDINGS, BEYOND_RECORDINGS
    handling = ((m.t, max(MIN_HANDLING_TIME, HANDLING_DEVIATIONS * m.std)) for m in moments)
    edges = [(first, first), *((t - half, t + half) for t, half in handling)]
    spans = [(a[1], b[0]) for a, b in zip(edges, [*edges[1:], (last, last)], strict=True)]
    carried = not moments[0].picked_up
    sides: tuple[list[tuple[float, float]], ...] = ([], [])
    for k, span in enumerate(spans):
        sides[carried ^ (k % 2 == 1)].append(span)
    return sides


def _times(moments: Sequence[LoadMoment], start: float) -> str:
    """Moments in words."""
    what = {True: "picked up", False: "put down"}
    return "; ".join(
        f"a change at {m.t - start:.4g} ± {1.96 * m.std:.2g} s looks like a load {what[m.picked_up]}" for m in moments
    )
