"""Recordings -> recordings with signs, and the flags of what makes them unreliable."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..deadline import steps_shown
from ..errors import OptionError, RecordingError, shorten
from ..recording import with_signs
from ..recording.sampling import time_origin
from ..regression.factors import Factors
from ..regression.session import Options, Part, Session, prepare, rearrange
from ..types import BaseMap, Estimate, Indices, Progress, Recording, Robot
from .branch_and_bound import OFFSET_LIMIT
from .exact import ascend
from .infer import MAX_RESIDUAL_KAPPA, MAX_RESIDUAL_SHARE, RIVAL_WINDOW, InferredSigns, infer
from .observations import Observations, observe, thinning
from .problem import friction_patterns
from .result import Signs, SignSegment, Trace
from .samples import RefinedSigns, expect_signs, place_jumps, refine_signs, signs_of_rows
from .torque_constants import TorqueConstants, constant_sensitivity, find_gains
from .tree import by_tree

FLIP_PROBABILITY = 1e-3  # [1] that all signs of a joint are inverted; the complement of CERTAIN_CONFIDENCE
NEAR_OFFSET_LIMIT = 0.95  # [OFFSET_LIMIT] an offset so close to its limit may be friction of the wrong sign; heuristic
OFFSET_DEVIATIONS = 2.0  # [standard deviations] by which an offset must exceed that; about 95 % of a normal law
MIN_BODY_TORQUE = 0.02  # [rms torque] standard deviation of the rigid-body torque that noise hides; heuristic
MAX_RESOLUTION_STEP = 0.15  # [rms torque] resolution; simulations: 98 % of the segments right at 0.1, 84 % at 0.3
IMPURE_SHARE = 0.1  # [1] of a joint's segments in which torque changed its sign; heuristic
MAX_ROUND_CHANGE = 1e-3  # [1] relative change of the parameters in the last round of refinement; heuristic
SIGN_METHODS = ("exact", "tree")


def raise_flags(observed: Observations, inferred: InferredSigns) -> tuple[str, ...]:
    """One sentence for each reason why the signs are unreliable; empty if there is none."""
    return (
        *_unfinished(inferred),
        *_undecided(observed, inferred),
        *_large_offset(observed, inferred),
        *_invisible_bodies(observed, inferred),
        *_unexplained(observed, inferred),
        *_coarse(observed),
        *_impure(observed, inferred),
    )


def _unfinished(inferred: InferredSigns) -> Iterator[str]:
    proof, refined = inferred.proof, inferred.refined
    if not proof.optimal:
        bound = f"gap {proof.gap:.2g}" if proof.has_bound else "no bound was proved"
        yield (
            f"the signs are the best that were found, not proved to be optimal ({bound}), so other signs may fit "
            f"better; do not take them for measured"
        )
    elif not inferred.complete:
        yield (
            "too many other signs are nearly as good as the best to be enumerated, so confidences may be too high; do "
            "not take the signs for measured"
        )
    if refined.change > MAX_ROUND_CHANGE:
        yield (
            f"signs and parameters had not settled after {refined.rounds} rounds of refinement (the last one changed "
            f"the torque by {100 * refined.change:.2g} %), so signs of small torques may be wrong"
        )


def _undecided(observed: Observations, inferred: InferredSigns) -> Iterator[str]:
    joints = [joint for joint, share in inferred.flip_probability.items() if share > FLIP_PROBABILITY]
    if not joints:
        return
    names, worst = shorten([observed.joints[j] for j in joints]), max(inferred.flip_probability[j] for j in joints)
    acceleration = np.gradient(observed.v, observed.period, axis=0)
    rms = [np.sqrt(np.mean(acceleration[:, j] ** 2)) for j in joints]
    fastest = int(np.argmax(rms))
    unit = "m/s2" if observed.units[joints[fastest]] == "N" else "rad/s2"
    others = len(observed.hidden) > 1 and len(joints) < len(observed.hidden)
    together = ", together with the other joints," if others else ""
    yield (
        f"the sign of the torque of {names} is not decided: inverted as a whole it explains the recording nearly as "
        f"well (probability {worst:.2g}); record a motion in which it{together} accelerates "
        f"harder (now {rms[fastest]:.2g} {unit} rms) and reverses more often, as one of `signid excite`, since inertia "
        f"is positive and friction brakes"
    )


def _large_offset(observed: Observations, inferred: InferredSigns) -> Iterator[str]:
    place = {law: k for k, law in observed.coefficients.items()}
    std = np.linalg.norm(inferred.problem.back, axis=1)  # of the base parameters
    for joint in observed.hidden:
        k, i = (place.get((name, joint)) for name in ("torque_offset", "coulomb_friction"))
        if k is None or i is None:
            continue
        offset, friction = inferred.refined.value[[k, i]]
        excess = abs(offset) - NEAR_OFFSET_LIMIT * OFFSET_LIMIT * max(friction, 0.0)
        if excess > OFFSET_DEVIATIONS * (std[k] + std[i]):
            yield (
                f"the torque offset of {observed.joints[joint]} ({offset:.2g} {observed.units[joint]}) is large "
                f"compared with its Coulomb friction ({friction:.2g} {observed.units[joint]}), as if friction had the "
                f"wrong sign; move the joint in both directions, at many speeds"
            )


def _invisible_bodies(observed: Observations, inferred: InferredSigns) -> Iterator[str]:
    """Joints with hardly any rigid-body torque, whose friction signs are nearly as good as rivals or the reverse."""
    problem, bodies = inferred.problem, inferred.refined.value.copy()
    bodies[list(observed.coefficients)] = 0.0
    share = np.std(observed.predict(bodies), axis=0) / observed.scale
    signs = np.append(inferred.signs, np.ones(problem.count - len(inferred.signs)))
    for pattern in friction_patterns(problem, observed, inferred.segments):
        nonzero = pattern != 0
        joint = int(problem.joints[nonzero][0])
        others = ascend(problem, np.where(nonzero, [signs * pattern, -signs * pattern], signs), joints=False)
        rivals = [problem.loss(other) for other in others if np.any(other[nonzero] != signs[nonzero])]
        if share[joint] < MIN_BODY_TORQUE and min(rivals, default=np.inf) < problem.loss(signs) + RIVAL_WINDOW:
            yield (
                f"the torque of {observed.joints[joint]} shows nothing of the robot's bodies, so Coulomb friction and "
                f"an offset explain it equally well and the signs rest on the prior that friction is larger; "
                f"accelerate harder, and check that the column holds the measured torque"
            )


def _unexplained(observed: Observations, inferred: InferredSigns) -> Iterator[str]:
    share = inferred.refined.sigma / observed.scale
    bad = [j for j in observed.hidden if share[j] > MAX_RESIDUAL_SHARE and inferred.inflation[j] > MAX_RESIDUAL_KAPPA]
    if bad:
        names = ", ".join(f"{observed.joints[j]} ({100 * share[j]:.0f} %)" for j in bad)
        yield (
            f"the model leaves much of the torque unexplained at {names}, and the residual is not noise, so missing "
            f"physics may have inverted signs; try more laws (--effects) or a higher --cutoff"
        )


def _coarse(observed: Observations) -> Iterator[str]:
    for joint in observed.hidden:
        levels = np.unique(np.abs(observed.torque[:, joint]))
        step = float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0
        if len(levels) < len(observed) / 4 and step > MAX_RESOLUTION_STEP * observed.scale[joint]:
            yield (
                f"the torque of {observed.joints[joint]} is recorded in steps of {step:.2g} {observed.units[joint]}, "
                f"{100 * step / observed.scale[joint]:.0f} % of its rms, so signs of small torques cannot be inferred; "
                f"record it at a finer resolution"
            )


def _impure(observed: Observations, inferred: InferredSigns) -> Iterator[str]:
    joints: Indices = np.array([s.joint for s in inferred.segments])
    for joint, count in inferred.impure.items():
        if count > IMPURE_SHARE * max(int(np.sum(joints == joint)), 1):
            yield (
                f"the torque of {observed.joints[joint]} changes its sign within {count} of its segments, so signs "
                f"near these changes may be wrong; record faster"
            )


@dataclass(frozen=True)
class Recovered:
    """A session with signed torque, and what is known about the signs that were found."""

    session: Session
    learning: Session  # its training torque with expected signs: a fit to it has no bias
    signs: Signs | None = None  # None where every torque had its sign
    gains: TorqueConstants | None = None  # torque constants that were not known

    def widen(self, estimate: Estimate, factors: Factors, base: BaseMap, whiten: bool) -> Estimate:
        """The estimate with the uncertainty of the torque constants that were found."""
        if self.gains is None:
            return estimate
        covariance = self.gains.covariance
        slopes = constant_sensitivity(estimate, factors, base, np.diag(covariance) > 0, whiten)
        return replace(estimate, covariance=estimate.covariance + slopes @ covariance @ slopes.T)

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
    whole = (*recordings, *held_out)
    known = all(r.signed.all() and (r.scaled is None or r.scaled.all()) for r in whole)
    chosen = options if known or unsigned is None else unsigned
    return recover(prepare(robot, recordings, held_out, chosen, scaled=False), method=method, progress=progress)


def recover(session: Session, *, method: str = "exact", progress: Progress | None = None) -> Recovered:
    """The session with the signs of all torques, which needs laws of friction among its effects.

    Signs are searched in the recordings of which at least a part is learned from, whole. Those of other recordings
    follow from the model that the search found. Torque constants that are not known are found first. The method is
    `exact`, proved by branch and bound within physics, or `tree`, the classical tree of sign choices.

    Raises:
        OptionError: there is no such method, or a torque constant is neither known nor identifiable.
        RecordingError: only some recordings have the torque of a joint.
    """
    if method not in SIGN_METHODS:
        raise OptionError(f"signs {method!r} is none of {', '.join(SIGN_METHODS)}")
    unscaled = any(recording.scaled is not None for recording in session.recordings)
    gains = find_gains(session, progress) if unscaled else None
    if gains is not None:
        recovered = recover(
            session.exchange({r: gains.scale(r) for r in session.recordings}), method=method, progress=progress
        )
        return replace(recovered, signs=recovered.signs and gains.describe(recovered.signs), gains=gains)
    if session.signed:
        return Recovered(session, session)
    task, learn, seed = session.task, session.learned, session.options.seed
    recordings = [recording for recording, _ in learn]
    for j, joint in enumerate(recordings[0].joints):
        has = [bool(r.columns["tau"][j]) for r in recordings]
        if any(not r.signed[j] for r in recordings) and not all(has):
            one = recordings[has.index(True)].path or "one recording"
            other = recordings[has.index(False)].path or "another"
            raise RecordingError(
                f"{one} has torque of {joint}, {other} has none; where signs are lost, use recordings with torque of "
                f"the same joints together, or leave the column out"
            )
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
    notes = [*_sign_notes(observed, inferred)]
    if unused := [observed.joints[j] for j in observed.hidden if any(recording.signed[j] for recording, _ in learn)]:
        notes.append(
            f"signs of {shorten(unused)}, which some recordings have, were not used: other recordings lack them"
        )
    return Recovered(whole, learning, _result(session, observed, inferred, notes, tuple(traced.values()), method))


def _traces(observed: Observations, parts: Sequence[Part], refined: RefinedSigns) -> dict[Recording, Trace]:
    """Per recording, its thinned samples with the signs found."""
    predicted, traces = observed.predict(refined.value), {}
    for k, (recording, _) in enumerate(parts):
        at = observed.part == k
        traces[recording] = Trace(
            path=recording.path,
            t=observed.t[at],
            first=np.flatnonzero(observed.first[at]),
            magnitude=np.where(observed.known, np.abs(observed.torque[at]), np.nan),
            signs=refined.signs[at],
            predicted=predicted[at],
            origin=time_origin(recording),
        )
    return traces


def _result(
    session: Session,
    observed: Observations,
    inferred: InferredSigns,
    notes: Sequence[str],
    traces: tuple[Trace, ...],
    method: str,
) -> Signs:
    found_signs = zip(inferred.segments, inferred.signs.tolist(), inferred.confidence.tolist(), strict=True)
    part, t = observed.part.tolist(), observed.t.tolist()
    segments = sorted(
        SignSegment(part[start], joint, t[start], t[stop - 1], int(sign), confidence)
        for (joint, start, stop), sign, confidence in found_signs
    )
    return Signs(
        joints=observed.joints,
        hidden=observed.hidden,
        method=method,
        segments=tuple(segments),
        threshold=inferred.threshold,
        proof=inferred.proof,
        flags=raise_flags(observed, inferred),
        notes=tuple(notes),
        value=inferred.refined.value,
        noise=inferred.refined.sigma,
        inflation=inferred.inflation,
        traces=traces,
        seed=session.options.seed,
    )


def _sign_notes(observed: Observations, inferred: InferredSigns) -> tuple[str, ...]:
    notes = [*inferred.notes]
    if inferred.finer:
        notes.append(
            "segments above the threshold hid changes of sign: stretches between low minima were searched instead"
        )
    for joint, count in inferred.impure.items():
        segments = "1 segment" if count == 1 else f"{count} segments"
        notes.append(f"{observed.joints[joint]}: {segments} cut at a change of sign of the torque inside")
    return tuple(notes)
