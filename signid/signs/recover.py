"""Session with unsigned torque -> signs, and the session as if they had been measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..deadline import steps_shown
from ..errors import OptionError, RecordingError, shorten
from ..recording import with_signs
from ..recording.sampling import time_origin
from ..regression.factors import Factors
from ..regression.prepare import prepare, rearrange
from ..regression.session import Options, Part, Session
from ..types import BaseMap, Estimate, Progress, Recording, Robot
from .flags import raise_flags
from .infer import Inferred, infer
from .observations import Observed, observe, thinning
from .result import Signs, SignSegment, Trace
from .samples.full_rate import expect_signs, place_jumps
from .samples.markov_chain import RefinedSigns, refine_signs
from .samples.rows_of_file import signs_of_rows
from .torque_constants.constants import widen_estimate
from .torque_constants.find import TorqueConstants, find_gains
from .tree.tree import by_tree

METHODS = ("exact", "tree")


@dataclass(frozen=True)
class Recovered:
    """A session with signed torque, and what is known about the signs that were found."""

    session: Session
    learning: Session  # its training torque with expected signs: a fit to it has no bias
    signs: Signs | None = None  # None where every torque had its sign
    gains: TorqueConstants | None = None  # torque constants that were not known

    def widen(self, found: Estimate, factors: Factors, base: BaseMap, whiten: bool) -> Estimate:
        """The estimate with the uncertainty of the torque constants that were found."""
        return found if self.gains is None else widen_estimate(found, factors, base, self.gains.covariance, whiten)

    def session_to_fit(self, robot: Robot) -> Session:
        """Session to estimate with; recovered signs give another noise of the torque, so it is arranged again."""
        return self.session if self.signs is None else rearrange(robot, self.learning, self.learning.options)

    @property
    def flags(self) -> tuple[str, ...]:
        """Reasons not to rely on the signs and the torque constants."""
        return self.signs.flags if self.signs else self.gains.flags if self.gains else ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on how the signs were found."""
        return self.signs.notes if self.signs else self.gains.notes if self.gains else ()


def prepare_and_recover(
    robot: Robot,
    recordings: Sequence[Recording],
    held_out: Sequence[Recording] = (),
    *,
    options: Options,
    unsigned: Options | None = None,
    method: str = "exact",
    progress: Progress | None = None,
) -> Recovered:
    """Prepare recordings once, and recover their signs and the torque constants of their currents.

    Where a torque lacks its sign or its constant, the options `unsigned` take the place of `options`, unless None.
    """
    everything = (*recordings, *held_out)
    known = all(r.signed.all() and (r.scaled is None or r.scaled.all()) for r in everything)
    own = options if known or unsigned is None else unsigned
    return recover(prepare(robot, recordings, held_out, own, scaled=False), method=method, progress=progress)


def recover(session: Session, *, method: str = "exact", progress: Progress | None = None) -> Recovered:
    """The session with the signs of all torques, which needs laws of friction among its effects.

    Signs are searched in the recordings of which at least a part is learned from, whole. Those of other recordings
    follow from the model that the search found. Torque constants that are not known are found first. The method is
    `exact`, proved by branch and bound within physics, or `tree`, the classical tree of sign choices.

    Raises:
        OptionError: there is no such method, or a torque constant is neither known nor identifiable.
    """
    if method not in METHODS:
        raise OptionError(f"signs {method!r} is none of {', '.join(METHODS)}")
    gains = find_gains(session, progress)
    if gains is not None:
        found = recover(
            session.exchange({r: gains.scale(r) for r in session.recordings}), method=method, progress=progress
        )
        return replace(found, signs=found.signs and gains.describe(found.signs), gains=gains)
    if session.signed:
        return Recovered(session, session)
    task, learn, seed = session.task, session.learned, session.options.seed
    _same_torques([recording for recording, _ in learn])
    if progress is not None:
        progress("searching signs", 0.0)
    observed = observe(task, learn)
    choose = by_tree(task, seed, progress) if method == "tree" else None
    with steps_shown(progress):
        inferred = infer(task, observed, seed, choose)
    value, traced = inferred.refined.value, _traces(observed, learn, inferred.refined)
    others = [part for part in session.whole if part not in learn and not part[0].signed.all()]
    for part in others:
        alone = observe(task, [part])
        traced |= _traces(alone, [part], replace(refine_signs(alone, value, rounds=1), value=value))
    signed, expected = dict[Recording, Recording](), dict[Recording, Recording]()
    for part in (*learn, *others):
        step = thinning(task, [part] if part in others else learn)
        t, first, placed = place_jumps(task, part, step, traced[part[0]], value)
        signs = signs_of_rows(*part, t, first, placed.astype(np.int8))
        signed[part[0]] = with_signs(part[0], signs)
        if part in learn:
            expected[part[0]] = with_signs(part[0], expect_signs(task, part, value, inferred.refined.sigma, signs))
    whole, learning = session.exchange(signed), session.exchange(signed | expected)
    notes = (*_notes(observed, inferred), *_unused(observed, learn))
    return Recovered(whole, learning, _result(session, observed, inferred, notes, tuple(traced.values()), method))


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


def _traces(observed: Observed, parts: Sequence[Part], refined: RefinedSigns) -> dict[Recording, Trace]:
    """Per recording, its thinned samples with the signs found."""
    predicted, found = observed.predict(refined.value), {}
    for k, (recording, _) in enumerate(parts):
        at = observed.part == k
        found[recording] = Trace(
            path=recording.path,
            t=observed.t[at],
            first=np.flatnonzero(observed.first[at]),
            magnitude=np.where(observed.known, np.abs(observed.torque[at]), np.nan),
            signs=refined.signs[at],
            predicted=predicted[at],
            origin=time_origin(recording),
        )
    return found


def _result(
    session: Session,
    observed: Observed,
    inferred: Inferred,
    notes: tuple[str, ...],
    traces: tuple[Trace, ...],
    method: str,
) -> Signs:
    each = zip(inferred.segments, inferred.signs.tolist(), inferred.confidence.tolist(), strict=True)
    part, t = observed.part.tolist(), observed.t.tolist()
    segments = sorted(
        SignSegment(part[start], joint, t[start], t[stop - 1], int(sign), confidence)
        for (joint, start, stop), sign, confidence in each
    )
    return Signs(
        joints=observed.joints,
        hidden=observed.hidden,
        method=method,
        segments=tuple(segments),
        threshold=inferred.threshold,
        proof=inferred.proof,
        flags=raise_flags(observed, inferred),
        notes=notes,
        value=inferred.refined.value,
        noise=inferred.refined.sigma,
        inflation=inferred.inflation,
        traces=traces,
        seed=session.options.seed,
    )


def _notes(observed: Observed, inferred: Inferred) -> tuple[str, ...]:
    notes = [*inferred.notes]
    if inferred.finer:
        notes.append(
            "segments above the threshold hid changes of sign: stretches between low minima were searched instead"
        )
    for joint, count in inferred.impure.items():
        segments = "1 segment" if count == 1 else f"{count} segments"
        notes.append(f"{observed.joints[joint]}: {segments} cut at a change of sign of the torque inside")
    return tuple(notes)


def _unused(observed: Observed, parts: Sequence[Part]) -> tuple[str, ...]:
    """A note on signs that some recordings have and others lack."""
    some = [observed.joints[j] for j in observed.hidden if any(recording.signed[j] for recording, _ in parts)]
    note = f"signs of {shorten(some)}, which some recordings have, were not used: other recordings lack them"
    return (note,) if some else ()
