"""Motions scaled to obey all limits, checked on fine grids."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import OptionError
from ...model import Model
from ...regression.motion import Motion
from ...types import Array
from .collision import Collision
from .limits import Limits
from .motions.family import Family
from .motions.random_motion import fit_inside, sample
from .problem import ExcitationProblem

FINE = 1e-3  # [s] grid on which limits are checked
NEAR = 5e-3  # [s] grid on which distances between links are checked
COARSE = 100  # [multiples of FINE] grid of a first check of these distances
POSTURES = 200  # random candidates for the home posture
HALVINGS = 8  # bisection steps of the scale of the motion
SLACK = 1e-9  # [1] rounding of a share of a limit


class FeasibleMotion(NamedTuple):
    """Motion within the limits."""

    x: Array  # (n, d) [rad or m] parameters
    share: float  # [1] scale of the motion about the home posture
    distance: float | None  # [m] smallest distance between links


def find_home(model: Model, limits: Limits, collision: Collision | None, clearance: float, seed: int) -> Array:
    """Home posture (n,) [rad or m], with the smallest share of the torque limits; motions shrink towards it.

    Args:
        model: model that gives the torque.
        limits: limits of n joints.
        collision: shapes of the links.
        clearance: smallest distance between links [m].
        seed: seed of the candidates.

    Raises:
        OptionError: no candidate obeys the torque limits and the clearance.
    """
    robot, rng = model.robot, np.random.default_rng(seed)
    low, up = limits.middle - limits.half, limits.middle + limits.half
    q = np.vstack([limits.middle, np.clip(0.0, low, up), rng.uniform(low, up, (POSTURES, len(low)))])
    still = np.zeros_like(q)
    torque = model.inverse(Motion(robot, np.arange(len(q), dtype=float), q, still, still))
    share = np.abs(torque / limits.torque).max(1)
    if share.min() >= limits.margin:
        j = int(np.argmax(np.abs(torque / limits.torque)[np.argmin(share)]))
        raise OptionError(
            f"gravity takes {share.min():.0%} of the torque limit of joint {robot.joints[j]} in the best of {len(q)} "
            f"postures, so there is no motion; raise the torque limit, or narrow the position limits"
        )
    if collision is not None:
        apart = (collision.distance(q) >= clearance) & (share < limits.margin)
        if not apart.any():
            raise OptionError(
                f"none of {len(q)} postures has links {clearance:g} m apart and obeys the torque limits; "
                "lower the clearance, or widen the position limits"
            )
        share = np.where(apart, share, np.inf)
    return np.asarray(q[np.argmin(share)])


def make_feasible(problem: ExcitationProblem, family: Family, x: Array) -> FeasibleMotion:
    """Scale a motion by as little as needed to obey all limits.

    Each joint is scaled to its position, velocity and acceleration limits. If torque or the distance between links
    exceeds a limit, the whole motion shrinks towards the home posture.

    Args:
        problem: problem whose limits and collision shapes are obeyed.
        family: family of motions.
        x: (n, d) [rad or m] parameters.

    Raises:
        OptionError: even a small motion exceeds a torque limit.
    """
    t = grid(family.duration, FINE)
    full = fit_inside(family.basis(t), problem.limits, x)
    home = np.zeros_like(full)
    home[:, 0] = problem.home
    best, high, share = FeasibleMotion(home, 0.0, None), 1.0, 1.0
    for _ in range(HALVINGS):
        tried = home + share * (full - home)
        ok, distance = _obeys(problem, family, t, tried)
        if ok:
            best = FeasibleMotion(tried, share, distance)
        else:
            high = share
        if best.share == high:
            break
        share = (best.share + high) / 2
    if best.share == 0.0:
        raise OptionError("even a small motion exceeds a torque limit; raise the limit, or state lower friction")
    return best


def grid(duration: float, step: float = FINE) -> Array:
    """Instants (N,) [s] from 0 to the duration [s], at most a step [s] apart."""
    return np.linspace(0, duration, int(np.ceil(duration / step)) + 1)


def _smallest_distance(problem: ExcitationProblem, family: Family, duration: float, x: Array) -> float | None:
    """Smallest distance between links [m], None without collision shapes; x: (n, d) [rad or m] parameters."""
    if problem.collision is None:
        return None
    t = grid(duration, NEAR)
    return float(problem.collision.distance(family.basis(t)[0] @ x.T).min())


def _obeys(problem: ExcitationProblem, family: Family, t: Array, x: Array) -> tuple[bool, float | None]:
    if problem.collision is not None:  # a coarse grid shows most collisions
        coarse = problem.collision.distance(family.basis(t[::COARSE])[0] @ x.T)
        if coarse.min() < problem.clearance:
            return False, None
    use = problem.use(sample(family, problem.model.robot.joints, x, t))
    if use.largest > problem.limits.margin + SLACK:
        return False, None
    distance = _smallest_distance(problem, family, float(t[-1]), x)
    return distance is None or distance >= problem.clearance, distance
