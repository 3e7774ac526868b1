"""What was inferred -> sentences on when not to trust it, and what motion would decide."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...errors import shorten
from ...regression.rows import Task
from ...types import Indices, Robot
from ..inferred import SUSPECT, SYSTEMATIC, Inferred
from ..rows.observations import Observed, law_coefficients
from ..search.cone import RECTIFIED
from ..search.friction import friction_patterns
from ..search.local_search import ascend
from .confidence import WINDOW

DOUBT = 1e-3  # probability that a joint's signs are all the other way round, at most
NEARLY = 0.95  # of the largest offset that the cone allows: one so large may be friction of the wrong sign
BARE = 0.02  # rms of what bodies and rotors add to the torque, over its rms, below which they do not show
COARSE = 0.15  # steps of the recorded torque over its rms
IMPURE = 0.1  # share of a joint's segments in which torque changed its sign
MOVES = 1e-3  # relative change of the parameters in the last round of refinement, above which it had not settled
DEVIATIONS = 2.0  # standard deviations by which an offset must be beyond


def raise_flags(task: Task, observed: Observed, inferred: Inferred) -> tuple[str, ...]:
    """When the signs are not to be trusted, a sentence each; nothing where all is well."""
    return (
        *_unproved(inferred),
        *_unsettled(inferred),
        *_undecided(observed, inferred),
        *_rectified(task, observed, inferred),
        *_bare(task, observed, inferred),
        *_unexplained(observed, inferred),
        *_coarse(task.robot, observed),
        *_impure(observed, inferred),
    )


def _unproved(inferred: Inferred) -> Iterator[str]:
    proof = inferred.proof
    if not proof.optimal:
        told = f"gap {proof.gap:.2g}" if proof.has_bound else "nothing is proved of others"
        yield f"the signs are the best that were found, not proved to be the best there are ({told})"
    elif not inferred.complete:
        yield "more choices of signs are nearly as good as the best than could be counted: confidences may be too high"


def _unsettled(inferred: Inferred) -> Iterator[str]:
    refined = inferred.refined
    if refined.change > MOVES:
        yield (
            f"signs and parameters had not settled after {refined.rounds} rounds of refinement (the last one moved the "
            f"torque by {100 * refined.change:.2g} %): signs of small torques may be wrong"
        )


def _undecided(observed: Observed, inferred: Inferred) -> Iterator[str]:
    doubtful = [joint for joint, doubt in inferred.flip_probability.items() if doubt > DOUBT]
    if not doubtful:
        return
    names = shorten([observed.joints[j] for j in doubtful])
    worst = max(inferred.flip_probability[j] for j in doubtful)
    yield (
        f"the sign of the torque of {names} is not decided: turned round as a whole it explains the recording nearly "
        f"as well (probability {worst:.2g}); {_advice(observed, doubtful)}"
    )


def _advice(observed: Observed, joints: list[int]) -> str:
    """What motion would decide: inertia is positive and friction brakes, and other joints feel the torque."""
    acceleration = np.gradient(observed.v, observed.period, axis=0)
    fast = float(np.max([np.sqrt(np.mean(acceleration[:, j] ** 2)) for j in joints]))
    alone = len(observed.hidden) > 1 and len(joints) < len(observed.hidden)
    together = ", together with the other joints," if alone else ""
    return (
        f"a motion would decide in which it{together} accelerates harder (now {fast:.2g} rad/s2 rms) and reverses more "
        f"often, for inertia is positive and friction brakes; `signid excite` makes one"
    )


def _rectified(task: Task, observed: Observed, inferred: Inferred) -> Iterator[str]:
    place = {law: k for k, law in law_coefficients(task).items()}
    std = np.linalg.norm(inferred.problem.back, axis=1)  # of the base parameters, in variance units
    for joint in observed.hidden:
        k, i = (place.get((name, joint)) for name in ("torque_offset", "coulomb_friction"))
        if k is None or i is None:
            continue
        offset, friction = inferred.refined.value[[k, i]]
        if abs(offset) - NEARLY * RECTIFIED * max(friction, 0.0) > DEVIATIONS * (std[k] + std[i]):
            yield (
                f"the torque offset of {observed.joints[joint]} ({offset:.2g} {_unit(task.robot, joint)}) is large "
                f"beside its Coulomb friction ({friction:.2g} {_unit(task.robot, joint)}): friction of the wrong sign "
                f"looks like that; move it both ways, at many speeds"
            )


def _bare(task: Task, observed: Observed, inferred: Inferred) -> Iterator[str]:
    problem, bodies = inferred.problem, inferred.refined.value.copy()
    bodies[list(law_coefficients(task))] = 0.0
    share = np.std(observed.predict(bodies), axis=0) / observed.scale
    signs = np.append(inferred.signs, np.ones(problem.count - len(inferred.signs)))
    for move in friction_patterns(problem, observed, inferred.segments):
        own = move != 0
        joint = int(problem.joints[own][0])
        others = ascend(problem, np.where(own, [signs * move, -signs * move], signs), joints=False)
        rivals = [problem.loss(other) for other in others if np.any(other[own] != signs[own])]
        if share[joint] < BARE and min(rivals, default=np.inf) < problem.loss(signs) + WINDOW:
            yield (
                f"nothing of the robot's bodies shows in the torque of {observed.joints[joint]}: Coulomb friction and "
                f"an offset explain it alike, and its signs rest on the belief that friction is the larger; accelerate "
                f"harder, and make sure that the column holds what was measured"
            )


def _unexplained(observed: Observed, inferred: Inferred) -> Iterator[str]:
    share = inferred.refined.sigma / observed.scale
    bad = [j for j in observed.hidden if share[j] > SUSPECT and inferred.inflation[j] > SYSTEMATIC]
    if bad:
        told = ", ".join(f"{observed.joints[j]} ({100 * share[j]:.0f} %)" for j in bad)
        yield (
            f"the model leaves much of the torque unexplained, and not as noise, at {told}: physics that it lacks may "
            f"have turned signs round; try more laws (--effects) or a higher --cutoff"
        )


def _coarse(robot: Robot, observed: Observed) -> Iterator[str]:
    for joint in observed.hidden:
        levels = np.unique(np.abs(observed.torque[:, joint]))
        step = float(np.median(np.diff(levels))) if len(levels) > 1 else 0.0
        if len(levels) < len(observed) / 4 and step > COARSE * observed.scale[joint]:
            yield (
                f"the torque of {observed.joints[joint]} is recorded in steps of {step:.2g} {_unit(robot, joint)}, "
                f"{100 * step / observed.scale[joint]:.0f} % of its rms: too coarse to tell signs where it is small"
            )


def _impure(observed: Observed, inferred: Inferred) -> Iterator[str]:
    joints: Indices = np.array([s.joint for s in inferred.segments])
    for joint, count in inferred.impure.items():
        if count > IMPURE * max(int(np.sum(joints == joint)), 1):
            yield (
                f"the torque of {observed.joints[joint]} changes its sign within {count} of its segments: record faster"
            )


def _unit(robot: Robot, joint: int) -> str:
    return "N" if robot.prismatic[joint] else "N.m"
