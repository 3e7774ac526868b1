"""Audit of a description without a recording: units, placeholders, impossible inertias, and defaults of joints."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from math import inf, pi, prod
from typing import Any, NamedTuple

import numpy as np

from ..errors import shorten
from ..types import Array, Mask, Robot
from .document import CONDITION_TEXTS, children, inertial_fault, local, parse

THOUSAND = 1e3  # g in a kg, mm in a m
INERTIA_UNITS = {1e3: "g.m2", 1e4: "kg.cm2", 1e6: "kg.mm2", 1e7: "g.cm2", 1e9: "g.mm2"}  # per kg.m2
# [1] inertia over mass and size squared: usual; too large; of a wrong unit in one body, and in most. The median of the
# bodies is 0.036 to 0.48 on sound robots of example-robot-data
USUAL_INERTIA_RATIO, MAX_INERTIA_RATIO, BODY_UNIT_RATIO, ROBOT_UNIT_RATIO = 0.16, 12.0, 100.0, 30.0
MAX_JOINT_DISTANCE = 20.0  # [m] largest distance between joints
MAX_CENTRE_RATIO = 30.0  # [1] largest distance of a centre of mass over the size of a body
# [kg/m3] masses over the cubes of sizes, 5 to 800 on these robots, from which on they are in g; density of metal, which
# a single body may be, and a shape
GRAM_DENSITY, METAL_DENSITY = 3000.0, 22_600.0
MASS_RATIO = 100.0  # [1] mass of one body over the median
LARGE_BODY_SHARE = 0.2  # [1] size, and radius of gyration, of one body over the reach, from which on it is large
MIN_BODY_SIZE = 0.02  # [m] smallest size of a body
POINT_MASS_INERTIA, MOMENT_TOLERANCE = 1e-7, 1e-6  # [kg.m2] inertia of a point mass, and [1] tolerance of equal moments
MIN_JOINTS, DISPARITY = 4, 2.0  # joints, and [1] ratio of their effort limits, from which on equal damping is a default
UNIT_WORDS = {"centre": ("centres of mass", "mm"), "mass": ("masses", "g"), "inertia": ("inertias", "")}
VOLUMES = {"box": 1.0, "cylinder": pi, "sphere": 4 / 3 * pi}  # [1] over the product of sizes, or of radius and length
HARMLESS_KINDS = ("damping", "effort", "velocity")  # kinds of suspects that no inertial torque depends on


class Suspect(NamedTuple):
    """A number of a description that is probably wrong; the sentence names all links with the same fault."""

    link: str
    what: str  # "length", "centre", "mass", "inertia", "placeholder", "impossible", "damping", "effort" or "velocity"
    factor: float | None  # [1] by which it is too large, where that is a unit
    sentence: str


@dataclass(frozen=True, eq=False)
class Audit:
    """Suspects of a description, and the robot with its bodies corrected where a unit was recognised."""

    robot: Robot
    suspects: tuple[Suspect, ...] = ()

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences on harmless suspects: limits and damping."""
        return tuple(dict.fromkeys(x.sentence for x in self.suspects if x.what in HARMLESS_KINDS))

    def before(self, flags: Iterable[str] = ()) -> tuple[str, ...]:
        """Sentences on all other suspects, then the flags, each once."""
        return tuple(dict.fromkeys((*(x.sentence for x in self.suspects if x.what not in HARMLESS_KINDS), *flags)))


