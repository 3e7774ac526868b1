"""Load that a model carries: the sum of its laws `payload`, and the model with a further load."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..effects import EFFECTS
from ..errors import OptionError
from ..model import Model, ModelSource, as_model
from ..robot.dynamics import own_body
from ..types import INERTIAL, Array, Frozen, Law, pseudo_inertia

NEGATIVE_MASS_DEVIATIONS = 3.0  # standard deviations of a mass below zero above which it is an error
DERIVATIVE_STEP = 1e-6  # [1] step of numerical derivatives, over a parameter's size


def carried(model: Model) -> Load | None:
    """Sum of the payloads of a model about the frame of its last joint; None without any.

    The covariance is zero if the model states none (`payload_covariance`).
    """
    laws = [law for law in model.laws if law.effect.name == "payload"]
    if not laws:
        return None
    total = np.sum([law.effect.coefficients(law.parameters) for law in laws], axis=0)
    known = model.payload_covariance
    return Load(total, np.zeros((len(INERTIAL),) * 2) if known is None else known)


def with_payload(model: ModelSource, inertial: ArrayLike, covariance: ArrayLike | None = None) -> Model:
    """Model that carries a further load at its last link, in one law with what it carries already.

    >>> signid.with_payload("3r", [0.3, 0, 0, 0.05]).laws[0].parameters["mass"]
    0.3

    A negative mass takes a load off. If nothing is left within three standard deviations, the model carries none. The
    covariance of the model's base parameters grows by that of the load.

    Args:
        model: rigid bodies and laws.
        inertial: (10,) [kg, kg.m, kg.m2] mass, first moments and inertia about the frame of the last joint, in
            Pinocchio's order; (4,): a point mass.
        covariance: (4, 4) or (10, 10) [products of their units] of their errors; infinite variances are
            unidentifiable. None: unknown, then also of the sum.

    Raises:
        OptionError: an array has another shape, a number is not finite, a variance is not positive, or more is taken
            off than the model carries.
    """
    model = as_model(model, "with_payload")
    effect, numbers = EFFECTS["payload"], np.asarray(inertial, float)
    shapes = [numbers.shape, (len(numbers),) * 2 if covariance is None else np.shape(covariance)]
    if shapes not in ([(4,), (4, 4)], [(10,), (10, 10)]) or not np.isfinite(numbers).all():
        raise OptionError(
            f"a payload has 4 or 10 finite numbers and a covariance of as many rows and columns, not shapes "
            f"{shapes[0]} and {shapes[1]}"
        )
    if covariance is not None and not np.all(np.diag(covariance) > 0):
        raise OptionError("a payload has a variance that is not positive; leave out a covariance that is not known")
    added = np.array(effect.coefficients(dict(zip(effect.parameters, numbers.tolist(), strict=False))))
    own = np.zeros((len(INERTIAL),) * 2) if covariance is None else _ten(np.asarray(covariance, float))
    before = carried(model) or Load(np.zeros(len(INERTIAL)), np.zeros_like(own))
    total, errors = before.inertial + added, before.covariance + own
    if total[0] < -NEGATIVE_MASS_DEVIATIONS * np.sqrt(errors[0, 0]):
        raise OptionError(
            f"the model of {model.robot.name} carries {before.inertial[0]:.3g} kg, so {-added[0]:.3g} kg cannot be "
            f"taken off; give a smaller load"
        )
    laws = tuple(law for law in model.laws if law.effect.name != "payload")
    if total[0] <= 0:
        return replace(model, laws=laws, payload_covariance=None)
    law = Law(effect, (len(model.robot.joints) - 1,), dict(zip(effect.parameters, total.tolist(), strict=True)))
    unknown = covariance is None or (before.inertial[0] > 0 and model.payload_covariance is None)
    return replace(_less_sure(model, own), laws=(*laws, law), payload_covariance=None if unknown else errors)


def _ten(covariance: Array) -> Array:
    """Covariance (10, 10) of ten numbers; the inertia of a point mass is not identified."""
    whole = np.diag(np.full(len(INERTIAL), np.inf))
    whole[: len(covariance), : len(covariance)] = covariance
    return whole


def _less_sure(model: Model, covariance: Array) -> Model:
    """Model whose base parameters have the errors of a load as well, where these are finite."""
    base = model.covariance
    if base is None:
        return model
    first = len(INERTIAL) * own_body(model.robot, len(model.robot.joints) - 1)
    columns = base.combination[:, first : first + len(INERTIAL)]
    finite = np.isfinite(np.diag(covariance))
    known = np.where(np.outer(finite, finite), covariance, 0.0)
    return replace(model, covariance=replace(base, matrix=base.matrix + columns @ known @ columns.T))


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
        size = np.maximum(np.abs(x), 1e-3 * np.abs(x).max()) * DERIVATIVE_STEP
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
