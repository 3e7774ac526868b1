"""Read MJCF: Pinocchio builds the model from the bodies and joints alone."""

from __future__ import annotations

import tempfile
from copy import deepcopy
from dataclasses import replace
from math import inf, nan, pi
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RobotError, shorten
from ..joints import is_plain
from .document import Axis, Document, Draft, Mimic, impossible_notes, massless_note
from .limits import bounded, check_count, check_names, not_negative
from .mjcf_tree import below_world, compiler_setting, included, joint_attribute, prepare

if TYPE_CHECKING:
    import pinocchio as pin

FRICTION = ("damping", "frictionloss", "armature")
NUMBERS = (
    "pos quat axisangle xyaxes zaxis euler axis ref springref stiffness damping frictionloss armature margin "
    "mass density diaginertia fullinertia size fromto shellinertia"
).split()  # attributes of bodies, joints, inertials and geometry


def read_mjcf(document: Document) -> Draft:
    """Read an MJCF file; free bases are held fixed.

    Raises:
        RobotError: Pinocchio cannot build the model, or there is no hinge or slide.
    """
    root = deepcopy(document.root)
    text = included(root, Path(document.path).parent, document.text)
    bodies, joints = (below_world(root, kinds) for kinds in (("body",), ("joint",)))
    check_count(len(bodies), len(joints), "bodies")
    check_names(joint=[node.get("name") for node in joints], body=[node.get("name") for node in bodies])
    _bound(root)
    notes = prepare(root)
    if not below_world(root, ("joint",)):
        raise RobotError("the file has no moving joint (hinge or slide): nothing to identify")
    model = _build(root)
    _check_numbers(model)
    model.gravity.linear = _gravity(root)
    axes, still = _axes(root, model)
    mimics, more = _mimics(root)
    links = tuple(_link(model, i) for i in range(1, model.njoints))
    moved = dict(zip(links, list(model.inertias)[1:], strict=True))
    notes += [*massless_note({name: body.mass for name, body in moved.items()}), *more]
    notes += impossible_notes({name: (body.mass, body.inertia) for name, body in moved.items()})
    if still:
        notes.append(f"held fixed at neutral: {shorten(still)}")
    model.armature = np.zeros(model.nv)  # armature is a law, not part of the rigid bodies
    return Draft(
        name=root.get("model") or document.stem,
        model=model,
        axes=tuple(replace(axis, mimic=mimics.get(axis.name)) for axis in axes),
        links=links,
        document=text,
        kind="mjcf",
        notes=tuple(notes),
        still=frozenset(still),
    )


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
        except Exception as error:  # Pinocchio's exceptions share no base class
            reason = str(error).partition("message:")[2] or str(error)
            raise RobotError(f"Pinocchio cannot build it: {' '.join(reason.split())}") from None


def _bound(root: Any) -> None:
    """Check the magnitude of the numbers that shape the dynamics, in place: negligible ones become 0."""
    for node in root.iter("body", "joint", "inertial", "geom"):
        for key in (key for key in NUMBERS if node.get(key)):
            stated = f"a <{node.tag}> has {key}={node.get(key)!r}"
            words = node.get(key).split()
            node.set(key, " ".join(_bounded(word, stated, key in FRICTION) for word in words))


def _bounded(word: str, stated: str, positive: bool) -> str:
    try:
        number = float(word)
    except ValueError:
        return word  # Pinocchio accepts words among numbers
    if positive:
        not_negative(number, stated)
    return word if bounded(number, stated) else "0"


def _check_numbers(model: pin.Model) -> None:
    """Reject poses and inertials that are not finite, because Pinocchio accepts words among numbers."""
    for name, place, body in list(zip(model.names, model.jointPlacements, model.inertias, strict=True))[1:]:
        if not (np.isfinite(place.homogeneous).all() and np.isfinite(body.toDynamicParameters()).all()):
            fault = "has a pose or an <inertial> that is not a finite number; correct it"
            raise RobotError(f"the body of joint {name!r} {fault}")


def _gravity(root: Any) -> Any:
    """Gravity (3,) [m/s2]."""
    stated = [node.get("gravity") for node in root.iterchildren("option") if node.get("gravity")]
    gravity = _numbers(stated[-1], "gravity is") if stated else [0.0, 0.0, -9.81]
    if len(gravity) != 3:
        raise RobotError(f"gravity is {stated[-1]!r}; expected three numbers")
    return np.array(gravity)


def _axes(root: Any, model: pin.Model) -> tuple[list[Axis], list[str]]:
    """Hinges and slides in the order of the file, and the names of all other joints."""
    axes, still = [], []
    for body in below_world(root, ("body",)):
        nodes = list(body.iterchildren("joint"))
        if not nodes:
            continue
        names = [node.get("name") for node in nodes]
        name = names[0] if len(names) == 1 else f"Composite_{names[0]}"
        if not model.existJointName(name):
            raise RobotError(f"Pinocchio omits joint {names[0]!r}; give the compiled model as saved by MuJoCo")
        joint = model.joints[model.getJointId(name)]
        parts = list(joint.extract().joints) if joint.shortname() == "JointModelComposite" else [joint]
        if is_plain(joint) and len(parts) == len(nodes):
            axes += [_axis(root, node, row, model) for row, node in enumerate(nodes, joint.idx_v)]
        else:
            still += names
    return axes, still


def _axis(root: Any, node: Any, row: int, model: pin.Model) -> Axis:
    """One hinge or slide; the range is read here, because Pinocchio scales ranges of slides like angles."""
    prismatic = joint_attribute(root, node, "type", "hinge") == "slide"
    degrees = compiler_setting(root, "angle", "degree") == "degree" and not prismatic
    ends = _numbers(joint_attribute(root, node, "range", ""), f"joint {node.get('name')!r} has range", False)
    limited = joint_attribute(root, node, "limited", "auto")
    if limited == "auto":
        limited = compiler_setting(root, "autolimits")
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
    """Linear equality constraints between two joints, and a note on all others."""
    found: dict[str, Mimic] = {}
    other = 0
    shifted = any(node.get("ref") for node in root.iter("joint"))  # the offset would differ
    for node in (node for group in root.iterchildren("equality") for node in group.iterchildren("*")):
        terms = _numbers(node.get("polycoef") or "0 1", f"the constraint of joint {node.get('joint1')!r} has polycoef")
        linear = node.tag == "joint" and node.get("joint2") and not any(terms[2:]) and not shifted
        if linear and len(terms) >= 2 and node.get("active") != "false":
            found[node.get("joint1")] = Mimic(node.get("joint2"), terms[1], terms[0])
        else:
            other += node.get("active") != "false"
    return found, [f"{other} equality constraints are ignored: they are not linear between two joints"] if other else []


def _link(model: pin.Model, joint: int) -> str:
    """Name of the first body that a joint moves."""
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
    return [bounded(number, f"{what} {text!r}") for number in numbers] if finite else numbers
