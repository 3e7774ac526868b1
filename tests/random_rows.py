"""Two joints, seven groups of random columns, and a residual: whitened rows for tests of the evidence."""

from __future__ import annotations

from functools import cache

import numpy as np
from plant import law

from signid.diagnose.data.dataset import Whitened
from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.data.rows import Group
from signid.diagnose.evidence.bayes_factors import Evidence
from signid.types import Array

ROWS, JOINTS = 40, 2
DISPERSION = np.array([1.3, 2.0])
FRICTION = Group(0, 1, law=law("viscous_friction", 0), deviation=(np.inf,))
BODIES = Group(1, 2, bodies=True, deviation=(0.4, 0.2))
VISCOUS = Group(3, 1, Hypothesis((law("viscous_friction", 1),)))  # one coefficient, positive
OFFSET = Group(4, 1, Hypothesis((law("torque_offset", 0),)))  # one, of either sign
SPRING = Group(5, 2, Hypothesis((law("spring", 0),)))  # two, the first positive
WAVE = Group(7, 2, Hypothesis((law("counterbalance", 1),)))  # two, of either sign
SWAP = Group(9, 1, Hypothesis((law("channel_swap", 0, 1),)))  # switched on or off
GROUPS = (FRICTION, BODIES, VISCOUS, OFFSET, SPRING, WAVE, SWAP)
PLACE = (np.array([0, 1, 2, 4, 5, 6, 9]), np.array([1, 2, 3, 7, 8, 9]))
CANDIDATES = [VISCOUS, OFFSET, SPRING, WAVE, SWAP]


@cache
def rows(seed: int = 0, size: float = 0.3, bodies: float = 0.0, count: int = ROWS, blocks: int = 1) -> Evidence:
    """Random columns; the residual holds some viscous friction, something of the bodies, and noise."""
    rng = np.random.default_rng(seed)
    columns = tuple(rng.standard_normal((count, len(place))) for place in PLACE)
    theta = np.zeros(10)
    theta[[1, 2]], theta[VISCOUS.start] = bodies, size
    noise = np.sqrt(DISPERSION)[:, None] * rng.standard_normal((JOINTS, count))
    residual = noise + np.array([x @ theta[place] for x, place in zip(columns, PLACE, strict=True)])
    return Evidence(table(columns, residual, np.arange(count) * blocks // count))


def table(columns: tuple[Array, ...], residual: Array, recording: Array) -> Whitened:
    moves = np.ones((residual.shape[1], JOINTS), dtype=bool)
    one = np.ones(JOINTS)
    return Whitened(GROUPS, 10, PLACE, columns, residual, moves, recording, columns, 3 * one, one)
