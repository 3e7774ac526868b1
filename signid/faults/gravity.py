"""Evidence -> gravity that the recordings show, where it is another one than that of the description.

With the inertials of the description, the torque of gravity is linear in its vector: three columns, one for each axis
of the root link. Errors of the inertials change the size of this torque more than its dependence on the posture, so a
factor on the predicted torque of each joint is free, as in all fits of recording faults, and the size of gravity stays.
What remains is a direction, or no gravity at all, and is compared with the given gravity.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..robot import with_gravity
from ..robot.joints import gravity_text, root_link
from ..types import Array, Frozen, Mask
from .distortions import axis_words, descend, nats, thinned
from .evidence import (
    MIN_AGREED,
    Correction,
    FaultEvidence,
    Signals,
    covariances,
    far_better,
    fit_passive,
    informative_torques,
    unexplained,
)
from .result import WARN, RecordingFault, named, percent

UPRIGHT = 1.0  # [degrees] largest angle to an upright or level base that is called so
STANDARD = 9.81  # [m/s2] size of gravity if the given one is zero
FLOOR = 0.03  # [1] smallest residual that counts in the weight of a joint, over the joint's torque
VISIBLE = 0.03  # [1] smallest torque of gravity in some direction, over the joints' torque, that shows it
# [rad] smallest angle to the given gravity. Measured on five real arms: 0 to 4 degrees; 14 with three joints at rest.
# Diagnosis has a law for smaller tilts
TILT = np.radians(12.0)
STEPS = tuple(np.radians((24.0, 12.0, 6.0, 3.0, 1.5, 0.7, 0.3)))  # [rad] steps of the search for the direction
AXIS = np.radians(8.0)  # [rad] largest angle to an axis of the root link that inertial errors can explain; heuristic
SNAP = 0.5  # [nats] largest loss by taking the axis; heuristic
# [nats] smallest reduction of the log unexplained shares; [1] largest unexplained share after it, in the median of the
# improved joints. Measured: 4.8 nats and more on simulated arms whose links have errors of 15 %; at most 0.7 on healthy
# real arms, and 2.4 on a dVRK whose description lacks masses
LEAST_GAIN, GOOD = 3.0, 0.1
FINEST = 1e-4  # [1] unexplained share of a joint that the search for the direction does not reduce further
# [1] smallest weight on a joint, over the largest one, that counts; largest share of it in torque without weight, and
# its range in torque with weight. Measured: 0.43 to 2.1 on healthy real arms, -0.25 to 0 on a dVRK without masses
HEAVY, BARE, WHOLE = 0.1, 0.15, (0.5, 2.0)
PROMISING = 0.5  # [nats] improvement by some coarse direction from which on the search goes on


@dataclass(frozen=True, eq=False)
class GravityEstimate(Frozen):
    """Gravity that explains the torque far better than the given one."""

    value: Array  # (3,) [m/s2] in the frame of the root link; zeros: the torque carries no weight
    std: Array  # (3,) [m/s2] of `value`: scatter over the blocks, and the difference from the free estimate
    before: float  # [1] mean unexplained share of the improved joints
    after: float  # [1] the same with this gravity
    agreement: float  # [1] share of the blocks in which it improves the fit
    left: float  # [nats] log unexplained shares of all informative joints
    gain: float  # [nats] by which they are less than with the given gravity
    hidden: bool  # whether gravity along some direction of the root link shows in no torque
    single: bool  # whether a single joint shows it

    @property
    def weightless(self) -> bool:
        """Whether the torque carries no weight."""
        return not self.value.any()


@lru_cache(maxsize=2)
def gravity_columns(evidence: FaultEvidence) -> Array:
    """Torque (K, n, 3) of unit gravity along each axis of the root link [kg.m or kg]."""
    return np.stack([_weight(evidence, axis) for axis in np.eye(3)], axis=-1)


def _weight(evidence: FaultEvidence, gravity: Array) -> Array:
    """Torque (K, n) [N.m or N] of gravity: (3,) [m/s2]."""
    motion = evidence.along(Correction.none(len(evidence.signed)))
    return replace(motion, robot=replace(evidence.robot, model=evidence.model.bodies())).gravity_torque(gravity)


def under_gravity(evidence: FaultEvidence, gravity: Array, columns: Array | None = None) -> FaultEvidence:
    """Evidence with the model in a field of gravity: (3,) [m/s2]; columns: (K, n, 3) [kg.m or kg] if known."""
    columns = gravity_columns(evidence) if columns is None else columns
    model = replace(evidence.model, robot=with_gravity(evidence.robot, gravity))
    change = model.bodies().gravity.linear - evidence.model.bodies().gravity.linear
    plain = evidence.plain._replace(predicted=evidence.plain.predicted + columns @ change)
    return replace(evidence, model=model, plain=plain)


@lru_cache(maxsize=2)
def find_gravity(evidence: FaultEvidence) -> GravityEstimate | None:
    """Find another gravity than the given one."""
    informative = informative_torques(evidence.plain, evidence.signed)
    stated, few = np.array(evidence.model.robot.model.gravity.linear), thinned(evidence)[0]
    bare = stated.any() and (weights := weigh(evidence)).bare.any() and np.array_equal(weights.bare, weights.strong)
    left, least = (nats(x, informative, FINEST) for x in (unexplained(few.plain), np.zeros(len(informative))))
    if not bare and left - least < PROMISING:
        return None  # nothing is left that another direction could explain
    columns = gravity_columns(evidence)
    before, strength = evidence.plain, np.zeros((3, 3))
    for j in np.flatnonzero(evidence.signed & (np.std(before.torque, axis=0) > 0)):
        shown = STANDARD * (columns[:, j] - columns[:, j].mean(axis=0)) / np.std(before.torque[:, j])
        strength += shown.T @ shown / len(shown)
    sizes, directions = np.linalg.eigh(strength)
    axes = np.asarray(directions.T[sizes >= VISIBLE**2])  # (k, 3) of gravity that show in the torque, orthonormal
    if not len(axes):
        return None
    if bare:
        value = np.zeros(3)  # compared with the given weight as it is: a factor of zero would hide it
        load = columns @ stated
        before = before._replace(predicted=before.predicted - load, torque=before.torque - load)
    elif (best := _best(evidence, informative, stated, columns)) is not None and _angle(best, stated) >= TILT:
        value = best
    else:
        return None
    return _judged(evidence, informative, before, columns, axes, value)


def _judged(
    evidence: FaultEvidence, informative: Mask, stated: Signals, columns: Array, axes: Array, value: Array
) -> GravityEstimate | None:
    """Compare a gravity: (3,) [m/s2] with signals under the given one; None if it is not far better."""
    turned = under_gravity(evidence, value, columns)
    power = np.maximum(np.var(evidence.plain.torque, axis=0), 1e-300)
    squares = [fit_passive(x).residual[:, :, 0].T ** 2 / power for x in (stated, turned.plain)]
    before, after = (np.minimum(square.mean(axis=0), 1.0) for square in squares)
    betters, left = far_better(before, after, informative), nats(after, informative)
    gain = nats(before, informative) - left
    if gain < LEAST_GAIN or not len(betters) or np.median(after[betters]) > GOOD:
        return None
    blocks = [[x[evidence.block == k][:, betters].sum() for k in np.unique(evidence.block)] for x in squares]
    agreement = float(np.mean(np.less(blocks[1], blocks[0])))
    if agreement < MIN_AGREED:
        return None
    # Jackknife: Efron, The Jackknife, the Bootstrap and Other Resampling Plans, SIAM, 1982, chapter 3
    x, shown = turned.plain, np.moveaxis(columns @ axes.T, 2, 0)
    signals = (x.predicted - columns @ value, x.v, x.direction, x.a, *shown, x.torque)
    whole, *without = (_linear(turned, axes, value, part) for part in covariances(signals, evidence.block))
    scatter = np.sqrt((len(without) - 1) * np.var(without, axis=0))  # of linear estimates over the blocks
    return GravityEstimate(
        value,
        np.hypot(scatter, whole - value),
        float(before[betters].mean()),
        float(after[betters].mean()),
        agreement,
        left,
        gain,
        hidden=len(axes) < 3,
        single=int(informative.sum()) < 2,
    )


class Weights(NamedTuple):
    """Share of the description's weight that the torque of each joint carries."""

    share: Array  # (n,) [1] by least squares; 0 where the torque does not show it
    strong: Mask  # (n,) joints with so much weight, and torque that is explained so well, that the share counts
    bare: Mask  # (n,) those of them whose torque carries none

    @property
    def only(self) -> Mask:
        """Mask (n,) of joints without weight in their torque, where that of as many others carries it."""
        usual = self.strong & (self.share >= WHOLE[0]) & (self.share <= WHOLE[1])
        return self.bare if usual.sum() >= self.bare.sum() else np.zeros_like(self.bare)


