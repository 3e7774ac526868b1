"""Robots of the blind benchmark: descriptions without visuals, and ranges of motion."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from signid.robot import load_robot

from ..plants.bodies import Body, bare

Array = NDArray[np.float64]

MASS, CENTRE, INERTIA = 1.0, 0.1, 2.0  # errors of mass [1], centre [m] and inertia [1] per unit of `error`
LEAST = 0.3  # smallest factor on a stated mass or inertia [1]


class Place(NamedTuple):
    """Centre and largest amplitude of a robot's motions."""

    centre: tuple[float, ...]  # (n,) [rad]
    reach: float  # rad


ROBOTS: Mapping[str, Place] = {
    "1r": Place((0.6,), 1.2),
    "3r": Place((0.0, 0.4, 0.6), 1.0),
    "ur5": Place((0.0, -1.2, 1.2, -0.6, 0.9, 0.3), 0.9),
    "panda": Place((0.0, -0.3, 0.0, -1.8, 0.3, 1.6, 0.4), 0.6),
    "kinova": Place((0.0, 2.6, 1.8, 0.3, 2.2, 0.4), 0.9),  # light wrist, like xarm7
    "xarm7": Place((0.0, -0.5, 0.2, 1.2, 0.3, 0.8, 0.3), 0.7),
    "z1": Place((0.0, 1.2, -1.2, 0.2, 0.3, 0.4), 0.7),
}


def described(name: str) -> Body:
    """Stated description of a robot: arm with welded hand, without visuals and drives."""
    robot = load_robot(name)
    body = Body(robot.document, robot.joints[: len(ROBOTS[name].centre)])
    root = ElementTree.fromstring(bare(body))
    for joint in root.findall("joint"):
        for part in (*joint.findall("dynamics"), *joint.findall("mimic"), *joint.findall("safety_controller")):
            joint.remove(part)
    return Body(ElementTree.tostring(root, encoding="unicode"), body.joints)


def mistaken(body: Body, error: float, rng: np.random.Generator) -> Body:
    """True robot of a wrong description: every mass, centre and inertia is perturbed."""
    root = ElementTree.fromstring(body.urdf)
    for link in root.findall("link"):
        part = link.find("inertial")
        mass, inertia = (None if part is None else part.find(tag) for tag in ("mass", "inertia"))
        draws = rng.standard_normal(5)
        if part is None or mass is None or inertia is None:
            continue
        mass.set("value", f"{float(mass.get('value', '0')) * max(1 + MASS * error * draws[0], LEAST):.17g}")
        factor = max(1 + INERTIA * error * draws[1], LEAST)
        for key, value in inertia.attrib.items():
            inertia.set(key, f"{float(value) * factor:.17g}")
        origin = part.find("origin")
        origin = ElementTree.SubElement(part, "origin") if origin is None else origin
        centre = np.array(origin.get("xyz", "0 0 0").split(), dtype=float) + CENTRE * error * draws[2:]
        origin.set("xyz", " ".join(f"{x:.17g}" for x in centre))
    return Body(ElementTree.tostring(root, encoding="unicode"), body.joints)
