"""A load as a person and a program want it: mass, centre and inertia, with standard deviations."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ..effects import EFFECTS
from ..types import Array, Frozen, Input, Law, Robot

NUDGE = 1e-6  # of a parameter's size, for derivatives


@dataclass(frozen=True, eq=False)
class Payload(Frozen):
    """A body that the last link carries. `flags` say what is not to be trusted; empty when all is well."""

    robot: Robot
    link: str  # that carries it, and in the frame of whose joint it is told
    inertial: Array  # (10,) in Pinocchio's order, about the joint's frame [kg, kg.m, kg.m2]
    covariance: Array  # (10, 10) of the difference before it was made feasible [products of their units]
    unidentified: tuple[str, ...]  # of mass, centre and inertia, those that the recordings do not tell
    moved: float  # standard deviations by which physics moved what was told at most
    misfit: float  # variance of what is no load in the difference, over that of noise; above 1 it widens the intervals
    drifted: float  # largest change of friction or offset, over that which was thought likely [1]
    inputs: tuple[Input, ...]
    cutoff: float  # [Hz]
    seed: int
    flags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def mass(self) -> tuple[float, float]:
        """Of the load, and its standard deviation [kg]."""
        return float(self.inertial[0]), float(self._std(lambda x: x[:1])[0])

    @property
    def centre(self) -> tuple[Array, Array]:
        """(3,) centre of mass [m] and its standard deviation (3,) [m]."""
        return self.inertial[1:4] / self.inertial[0], self._std(lambda x: x[1:4] / x[0])

    @property
    def inertia(self) -> tuple[Array, Array]:
        """(6,) about the centre of mass, xx, xy, yy, xz, yz, zz [kg.m2], and its standard deviation (6,) [kg.m2]."""
        return about_centre(self.inertial), self._std(about_centre)

    @property
    def law(self) -> Law:
        """The load as a law that a model can have."""
        effect = EFFECTS["payload"]
        values = dict(zip(effect.parameters, self.inertial.tolist(), strict=True))
        return Law(effect, (len(self.robot.joints) - 1,), values)

    def _std(self, of: Callable[[Array], Array]) -> Array:
        """Standard deviations (k,) of a function of the ten numbers; infinite where it is not told."""
        x, finite = self.inertial, np.isfinite(np.diag(self.covariance))
        size = np.maximum(np.abs(x), 1e-3 * np.abs(x).max()) * NUDGE
        slope = np.column_stack([(of(x + d) - of(x - d)) / (2 * s) for d, s in zip(np.diag(size), size, strict=True)])
        known = np.where(np.outer(finite, finite), self.covariance, 0.0)
        std = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slope, known, slope), 0.0))
        return np.where(np.abs(slope[:, ~finite]).max(axis=1, initial=0.0) > 0, np.inf, std)


def about_centre(inertial: Array) -> Array:
    """Inertia (6,) about the centre of mass [kg.m2], in Pinocchio's order.

    Args:
        inertial: (10,) about a frame's origin [kg, kg.m, kg.m2].
    """
    m, (x, y, z) = inertial[0], inertial[1:4]
    shift = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    return np.asarray(inertial[4:] - shift / m)