@lru_cache(maxsize=2)
def weigh(evidence: FaultEvidence) -> Weights:
    """Estimate the share of the weight in each joint's torque, beside inertial torque, friction, rotor and offset."""
    x, n = evidence.plain, len(evidence.signed)
    load = _weight(evidence, np.array(evidence.model.bodies().gravity.linear))
    inertial, deviation = x.predicted - load, np.std(load, axis=0)
    share, strong, bare = np.zeros(n), np.zeros(n, dtype=bool), np.zeros(n, dtype=bool)
    moments = covariances((inertial, x.v, x.direction, x.a, load, x.torque), evidence.block)
    heavy = evidence.signed & (deviation > HEAVY * deviation.max()) & (np.std(x.torque, axis=0) > 0)
    for j in np.flatnonzero(heavy).tolist():
        products = _beyond_inertia(moments[:, j]) / np.var(x.torque[:, j])
        if products[0][0, 0] >= VISIBLE**2:
            shares = np.array([gram[0, 1] / max(gram[0, 0], 1e-300) for gram in products])
            spread = float(np.sqrt((len(shares) - 2) * np.var(shares[1:])))
            share[j], strong[j] = shares[0], products[0][1, 1] - shares[0] ** 2 * products[0][0, 0] <= GOOD
            bare[j] = strong[j] and abs(shares[0]) + 2 * spread <= BARE
    return Weights(share, strong, bare)


