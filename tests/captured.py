"""Identification results of a robot with known parameters: base map, estimate and inexact prior."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from signid.effects import EFFECT_NAMES, EFFECTS
from signid.estimation.feasible import feasible_prior, inertial
from signid.regression.base_parameters import build_base
from signid.regression.motion import Motion, regressor
from signid.robot import load_robot
from signid.types import Array, BaseMap, Estimate, Law, Parameters


@dataclass(frozen=True)
class Captured:
    """Input of the retrieval of standard parameters, and the true parameters."""

    base: BaseMap
    estimate: Estimate
    prior: Parameters
    truth: Parameters


def captured(name: str, noise: float, seed: int = 0, laws: bool = True, rows: int = 400) -> Captured:
    """Robot with bodies of 0.6 to 1.5 times the stated mass, sampled in `rows` random states.

    `noise` is relative to the rms torque of each joint.
    """
    robot, rng = load_robot(name), np.random.default_rng(seed)
    effects = [Law(EFFECTS[name], (j,)) for name in EFFECT_NAMES for j in range(len(robot.joints))] if laws else []
    base = build_base(robot, effects)
    prior, _ = feasible_prior(base, Parameters(base.labels, np.r_[_stated(robot.model), np.zeros(_laws(base))]))
    values = prior.values.copy()
    values[inertial(prior)] *= np.repeat(rng.uniform(0.6, 1.5, len(robot.links)), 10)
    values[~inertial(prior)] = np.abs(rng.standard_normal(_laws(base)))
    states = rng.uniform(-3, 3, (3, rows, len(robot.joints)))
    columns = regressor(Motion(robot, np.arange(rows) * 0.01, *states), effects)[:, :, base.independent]
    torque = columns @ (base.combination @ values)
    size = noise * torque.std(0)
    measured = torque + size * rng.standard_normal(torque.shape)
    whitened = (columns / size[:, None]).reshape(-1, base.rank)
    value = np.linalg.lstsq(whitened, (measured / size).ravel(), rcond=None)[0]
    information = whitened.T @ whitened
    found = Estimate(value, np.linalg.inv(information), information, size, (0,) * len(robot.joints))
    return Captured(base, found, prior, replace(prior, values=values))


def _stated(model: object) -> Array:
    return np.concatenate([body.toDynamicParameters() for body in list(model.inertias)[1:]])  # type: ignore[attr-defined]


def _laws(base: BaseMap) -> int:
    return sum(label.body is None for label in base.labels)
