"""Recordings without the mismatch -> what they tell of the bodies, for the recordings with it."""

from __future__ import annotations

import numpy as np

from .linear import FLAT, Known
from .odds import Judge
from .sizes import measure_sizes
from .whitened import columns_of, total

NOISE_ERROR = 1.3  # of the noise's variance
ROUNDS = 3
DISTRUST = 2.0  # of the tolerance of inertials


def learn_bodies(judge: Judge) -> Known:
    """What rows of healthy recordings say of the bodies while the laws that are refitted are fitted beside.

    Args:
        judge: rows along the healthy recordings, of the simulation that is diagnosed.
    """
    evidence, data = judge.evidence, judge.evidence.data
    base = np.full(data.joints, NOISE_ERROR)
    for _ in range(ROUNDS):
        left = measure_sizes(evidence, (), base, DISTRUST).left
        base = np.maximum(NOISE_ERROR, NOISE_ERROR * left)
    which = columns_of(data.refitted)
    bodies = np.concatenate([np.full(group.size, group.bodies) for group in data.refitted])
    gram = total(data.refitted_gram, base, (len(which), data.count))[:, which]
    right = (data.right[:, which] / base[:, None]).sum(0)
    deviation = np.concatenate([np.array(group.deviation) for group in data.refitted])
    flat = FLAT * np.maximum(np.diag(gram), 1e-12)
    precision = np.where(np.isinf(deviation), flat, np.maximum(deviation, 1e-150) ** -2.0)
    laws = ~bodies
    across = gram[np.ix_(laws, bodies)]
    own = gram[np.ix_(laws, laws)] + np.diag(precision[laws])
    solved = np.linalg.solve(own, np.column_stack([across, right[laws]]))
    information = gram[np.ix_(bodies, bodies)] - across.T @ solved[:, :-1]
    return Known(information, right[bodies] - across.T @ solved[:, -1])
