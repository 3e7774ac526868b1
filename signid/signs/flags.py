"""Flags: sentences that say when inferred signs are unreliable, and what to do."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..errors import shorten
from ..types import Indices
from .infer import Inferred
from .observations import Observed
from .search.local_search import ascend
from .search.problem import friction_patterns
from .thresholds import (
    COARSE_STEP,
    CORRELATED_RESIDUAL,
    FLIP_PROBABILITY,
    IMPURE_SHARE,
    INVISIBLE_BODIES,
    LARGE_RESIDUAL,
    NEAR_OFFSET_LIMIT,
    OFFSET_DEVIATIONS,
    OFFSET_LIMIT,
    RIVAL_WINDOW,
    UNSETTLED_CHANGE,
)


def raise_flags(observed: Observed, inferred: Inferred) -> tuple[str, ...]:
    """One sentence for each reason why the signs are unreliable; empty if there is none."""
    return (
        *_unproved(inferred),
        *_unsettled(inferred),
        *_undecided(observed, inferred),
        *_large_offset(observed, inferred),
        *_invisible_bodies(observed, inferred),
        *_unexplained(observed, inferred),
        *_coarse(observed),
        *_impure(observed, inferred),
    )


def _unproved(inferred: Inferred) -> Iterator[str]:
    proof = inferred.proof
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


def _unsettled(inferred: Inferred) -> Iterator[str]:
    refined = inferred.refined
    if refined.change > UNSETTLED_CHANGE:
        yield (
            f"signs and parameters had not settled after {refined.rounds} rounds of refinement (the last one changed "
            f"the torque by {100 * refined.change:.2g} %), so signs of small torques may be wrong"
        )


def _undecided(observed: Observed, inferred: Inferred) -> Iterator[str]:
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


def _large_offset(observed: Observed, inferred: Inferred) -> Iterator[str]:
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


def _invisible_bodies(observed: Observed, inferred: Inferred) -> Iterator[str]:
    """Joints with hardly any rigid-body torque, whose friction signs are nearly as good as rivals or the reverse."""
    problem, bodies = inferred.problem, inferred.refined.value.copy()
    bodies[list(observed.coefficients)] = 0.0
    share = np.std(observed.predict(bodies), axis=0) / observed.scale
    signs = np.append(inferred.signs, np.ones(problem.count - len(inferred.signs)))
    for pattern in friction_patterns(problem, observed, inferred.segments):
        own = pattern != 0
        joint = int(problem.joints[own][0])
        others = ascend(problem, np.where(own, [signs * pattern, -signs * pattern], signs), joints=False)
        rivals = [problem.loss(other) for other in others if np.any(other[own] != signs[own])]
        if share[joint] < INVISIBLE_BODIES and min(rivals, default=np.inf) < problem.loss(signs) + RIVAL_WINDOW:
            yield (
                f"the torque of {observed.joints[joint]} shows nothing of the robot's bodies, so Coulomb friction and "
                f"an offset explain it equally well and the signs rest on the prior that friction is larger; "
                f"accelerate harder, and check that the column holds the measured torque"
            )


def _unexplained(observed: Observed, inferred: Inferred) -> Iterator[str]:
    share = inferred.refined.sigma / observed.scale
    bad = [j for j in observed.hidden if share[j] > LARGE_RESIDUAL and inferred.inflation[j] > CORRELATED_RESIDUAL]
    if bad:
        names = ", ".join(f"{observed.joints[j]} ({100 * share[j]:.0f} %)" for j in bad)
        yield (
            f"the model leaves much of the torque unexplained at {names}, and the residual is not noise, so missing "
            f"physics may have inverted signs; try more laws (--effects) or a higher --cutoff"
        )


def _coarse(observed: Observed) -> Iterator[str]:
    for joint in observed.hidden:
        levels = np.unique(np.abs(observed.torque[:, joint]))
        step = float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0
        if len(levels) < len(observed) / 4 and step > COARSE_STEP * observed.scale[joint]:
            yield (
                f"the torque of {observed.joints[joint]} is recorded in steps of {step:.2g} {observed.units[joint]}, "
                f"{100 * step / observed.scale[joint]:.0f} % of its rms, so signs of small torques cannot be inferred; "
                f"record it at a finer resolution"
            )


def _impure(observed: Observed, inferred: Inferred) -> Iterator[str]:
    joints: Indices = np.array([s.joint for s in inferred.segments])
    for joint, count in inferred.impure.items():
        if count > IMPURE_SHARE * max(int(np.sum(joints == joint)), 1):
            yield (
                f"the torque of {observed.joints[joint]} changes its sign within {count} of its segments, so signs "
                f"near these changes may be wrong; record faster"
            )
