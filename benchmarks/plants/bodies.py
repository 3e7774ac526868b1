"""URDF for a plant: visuals removed, unused joints welded, planted bodies added."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from .control import Array
from .faults import BODY, INERTIA, Fault


@dataclass(frozen=True)
class Drives:
    """Drive parameters, n values each [kg.m2, N.m.s/rad, N.m, N.m]; offsets are torques that the motor adds."""

    armature: Sequence[float]
    viscous_friction: Sequence[float]
    coulomb_friction: Sequence[float]
    torque_offset: Sequence[float]

    @classmethod
    def none(cls, n: int) -> Drives:
        """Drives of n joints without friction and rotors."""
        zero = (0.0,) * n
        return cls(zero, zero, zero, zero)


@dataclass(frozen=True)
class Body:
    """URDF with the names of its moving joints and mass factors of links; all other joints are welded."""

    urdf: str  # text of the URDF
    joints: tuple[str, ...]
    heavier: Mapping[str, float] = field(default_factory=dict)  # link -> factor on mass and inertia [1]


def drive(drives: Drives, joints: Sequence[str], faults: Iterable[Fault]) -> Drives:
    """Add the faults that change a drive parameter to the drives."""
    names = {
        "armature": ("armature", "inertia"),
        "viscous_friction": ("viscous_friction", "coefficient"),
        "coulomb_friction": ("coulomb_friction", "level"),
        "torque_offset": ("torque_offset", "offset"),
    }
    values = {name: np.array(getattr(drives, name), dtype=float) for name in names}
    for fault in faults:
        if fault.effect in names:
            name, key = names[fault.effect]
            values[name][joints.index(str(fault.joint))] += fault.numbers[key]
    return Drives(**{name: tuple(value) for name, value in values.items()})


def bare(body: Body, faults: Iterable[Fault] = ()) -> str:
    """URDF without visuals, with welded joints and planted bodies."""
    root = ElementTree.fromstring(body.urdf.encode())
    for link in root.iter("link"):
        for part in (*link.findall("visual"), *link.findall("collision")):
            link.remove(part)
    for other in [child for child in root if child.tag not in ("link", "joint")]:
        root.remove(other)
    for joint in root.findall("joint"):
        if joint.get("name") not in body.joints:
            joint.set("type", "fixed")
    for fault in faults:
        if fault.effect in ("payload", "link_inertia"):
            _burden(_moved(root, fault.joint or body.joints[-1]), fault)
    return ElementTree.tostring(root, encoding="unicode")


def tilted(gravity: Array, faults: Iterable[Fault]) -> Array:
    """Gravity (3,) [m/s2] in the frame of the tilted base: transposed rotation by the vector (x, y, 0)."""
    for fault in faults:
        if fault.effect == "base_tilt":
            vector = np.array([fault.numbers["x"], fault.numbers["y"], 0.0])
            angle = float(np.linalg.norm(vector)) or 1e-300
            x = vector / angle
            across = np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])
            rotation = np.eye(3) + np.sin(angle) * across + (1 - np.cos(angle)) * across @ across
            gravity = rotation.T @ gravity
    return gravity


def _moved(root: ElementTree.Element, joint: str) -> ElementTree.Element:
    """Child link of a joint."""
    child = root.find(f"joint[@name='{joint}']/child")
    link = root.find(f"link[@name='{child.get('link')}']") if child is not None else None
    if link is None:
        raise ValueError(f"the URDF has no joint {joint} that moves a link")
    return link


def _burden(link: ElementTree.Element, fault: Fault) -> None:
    """Add the fault's mass, first moment and inertia to the link's inertial.

    Without a given inertia (about the joint's frame), a payload is a point mass, and a corrected link keeps its inertia
    about the moved centre of mass.
    """
    mass, centre, inertia = _inertial(link)
    more, *moment = (fault.numbers[key] for key in BODY)
    total = mass + more
    if total <= 0:
        raise ValueError(f"{fault.effect} leaves link {link.get('name')} without positive mass")
    moved = (mass * centre + moment) / total
    if INERTIA[0] in fault.parameters:
        xx, xy, yy, xz, yz, zz = (fault.numbers[key] for key in INERTIA)
        about = inertia + mass * _spread(centre) + np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        inertia = about - total * _spread(moved)
    elif fault.effect == "payload":
        about = inertia + mass * _spread(centre) + more * _spread(np.array(moment) / (more or 1.0))
        inertia = about - total * _spread(moved)
    least = np.linalg.eigvalsh(inertia)
    if least[0] < 0 or least[0] + least[1] < least[2] * (1 - 1e-9):
        raise ValueError(f"{fault.effect} leaves link {link.get('name')} with a physically inconsistent inertia")
    _write(link, total, moved, inertia)


def _spread(c: Array) -> Array:
    """Inertia (3, 3) [m2] of a unit mass at c (3,) [m]."""
    return np.asarray(c @ c * np.eye(3) - np.outer(c, c))


def _inertial(link: ElementTree.Element) -> tuple[float, Array, Array]:
    """Mass [kg], centre (3,) [m] and inertia about it (3, 3) [kg.m2] along the link's axes."""
    part = link.find("inertial")
    if part is None:
        return 0.0, np.zeros(3), np.zeros((3, 3))
    origin, mass, stated = (part.find(tag) for tag in ("origin", "mass", "inertia"))
    place = {} if origin is None else origin.attrib
    centre, (r, p, y) = (np.array(place.get(key, "0 0 0").split(), dtype=float) for key in ("xyz", "rpy"))
    turn = _turn(2, y) @ _turn(1, p) @ _turn(0, r)
    xx, xy, yy, xz, yz, zz = (
        float("0" if stated is None else stated.get(key, "0")) for key in ("ixx", "ixy", "iyy", "ixz", "iyz", "izz")
    )
    inertia = turn @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ turn.T
    return float("0" if mass is None else mass.get("value", "0")), centre, inertia


def _turn(axis: int, angle: float) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    turn, (i, j) = np.eye(3), ((1, 2), (2, 0), (0, 1))[axis]
    turn[i, i], turn[j, j], turn[i, j], turn[j, i] = c, c, -s, s
    return turn


def _write(link: ElementTree.Element, mass: float, centre: Array, inertia: Array) -> None:
    for old in link.findall("inertial"):
        link.remove(old)
    part = ElementTree.SubElement(link, "inertial")
    ElementTree.SubElement(part, "origin", xyz=" ".join(f"{x:.17g}" for x in centre), rpy="0 0 0")
    ElementTree.SubElement(part, "mass", value=f"{mass:.17g}")
    rows = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    ElementTree.SubElement(part, "inertia", {key: f"{inertia[at]:.17g}" for key, at in rows.items()})
