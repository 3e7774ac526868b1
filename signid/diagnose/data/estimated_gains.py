"""Gains of joints whose torque constants were estimated: fitted beside every hypothesis, with a known prior."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...effects.torque_gain import PLUGIN, TorqueGain
from ...model import Model
from ...types import Array, Indices, Law

MIN_START_GAIN = 1e-9  # start of a gain [1]: a law of zero numbers is no column
MIN_GAIN_STD = 1e-4  # [1] of a gain, so that precisions are finite


class EstimatedGain(TorqueGain):
    """Gain of a joint whose torque constant was estimated, with the covariance of that estimate."""

    def __init__(self, covariance: Array) -> None:
        self.covariance = covariance  # (n,) [1] of the logarithm of the constant, with those of all joints


class GainPrior(NamedTuple):
    """Gaussian prior of m gains.

    Where no constant is known, the description sets the scale of all: errors of bodies are that scale already, so it is
    no gain beside them, but counts in intervals.
    """

    columns: Indices  # (m,) column indices
    covariance: Array  # (m, m) [1] of the constants
    beside_bodies: Array  # (m, m) [1] the same, without the scale of all where no constant is known

    def among(self, which: Indices) -> Indices:
        """(m,) positions of the gains among fitted columns `which` (k,) [1], in ascending order."""
        return np.flatnonzero(np.isin(which, self.columns))

    def widened(self, covariance: Array, at: Indices) -> Array:
        """Posterior with the gains, at positions (m,), as uncertain as their prior: the same rows gave the constants.

        covariance: (k, k) of the posterior [products of the units].
        """
        slopes = np.linalg.solve(covariance[np.ix_(at, at)], covariance[at]).T
        return np.asarray(covariance + slopes @ (self.covariance - covariance[np.ix_(at, at)]) @ slopes.T)


def gain_prior(laws: Iterable[tuple[int, Law | None]]) -> GainPrior:
    """Prior of the estimated gains among laws, each with its column index."""
    pairs = [(k, law) for k, law in laws if law is not None]
    own = [(k, x.joints[0], x.effect.covariance) for k, x in pairs if isinstance(x.effect, EstimatedGain)]
    covariance = np.array([row[[joint for _, joint, _ in own]] for _, _, row in own]).reshape(len(own), len(own))
    scale = 1 / np.linalg.inv(covariance).sum() if own and len(own) == len(own[0][2]) else 0.0
    beside = covariance - scale + MIN_GAIN_STD**2 * np.eye(len(own))
    return GainPrior(np.array([k for k, _, _ in own], dtype=np.intp), covariance, beside)


def with_estimated_gains(model: Model, covariance: Array | None) -> tuple[Model, tuple[Law, ...]]:
    """Simulation with the gains of joints whose torque constants were estimated, and these gains.

    covariance: (n, n) [1] of the logarithms of the constants, zero where they are known; None: all are.
    """
    if covariance is None:
        return model, ()
    stated = {law.joints[0]: law.parameters for law in model.laws if law.effect.name == "torque_gain"}
    found = [(j, EstimatedGain(row)) for j, row in enumerate(covariance) if row[j] > 0]
    gains = tuple(Law(effect, (j,), stated.get(j, {"error": MIN_START_GAIN})) for j, effect in found)
    taken = {(gain.effect.name, gain.joints) for gain in gains}
    kept = [law for law in model.laws if (law.effect.name, law.joints) not in taken]
    return replace(model, laws=(*kept, *gains)), gains


def as_given(model: Model) -> Model:
    """Simulation whose estimated gains are laws as any other."""
    plain = [replace(x, effect=PLUGIN) if isinstance(x.effect, EstimatedGain) else x for x in model.laws]
    return replace(model, laws=tuple(plain))
