"""Body that a robot carries: ten inertial parameters with their covariance, in any frame."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import pinocchio as pin

from ..types import INERTIAL, Array, Frozen, pseudo_inertia

STEP = 1e-6  # [1] step of numerical derivatives, over a parameter's size


@dataclass(frozen=True, eq=False)
class Load(Frozen):
    """Inertial parameters of a body about the origin of a frame."""

    inertial: Array  # (10,) in Pinocchio's order [kg, kg.m, kg.m2]
    covariance: Array  # (10, 10) [products of their units]; infinite variance if unidentifiable

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

    def seen_from(self, frame: pin.SE3) -> Load:
        """The same body about the origin and along the axes of a frame, whose placement in the present one is given."""
        change = np.column_stack([_moved(x, frame.inverse().homogeneous) for x in np.eye(len(INERTIAL))])
        finite = np.isfinite(np.diag(self.covariance))
        covariance = change @ np.where(np.outer(finite, finite), self.covariance, 0.0) @ change.T
        lost = np.abs(change[:, ~finite]).max(axis=1, initial=0.0) > 0
        covariance[lost, lost] = np.inf
        return Load(change @ self.inertial, covariance)

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


def _moved(inertial: Array, frame: Array) -> Array:
    """Ten parameters in another frame, in which the present one is placed by a homogeneous matrix (4, 4)."""
    pseudo = frame @ pseudo_inertia(inertial) @ frame.T
    inertia = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
