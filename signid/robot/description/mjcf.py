"""MJCF to draft: the mechanism alone goes to Pinocchio, every body and joint in it named."""

from __future__ import annotations

import tempfile
from copy import deepcopy
from dataclasses import replace
from math import inf, nan, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RobotError, shorten
from ..configuration import is_plain
from .document import Document
from .draft import Axis, Draft, Mimic
from .inertials import impossible_notes, massless_note
from .mjcf_tree import below_world, compiler_setting, included, joint_attribute, prepare
from .tree import MOST

if TYPE_CHECKING:
    import pinocchio as pin


def read_mjcf(document: Document) -> Draft:
    """The draft of an MJCF file, free bases held fixed.

    Raises:
        RobotError: when Pinocchio cannot build the model, or no hinge or slide moves.
    """
    root = deepcopy(document.root)
    text = included(root, Path(document.path).parent, document.text)
    if len(below_world(root, ("body",))) > MOST:
        raise RobotError(f"the file has more than {MOST} bodies; give the description of one robot")
    notes = prepare(root)
    if not below_world(root, ("joint",)):
        raise RobotError("the file has no moving joint (hinge or slide): nothing to identify")
    model = _build(root)
    _check_numbers(model)
    model.gravity.linear = _gravity(root)
    axes, still = _axes(root, model)
    mimics, more = _mimics(root)
    links = tuple(_link(model, i) for i in range(1, model.njoints))
    bodies = dict(zip(links, list(model.inertias)[1:], strict=True))
    notes += [*massless_note({name: body.mass for name, body in bodies.items()}), *more]
    notes += impossible_notes({name: (body.mass, body.inertia) for name, body in bodies.items()})
    if still:
        notes.append(f"held fixed at neutral: {shorten(still)}")
    draft = Draft(
        name=root.get("model") or document.stem,
        model=model,
        axes=tuple(replace(axis, mimic=mimics.get(axis.name)) for axis in axes),
        links=links,
        document=text,
        kind="mjcf",
        notes=tuple(notes),
        still=frozenset(still),
    )
    model.armature = np.zeros(model.nv)  # a law of its own, not part of the rigid bodies
    return draft


def _build(root: Any) -> pin.Model:
    import pinocchio as pin
    from lxml import etree

    bare = etree.Element("mujoco", dict(root.attrib))
    for tag in ("compiler", "option", "default", "worldbody"):
        bare.extend([deepcopy(node) for node in root.iterchildren(tag)])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        path.write_bytes(etree.tostring(bare))
        try:
            return pin.buildModelFromMJCF(str(path))
        except Exception as error:  # Pinocchio's are of no family
            reason = str(error).partition("message:")[2] or str(error)
            raise RobotError(f"Pinocchio cannot build it: {' '.join(reason.split())}") from None


def _check_numbers(model: pin.Model) -> None:
    """Pinocchio reads words among numbers as it likes.

    Raises:
        RobotError: a place or an inertial is not made of finite numbers.
    """
    for name, place, body in list(zip(model.names, model.jointPlacements, model.inertias, strict=True))[1:]:
        if not (np.isfinite(place.homogeneous).all() and np.isfinite(body.toDynamicParameters()).all()):
            raise RobotError(
                f"the body that joint {name!r} moves has a place or an <inertial> that is no number; mend it"
            )


def _gravity(root: Any) -> Any:
    """(3,) [m/s2]."""
    stated = [node.get("gravity") for node in root.iterchildren("option") if node.get("gravity")]
    gravity = _numbers(stated[-1], "gravity is") if stated else [0.0, 0.0, -9.81]
    if len(gravity) != 3:
        raise RobotError(f"gravity is {stated[-1]!r}; expected three numbers")
    return np.array(gravity)


def _axes(root: Any, model: pin.Model) -> tuple[list[Axis], list[str]]:
    """Hinges and slides in the order of the file, and the joints of other kinds."""
    axes, still = [], []
    for body in below_world(root, ("body",)):
        nodes = list(body.iterchildren("joint"))
        if not nodes:
            continue
        names = [node.get("name") for node in nodes]
        name = names[0] if len(names) == 1 else f"Composite_{names[0]}"
        if not model.existJointName(name):
            raise RobotError(f"Pinocchio leaves out joint {names[0]!r}; let MuJoCo save the compiled model")
        joint = model.joints[model.getJointId(name)]
        parts = list(joint.extract().joints) if joint.shortname() == "JointModelComposite" else [joint]
        if is_plain(joint) and len(parts) == len(nodes):
            rows = range(joint.idx_v, joint.idx_v + len(nodes))
            axes += [_axis(root, node, row, model) for node, row in zip(nodes, rows, strict=True)]
        else:
            still += names
    return axes, still


def _axis(root: Any, node: Any, row: int, model: pin.Model) -> Axis:
    """One hinge or slide; Pinocchio scales the range of slides as if it were an angle, so that is read here."""
    prismatic = joint_attribute(root, node, "type", "hinge") == "slide"
    degrees = compiler_setting(root, "angle", "degree") == "degree" and not prismatic
    ends = _numbers(joint_attribute(root, node, "range", ""), f"joint {node.get('name')!r} has range", False)
    limited = joint_attribute(root, node, "limited", "auto")
    if limited == "auto" and compiler_setting(root, "autolimits") == "false":
        limited = "false"
    free = limited == "false" or len(ends) != 2
    lower, upper = (-inf, inf) if free else (x * (pi / 180 if degrees else 1.0) for x in ends)
    return Axis(
        name=node.get("name"),
        row=row,
        prismatic=prismatic,
        lower=lower,
        upper=upper,
        velocity=float(model.velocityLimit[row]),
        effort=float(model.upperEffortLimit[row]),
        viscous=float(model.damping[row]),
        coulomb=float(model.upperDryFrictionLimit[row]),
        armature=float(model.armature[row]),
    )


def _mimics(root: Any) -> tuple[dict[str, Mimic], list[str]]:
    """Equality constraints that tie one joint to another by a straight line; a note on all others."""
    found: dict[str, Mimic] = {}
    other = 0
    moved = any(node.get("ref") for node in root.iter("joint"))  # the line would go through other points
    for node in (node for group in root.iterchildren("equality") for node in group.iterchildren("*")):
        terms = _numbers(node.get("polycoef") or "0 1", f"the constraint of joint {node.get('joint1')!r} has polycoef")
        straight = node.tag == "joint" and node.get("joint2") and not any(terms[2:]) and not moved
        if node.get("active") == "false":
            continue
        if straight and len(terms) >= 2:
            found[node.get("joint1")] = Mimic(node.get("joint2"), terms[1], terms[0])
        else:
            other += 1
    return found, [f"{other} equality constraints are left out: they are no straight mimic of a joint"] if other else []


def _link(model: pin.Model, joint: int) -> str:
    """Name of the first body that the joint carries."""
    import pinocchio as pin

    frames = [x for x in model.frames if x.parentJoint == joint and x.type == pin.FrameType.BODY]
    return str(frames[0].name) if frames else str(model.names[joint])


def _numbers(text: str, what: str, finite: bool = True) -> list[float]:
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = [nan]
    if np.isnan(numbers).any() or (finite and np.isinf(numbers).any()):
        raise RobotError(f"{what} {text!r}; expected {'finite ' if finite else ''}numbers")
    return numbers
