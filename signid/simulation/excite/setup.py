"""Model and limits -> problem of finding an exciting motion: noise, shapes and reference sizes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...effects import EFFECTS
from ...errors import OptionError
from ...model import Model
from ...regression.base_parameters import build_base
from ...regression.motion import Motion
from ...types import Array, Law
from .collision import build_collision
from .feasible import find_home
from .limits import Limits
from .motions.family import Family
from .motions.random_motion import random_parameters, sample
from .problem import ExcitationProblem

REFERENCES = 20  # random motions for reference sizes
INSTANTS = 200  # samples of each of these motions
NOISE = 0.01  # [1] torque noise over the torque limit, or over the rms torque without a limit


def build_problem(
    model: Model, laws: tuple[Law, ...], family: Family, limits: Limits, clearance: float, seed: int
) -> tuple[ExcitationProblem, tuple[str, ...]]:
    """Problem of finding an exciting motion, and a note if self-collision is not checked.

    Torque noise is 1 % of each joint's torque limit; for joints without a limit, 1 % of the rms torque along random
    motions. The reference size of a base parameter's column is its rms along these motions.

    Args:
        model: robot, inertials and laws as known so far.
        laws: laws whose coefficients are to be identified, besides the bodies.
        family: family of the random motions.
        limits: limits of the joints.
        clearance: smallest distance between links [m].
        seed: seed of the random numbers.

    Raises:
        OptionError: no posture obeys the limits, or the clearance is negative or infinite.
    """
    if not 0 <= clearance < np.inf:
        raise OptionError(f"the clearance is {clearance:g} m; give 0 or more")
    base = build_base(model.robot, laws, seed)
    collision, why = build_collision(model.robot, limits, clearance, seed)
    home = find_home(model, limits, collision, clearance, seed)
    rng = np.random.default_rng(seed)
    t = np.linspace(0, family.duration, INSTANTS)
    basis = family.basis(t)
    drawn = [sample(family, model.robot.joints, random_parameters(basis, limits, rng), t) for _ in range(REFERENCES)]
    states = [np.concatenate([getattr(motion, key) for motion in drawn]) for key in "qva"]
    times = np.tile(t, REFERENCES)
    torque = model.inverse(Motion(model.robot, times, states[0], states[1], states[2]))
    noise = _noise(limits, torque)
    bare = ExcitationProblem(model, laws, base, limits, noise, np.ones(base.rank), collision, clearance, home)
    rows = bare.rows(times, states[0], states[1], states[2])
    size = np.sqrt(np.diag(bare.information(rows)) / len(times))
    problem = ExcitationProblem(model, laws, base, limits, noise, np.maximum(size, 1e-300), collision, clearance, home)
    return problem, (why,) if why else ()


def usual_laws(model: Model, effects: Sequence[str]) -> tuple[Law, ...]:
    """Laws of the given effects at every joint.

    Raises:
        OptionError: there is no such effect, or it is not linear in its parameters at a single joint.
    """
    for name in effects:
        effect = EFFECTS[name]
        if effect.scope != "joint" or not effect.parameters or len(effect.linear()) < len(effect.parameters):
            raise OptionError(
                f"{name} is not linear in its parameters at a single joint and cannot be optimised for; leave it out, "
                "and use separate to find a motion for it"
            )
    return tuple(Law(EFFECTS[name], (j,)) for name in effects for j in range(len(model.robot.joints)))


def _noise(limits: Limits, torque: Array) -> Array:
    """Assumed torque noise (n,) [N.m or N], from torque (N, n) [N.m or N] along random motions."""
    rms = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-9)
    return NOISE * np.where(np.isfinite(limits.torque), limits.torque, rms)