class _BodySizes(NamedTuple):
    """Moving bodies as stated, without and with a shape."""

    mass: Array  # (nb,) [kg]
    centre: Array  # (nb,) [m] distance of the centre of mass from the joint
    moments: Array  # (nb, 3) [kg.m2] principal, about the centre of mass; 0 where no joint turns the body
    length: Array  # (nb,) [m] to the farthest joint behind, or from the joint before where that is near
    path: Array  # (nb,) [m] from the root along the joints to this one
    extent: Array  # (nb,) [m] of the shape, 0 without
    density: Array  # (nb,) [kg/m3] of the link in its shape, 0 without

    @property
    def reach(self) -> float:
        """Farthest that a body is along the joints [m]."""
        return float(np.max(self.path + np.maximum(self.centre, self.extent), initial=0.0))

    @property
    def usual(self) -> float:
        """Median of the lengths [m]; 0 without any."""
        known = self.length[self.length > 0]
        return float(np.median(known)) if len(known) else 0.0

    @property
    def radius(self) -> Array:
        """Radii of gyration (nb,) [m], the largest; 0 without mass."""
        return np.sqrt(np.maximum(self.moments[:, 2], 0.0) / np.where(self.mass > 0, self.mass, inf))

    @property
    def size(self) -> Array:
        """Sizes (nb,) [m]: of the shape or the link, at least half of the usual length."""
        least = max(self.usual / 2, MIN_BODY_SIZE)
        return np.asarray(np.maximum.reduce([self.length, self.extent, self.centre]).clip(least))

    @property
    def share(self) -> Array:
        """Largest moment over mass and size squared (nb,) [1]; 0 without mass."""
        return np.asarray((self.radius / self.size) ** 2)


def audit(robot: Robot) -> Audit:
    """Judge the numbers of a description by each other, without a recording.

    Units are recognised where lengths, masses or inertias are 1000 times and more too large for a robot. A moving body
    is judged with all links that are rigidly attached to it, by which the torque changes.
    """
    root = parse(robot.document) if robot.kind == "urdf" else None
    bodies, suspects = _measure_bodies(robot, root), list[Suspect]()
    if (far := bodies.length > MAX_JOINT_DISTANCE).any():
        text = f"joints of {{}} are up to {bodies.length.max():.3g} m apart: their distances seem to be in mm"
        suspects += _suspects(robot, far, "length", THOUSAND, f"{text}; correct the description")
        bodies = bodies._replace(length=bodies.length / THOUSAND, path=bodies.path / THOUSAND)
    usual = max(bodies.usual, MIN_BODY_SIZE) if bodies.usual else MAX_JOINT_DISTANCE / MAX_CENTRE_RATIO
    far = bodies.centre > MAX_CENTRE_RATIO * np.maximum(bodies.length, bodies.extent).clip(usual)
    mostly = np.sum(far) >= np.sum(bodies.mass > 0) / 2 > 0
    centre = np.where((bodies.centre > 0) if mostly else far, THOUSAND, 1.0)
    bodies = bodies._replace(centre=bodies.centre / centre)
    mass = _mass_factors(bodies)
    bodies = bodies._replace(mass=bodies.mass / mass)
    default = _placeholders(bodies)
    inertia = _inertia_factors(bodies, default)
    bodies = bodies._replace(moments=bodies.moments / inertia[:, None])
    for what, factors in (("centre", centre), ("mass", mass), ("inertia", inertia)):
        for factor in np.unique(factors[factors > 1]).tolist():
            noun, unit = UNIT_WORDS[what]
            fact = f"the {noun} of {{}} are about {factor:.0f} times too large: they seem to be in"
            advice = "correct the description; check, identify and diagnose calculate with the corrected numbers"
            text = f"{fact} {unit or INERTIA_UNITS[factor]}; {advice}"
            suspects += _suspects(robot, factors == factor, what, factor, text)
    suspects += [*_inertia_suspects(robot, bodies, default), *(() if root is None else _joint_suspects(robot, root))]
    if any((factors > 1).any() for factors in (centre, mass, inertia)):
        model = robot.model.copy()
        for k, body in enumerate(model.inertias[1:]):
            body.inertia, body.mass, body.lever = body.inertia / inertia[k], body.mass / mass[k], body.lever / centre[k]
            model.inertias[k + 1] = body
        robot = replace(robot, model=model)
    return Audit(robot, tuple(suspects))


