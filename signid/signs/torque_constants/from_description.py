"""Torque constants by the inertials that a description states, and both kinds of knowledge of them as one."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...estimation.least_squares import estimate
from ...model import stated_inertials
from ...regression.factors import Factors
from ...regression.rows import Task
from ...types import Array, Mask
from .from_shared_parameters import Constants, move

WRONG = 0.2  # of mass, first moment and inertia of each link: by how much a description is off, one standard deviation
WEAK = 0.5  # relative standard deviation from which on a logarithm of a constant means nothing
FLAT, CERTAIN = 30.0, 1e-4  # standard deviations of a logarithm of which nothing is known, and all


def describe_constants(task: Task, factors: Factors) -> Constants:
    """Torque constants of n joints, each by itself: the rigid-body torque of the stated inertials is taken as true.

    What was recorded is regressed on it and on the joint's laws. The covariance counts noise, and how wrong a
    description may be; it is infinite where the torque of the stated inertials cannot be told from the laws.

    Args:
        task: robot, laws and base map.
        factors: of the joints, as recorded.
    """
    stated = stated_inertials(task.robot)
    bodies = task.base.combination[:, : stated.size]
    rigid, n = bodies @ stated.ravel(), len(factors.joints)
    log, noise, off = np.zeros(n), np.full(n, np.inf), np.zeros((n, stated.size))
    for j, (joint, seen) in enumerate(zip(factors.joints, factors.columns, strict=True)):
        laws = [k for k, label in enumerate(task.base.labels) if label.law is not None and label.joint == j]
        columns = np.column_stack([rigid[seen], task.base.combination[seen][:, laws]])
        if not joint.counts[0] or not rigid[seen].any():
            continue
        one = replace(factors, joints=(move(joint, columns),), columns=(np.arange(len(laws) + 1),), sample=None)
        found = estimate(one, task.base, np.zeros(len(laws) + 1))
        inverse, std = float(found.value[0]), float(np.sqrt(found.covariance[0, 0]))
        if inverse > 0 and std < WEAK * inverse:
            log[j], noise[j] = -np.log(inverse), std / inverse
            off[j] = _share(joint.grams[0][-len(seen) - 1 : -1, -len(seen) - 1 : -1], columns, bodies[seen])
    off *= WRONG * np.concatenate([_sizes(body) for body in stated])
    return Constants(log, off @ off.T + np.diag(noise**2))


def combine(relative: Constants, described: Constants, known: Mask) -> Constants:
    """Constants by what joints share and by what the description states; they weigh as their covariances say.

    Where the descriptions of several joints disagree by more than that, they are trusted less.

    Args:
        relative: of n joints, to one of them.
        described: of n joints.
        known: (n,) joints whose constant is 1 for certain.
    """
    log, before = relative.log.copy(), relative.covariance.copy()
    lost = ~(relative.std < WEAK)
    before[lost], before[:, lost] = 0.0, 0.0
    before += FLAT**2 * (1.0 + np.diag(lost))
    at = np.flatnonzero(known | np.isfinite(described.std))
    if not len(at):
        return Constants(log, before)
    told = np.where(known | known[:, None], CERTAIN**2 * np.eye(len(log)), described.covariance)[np.ix_(at, at)]
    apart = np.where(known, 0.0, described.log)[at] - np.where(lost, 0.0, log)[at]
    log[lost] = 0.0
    spread = before[np.ix_(at, at)]
    others = int(np.sum(~lost[at])) - 1
    weighed = float(apart @ np.linalg.solve(spread + told, apart)) / max(others, 1)
    gain = np.linalg.solve(spread + max(weighed, 1.0) * told, before[at]).T
    return Constants(log + gain @ apart, before - gain @ before[at])


def _share(gram: Array, columns: Array, bodies: Array) -> Array:
    """(10 nb,) by how much of itself the regressed torque changes with each inertial parameter [1 over its unit]."""
    normal = columns.T @ gram @ columns
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
    return np.asarray(inverse[0] @ columns.T @ gram @ bodies)


def _sizes(body: Array) -> Array:
    """(10,) of the inertial parameters of a body: what they would be at the distance at which its mass is."""
    mass, second = body[0], max((body[4] + body[6] + body[9]) / 2, 0.0)
    return np.array([mass, *[np.sqrt(max(mass * second, 0.0))] * 3, *[second] * 6])
