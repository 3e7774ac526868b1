"""Physical cone: linear inequalities that the base parameters of every real robot satisfy, and the distance from it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...regression.motion import Motion
from ...regression.regressor import base_rows
from ...regression.rows import Task
from ...types import Array, Frozen
from ..observations import Observed, law_coefficients
from ..thresholds import OFFSET_LIMIT
from .problem import SignProblem

POSES = 15  # configurations at which kinetic energy must be positive; logs: enough for Panda and UR10e
DIRECTIONS = 4  # random joint velocities per configuration, beside those of each joint alone; as POSES
ZERO_ROW = 1e-9  # [sum of the absolute values of its terms] length of a row that is zero but for rounding
INSIDE = 1e-9  # [distance from the origin] violation of an inequality that is rounding error
ROUNDS = 20  # [iterations per row] of the search for multipliers, at most; heuristic


def cone_inequalities(task: Task, observed: Observed, seed: int = 0) -> Array:
    """Rows c (g, b) with c'theta >= 0 for the base parameters theta of every real robot [1 over units of base].

    Three kinds: kinetic energy x'M(q)x >= 0 at observed configurations, for each joint's velocity alone and for random
    ones; law coefficients that are not negative; and |offset| <= 2 Coulomb friction where a joint has both, since
    friction alone fits as well as an offset of its size with signs that are all equal.
    """
    labels = [task.base.labels[k] for k in task.base.independent]
    positive = np.eye(task.base.rank)[[k for k in law_coefficients(task) if labels[k].positive]]
    return np.concatenate([_energy_rows(task, observed, seed), positive, _offset_rows(task)])


def kinetic_rows(task: Task, q: Array, x: Array) -> Array:
    """Rows (k, b) whose product with theta is x'M(q)x = x'(torque(q, 0, x) - torque(q, 0, 0)).

    The third argument of the torque is the acceleration, here set to the velocities x (k, n) [rad/s or m/s], 0 at
    joints whose torque is unknown. The configurations are q (k, n) [rad or m].
    """
    n = len(task.robot.joints)
    t, still = np.arange(len(q), dtype=np.float64), np.zeros_like(q)
    motions = (Motion(task.robot, t, q, still, a, slow=task.slow) for a in (still, x))
    at_rest, pushed = (base_rows(motion, task.laws, task.wanted) for motion in motions)
    rows = np.zeros((len(q), task.base.rank))
    for j in range(n):
        rows[:, task.seen(j)] += x[:, j, None] * (pushed[j] - at_rest[j])
    return rows


def _energy_rows(task: Task, observed: Observed, seed: int) -> Array:
    rng, n = np.random.default_rng(seed), len(observed.joints)
    rms = observed.rms
    size = np.where(rms > 0, 1 / np.sqrt(np.where(rms > 0, rms, 1.0)), 0.0)  # similar kinetic energy of all joints
    at = np.sort(rng.choice(len(observed), min(POSES, len(observed)), replace=False))
    single, mixed = np.tile(np.diag(size), (len(at), 1)), rng.standard_normal((len(at) * DIRECTIONS, n)) * size
    q = np.concatenate([observed.q[at].repeat(n, axis=0), observed.q[at].repeat(DIRECTIONS, axis=0)])
    return kinetic_rows(task, q, np.concatenate([single, mixed]))


def _offset_rows(task: Task) -> Array:
    own = {law: k for k, law in law_coefficients(task).items()}
    unit, rows = np.eye(task.base.rank), [np.zeros((0, task.base.rank))]
    for (name, joint), k in own.items():
        coulomb = own.get(("coulomb_friction", joint))
        if name == "torque_offset" and coulomb is not None:
            rows.append(OFFSET_LIMIT * unit[coulomb] + np.array([[1.0], [-1.0]]) * unit[k])
    return np.concatenate(rows)


@dataclass(frozen=True, eq=False)
class PhysicalCone(Frozen):
    """Coordinates z of a problem that a real robot can have: G z >= 0."""

    rows: Array  # (g, r) G, each row of length 1 [1]

    @classmethod
    def of(cls, problem: SignProblem, rows: Array) -> PhysicalCone:
        """Cone in the coordinates of a problem, by rows (g, b) [1 over units of base] on identifiable parameters."""
        size = np.linalg.norm(problem.back, axis=1)  # 0: unidentifiable
        rows = rows[~np.any((rows != 0) & (size == 0), axis=1)]
        moved = rows @ problem.back
        length = np.linalg.norm(moved, axis=1)
        kept = length > ZERO_ROW * (np.abs(rows) @ size)
        unit = moved[kept] / length[kept, None]
        distinct = np.unique(np.round(unit, 9), axis=0, return_index=True)[1]
        return cls(unit[np.sort(distinct)])

    def distance(self, z: Array) -> tuple[float, Array]:
        """Squared distance from the cone of z (r,) [standard deviations], and the point of the cone nearest to z (r,).

        Only violated rows enter, as few are active. If their multipliers cannot be computed, the result is a lower
        bound on the distance and a point outside the cone.

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
    """Multipliers lam >= 0 such that z + rows' lam is the point nearest to z in the cone of these rows.

    If the solver fails, any lam >= 0 scaled to maximise the dual -|rows' lam|^2 - 2 lam'rows z gives a lower bound.
    """
    from scipy.optimize import lsq_linear, nnls

    try:
        return np.asarray(nnls(rows.T, -z, maxiter=ROUNDS * len(rows))[0])
    except RuntimeError:  # too many iterations
        found = np.maximum(lsq_linear(rows.T, -z, (0, np.inf), method="bvls", max_iter=ROUNDS * len(rows)).x, 0.0)
    step = rows.T @ found
    return np.asarray(found * max(-float(step @ z), 0.0) / max(float(step @ step), 1e-300))