def _measure_bodies(robot: Robot, root: Any) -> _BodySizes:
    stated, before = list(robot.model.inertias)[1:], np.array(list(robot.model.parents)[1:], int) - 1
    offset = np.array([np.linalg.norm(place.translation) for place in list(robot.model.jointPlacements)[1:]])
    length, path = np.zeros(len(stated)), offset.copy()
    turns = np.array([not x.shortname().startswith("JointModelP") for x in list(robot.model.joints)[1:]])
    for body in np.flatnonzero(before >= 0).tolist():
        length[before[body]] = max(length[before[body]], offset[body])
        path[body] += path[before[body]]
        turns[body] |= turns[before[body]]
    length = np.where(length > MIN_BODY_SIZE, length, np.maximum(length, offset))
    mass = np.array([body.mass for body in stated])
    centre = np.array([np.linalg.norm(body.lever) if body.mass else 0.0 for body in stated])
    counts = zip(stated, turns, strict=True)
    moments = np.array([np.linalg.eigvalsh(x.inertia) if x.mass and turn else np.zeros(3) for x, turn in counts])
    shapes = {} if root is None else {link.get("name"): _link_shape(link) for link in children(root, "link")}
    extent, density = np.array([shapes.get(link, (0.0, 0.0)) for link in robot.links]).reshape(-1, 2).T
    return _BodySizes(mass, centre, moments, length, path, extent, density)


def _link_shape(link: Any) -> tuple[float, float]:
    """Largest extent [m] of the boxes, cylinders and spheres of a link, and its density in them [kg/m3]; 0 without."""
    extents, volumes = [0.0], dict.fromkeys(("visual", "collision"), 0.0)
    for kind in volumes:
        for form in (form for part in children(link, kind) for node in children(part, "geometry") for form in node):
            try:
                size = [float(x) for key in ("size", "radius", "length") for x in (form.get(key) or "").split()]
            except ValueError:
                size = []
            if len(size) != {"box": 3, "cylinder": 2, "sphere": 1}.get(tag := local(form)):
                volumes[kind] = inf  # a mesh, whose volume is unknown
                continue
            extents.append(float(np.linalg.norm(size)) * (2 if tag == "sphere" else 1))
            volumes[kind] += VOLUMES[tag] * prod(size) * {"cylinder": size[0], "sphere": size[0] ** 2}.get(tag, 1.0)
    stated = [float(mass.get("value") or 0) for part in children(link, "inertial") for mass in children(part, "mass")]
    volume = max(volumes.values())
    return max(extents), stated[0] / volume if stated and 0 < volume < inf else 0.0


def _mass_factors(bodies: _BodySizes) -> Array:
    """Factors (nb,) [1] by which masses are too large: of all bodies, or of those beyond the others and their shape."""
    weighs, volume = bodies.mass > 0, bodies.size**3
    others = weighs & (np.arange(len(weighs)) != np.argmax(bodies.mass))
    limit, judged = (GRAM_DENSITY, others) if others.any() else (METAL_DENSITY, weighs)
    if not judged.any() or bodies.reach < MIN_BODY_SIZE:
        return np.ones(len(weighs))
    dense = others.any() and np.median(bodies.density) > METAL_DENSITY  # shapes of most bodies
    if dense or bodies.mass[judged].sum() > limit * volume[judged].sum():
        return np.where(weighs, THOUSAND, 1.0)
    least = GRAM_DENSITY * np.maximum(bodies.size, LARGE_BODY_SHARE * bodies.reach) ** 3
    return np.where((bodies.mass > MASS_RATIO * np.median(bodies.mass[weighs])) & (bodies.mass > least), THOUSAND, 1.0)


def _placeholders(bodies: _BodySizes) -> Mask:
    """Bodies (nb,) with three equal moments that are a power of ten, as others have or far too large for the body."""
    least, most = bodies.moments[:, 0], bodies.moments[:, 2]
    power = np.log10(np.where(most > POINT_MASS_INERTIA, most, 2.0))
    default = (most - least <= MOMENT_TOLERANCE * np.abs(most)) & (np.abs(power - np.round(power)) < MOMENT_TOLERANCE)
    several = np.array([np.sum(default & (np.abs(power - x) < MOMENT_TOLERANCE)) > 1 for x in power])
    return default & (several | (bodies.share > MAX_INERTIA_RATIO))


