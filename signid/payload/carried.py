"""Load that a model carries: the sum of its laws `payload`, and the model with a further load."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..effects import EFFECTS
from ..errors import OptionError
from ..model import Model
from ..robot.dynamics import own_body
from ..types import INERTIAL, Array, Law
from .load import Load

CERTAIN = 3.0  # standard deviations of a mass below zero above which it is an error


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


def with_payload(model: Model, inertial: Array, covariance: Array | None = None) -> Model:
    """Model that carries a further load at its last link, in one law with what it carries already.

    A negative mass takes a load off. If nothing is left within three standard deviations, the model carries none. The
    covariance of the model's base parameters grows by that of the load.

    Args:
        model: rigid bodies and laws.
        inertial: (10,) [kg, kg.m, kg.m2] mass, first moments and inertia about the frame of the last joint, in
            Pinocchio's order; (4,): a point mass.
        covariance: (4, 4) or (10, 10) [products of their units] of their errors; infinite variances are
            unidentifiable. None: unknown, then also of the sum.

    Raises:
        OptionError: the array has another shape, or more is taken off than the model carries.
    """
    effect, k = EFFECTS["payload"], len(inertial)
    if k not in (4, len(INERTIAL)) or not (covariance is None or np.shape(covariance) == (k, k)):
        raise OptionError(
            f"a payload has 4 or 10 numbers and a square covariance, not {k} numbers"
            f"{'' if covariance is None else f' and a covariance of shape {np.shape(covariance)}'}"
        )
    added = np.array(effect.coefficients(dict(zip(effect.parameters, map(float, inertial), strict=False))))
    before = carried(model)
    total = added if before is None else before.inertial + added
    whole = None if covariance is None else _ten(np.asarray(covariance, float))
    errors = None if before is not None and model.payload_covariance is None else whole
    if errors is not None and before is not None:
        errors = errors + before.covariance
    least = 0.0 if errors is None else -CERTAIN * np.sqrt(errors[0, 0])
    if total[0] < least:
        raise OptionError(
            f"the model of {model.robot.name} carries {total[0] - added[0]:.3g} kg, so {-added[0]:.3g} kg cannot be "
            f"taken off; give a smaller load"
        )
    laws = tuple(law for law in model.laws if law.effect.name != "payload")
    if total[0] <= 0:
        return replace(model, laws=laws, payload_covariance=None)
    law = Law(effect, (len(model.robot.joints) - 1,), dict(zip(effect.parameters, total.tolist(), strict=True)))
    less_sure = model if whole is None else _less_sure(model, whole)
    return replace(less_sure, laws=(*laws, law), payload_covariance=errors)


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