def _beyond_inertia(moments: Array) -> Array:
    """Covariances (S, k, k) of k signals of a joint after inertial torque, friction and rotor.

    moments: (S, 4 + k, 4 + k), in S subsets of the rows, of inertial torque, friction, rotor, and the k signals.
    """
    size = np.sqrt(np.maximum(np.diagonal(moments, axis1=1, axis2=2), 1e-300))[:, :4, None]
    inner = np.linalg.pinv(moments[:, :4, :4] / (size * size.swapaxes(1, 2)), 1e-12, True)
    across = moments[:, :4, 4:] / size
    return np.asarray(moments[:, 4:, 4:] - across.swapaxes(1, 2) @ inner @ across)


def _best(evidence: FaultEvidence, informative: Mask, gravity: Array, columns: Array) -> Array | None:
    """Gravity (3,) [m/s2] of the direction that explains most, or of the axis near it; None: about the given one."""
    few, rows = thinned(evidence)
    few_columns, size = columns[rows], float(np.linalg.norm(gravity)) or STANDARD

    def score(value: Array) -> float:
        return nats(unexplained(under_gravity(few, size * value, few_columns).plain), informative, FINEST)

    stated = score(gravity / size)
    corners = np.array([[x, y, z] for x in (1, -1) for y in (1, -1) for z in (1, -1)]) / np.sqrt(3)
    starts = [*np.eye(3), *-np.eye(3), *corners]
    starts += _around(gravity / size, TILT) if gravity.any() else []
    scores = [score(u) for u in starts]
    if min(scores) > stated - PROMISING:
        return None
    direction, left = descend(score, starts[int(np.argmin(scores))], _around, STEPS)
    largest = int(np.argmax(np.abs(direction)))
    axis = np.sign(direction[largest]) * np.eye(3)[largest]  # of the root link
    near = _angle(direction, axis) <= AXIS and axis.any()
    return size * (axis if near and score(axis) <= left + SNAP else direction) + 0.0


def _around(direction: Array, angle: float) -> list[Array]:
    """Four unit vectors at an angle [rad] around a direction."""
    across = np.linalg.svd(direction[None])[2][1:]
    sides = (across[0], -across[0], across[1], -across[1])
    return [np.cos(angle) * direction + np.sin(angle) * side for side in sides]


def _angle(a: Array, b: Array) -> float:
    """Angle [rad] between two vectors; pi if one is zero, 0 if both are."""
    size = float(np.linalg.norm(a) * np.linalg.norm(b))
    return float(np.arccos(np.clip(a @ b / size, -1.0, 1.0))) if size else np.pi * bool(a.any() or b.any())


