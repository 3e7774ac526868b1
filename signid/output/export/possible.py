"""The bodies of a model as MuJoCo takes them: only such as could be."""

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

_SURE = 1e8  # 1 over the standard deviation of every base parameter, in its own size


class Bodies(NamedTuple):
    """What the joints carry, payloads that are bodies by themselves, and a sentence on what had to be changed."""

    links: list[Principal]  # nb
    loads: list[tuple[Law, Principal]]
    notes: list[str]


def possible_bodies(model: Model) -> Bodies:
    """The bodies of a model; where some could not be, all are exchanged for others with the same torque.

    Raises:
        RobotError: no real robot has that torque.
    """
    loads = _loads(model)
    apart = {id(law) for law, _ in loads}
    bare = replace(model, laws=tuple(law for law in model.laws if id(law) not in apart))
    links = [principal(x) for x in bare.whole_inertials()]
    odd = [name for name, body in zip(model.robot.links, links, strict=True) if body is None]
    if not odd:
        return Bodies([body for body in links if body], loads, [])
    changed = _exchanged(model)
    bodies = [] if changed is None else [body for body in map(principal, changed) if body]
    if len(bodies) < len(links):
        raise RobotError(
            f"no real robot has the torque of this one, as its {shorten(odd)} could not be, and MuJoCo takes only "
            "bodies that could; identify with --method convex, or export to a URDF"
        )
    told = f"inertials are others that a real robot could have, with the same torque, as none has {shorten(odd)}"
    return Bodies(bodies, [], [told])


def _loads(model: Model) -> list[tuple[Law, Principal]]:
    """Payloads that are possible bodies by themselves, to be seen; others become part of their link's inertial."""
    found = []
    for law in model.laws:
        if law.effect.name == "payload" and law.parameters["mass"] > LEAST:
            body = principal(np.array(law.effect.coefficients(law.parameters)))
            found += [(law, body)] if body else []
    return found


def _exchanged(model: Model) -> Array | None:
    """Inertials (nb, 10) [kg, kg.m, kg.m2] of real bodies with the torque of the model's; None if there are none.

    They have the same base parameters and are otherwise near those of the description.
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
