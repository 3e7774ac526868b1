"""Load of the last link, with standard deviations, and the moments at which it was picked up and put down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..effects import EFFECTS
from ..errors import OptionError
from ..types import Array, Input, Law, Result, Robot

STEP = 1e-6  # [1] step of numerical derivatives, over a parameter's size


class LoadMoment(NamedTuple):
    """When the load was picked up, or put down."""

    t: float  # [s] in the recording
    std: float  # [s]
    picked_up: bool


@dataclass(frozen=True, eq=False)
class Payload(Result):
    """Body that the last link carries. `flags` name unreliable results; empty if there are none."""

    robot: Robot
    link: str  # link that carries the load; the load is expressed in the frame of its joint
    inertial: Array  # (10,) in Pinocchio's order, about the joint's frame [kg, kg.m, kg.m2]; NaN: no load was found
    covariance: Array  # (10, 10) of the difference before it was made feasible [products of their units]
    unidentified: tuple[str, ...]  # unidentifiable ones of mass, centre and inertia
    moved: float  # [standard deviations] largest change of an identifiable number by feasibility
    misfit: float  # [1] variance of the residual of the difference over that of noise; above 1 it widens the intervals
    drifted: float  # [1] largest change of friction or offset, over its prior standard deviation
    inputs: tuple[Input, ...]
    cutoff: float  # [Hz]
    seed: int
    flags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    moments: tuple[LoadMoment, ...] = ()  # in one recording; empty for separate recordings

    @property
    def found(self) -> bool:
        """Whether there is a load."""
        return bool(np.isfinite(self.inertial[0]))

    @property
    def mass(self) -> tuple[float, float]:
        """Mass of the load, and its standard deviation [kg]."""
        return float(self.inertial[0]), float(self._std(lambda x: x[:1])[0])

    @property
    def centre(self) -> tuple[Array, Array]:
        """Centre of mass (3,) [m], and its standard deviation (3,) [m]."""
        return self.inertial[1:4] / self.inertial[0], self._std(lambda x: x[1:4] / x[0])

    @property
    def inertia(self) -> tuple[Array, Array]:
        """Inertia (6,) about the centre of mass, xx, xy, yy, xz, yz, zz [kg.m2], and its standard deviation (6,)."""
        return _about_centre(self.inertial), self._std(_about_centre)

    @property
    def law(self) -> Law:
        """Load as a law of a model.

        Raises:
            OptionError: no load was found.
        """
        if not self.found:
            raise OptionError("no load was found, so it is no law; see the flags of the result")
        effect = EFFECTS["payload"]
        values = dict(zip(effect.parameters, self.inertial.tolist(), strict=True))
        return Law(effect, (len(self.robot.joints) - 1,), values)

    def _std(self, of: Callable[[Array], Array]) -> Array:
        """Standard deviations (k,) of a function of the ten numbers; infinite if unidentifiable."""
        x, finite = self.inertial, np.isfinite(np.diag(self.covariance))
        size = np.maximum(np.abs(x), 1e-3 * np.abs(x).max()) * STEP
        slope = np.column_stack([(of(x + d) - of(x - d)) / (2 * s) for d, s in zip(np.diag(size), size, strict=True)])
        known = np.where(np.outer(finite, finite), self.covariance, 0.0)
        std = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slope, known, slope), 0.0))
        return np.where(np.abs(slope[:, ~finite]).max(axis=1, initial=0.0) > 0, np.inf, std)


def _about_centre(inertial: Array) -> Array:
    """Inertia (6,) about the centre of mass [kg.m2], in Pinocchio's order, of ten parameters about a frame's origin."""
    m, (x, y, z) = inertial[0], inertial[1:4]
    shift = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    return np.asarray(inertial[4:] - shift / m)
