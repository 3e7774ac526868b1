"""Fit of joints' torques by passive joints with the model's bodies, or with a law that the model lacks."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product
from typing import NamedTuple

import numpy as np

from ..regression.projection import leave
from ..robot.dynamics import own_body
from ..types import INERTIAL, Array, Indices, Mask
from .evidence import Correction, FaultEvidence, Signals

ROUNDING = 1e-12  # [1] rounding error over the largest number
# [1] smallest standard deviation of an informative torque, over that of the second strongest, and over its own rms
WEAK, STEADY = 0.03, 0.05


class PassiveFit(NamedTuple):
    """Fits of T torques of each of n joints: gain * predicted + friction + rotor + offset, no coefficient negative.

    Only the offset may be negative.
    """

    gain: Array  # (n, T) [1] factor on the predicted torque
    unexplained: Array  # (n, T) [1] residual variance over the torque's variance
    residual: Array  # (n, K, T) [N.m or N]
    power: Array  # (n, T) [N2.m2 or N2] variance of the torque


def fit_passive(x: Signals, torque: Array | None = None, predicted: bool = True, rotor: bool = True) -> PassiveFit:
    """Fit torques (n, K, T) [N.m or N], or the recorded ones (T = 1), by the columns of each joint.

    Columns are predicted torque, viscous and Coulomb friction, and a rotor; two of them can be left out.
    """
    used = [x.predicted] * predicted + [x.v, x.direction] + [x.a] * rotor
    columns = np.stack([signal.T for signal in used], axis=-1)
    columns = columns - columns.mean(axis=1, keepdims=True)
    size = np.maximum(np.linalg.norm(columns, axis=1), 1e-300)
    y = x.torque.T[:, :, None] if torque is None else torque
    y = y - y.mean(axis=1, keepdims=True)
    across = columns.swapaxes(1, 2)
    gram = across @ columns / (size[:, :, None] * size[:, None, :])
    value = nonnegative(gram, across @ y / size[:, :, None]) / size[:, :, None]
    residual, power = y - columns @ value, np.sum(y**2, axis=1)
    share = np.where(power > 0, np.sum(residual**2, axis=1) / np.where(power > 0, power, 1.0), 1.0)
    return PassiveFit(value[:, 0], share, residual, power / y.shape[1])


def nonnegative(gram: Array, right: Array) -> Array:
    """Non-negative least-squares coefficients (n, k, T), by trial of all choices of coefficients that are not zero.

    gram: (n, k, k) products of columns; right: (n, k, T) products of columns and targets [any units].
    """
    count = gram.shape[-1]
    free = np.array(list(product((False, True), repeat=count)))
    both = free[:, :, None] & free[:, None, :]
    least = ROUNDING * np.max(gram, axis=(1, 2), initial=1e-280, keepdims=True)  # columns may be equal
    blocks = np.where(both, (gram + least * np.eye(count))[:, None], np.eye(count))
    value = (np.linalg.inv(blocks) * both) @ right[:, None]
    gain = np.where((value >= 0).all(axis=2), np.sum(value * right[:, None], axis=2), -np.inf)
    return np.take_along_axis(value, np.argmax(gain, axis=1)[:, None, None], axis=1)[:, 0]


def unexplained(x: Signals) -> Array:
    """Unexplained shares (n,) [1] of the torques' variances."""
    return fit_passive(x).unexplained[:, 0]


def unexplained_by_others(x: Signals) -> Array:
    """Unexplained shares (n, n, 2) [1] of each torque (second axis) and its negative by each joint's columns."""
    n, both = x.torque.shape[1], np.concatenate([x.torque, -x.torque], axis=1)
    found = fit_passive(x, np.broadcast_to(both, (n, *both.shape))).unexplained
    return found.reshape(n, 2, n).swapaxes(1, 2)


def agreement(before: Signals, after: Signals, block: Indices, joints: Sequence[int], moved: Sequence[int]) -> float:
    """Share [1] of the blocks in which a correction reduces the residual of some joints' torques.

    block: (K,) of each row; moved: the joints that have the same torques after the correction.
    """
    sizes = []
    for x, own in ((before, joints), (after, moved)):
        found = fit_passive(x)
        square = np.sum(found.residual[own, :, 0] ** 2 / found.power[own], axis=0)
        sizes.append(np.array([square[block == k].sum() for k in np.unique(block)]))
    return float(np.mean(sizes[1] < sizes[0]))


def informative_torques(x: Signals, signed: Mask) -> Mask:
    """Mask (n,) of joints with torque that is recorded with its sign, signed: (n,), and strong enough to inform."""
    size = np.where(signed, np.std(x.torque, axis=0), 0.0)
    strong = np.sort(size)[-2:][0] if len(size) > 2 else size.max(initial=0.0)
    rms = np.sqrt(np.mean(x.torque**2, axis=0))
    return np.asarray(signed & (size > 0) & (size >= WEAK * strong) & (size >= STEADY * rms))


def missing_laws(evidence: FaultEvidence) -> Iterator[tuple[str, Array]]:
    """Each kind of missing law, in words, and the shares (n,) [1] of the torques' variances that it leaves.

    Friction, rotor and offset of every joint may have any size and sign, since a simulation may state too much of them.
    Beside these, all ten numbers of the body that one joint moves may be others: a payload, a counterbalance, a wrong
    link.
    """
    x, count, joints = evidence.plain, len(evidence.q), np.flatnonzero(evidence.signed)
    own = [np.stack([np.ones(count), x.v[:, j], x.direction[:, j], x.a[:, j]], axis=1) for j in joints]
    size = np.maximum(np.std(x.torque, axis=0), 1e-300)
    y = [leave((x.torque - x.predicted)[:, j], own[k]) / size[j] for k, j in enumerate(joints)]
    shares = np.ones(len(size))
    shares[joints] = np.mean(np.square(y), axis=1)
    yield "friction or a rotor of another size", shares
    bodies = evidence.along(Correction.none(len(size))).bodies.reshape(count, len(size), -1, len(INERTIAL))
    for moved, joint in enumerate(evidence.robot.joints):
        columns = bodies[:, :, own_body(evidence.robot, moved)]
        beyond = [leave(columns[:, j], own[k]) / size[j] for k, j in enumerate(joints)]
        rest = leave(np.concatenate(y), np.concatenate(beyond)).reshape(len(joints), count)
        shares = shares.copy()
        shares[joints] = np.mean(rest**2, axis=1)
        yield f"another body than stated at the link that {joint} moves", shares