def _linear(evidence: FaultEvidence, axes: Array, value: Array, moments: Array) -> Array:
    """Gravity (3,) [m/s2] by least squares, of the size of `value`: (3,) [m/s2] if that is not zero.

    moments: (n, 5 + k, 5 + k) of the columns of `_beyond_inertia`, of torque along each of the k axes, and of torque.
    """
    gram, right, along = np.zeros((len(axes), len(axes))), np.zeros(len(axes)), axes @ value
    variance = np.var(evidence.plain.torque, axis=0)
    for j in np.flatnonzero(evidence.signed & (variance > 0)).tolist():
        both = _beyond_inertia(moments[[j]])[0] / variance[j]
        free, torque = both[:-1, :-1], both[:-1, -1]
        shown, least = float(along @ free @ along), VISIBLE**2  # a joint that hardly shows gravity has no own factor
        gain = max(float(along @ torque) + least, 0.0) / (shown + least) if value.any() else 1.0
        weight = 1 / max(float(both[-1, -1] - 2 * gain * along @ torque + gain**2 * shown), FLOOR**2)
        gram, right = gram + weight * gain**2 * free, right + weight * gain * torque
    linear = axes.T @ np.linalg.lstsq(gram, right, rcond=1e-9)[0] + value - axes.T @ (axes @ value)
    size = float(np.linalg.norm(value))
    return np.asarray(linear * (size / max(float(np.linalg.norm(linear)), 1e-300)) if size else linear)


def gravity_fault(found: GravityEstimate, rivals: Sequence[RecordingFault], evidence: FaultEvidence) -> RecordingFault:
    """Finding that gravity acts otherwise than the description says, or that the torque carries no weight."""
    robot, blocks = evidence.robot, len(np.unique(evidence.block))
    words = ",".join(f"{x + 0.0:.4g}" for x in found.value)
    gain = f"model and friction explain {percent(1 - found.after)} of the torque instead of {percent(1 - found.before)}"
    better = f"better in {round(found.agreement * blocks)} of {blocks} blocks of the recordings"
    others = [rival.sentence.partition(":")[0] for rival in rivals]
    if found.single:
        others.append(f"another zero or first moment of {robot.joints[int(np.argmax(evidence.signed))]}")
    if found.weightless and found.hidden:
        others.append("gravity along an axis that no joint feels")
    equally = f" (equally likely: {'; '.join(others)})" if others else ""
    if found.weightless:
        fact, how = "the recorded torque carries no weight of the robot", "without gravity"
        advice = f"log the whole torque, or state it with --gravity {words}; masses are not identifiable from it"
    else:
        along = f"{axis_words(found.value) or 'the direction'} of {root_link(robot)} {gravity_text(found.value)}"
        # how the robot stands in a field of gravity in the frame of its root link, whose z points up
        angle = float(np.degrees(np.arccos(np.clip(-found.value[2] / np.linalg.norm(found.value), -1.0, 1.0))))
        mountings = ((0.0, "stands upright"), (90.0, "is mounted on its side"), (180.0, "hangs upside down"))
        upright = next((f"the robot {words}" for middle, words in mountings if abs(angle - middle) < UPRIGHT), "")
        mounting = upright or f"its base is inclined by {angle:.0f} degrees"
        fact, how = f"gravity acts along {along}: {mounting}", "with it"
        advice = f"state it with --gravity {words}"
    measures = dict(zip(("x", "y", "z", "std_x", "std_y", "std_z"), (*found.value, *found.std), strict=True))
    measures |= {"explained_before": 1 - found.before, "explained_after": 1 - found.after, "gain": found.gain}
    measures |= {"agreement": found.agreement, "single": float(found.single)}
    kinds = tuple((rival.kind, rival.joints) for rival in rivals)
    return RecordingFault("gravity", (), WARN, measures, f"{fact}; {how}, {gain} ({better}){equally}; {advice}", kinds)


def weight_fault(joints: Sequence[str]) -> RecordingFault:
    """Fault of torque of some joints that carries no weight, although that of others does."""
    fact = f"the torque of {named(joints)} carries no weight of the links, although that of other joints does"
    why = "its drive, a spring or a counterweight compensates it, so masses are not identifiable from it"
    return RecordingFault("weight", tuple(joints), WARN, {}, f"{fact}: {why}; log the whole torque")
