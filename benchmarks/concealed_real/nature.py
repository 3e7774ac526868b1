"""What nature concealed: physics that the usual model of a set lacks, as others found it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import signid
from signid.effects import EFFECTS
from signid.model import Model, load_model
from signid.types import Law, Recording

from .case import Case, Truth
from .changes import Scene
from .sets import RealSet, data, read

KIND = "nature"
PAYLOAD = 2.805  # kg, weighed by those who recorded
COUPLING = {"inertia": 0.00964, "viscous": 0.616, "coulomb": 1.95}  # published, kg.m2, N.m.s/rad, N.m
DIRECTIONS = ("asymmetric_friction", "armature")
FRICTION = ("viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction")


def concealed(one: RealSet, scene: Scene, a: list[Recording]) -> Iterator[Case]:
    """The cases of a set, none for most.

    Args:
        one: the set.
        scene: of the set.
        a: what was identified.
    """
    if one.name in CASES:
        yield CASES[one.name](one, scene, a)


def _payload(one: RealSet, scene: Scene, a: list[Recording]) -> Case:
    b, c = (read(one, scene.model.robot, one.more[key]) for key in ("loaded", "loaded, judged"))
    truth = Truth(("payload",), (len(scene.model.robot.joints) - 1,), {"mass": PAYLOAD}, last=True)
    return Case(KIND, f"{PAYLOAD} kg payload", scene.model, b, c, truth, other=True)


def _coupling(one: RealSet, scene: Scene, a: list[Recording]) -> Case:
    law = Law(EFFECTS["joint_coupling"], (4, 5), COUPLING)
    knowing = replace(scene.model, laws=(*scene.model.laws, law))
    return _same(scene, "wrist coupling", Truth(("joint_coupling",), (4, 5)), knowing)


def _directions(one: RealSet, scene: Scene, a: list[Recording]) -> Case:
    knowing = signid.identify(scene.model.robot, a, options=signid.Options(effects=DIRECTIONS)).model
    return _same(scene, "asymmetric friction", Truth(("asymmetric_friction",), (0,)), knowing)


def _friction(one: RealSet, scene: Scene, a: list[Recording]) -> Case:
    published = load_model(data() / one.folder / one.urdf)
    case = _same(scene, "published inertials, no friction", Truth(FRICTION, None), scene.model)
    return replace(case, model=published)


def _same(scene: Scene, what: str, truth: Truth, knowing: Model) -> Case:
    return Case(KIND, what, scene.model, scene.b, scene.c, truth, knowing)


CASES: dict[str, Callable[[RealSet, Scene, list[Recording]], Case]] = {
    "ur10e": _payload,
    "tx40": _coupling,
    "emps": _directions,
    "panda": _friction,
}
