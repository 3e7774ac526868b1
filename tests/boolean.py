"""Small problems with lost signs: all 2^S choices can be tried."""

from __future__ import annotations

from itertools import product

import numpy as np
from hypothesis import given, strategies as st
from scipy.optimize import nnls

from signid.signs.problem import SignProblem, eliminate
from signid.types import Array

CLOSE = 1e-9  # share of the total energy


class Facets:
    """The cone G z >= 0."""

    def __init__(self, normals: Array) -> None:
        self.normals = normals

    def distance(self, z: Array) -> tuple[float, Array]:
        move = self.normals.T @ nnls(self.normals.T, -z)[0]
        return float(move @ move), z + move


def drawn(rng: np.random.Generator, count: int, noise: float, anchored: bool = False, columns: int = 4) -> SignProblem:
    """S segments of two joints, of 1 to 6 samples; with noise of many times the torque nothing is explained."""
    joints = np.sort(rng.integers(0, 2, count)).tolist()
    rows = [rng.normal(size=(rng.integers(1, 7), columns)) * (1.0, 1.0, 1.0 + j, j)[:columns] for j in joints]
    truth = rng.normal(size=columns)
    right = [r @ truth * rng.choice([-1, 1]) + noise * rng.normal(size=len(r)) for r in rows]
    if anchored:
        rows, right, joints = [*rows, np.eye(columns)], [*right, rng.normal(size=columns)], [*joints, -1]
    return eliminate(rows, right, joints)


def every(problem: SignProblem) -> Array:
    """(2^S, S) all signs; half as many where one is known."""
    free = problem.count - int(problem.anchored)
    signs = np.array(list(product((1.0, -1.0), repeat=free))).reshape(2**free, free)
    return np.column_stack([signs, np.ones((len(signs), int(problem.anchored)))])


def losses(problem: SignProblem, signs: Array, cone: Facets | None = None) -> Array:
    far = [cone.distance(problem.coordinates(s))[0] if cone else 0.0 for s in signs]
    return np.array([problem.loss(s) for s in signs]) + far


def half(problem: SignProblem, rng: np.random.Generator) -> Facets:
    """A cone of about half of all coordinates or less."""
    return Facets(rng.normal(size=(rng.integers(1, 4), len(problem.projections))))


problems = given(
    st.integers(0, 2**32 - 1), st.integers(1, 9), st.sampled_from([0.0, 1e-3, 0.3, 1.0, 30.0]), st.booleans()
)
