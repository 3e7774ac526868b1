"""Recordings whose torque lost its sign -> signs, and the recordings as if they had been measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..deadline import steps_shown
from ..errors import OptionError, RecordingError, shorten
from ..recording import with_signs
from ..regression.factors import Factors
from ..regression.prepare import prepare
from ..regression.rows import Task
from ..regression.session import Options, Part
from ..types import Array, BaseMap, Estimate, Progress, Recording, Robot
from .infer import infer
from .inferred import Inferred
from .posterior.flags import raise_flags
from .result import Signs, SignSegment, Trace
from .rows.observations import Observed, observe, thinning
from .samples.expected_signs import expect_signs
from .samples.jumps import Signed, place_jumps
from .samples.markov_chain import refine_signs
from .samples.rows_of_file import signs_of_rows
from .torque_constants.find import Gains, find_gains
from .torque_constants.from_shared_parameters import widen_estimate
from .tree.method import by_tree

METHODS = ("exact", "tree")


@dataclass(frozen=True)
class Recovered:
    """Recordings with signed torque, and what is known about the signs that were found."""

    recordings: tuple[Recording, ...]
    held_out: tuple[Recording, ...]
    expected: tuple[Recording, ...]  # the recordings with expectations of signs: a fit to them has no bias
    signs: Signs | None = None  # None where every torque had its sign
    gains: Gains | None = None  # torque constants that were not known

    def widen(self, found: Estimate, factors: Factors, base: BaseMap, whiten: bool) -> Estimate:
        """The estimate with the uncertainty of torque constants that were found.

        Args:
            found: with the constants taken to be exact.
            factors: that it comes from.
            base: what the columns are.
            whiten: as for the estimate.
        """
        return found if self.gains is None else widen_estimate(found, factors, base, self.gains.covariance, whiten)

    @property
    def flags(self) -> tuple[str, ...]:
        """When not to trust the signs."""
        return () if self.signs is None else self.signs.flags

    @property
    def notes(self) -> tuple[str, ...]:
        """What was done."""
        return () if self.signs is None else self.signs.notes


def recover(
    robot: Robot,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    *,
    method: str = "exact",
    options: Options | None = None,
    progress: Progress | None = None,
) -> Recovered:
    """The recordings with the signs of all torques.

    Signs are searched in the recordings to learn from, whole; where there are several and none is held out, the last
    takes no part. Those of held-out recordings follow from the model that the search found. Torque constants that are
    not known are found first.

    Args:
        robot: as `load_robot` gives it.
        recordings: to learn from.
        held_out: to judge by.
        method: `exact`: proved by branch and bound within physics; `tree`: the classical tree of sign choices.
        options: effects, cut-off and the like.
        progress: told what is being done and how far it is.

    Raises:
        OptionError: there is no such method, or a torque constant is neither known nor told.
        RecordingError: a recording cannot be used, or lacks a torque that another has without its sign, or a torque has
            no stretch of one sign.
    """
    if method not in METHODS:
        raise OptionError(f"signs {method!r} is none of {', '.join(METHODS)}")
    everything = (*recordings, *held_out)
    if all(r.signed.all() for r in everything):
        return Recovered(tuple(recordings), tuple(held_out), tuple(recordings))
    options = options or Options()
    judges = held_out if held_out or len(recordings) == 1 else recordings[-1:]
    gains = find_gains(robot, everything, [r for r in recordings if r not in judges], options, progress)
    if gains is not None:
        scaled = [[gains.scale(r) for r in some] for some in (recordings, held_out)]
        found = recover(robot, *scaled, method=method, options=options, progress=progress)
        return replace(found, signs=found.signs and gains.tell(found.signs), gains=gains)
    session = prepare(robot, recordings, judges or recordings, options)  # all parts are whole
    parts = {part[0]: part for part in (*session.train, *session.held_out)}
    learn = [parts[r] for r in recordings if r not in judges]
    _same_torques([recording for recording, _ in learn])
    if progress is not None:
        progress("searching signs", 0.0)
    observed = observe(session.task, learn)
    choose = by_tree(session.task, options.seed, progress) if method == "tree" else None
    with steps_shown(progress):
        inferred = infer(session.task, observed, options.seed, choose)
    notes = (*_notes(observed, inferred), *_unused(observed, learn))
    traced = _traces(observed, learn, inferred, inferred.refined.signs)
    for part in (parts[r] for r in judges if not r.signed.all()):
        traced |= _followed(session.task, part, inferred)
    steps = {r: thinning(session.task, [parts[r]] if r in judges else learn) for r in traced}
    signed = {r: _with(session.task, parts[r], trace, steps[r], inferred) for r, trace in traced.items()}
    return Recovered(
        tuple(signed.get(r, (r,))[0] for r in recordings),
        tuple(signed.get(r, (r,))[0] for r in held_out),
        tuple(signed.get(r, (r,))[-1] for r in recordings),
        _result(observed, inferred, notes, tuple(traced.values()), method, options.seed),
    )


def _same_torques(recordings: Sequence[Recording]) -> None:
    """Where a torque lacks its sign, all recordings must have that torque."""
    for j, joint in enumerate(recordings[0].joints):
        has = [bool(r.columns["tau"][j]) for r in recordings]
        if any(not r.signed[j] for r in recordings) and not all(has):
            one = recordings[has.index(True)].path or "one recording"
            other = recordings[has.index(False)].path or "another"
            raise RecordingError(
                f"{one} has torque of {joint}, {other} has none; where signs are lost, use recordings with torque of "
                f"the same joints together, or leave the column out"
            )


def _traces(observed: Observed, parts: Sequence[Part], inferred: Inferred, signs: Array) -> dict[Recording, Trace]:
    """Per recording, its thinned samples with the signs (N, n) [1] found."""
    predicted, found = observed.predict(inferred.refined.value), {}
    for k, (recording, _) in enumerate(parts):
        at = observed.part == k
        found[recording] = Trace(
            path=recording.path,
            t=observed.t[at],
            first=np.flatnonzero(observed.first[at]),
            magnitude=np.where(observed.known, np.abs(observed.torque[at]), np.nan),
            signs=signs[at],
            predicted=predicted[at],
        )
    return found


def _followed(task: Task, part: Part, inferred: Inferred) -> dict[Recording, Trace]:
    """The signs that the model found elsewhere gives a recording that took no part in the search."""
    observed = observe(task, [part])
    told = refine_signs(observed, 1 / observed.scale, inferred.refined.value, rounds=1)
    return _traces(observed, [part], inferred, told.signs)


def _with(task: Task, part: Part, trace: Trace, step: int, inferred: Inferred) -> tuple[Recording, Recording]:
    """The recording with the signs found, and with their expectations."""
    recording, sampling = part
    thinned, refined = Signed(trace.t, trace.first, trace.signs), inferred.refined
    told = place_jumps(task, part, step, thinned, trace.magnitude, refined.value)
    signs = signs_of_rows(recording, sampling, told.t, told.first, told.signs.astype(np.int8))
    expected = expect_signs(task, part, refined.value, refined.sigma, signs)
    return with_signs(recording, signs), with_signs(recording, expected)


def _result(
    observed: Observed,
    inferred: Inferred,
    notes: tuple[str, ...],
    traces: tuple[Trace, ...],
    method: str,
    seed: int,
) -> Signs:
    order = sorted(range(len(inferred.segments)), key=lambda k: _place(observed, inferred, k))
    told = [_told(observed, inferred, k) for k in order]
    return Signs(
        joints=observed.joints,
        hidden=observed.hidden,
        method=method,
        segments=tuple(told),
        threshold=inferred.threshold,
        proof=inferred.proof,
        flags=raise_flags(observed, inferred),
        notes=notes,
        value=inferred.refined.value,
        noise=inferred.refined.sigma,
        inflation=inferred.inflation,
        traces=traces,
        seed=seed,
    )


def _place(observed: Observed, inferred: Inferred, k: int) -> tuple[int, int, int]:
    joint, start, _ = inferred.segments[k]
    return int(observed.part[start]), joint, start


def _told(observed: Observed, inferred: Inferred, k: int) -> SignSegment:
    joint, start, stop = inferred.segments[k]
    return SignSegment(
        part=int(observed.part[start]),
        joint=joint,
        start=float(observed.t[start]),
        end=float(observed.t[stop - 1]),
        sign=int(inferred.signs[k]),
        confidence=float(inferred.confidence[k]),
    )


def _notes(observed: Observed, inferred: Inferred) -> tuple[str, ...]:
    notes = [*inferred.notes]
    if inferred.finer:
        notes.append("segments above the threshold hid changes of sign: stretches between low minima were searched")
    for joint, count in inferred.impure.items():
        told, them = ("1 segment", "was") if count == 1 else (f"{count} segments", "were")
        inside = "inside it" if count == 1 else "inside them"
        notes.append(f"{told} of {observed.joints[joint]} {them} cut where the torque changes its sign {inside}")
    return tuple(notes)


def _unused(observed: Observed, parts: Sequence[Part]) -> tuple[str, ...]:
    """Signs that some recordings have and others have not."""
    some = [observed.joints[j] for j in observed.hidden if any(recording.signed[j] for recording, _ in parts)]
    told = f"signs of {shorten(some)}, which some recordings have, took no part in the search: others lack them"
    return (told,) if some else ()
