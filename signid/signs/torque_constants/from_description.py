"""Torque constants from the inertials of the description, and their combination with those from shared parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...estimation.least_squares import estimate
from ...model import stated_inertials
from ...regression.factors import Factors
from ...regression.rows import Task
from ...types import Array, Mask
from ..thresholds import INERTIAL_ERROR, UNKNOWN_CONSTANT
from .from_shared_parameters import Constants, move

FLAT = 30.0  # [log] standard deviation of an uninformative constant: thirteen decades
EXACT = 1e-4  # [log] standard deviation of an exact constant; keeps matrices regular


def describe_constants(task: Task, factors: Factors) -> Constants:
    """Torque constants of n joints, each alone, from the rigid-body torque of the stated inertials.

    The recorded currents of a joint are regressed on that torque and on the joint's laws. The covariance includes noise
    and the error of the description; it is infinite where the torque is indistinguishable from the laws.

    Args:
        task: robot, laws and base map.
        factors: factors of the joints, in recorded units.
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
        if inverse > 0 and std < UNKNOWN_CONSTANT * inverse:
            log[j], noise[j] = -np.log(inverse), std / inverse
            off[j] = _share(joint.grams[0][-len(seen) - 1 : -1, -len(seen) - 1 : -1], columns, bodies[seen])
    off *= INERTIAL_ERROR * np.concatenate([_sizes(body) for body in stated])
    return Constants(log, off @ off.T + np.diag(noise**2))


def combine(relative: Constants, described: Constants, known: Mask) -> Constants:
    """Combine constants from shared parameters with those from the description, weighted by their covariances.

    If the descriptions of several joints disagree by more than their covariance, it is inflated.

    Args:
        relative: constants of n joints, relative to one of them.
        described: constants of n joints from the description.
        known: (n,) joints whose constant is exactly 1.
    """
    log, before = relative.log.copy(), relative.covariance.copy()
    lost = ~(relative.std < UNKNOWN_CONSTANT)
    before[lost], before[:, lost] = 0.0, 0.0
    before += FLAT**2 * (1.0 + np.diag(lost))
    at = np.flatnonzero(known | np.isfinite(described.std))
    if not len(at):
        return Constants(log, before)
    stated = np.where(known | known[:, None], EXACT**2 * np.eye(len(log)), described.covariance)[np.ix_(at, at)]
    difference = np.where(known, 0.0, described.log)[at] - np.where(lost, 0.0, log)[at]
    log[lost] = 0.0
    shared = before[np.ix_(at, at)]
    freedom = max(int(np.sum(~lost[at])) - 1, 1)
    chi2 = float(difference @ np.linalg.solve(shared + stated, difference)) / freedom
    gain = np.linalg.solve(shared + max(chi2, 1.0) * stated, before[at]).T
    return Constants(log + gain @ difference, before - gain @ before[at])


def _share(gram: Array, columns: Array, bodies: Array) -> Array:
    """Relative change (10 nb,) of the regressed torque with each inertial parameter [1 over its unit]."""
    normal = columns.T @ gram @ columns
    size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
    inverse = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
    return np.asarray(inverse[0] @ columns.T @ gram @ bodies)


def _sizes(body: Array) -> Array:
    """Scales (10,) of the inertial parameters of a body: those of its mass at its radius of gyration."""
    mass, second = body[0], max((body[4] + body[6] + body[9]) / 2, 0.0)
    return np.array([mass, *[np.sqrt(max(mass * second, 0.0))] * 3, *[second] * 6])
