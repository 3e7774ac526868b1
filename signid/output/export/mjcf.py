"""Export of a model as MJCF, the format of MuJoCo."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ...effects.base import TransmissionLaw
from ...effects.joint_elasticity import RELAXATION_TIME
from ...errors import RobotError, shorten
from ...model import Model
from ...robot import configuration
from ...robot.document import children, parse
from ...robot.dynamics import joint_of_row, own_row
from ...robot.joints import is_plain
from ...robot.locate import find_mesh
from ...types import Array, Robot
from ..geometry import origin, vector
from .bodies import (
    MIN_MASS,
    Exported,
    PossibleBodies,
    Principal,
    fixed_note,
    pose_words,
    possible_bodies,
    principal,
    summed,
    words,
)
from .drives import DRIVE_STEP, mjcf_actuators, mjcf_joint, mjcf_notes
from .formats import PASSIVE, held, stiffness

NOTED_MASS_DIFFERENCE = 1e-3  # [1] difference of the mass of a floating robot from its description that is said
_PAYLOAD_DENSITY = 2700.0  # density at which a payload is drawn [kg/m3]
_PASSIVE_ATTRIBUTES = dict(zip(("damping", "frictionloss", "armature"), PASSIVE, strict=True))
_STOP_IMPEDANCE = "0.9999 0.9999 0.001 0.5 2"  # impedance of the stops of a gear
_SHORT_STEP_LAWS = ("joint_elasticity", "backlash", "presliding_friction")  # laws that need the time step of drives
_NOTES = {  # sentences, and the laws that they are on
    "polynomials of damping and stiffness need MuJoCo 3.7 or newer": ("quadratic_friction", "cable_torque"),
    "passive dcmotors need MuJoCo 3.12 or newer": ("counterbalance", "torque_ripple", "presliding_friction"),
    "JOINT is the motor and JOINT_gear the deflection of the link from it: positions add up": _SHORT_STEP_LAWS[:2],
    "elasticity, backlash and presliding need a time step of 0.1 ms to repeat a motion to 1 mrad": _SHORT_STEP_LAWS,
}
_NO_MOTOR = {"motorconst": "0", "resistance": "1", "input": "none"}  # a dcmotor without its electrical part
_MAX_STL_FACES, _STL_HEADER_BYTES, _STL_FACE_BYTES = 200_000, 84, 50  # limit of MuJoCo, and sizes [bytes]


class _Place(NamedTuple):
    """A body: parent joint of the model, pose in the parent at zero, and its joints as in MJCF by their rows."""

    parent: int
    pose: Any  # pin.SE3
    joints: dict[int, dict[str, str]]


def write_mjcf(
    model: Model, package_dirs: Sequence[str | Path] = (), floating: bool = False, meshes: str | None = None
) -> Exported:
    """Write MJCF with bodies, joints, gravity, ranges, armature, friction and springs, and a motor per joint.

    Joints with a position drive get its actuator instead. Mimic joints become equality constraints. Shapes are visual
    only: mass comes from inertials, and nothing collides. If `floating`, the base link is a body on a free joint.
    Meshes are read from their place, or from the folder `meshes` beside the file.
    """
    from lxml import etree

    robot, bodies = model.robot, possible_bodies(model)
    shapes, placed = _Shapes(robot, package_dirs), _body_places(robot)
    files = {} if meshes is None else copied(shapes.meshes, meshes)
    ties, leading = [], {own_row(robot, j) for j in range(len(robot.joints))}
    for row, joint in ((row, joint) for place in placed for row, joint in place.joints.items() if row not in leading):
        for j in np.flatnonzero(robot.drive[row])[:1]:  # position = offset + scale * position of the leader
            polynomial = words([robot.rest[row], robot.drive[row, j], 0, 0, 0])
            ties.append({"joint1": joint["name"], "joint2": robot.joints[j], "polycoef": polynomial})
    root = etree.Element("mujoco", model=robot.name)
    _add(root, "compiler", {"angle": "radian", "autolimits": "true"})
    gravity = robot.model.gravity if floating else model.bodies().gravity
    option = {"gravity": words(gravity.linear), "integrator": "implicitfast"}
    options = parse(robot.document).iter("option") if robot.kind == "mjcf" else ()
    effects = {law.effect.name for law in held(model, "mjcf")}
    short = [repr(DRIVE_STEP)] if model.servos or effects & set(_SHORT_STEP_LAWS) else []
    steps = [x for node in options if (x := node.get("timestep"))] or short
    _add(root, "option", option | ({"timestep": steps[-1]} if steps else {}))
    _add(_add(root, "default"), "geom", {"contype": "0", "conaffinity": "0", "group": "2"})
    _group(root, "asset", "mesh", shapes.meshes)
    world = _add(root, "worldbody")
    _tree(_trunk(world, robot) if floating else world, model, shapes, bodies, placed)
    _group(root, "equality", "joint", ties)
    _actuators(_add(root, "actuator"), model)
    written = [sentence for sentence, laws in _NOTES.items() if effects & set(laws)]
    notes = (*_notes(model, ties, written, bodies, floating), *shapes.notes)
    etree.indent(root)
    return Exported(str(etree.tostring(root, encoding="unicode")) + "\n", notes, meshes=files)


def _add(parent: Any, tag: str, attributes: Mapping[str, str] = MappingProxyType({})) -> Any:
    from lxml import etree

    return etree.SubElement(parent, tag, dict(attributes))


def _group(root: Any, name: str, tag: str, entries: Sequence[Mapping[str, str]]) -> None:
    """Add an element with the entries, if there are any."""
    group = _add(root, name) if entries else None
    for entry in entries:
        _add(group, tag, entry)


def _trunk(world: Any, robot: Robot) -> Any:
    """The base link as a body on a free joint, with all links that are fixed to it.

    Raises:
        RobotError: the base has no mass, or its inertia is not physically consistent.
    """
    body = principal(robot.model.inertias[0].toDynamicParameters())
    if body is None or body.mass <= MIN_MASS:
        what = "has no mass" if body is not None else "has an inertia that no body can have"
        raise RobotError(
            f"the base of {robot.name} {what}, so it cannot float; state its inertial in the description, or export "
            f"with a fixed base"
        )
    name = "trunk"  # of a base link that the description does not name, or whose name is taken
    if robot.kind == "urdf":
        root: Any = parse(robot.document)
        below = {node.get("link") for joint in children(root, "joint") for node in children(joint, "child")}
        name = next((str(x.get("name")) for x in children(root, "link") if x.get("name") not in below), name)
    while name in (*robot.links, "world", ""):
        name += "_"
    node = _add(world, "body", {"name": name})
    _add(node, "freejoint")
    _add(node, "inertial", _inertial(body))
    return node


def _tree(world: Any, model: Model, shapes: _Shapes, bodies: PossibleBodies, placed: Sequence[_Place]) -> None:
    robot, nodes = model.robot, [world]
    for tag, entry in shapes.at.get(0, ()):
        _add(world, tag, entry)
    for place, link, body in zip(placed, robot.links, bodies.links, strict=True):
        node = _add(nodes[place.parent], "body", {"name": link, **pose_words(place.pose)})
        _add(node, "inertial", _inertial(body))
        for joint in place.joints.values():
            _add(node, "joint", {**joint, **_joint(model, joint["name"])})
            if behind := _gear(model, joint["name"]):
                _add(node, "joint", joint | behind)
        for tag, entry in shapes.at.get(len(nodes), ()):
            _add(node, tag, entry)
        nodes.append(node)
    for k, (law, body) in enumerate(bodies.loads):
        at = nodes[joint_of_row(robot.model, own_row(robot, law.joints[0]))]
        name = "payload" if k == 0 else f"payload_{k + 1}"
        while name in robot.links:
            name += "_"
        node = _add(at, "body", {"name": name})
        _add(node, "inertial", _inertial(body))
        size = words([(3 * body.mass / (4 * np.pi * _PAYLOAD_DENSITY)) ** (1 / 3)])
        _add(node, "geom", {"type": "sphere", "size": size, "pos": words(body.centre), "rgba": "0.9 0.6 0 1"})


def _inertial(body: Principal) -> dict[str, str]:
    pose = {"pos": words(body.centre), "quat": words(body.quaternion)}
    return {**pose, "mass": repr(body.mass), "diaginertia": words(body.moments)}


def _joint(model: Model, name: str) -> dict[str, str]:
    """Range, friction, armature, spring and cable of a joint as attributes; nothing for mimic joints."""
    robot, stated = model.robot, dict[str, str]()
    if name not in robot.joints:
        return stated
    j = robot.index(name)
    ends = robot.lower[j], robot.upper[j]
    if np.isfinite(ends).all():
        stated["range"] = words(ends)
    sums = {key: float(np.nan_to_num(summed(model, effect)[j])) for key, effect in _PASSIVE_ATTRIBUTES.items()}
    stated |= {key: repr(value) for key, value in sums.items() if value > 0}
    spring, rest = stiffness(model).get(j, (0.0, 0.0))
    stated |= {"stiffness": repr(spring), "springref": repr(rest)} if spring > 0 else {}
    for law in (law for law in held(model, "mjcf") if law.joints == (j,)):
        if law.effect.name == "quadratic_friction":
            stated["damping"] = words([max(sums["damping"], 0.0), summed(model, law.effect.name)[j]])
        if law.effect.name == "cable_torque":
            stated["stiffness"] = words([max(spring, 0.0), 0.0, law.parameters["cubic"]])
            stated["springref"] = repr(float(law.parameters["centre"]))
    return stated | (mjcf_joint(model.servos[name]) if name in model.servos else {})


def _actuators(group: Any, model: Model) -> None:
    """Add the drives, a motor at each other joint, less its torque offset, and passive actuators.

    The effort limit and torque saturation limit a motor.
    """
    limit, offsets = model.robot.effort_limit.copy(), np.nan_to_num(summed(model, "torque_offset"))
    for law in model.joint_laws:
        if law.effect.name == "torque_saturation":
            limit[list(law.joints)] = np.minimum(limit[list(law.joints)], law.parameters["limit"])
    for joint, max_force, offset in zip(model.robot.joints, limit.tolist(), offsets.tolist(), strict=True):
        motor = {"name": joint, "joint": joint}
        motor |= {"forcerange": words([-max_force - offset, max_force - offset])} if np.isfinite(max_force) else {}
        less = {"biastype": "affine", "biasprm": words([-offset, 0, 0])}
        made = [("general", motor | less) if offset else ("motor", motor)]
        for tag, entry in mjcf_actuators(joint, model.servos[joint]) if joint in model.servos else made:
            _add(group, tag, entry)
    for k, law in enumerate(held(model, "mjcf")):  # a torque that is a sine of the position, and presliding friction
        name, p, joint = law.effect.name, law.parameters, model.robot.joints[law.joints[0]]
        line = {"name": f"{joint}_{name}_{k}", "joint": joint, **_NO_MOTOR}
        if name in ("counterbalance", "torque_ripple"):
            cogging = words([-p["amplitude"], p.get("frequency", 1.0), p["phase"]])
            _add(group, "dcmotor", {**line, "cogging": cogging})
        elif name == "presliding_friction":
            lugre = words([p["level"] / p["distance"], 0, p["level"], p["level"], 1])
            _add(group, "dcmotor", {**line, "lugre": lugre})


def _notes(
    model: Model, ties: Sequence[Mapping[str, str]], written: Sequence[str], bodies: PossibleBodies, floating: bool
) -> list[str]:
    """Content that an MJCF lacks or holds in its own way; written: sentences on the laws in it."""
    robot = model.robot
    notes = fixed_note(robot, "they are rigid in the MJCF")
    if np.isfinite(robot.velocity_limit).any():
        notes.append("an MJCF cannot hold velocity limits")
    ends = zip(robot.joints, np.isfinite(robot.lower), np.isfinite(robot.upper), strict=True)
    if half := [joint for joint, low, high in ends if low != high]:
        notes.append(f"an MJCF cannot hold a range with one end: {', '.join(half)}")
    if ties:
        pairs = ", ".join(f"{tie['joint1']} of {tie['joint2']}" for tie in ties)
        notes.append(f"mimic joints are equality constraints, which are slightly compliant in MuJoCo: {pairs}")
    notes += [*mjcf_notes(model), *written, *bodies.notes]
    if floating:
        notes.append("the trunk floats on a free joint, with the mass that the description states")
        trunk = float(robot.model.inertias[0].mass)
        mass = trunk + sum(body.mass for body in (*bodies.links, *(body for _, body in bodies.loads)))
        stated = float(sum(body.mass for body in robot.model.inertias))
        if abs(mass - stated) > NOTED_MASS_DIFFERENCE * stated:
            notes.append(f"the floating robot has {mass:.4g} kg, {stated:.4g} kg in the description")
        if model.covariance is not None:
            notes.append(
                "a fixed base does not identify all inertials that a floating one feels; those are of the description"
            )
    if empty := [link for link, body in zip(robot.links, bodies.links, strict=True) if body.mass <= MIN_MASS]:
        notes.append(f"massless links get {MIN_MASS:g} kg, since MuJoCo rejects zero mass: {', '.join(empty)}")
    return notes


def _body_places(robot: Robot) -> list[_Place]:
    """List the bodies of the model; held joints are part of the pose of their body."""
    at_zero = configuration(robot, np.zeros(len(robot.joints)))
    leaders = {own_row(robot, j): name for j, name in enumerate(robot.joints)}
    places = []
    for i in range(1, robot.model.njoints):
        pose, frames = robot.model.jointPlacements[i], []
        parts = [(robot.model.joints[i], pin.SE3.Identity())]
        if parts[0][0].shortname() == "JointModelComposite" and is_plain(parts[0][0]):
            composite = parts[0][0].extract()
            parts = list(zip(composite.joints, composite.jointPlacements, strict=True))
        for joint, before in parts:
            pose = pose * before
            state = joint.createData()
            joint.calc(state, at_zero)
            if robot.drive[joint.idx_v : joint.idx_v + joint.nv].any():
                frames.append((joint.idx_v, pose, np.asarray(state.S, float).reshape(6, -1)[:, 0]))
            else:
                pose = pose * state.M
        name = str(robot.model.names[i])
        joints = dict[int, dict[str, str]]()
        for row, where, motion in frames:
            frame, slide = pose.actInv(where), bool(np.any(motion[:3]))
            axis = words(frame.rotation @ (motion[:3] if slide else motion[3:]))
            joints[row] = {"name": leaders.get(row, name), "type": "slide" if slide else "hinge", "axis": axis}
            joints[row] |= {"pos": words(frame.translation)} if np.any(frame.translation) else {}
        places.append(_Place(int(robot.model.parents[i]), pose, joints))
    return places


def _gear(model: Model, joint: str) -> dict[str, str]:
    """Attributes of the joint between motor and link, by its elasticity or backlash; empty without a gear.

    The inertia of the motor, friction and the actuator belong to the joint before it.
    """
    for law in held(model, "mjcf"):
        if isinstance(law.effect, TransmissionLaw) and model.robot.joints[law.joints[0]] == joint:
            name = {"name": f"{joint}_gear"}
            if law.effect.name == "joint_elasticity":
                k = float(law.parameters["stiffness"])
                return {**name, "stiffness": repr(k), "damping": repr(RELAXATION_TIME * k)}
            half = law.parameters["gap"] / 2
            return {**name, "range": words([-half, half]), "solreflimit": "0.0005 1", "solimplimit": _STOP_IMPEDANCE}
    return {}


def copied(meshes: list[dict[str, str]], folder: str) -> dict[str, Path]:
    """Refer to meshes by names below a folder beside the MJCF; return the sources by these names."""
    names: dict[str, str] = {}  # path below the folder, by source
    for mesh in meshes:
        if mesh["file"] not in names:
            source, taken = Path(mesh["file"]), set(names.values())
            ends = (f"_{k}" if k > 1 else "" for k in count(1))
            names[mesh["file"]] = next(
                name for end in ends if (name := f"{folder}/{source.stem}{end}{source.suffix}") not in taken
            )
        mesh["file"] = names[mesh["file"]]
    return {name: Path(source) for source, name in names.items()}


class _Shapes:
    """Meshes, and geoms and sites of fixed links by the model's joints (0: world), of the URDF.

    The shapes are the visual ones, or those for collisions if MuJoCo cannot read the former.
    """

    def __init__(self, robot: Robot, package_dirs: Sequence[str | Path]) -> None:
        self.path, self.package_dirs = robot.path, package_dirs
        self.meshes, self.notes = list[dict[str, str]](), list[str]()
        self.at = dict[int, list[tuple[str, dict[str, str]]]]()
        if robot.kind != "urdf":
            self.notes.append("shapes, actuators and sensors of the original MJCF are left out")
            return
        root, missing = parse(robot.document), list[str]()
        self.colours = {material.get("name"): material for material in children(root, "material")}
        links = {link.get("name"): link for link in children(root, "link")}
        for frame in (x for x in robot.model.frames if x.type == pin.FrameType.BODY and x.name in links):
            here, link = self.at.setdefault(int(frame.parentJoint), []), links[frame.name]
            if frame.parentJoint and frame.name not in robot.links:
                here.append(("site", {"name": str(frame.name), **pose_words(frame.placement)}))
            kinds = [[self._geom(x, frame.placement) for x in children(link, tag)] for tag in ("visual", "collision")]
            whole = next((geoms for geoms in kinds if geoms and all(geoms)), None)
            shown = next((geoms for geoms in kinds if any(geoms)), []) if whole is None else whole
            here += [("geom", geom) for geom in shown if geom]
            if any(kinds) and not any(shown):
                missing.append(str(frame.name))
        if missing:
            self.notes.append(f"no shapes for {shorten(missing)}: their meshes are missing or not readable by MuJoCo")

    def _geom(self, element: Any, placement: Any) -> dict[str, str]:
        """Geom of an element; empty if MuJoCo has none for it."""
        pose = pose_words(placement * origin(element))
        for shape in (x for g in children(element, "geometry") for x in g if isinstance(x.tag, str)):
            if size := self._shape(shape):
                return {**size, **pose, **self._colour(element)}
        return {}

    def _shape(self, shape: Any) -> dict[str, str]:
        kind = shape.tag.rpartition("}")[2]
        if kind == "mesh":
            return self._mesh(shape)
        if kind == "box":
            return _solid(kind, vector(shape.get("size"), 3) / 2)
        radius, length = vector(shape.get("radius"), 1), vector(shape.get("length"), 1)
        return _solid(kind, {"sphere": radius}.get(kind, np.append(radius, length / 2)))

    def _mesh(self, shape: Any) -> dict[str, str]:
        path = find_mesh(shape.get("filename") or "", self.path, self.package_dirs)
        if path is None or not _readable(path):
            return {}
        scale = words(vector(shape.get("scale"), 3, 1.0))
        entry = {"file": path.resolve().as_posix(), "scale": scale, "inertia": "shell"}
        names = {tuple(known[key] for key in entry): known["name"] for known in self.meshes}
        if tuple(entry.values()) not in names:
            self.meshes.append({"name": f"{path.stem}_{len(self.meshes) + 1}", **entry})
        return {"type": "mesh", "mesh": names.get(tuple(entry.values()), self.meshes[-1]["name"])}

    def _colour(self, element: Any) -> dict[str, str]:
        for material in children(element, "material"):
            for stated in (material, self.colours.get(material.get("name"))):
                for colour in children(stated, "color") if stated is not None else ():
                    return {"rgba": words(np.clip(vector(colour.get("rgba"), 4, 1.0), 0, 1))}
        return {}


def _solid(kind: str, size: Array) -> dict[str, str]:
    known = kind in ("box", "sphere", "cylinder", "capsule") and (size > 0).all()
    return {"type": kind, "size": words(size)} if known else {}


def _readable(path: Path) -> bool:
    """Whether MuJoCo can read a mesh: OBJ, or binary STL up to its limit of faces."""
    if path.suffix.lower() != ".stl":
        return path.suffix.lower() == ".obj"
    with path.open("rb") as file:
        head = file.read(_STL_HEADER_BYTES)
    count = int.from_bytes(head[80:], "little")
    return 0 < count <= _MAX_STL_FACES and path.stat().st_size == _STL_HEADER_BYTES + _STL_FACE_BYTES * count