def _inertia_factors(bodies: _BodySizes, placeholder: Mask) -> Array:
    """Factors (nb,) [1] of units by which inertias are too large, the same of all bodies where most are."""
    share, units = np.where(placeholder, 0.0, bodies.share), np.array(list(INERTIA_UNITS))

    def nearest(ratio: Array) -> Array:
        return np.asarray(units[np.argmin(np.abs(np.log(ratio[:, None] / USUAL_INERTIA_RATIO / units)), axis=1)])

    middle = np.median(share[share > 0]) if share.any() else 0.0
    if middle > ROBOT_UNIT_RATIO:
        unit = nearest(np.array([middle]))
        return np.where(share > unit * USUAL_INERTIA_RATIO / THOUSAND, unit, 1.0)
    return np.where(share > BODY_UNIT_RATIO, nearest(np.maximum(share, ROBOT_UNIT_RATIO)), 1.0)


def _suspects(robot: Robot, which: Mask, what: str, factor: float | None, text: str) -> Iterator[Suspect]:
    """Suspects of bodies (nb,) with one sentence, in which {} stands for their links."""
    links = [link for link, suspect in zip(robot.links, which, strict=True) if suspect]
    sentence = text.format(("link " if len(links) == 1 else "links ") + shorten(links, 4))
    return (Suspect(link, what, factor, sentence) for link in links)


def _inertia_suspects(robot: Robot, bodies: _BodySizes, placeholder: Mask) -> Iterator[Suspect]:
    """Placeholders, inertias too large for mass and size, and those that no body can have."""
    text = "the inertias of {} are placeholders: a power of ten in all directions; replace them"
    yield from _suspects(robot, placeholder, "placeholder", None, text)
    large = (bodies.share > MAX_INERTIA_RATIO) & (bodies.radius > LARGE_BODY_SHARE * bodies.reach) & ~placeholder
    widest = bodies.radius[large].max(initial=0.0)
    text = f"the inertias of {{}} are too large for mass and size (radius of gyration up to {widest:.2g} m)"
    yield from _suspects(robot, large, "inertia", None, f"{text}; correct the description")
    least, middle, most = bodies.moments.T
    near = np.maximum(MOMENT_TOLERANCE * most, POINT_MASS_INERTIA)
    thin = (bodies.mass > 0) & (np.abs(least) <= near) & (most - middle <= near)  # points and rods
    kinds = [inertial_fault(m, np.diag(axes)) for m, axes in zip(bodies.mass, bodies.moments, strict=True)]
    for kind, texts in CONDITION_TEXTS.items():
        wrong = np.array([axes == kind for axes in kinds]) & ~placeholder & ~thin
        yield from _suspects(robot, wrong, "impossible", None, f"{{}} {texts[int(wrong.sum() > 1)]}")


def _joint_suspects(robot: Robot, root: Any) -> Iterator[Suspect]:
    """Limits of zero, and one damping of all joints although their effort limits differ."""
    stated = {joint.get("name"): joint for joint in children(root, "joint")}
    joints = [(name, link, stated[name]) for name, link in zip(list(robot.model.names)[1:], robot.links, strict=True)]
    for key in ("effort", "velocity"):
        zero = [entry for entry in joints if any(float(x.get(key) or 1) == 0 for x in children(entry[2], "limit"))]
        sentence = f"the {key} limit of {shorten([name for name, *_ in zero], 4)} is stated as 0, which counts as none"
        yield from (Suspect(link, key, None, sentence) for _, link, _ in zero)
    damping = [float(form.get("damping") or 0) for *_, joint in joints for form in children(joint, "dynamics")]
    effort, same = robot.effort_limit, max(damping, default=0.0)
    disparate = effort.max() >= DISPARITY * effort.min()
    if len(damping) == len(joints) >= MIN_JOINTS and min(damping) == same > 0 and disparate:
        text = f"all joints have the same damping of {same:g}, although their effort limits differ"
        yield from (Suspect(link, "damping", None, f"{text}: it is a default") for _, link, _ in joints)
