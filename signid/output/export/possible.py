"""Physically consistent bodies of a model, as MuJoCo requires."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...errors import RobotError, shorten
from ...estimation.feasible import fit_consistent
from ...model import Model, stated_inertials
from ...regression.base_parameters import build_base
from ...regression.projection import least_squares
from ...types import Array, Estimate, Law, Parameters
from .inertial import LEAST, Principal, principal

_SURE = 1e8  # size of a base parameter over its standard deviation


class PossibleBodies(NamedTuple):
    """Bodies of the links, separate payload bodies, and notes on changes."""

    links: list[Principal]  # nb
    loads: list[tuple[Law, Principal]]
    notes: list[str]


def possible_bodies(model: Model) -> PossibleBodies:
    """Return the bodies of a model; if some are inconsistent, replace all by consistent ones with the same torque.

    Args:
        model: rigid bodies and laws.

    Raises:
        RobotError: no physically consistent bodies give this torque.
    """
    loads = _loads(model)
    apart = {id(law) for law, _ in loads}
    bare = replace(model, laws=tuple(law for law in model.laws if id(law) not in apart))
    links = [principal(x) for x in bare.whole_inertials()]
    odd = [name for name, body in zip(model.robot.links, links, strict=True) if body is None]
    if not odd:
        return PossibleBodies([body for body in links if body], loads, [])
    changed = _exchanged(model)
    bodies = [] if changed is None else [body for body in map(principal, changed) if body]
    if len(bodies) < len(links):
        raise RobotError(
            f"the inertials of {shorten(odd)} are not physically consistent, as MuJoCo requires, and no "
            "consistent ones give the same torque; identify with --method convex, or export to a URDF"
        )
    note = f"inertials are replaced by consistent ones with the same torque, since {shorten(odd)} had inconsistent ones"
    return PossibleBodies(bodies, [], [note])


def _loads(model: Model) -> list[tuple[Law, Principal]]:
    """Payloads that are consistent bodies by themselves; others are added to the inertial of their link."""
    found = []
    for law in model.laws:
        if law.effect.name == "payload" and law.parameters["mass"] > LEAST:
            body = principal(np.array(law.effect.coefficients(law.parameters)))
            found += [(law, body)] if body else []
    return found


def _exchanged(model: Model) -> Array | None:
    """Consistent inertials with the torque of the model, (nb, 10) [kg, kg.m, kg.m2]; None if there are none.

    They have the same base parameters and are otherwise close to the description.
    """
    robot = replace(model.robot, model=model.bodies())
    base = build_base(robot)
    value = base.combination @ model.whole_inertials().ravel()
    size = np.maximum(np.abs(value), 1e-3 * np.abs(value).max(initial=1e-9))
    known = Estimate(value, np.diag((size / _SURE) ** 2), np.diag((_SURE / size) ** 2), np.zeros(0), ())
    found = fit_consistent(base, known, Parameters(base.labels, stated_inertials(model.robot).ravel()))
    if not found.feasible_without_moving:
        return None
    near = found.parameters.values
    rest = value - base.combination @ near
    exact = Parameters(base.labels, near + least_squares(base.combination, rest))
    return exact.bodies() if exact.is_feasible() else None
