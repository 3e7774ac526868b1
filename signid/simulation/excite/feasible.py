"""Motions scaled to obey all limits, checked on fine grids."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ...errors import OptionError
from ...types import Array
from .families import Family
from .problem import ExcitationProblem
from .random_motions import fit_inside

FINE = 1e-3  # [s] grid on which limits are checked
NEAR = 5e-3  # [s] grid on which distances between links are checked
COARSE = 100  # [multiples of FINE] grid of a first check of these distances
HALVINGS = 8  # bisection steps of the scale of the motion
SLACK = 1e-9  # [1] rounding of a share of a limit


class FeasibleMotion(NamedTuple):
    """Motion within the limits."""

    x: Array  # (n, d) [rad or m] parameters
    share: float  # [1] scale of the motion about the home posture
    distance: float | None  # [m] smallest distance between links


def make_feasible(problem: ExcitationProblem, family: Family, x: Array) -> FeasibleMotion:
    """Scale a motion of parameters x (n, d) [rad or m] by as little as needed to obey all limits.

    Each joint is scaled to its position, velocity and acceleration limits. If torque or the distance between links
    exceeds a limit, the whole motion shrinks towards the home posture.

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


def _obeys(problem: ExcitationProblem, family: Family, t: Array, x: Array) -> tuple[bool, float | None]:
    """Whether a motion obeys all limits, and the smallest distance between links [m], None without their shapes."""
    shapes, clearance = problem.collision, problem.clearance
    if shapes is not None:  # a coarse grid shows most collisions
        if shapes.distance(family.basis(t[::COARSE])[0] @ x.T).min() < clearance:
            return False, None
    use = problem.use(family.sample(problem.model.robot.joints, x, t))
    if use.largest > problem.limits.margin + SLACK:
        return False, None
    if shapes is None:
        return True, None
    distance = float(shapes.distance(family.basis(grid(float(t[-1]), NEAR))[0] @ x.T).min())
    return distance >= clearance, distance
