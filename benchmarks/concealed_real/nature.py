"""Physics missing in the default model of a set, with the published truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import signid
from signid.effects import EFFECTS
from signid.model import Model, load_model
from signid.types import Law, Recording

from .case import Case, Truth
from .changes import Setup
from .sets import RealSet, data, read

KIND = "nature"
PAYLOAD = 2.805  # mass weighed by the authors [kg]
COUPLING = {"inertia": 0.00964, "viscous": 0.616, "coulomb": 1.95}  # published [kg.m2], [N.m.s/rad], [N.m]
DIRECTIONS = ("asymmetric_friction", "armature")
FRICTION = ("viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction")


def concealed(one: RealSet, setup: Setup, a: list[Recording]) -> Iterator[Case]:
    """Yield the cases of a set; most sets have none.

    Args:
        one: set of recordings.
        setup: model and recordings of the set.
        a: identified recordings.
    """
    if one.name in CASES:
        yield CASES[one.name](one, setup, a)


def _payload(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    b, c = (read(one, setup.model.robot, one.more[key]) for key in ("loaded", "loaded, held out"))
    truth = Truth(("payload",), (len(setup.model.robot.joints) - 1,), {"mass": PAYLOAD}, last=True)
    return Case(KIND, f"{PAYLOAD} kg payload", setup.model, b, c, truth, other=True)


def _coupling(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    law = Law(EFFECTS["joint_coupling"], (4, 5), COUPLING)
    complete = replace(setup.model, laws=(*setup.model.laws, law))
    return _same(setup, "wrist coupling", Truth(("joint_coupling",), (4, 5)), complete)


def _directions(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    complete = signid.identify(setup.model.robot, a, options=signid.Options(effects=DIRECTIONS)).model
    return _same(setup, "asymmetric friction", Truth(("asymmetric_friction",), (0,)), complete)


def _friction(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    published = load_model(data() / one.folder / one.urdf)
    case = _same(setup, "published inertials, no friction", Truth(FRICTION, None), setup.model)
    return replace(case, model=published)


def _same(setup: Setup, what: str, truth: Truth, complete: Model) -> Case:
    return Case(KIND, what, setup.model, setup.b, setup.c, truth, complete)


CASES: dict[str, Callable[[RealSet, Setup, list[Recording]], Case]] = {
    "ur10e": _payload,
    "tx40": _coupling,
    "emps": _directions,
    "panda": _friction,
}
