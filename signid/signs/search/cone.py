"""What physics allows, as linear inequalities of base parameters, and how far an estimate is outside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...regression.motion import Motion
from ...regression.rows import Task
from ...types import Array, Frozen
from ..rows.observations import Observed, columns_of, law_coefficients
from .problem import SignProblem

POSES, DIRECTIONS = 15, 4  # configurations of the mass matrix, and random velocities at each
RECTIFIED = 2.0  # an offset larger than so many times Coulomb friction is friction whose sign went astray
VANISHES = 1e-9  # of the sum of its parts: a row that is zero
INSIDE = 1e-9  # of the distance from the origin: no further outside is inside
ROUNDS = 20  # a row, of a search for multipliers, at most


def cone_inequalities(task: Task, observed: Observed, seed: int = 0) -> Array:
    """Rows c (g, b) with c'theta >= 0 for the base parameters theta of every real robot.

    Kinetic energy x'M(q)x at observed configurations, for each joint's velocity alone and for random ones;
    coefficients that physics does not allow to be negative; and |offset| <= 2 Coulomb friction where a joint has both:
    a torque of friction alone is explained as well by an offset of its size, and signs that are all the same.

    Args:
        task: robot, laws and base map.
        observed: configurations, and which joints' torque is known.
        seed: of configurations and velocities.
    """
    return np.concatenate([_energy(task, observed, seed), _signs(task), _offsets(task)])


def kinetic_rows(task: Task, q: Array, x: Array) -> Array:
    """Rows (k, b) whose product with base parameters is x'M(q)x = x'(torque(q, 0, x) - torque(q, 0, 0)).

    Args:
        task: robot, laws and base map.
        q: (k, n) [rad or m] configurations.
        x: (k, n) [rad/s or m/s] velocities, 0 at joints whose torque is not known.
    """
    n = len(task.robot.joints)
    t, still = np.arange(len(q), dtype=np.float64), np.zeros_like(q)
    at_rest, pushed = (columns_of(task, Motion(task.robot, t, q, still, a, slow=task.slow)) for a in (still, x))
    rows = np.zeros((len(q), task.base.rank))
    for j in range(n):
        rows[:, task.seen(j)] += x[:, j, None] * (pushed[j] - at_rest[j])
    return rows


def _energy(task: Task, observed: Observed, seed: int) -> Array:
    rng, n = np.random.default_rng(seed), len(observed.joints)
    rms = observed.rms
    size = np.where(rms > 0, 1 / np.sqrt(np.where(rms > 0, rms, 1.0)), 0.0)  # alike in kinetic energy
    at = np.sort(rng.choice(len(observed), min(POSES, len(observed)), replace=False))
    single, mixed = np.tile(np.diag(size), (len(at), 1)), rng.standard_normal((len(at) * DIRECTIONS, n)) * size
    q = np.concatenate([observed.q[at].repeat(n, axis=0), observed.q[at].repeat(DIRECTIONS, axis=0)])
    return kinetic_rows(task, q, np.concatenate([single, mixed]))


def _signs(task: Task) -> Array:
    labels = [task.base.labels[k] for k in task.base.independent]
    return np.eye(task.base.rank)[[k for k in law_coefficients(task) if labels[k].positive]]


def _offsets(task: Task) -> Array:
    own = {law: k for k, law in law_coefficients(task).items()}
    unit, rows = np.eye(task.base.rank), [np.zeros((0, task.base.rank))]
    for (name, joint), k in own.items():
        coulomb = own.get(("coulomb_friction", joint))
        if name == "torque_offset" and coulomb is not None:
            rows.append(RECTIFIED * unit[coulomb] + np.array([[1.0], [-1.0]]) * unit[k])
    return np.concatenate(rows)


@dataclass(frozen=True, eq=False)
class PhysicalCone(Frozen):
    """The coordinates z of a problem that a real robot could have: those with G z >= 0."""

    rows: Array  # (g, r) G, each of length 1 [1]

    @classmethod
    def of(cls, problem: SignProblem, rows: Array) -> PhysicalCone:
        """The cone in a problem's coordinates; rows of parameters that it does not tell are left out.

        Args:
            problem: gives the coordinates.
            rows: (g, b) of inequalities of base parameters [1 over units of base].
        """
        told = np.linalg.norm(problem.back, axis=1)
        rows = rows[~np.any((rows != 0) & (told == 0), axis=1)]
        moved = rows @ problem.back
        length = np.linalg.norm(moved, axis=1)
        kept = length > VANISHES * (np.abs(rows) @ told)
        return cls(_distinct(moved[kept] / length[kept, None]))

    def distance(self, z: Array) -> tuple[float, Array]:
        """Squared distance from the cone, and its point nearest to z (r,) [standard deviations].

        Only rows that the point violates enter: few are active. Where the multipliers of these cannot be computed, it
        is a lower bound of the distance, and the point lies outside.

        Args:
            z: (r,) [standard deviations].

        Source: the dual, non-negative least squares: Lawson, Hanson, Solving Least Squares Problems, 1974, chapter 23.
        """
        least = INSIDE * float(np.linalg.norm(z))
        near, active = z, np.zeros(len(self.rows), dtype=bool)
        for _ in range(len(self.rows)):
            violated = (self.rows @ near < -least) & ~active
            if not violated.any():
                break
            active |= violated
            near = z + self.rows[active].T @ _multipliers(self.rows[active], z)
        return float(np.sum((near - z) ** 2)), near


def _multipliers(rows: Array, z: Array) -> Array:
    """The lam >= 0 for which z + rows' lam is the point of the cone of these rows nearest to z, or nearly so.

    Any lam >= 0, scaled to maximise -|rows' lam|^2 - 2 lam'rows z, gives a point no farther from z than the cone is.
    """
    from scipy.optimize import lsq_linear, nnls

    try:
        return np.asarray(nnls(rows.T, -z, maxiter=ROUNDS * len(rows))[0])
    except RuntimeError:  # too many rounds
        found = np.maximum(lsq_linear(rows.T, -z, (0, np.inf), method="bvls", max_iter=ROUNDS * len(rows)).x, 0.0)
    step = rows.T @ found
    return np.asarray(found * max(-float(step @ z), 0.0) / max(float(step @ step), 1e-300))


def _distinct(rows: Array) -> Array:
    _, at = np.unique(np.round(rows, 9), axis=0, return_index=True)
    return rows[np.sort(at)]
