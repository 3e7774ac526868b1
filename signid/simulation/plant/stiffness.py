"""Stiffness of the laws of a plant, measured at random states over its range."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...errors import OptionError
from ...types import Array, Robot
from .dynamics import Dynamics
from .effect_terms import Moment, Term, total_torque

STATES = 60  # random states
TRIAL = 1e-6  # [rad, rad/s] step of the numerical derivatives of the laws
SLACK = 4.0  # [1] safety factor: laws may be stiffer than at the random states
GENTLE = 0.4  # [1] load of the laws over the inertia, below which steps are explicit
RINGING, DECAY = 0.3, 0.5  # [1] largest step times frequency, and times decay rate, of explicit steps


class Stiffness(NamedTuple):
    """Largest derivatives of the laws' torque by velocity and position, and smallest inertia, (c,) each."""

    damping: Array  # (c,) [N.m.s/rad]
    spring: Array  # (c,) [N.m/rad]
    inertia: Array  # (c,) [kg.m2]

    def stiff(self, dt: float) -> bool:
        """Whether a step of dt [s] must evaluate the laws at its end."""
        load = SLACK * (dt * self.damping + dt**2 * self.spring)
        return bool((load > GENTLE * self.inertia).any())

    def substeps(self, step: float, implicit: bool) -> int:
        """Number of sub-steps of a step [s], for accuracy with oscillating springs, and stability if explicit."""
        rate = RINGING**-1 * np.sqrt(self.spring / self.inertia)
        if implicit:
            return int(np.clip(np.ceil(step * rate.max()), 1, 10))
        return int(max(1, np.ceil(step * max(rate.max(), (self.damping / self.inertia).max() / DECAY))))


def measure_stiffness(moment: Moment, terms: Sequence[Term], step: float, robot: Robot) -> Stiffness:
    """Measure the stiffness of a plant's laws, for steps [s], at random states, slow and fast."""
    rng, dynamics, (copies, count) = np.random.default_rng(0), moment.dynamics, moment.inertia.shape
    bodies = dynamics.bodies
    low, high = np.clip((robot.lower, robot.upper), -np.pi, np.pi)
    damping, spring, inertia = np.zeros(count), np.zeros(count), np.full(count, np.inf)
    for k in range(STATES):
        q, v = np.zeros((copies, count)), np.zeros((copies, count))
        q[:, bodies.motor] = rng.uniform(low, high)
        v[:] = rng.choice([-1.0, 1.0], count) * 10.0 ** (rng.uniform(-5, 0.5) + rng.uniform(-0.5, 0, count))
        q[:, bodies.flex] = rng.uniform(-0.05, 0.05, len(bodies.flex))
        moment.inertia = np.repeat(dynamics.inertia(q[:1]), copies, axis=0)
        trials, speeds = np.stack([q, q, q + TRIAL]), np.stack([v, v + TRIAL, v])
        moment.set(float(k), step, trials, speeds, np.sign(speeds))
        for term in terms:
            term.begin()
        here, faster, moved = total_torque(terms, speeds.shape)[:, 0]
        damping, spring = np.maximum(damping, (faster - here) / TRIAL), np.maximum(spring, (moved - here) / TRIAL)
        inertia = np.minimum(inertia, 1 / _mobility(dynamics, q[:1], robot.name).diagonal())
    return Stiffness(damping, spring, inertia)


def _mobility(dynamics: Dynamics, q: Array, robot: str) -> Array:
    """Inverse (c, c) of the mass matrix at q (1, c), if that is positive definite."""
    try:
        found = dynamics.mobility(q)[0]
        feasible = bool(np.isfinite(found).all()) and np.linalg.eigvalsh(found)[0] > 0
    except np.linalg.LinAlgError:
        feasible = False
    if not feasible:
        raise OptionError(
            f"the bodies of {robot} are infeasible: their mass matrix is not positive definite; give every joint mass "
            "or an armature, and a payload or a correction of a link smaller first moments"
        )
    return np.asarray(found)
