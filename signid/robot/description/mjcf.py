"""Read MJCF: MuJoCo compiles it, and the robot is built from the bodies and joints that it compiled."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from ...errors import RobotError, shorten
from .document import Axis, Document, Draft, Mimic, impossible_notes, massless_note
from .limits import LARGEST
from .mjcf_text import dynamics_text, included

if TYPE_CHECKING:
    import pinocchio as pin

LEAST = 2e-15  # [kg or kg.m2] bound with which bodies without mass compile; MuJoCo refuses 1e-15
MASSLESS = 1e-14  # [kg or kg.m2] masses and inertias below it are zero
PLACE = 1e-9  # largest deviation of an axis from x, y or z that is rounding


def read_mjcf(document: Document) -> Draft:
    """Read an MJCF file; free bases and ball joints are held fixed.

    Raises:
        RobotError: MuJoCo cannot compile the file, or there is no hinge or slide.
    """
    root = deepcopy(document.root)
    text = included(root, Path(document.path).parent, document.text)
    stated, notes = dynamics_text(root)
    compiled, still, more = _compile(stated)
    if not compiled.njnt:
        raise RobotError("the file has no moving joint (hinge or slide): nothing to identify")
    model = _build(compiled)
    mimics = _mimics(compiled)
    links = tuple(str(model.frames[_first(model, i)].name) for i in range(1, model.njoints))
    moved = dict(zip(links, list(model.inertias)[1:], strict=True))
    notes += [*more, *massless_note({name: body.mass for name, body in moved.items()}), *_lost(compiled)]
    notes += impossible_notes({name: (body.mass, body.inertia) for name, body in moved.items()})
    if still:
        notes.append(f"held fixed at neutral: {shorten(still)}")
    axes = (_axis(compiled, j, model) for j in range(compiled.njnt))
    return Draft(
        name=document.root.get("model") or document.stem,
        model=model,
        axes=tuple(replace(axis, mimic=mimics.get(axis.name)) for axis in axes),
        links=links,
        document=text,
        kind="mjcf",
        notes=tuple(notes),
        still=frozenset(still),
    )


def _compile(text: str) -> tuple[Any, list[str], list[str]]:
    """Compiled MjModel of hinges and slides; names of ball joints; notes on free bodies and on meshes."""
    import mujoco

    try:
        with _quietly():
            return _compiled(mujoco.MjSpec.from_string(text))
    except (ValueError, TypeError, RuntimeError, mujoco.FatalError) as error:
        reason = " ".join(str(error).split())
        raise RobotError(f"MuJoCo cannot compile it: {reason.removeprefix('Error: ')}") from None


@contextmanager
def _quietly() -> Iterator[None]:
    """Keep MuJoCo from writing its warnings, of deprecated settings among others, to a log file and standard error."""
    import mujoco

    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda message: None)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        mujoco.set_mju_user_warning(before)


def _compiled(spec: Any) -> tuple[Any, list[str], list[str]]:
    import mujoco

    notes = [*_without_meshes(spec), *_without_free(spec)]
    ball = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_BALL]
    still = [joint.name for joint in ball]
    kinds = (mujoco.mjtJoint.mjJNT_HINGE, mujoco.mjtJoint.mjJNT_SLIDE)
    moving = {joint.name for joint in spec.joints if joint.type in kinds}
    others = [eq for eq in spec.equalities if not _couples(eq, moving)]
    if count := sum(bool(eq.active) for eq in others):
        notes.append(f"{count} equality constraints are ignored: they are not linear between two joints")
    for element in (*ball, *others):
        spec.delete(element)
    compiler = spec.compiler
    compiler.boundmass, compiler.boundinertia = max(compiler.boundmass, LEAST), max(compiler.boundinertia, LEAST)
    compiler.fusestatic = False
    return spec.compile(), still, notes


def _without_free(spec: Any) -> list[str]:
    """Delete free joints; a note on each body that is then held."""
    import mujoco

    free = [joint for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_FREE]
    notes = [f"body {joint.parent.name} is free; it is held fixed at the pose of the file" for joint in free]
    for joint in free:
        spec.delete(joint)
    return notes


def _without_meshes(spec: Any) -> list[str]:
    """Delete geometry that needs files, and all materials; a note on bodies whose mass it would give."""
    import mujoco

    kinds = (mujoco.mjtGeom.mjGEOM_MESH, mujoco.mjtGeom.mjGEOM_HFIELD, mujoco.mjtGeom.mjGEOM_SDF)
    lost = set()
    for geom in list(spec.geoms):
        geom.material = ""
        if geom.type in kinds or geom.meshname:
            body = geom.parent
            everywhere = spec.compiler.inertiafromgeom == mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
            if body.name != "world" and (everywhere or not body.explicitinertial):
                lost.add(body.name)
            spec.delete(geom)
    for site in spec.sites:
        site.material = ""
    said = f"the mass of the meshes of {shorten(sorted(lost))} is not computed; add an <inertial> there"
    return [said] if lost else []


def _couples(equality: Any, moving: set[str]) -> bool:
    """Whether a constraint is active and linear between two joints."""
    import mujoco

    terms = equality.data[:5]
    if equality.type == mujoco.mjtEq.mjEQ_JOINT and not np.all(np.abs(terms) <= LARGEST):
        raise RobotError(f"the constraint of joint {equality.name1!r} has polycoef {terms}; expected finite numbers")
    joints = {equality.name1, equality.name2} <= moving and equality.type == mujoco.mjtEq.mjEQ_JOINT
    return bool(joints and equality.active and not np.any(terms[2:]))


def _build(compiled: Any) -> pin.Model:
    """Model of Pinocchio with the bodies, joints and gravity of a compiled MjModel, without armature."""
    import pinocchio as pin

    model = pin.Model()
    if not np.all(np.abs(compiled.opt.gravity) <= LARGEST):
        raise RobotError(f"gravity is {compiled.opt.gravity}; expected finite numbers")
    model.gravity.linear = compiled.opt.gravity
    joint_of, place_of, frame_of = [0], [pin.SE3.Identity()], [0]  # of each body: its joint, its pose there, its frame
    for i in range(1, compiled.nbody):
        parent, name = int(compiled.body_parentid[i]), compiled.body(i).name
        place = place_of[parent] * pin.SE3(_rotation(compiled.body_quat[i]), compiled.body_pos[i])
        first, count = int(compiled.body_jntadr[i]), int(compiled.body_jntnum[i])
        joint, frame = joint_of[parent], frame_of[parent]
        if count:
            place, joint = _add_joint(model, compiled, joint, place, range(first, first + count))
            frame = model.addJointFrame(joint, frame)
        model.appendBodyToJoint(joint, _inertia(compiled, i), place)
        frame_of.append(model.addBodyFrame(name, joint, place, frame))
        joint_of.append(joint)
        place_of.append(place)
    model.armature = np.zeros(model.nv)  # armature is a law, not part of the rigid bodies
    return model


def _add_joint(model: pin.Model, compiled: Any, parent: int, place: pin.SE3, joints: range) -> tuple[pin.SE3, int]:
    """Append the joints of a body at its `place` in the frame of `parent`; the body's place in the new joint's frame.

    The frame of a joint has the orientation of the body, and its origin at the anchor of the joint.
    """
    import pinocchio as pin

    parts, anchor = list[tuple[Any, pin.SE3]](), np.zeros(3)
    for k, j in enumerate(joints):
        shift = compiled.jnt_pos[j] - anchor
        before = (place if k == 0 else pin.SE3.Identity()) * pin.SE3(np.eye(3), shift)
        parts.append((_kind(compiled, j), before * _reference(compiled, j)))
        anchor = compiled.jnt_pos[j].copy()
    first = compiled.joint(joints[0]).name
    if len(parts) == 1:
        (kind, where), name = parts[0], first
    else:
        kind, where, name = pin.JointModelComposite(len(parts)), pin.SE3.Identity(), f"Composite_{first}"
        for part in parts:
            kind.addJoint(*part)
    return pin.SE3(np.eye(3), -anchor), model.addJoint(parent, kind, where, name)


def _kind(compiled: Any, j: int) -> Any:
    """Joint of Pinocchio for a hinge or a slide."""
    import mujoco
    import pinocchio as pin

    slides = compiled.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE
    axis = compiled.jnt_axis[j]
    k = int(np.argmax(np.abs(axis)))
    if np.abs(axis - np.eye(3)[k]).max() < PLACE:
        return (
            (pin.JointModelPX, pin.JointModelPY, pin.JointModelPZ)[k]()
            if slides
            else (pin.JointModelRX, pin.JointModelRY, pin.JointModelRZ)[k]()
        )
    return (pin.JointModelPrismaticUnaligned if slides else pin.JointModelRevoluteUnaligned)(axis.copy())


def _reference(compiled: Any, j: int) -> pin.SE3:
    """Displacement that a joint has at position zero: the pose of the file is that at its reference."""
    import mujoco
    import pinocchio as pin

    axis, zero = compiled.jnt_axis[j], -float(compiled.qpos0[compiled.jnt_qposadr[j]])
    if compiled.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE:
        return pin.SE3(np.eye(3), axis * zero)
    return pin.SE3(pin.exp3(axis * zero), np.zeros(3))


def _inertia(compiled: Any, i: int) -> pin.Inertia:
    """Inertia of a body in its frame; the bounds that let it compile are zero."""
    import pinocchio as pin

    mass, moments = float(compiled.body_mass[i]), compiled.body_inertia[i].copy()
    turn = _rotation(compiled.body_iquat[i])
    moments[moments < MASSLESS] = 0.0
    return pin.Inertia(mass if mass > MASSLESS else 0.0, compiled.body_ipos[i].copy(), turn @ np.diag(moments) @ turn.T)


def _rotation(quaternion: Any) -> Any:
    import mujoco

    out = np.zeros(9)
    mujoco.mju_quat2Mat(out, quaternion)
    near = np.round(out)
    return np.where(np.abs(out - near) < PLACE, near, out).reshape(3, 3)


def _axis(compiled: Any, j: int, model: pin.Model) -> Axis:
    """Degree of freedom of a hinge or a slide."""
    import mujoco

    row = int(compiled.jnt_dofadr[j])
    limited, driven = bool(compiled.jnt_limited[j]), bool(compiled.jnt_actfrclimited[j])
    lower, upper = compiled.jnt_range[j].tolist() if limited else (-inf, inf)
    stiffness = float(compiled.jnt_stiffness[j])
    return Axis(
        name=compiled.joint(j).name,
        row=row,
        prismatic=bool(compiled.jnt_type[j] == mujoco.mjtJoint.mjJNT_SLIDE),
        lower=lower,
        upper=upper,
        effort=float(compiled.jnt_actfrcrange[j][1]) if driven else inf,
        viscous=float(compiled.dof_damping[row]),
        coulomb=float(compiled.dof_frictionloss[row]),
        armature=float(compiled.dof_armature[row]),
        spring=(stiffness, float(compiled.qpos_spring[compiled.jnt_qposadr[j]])) if stiffness > 0 else None,
    )


def _mimics(compiled: Any) -> dict[str, Mimic]:
    """Linear constraints between two joints: y - y0 = a + b (x - x0)."""
    found = {}
    for k in range(compiled.neq):
        y, x = (int(ids[k]) for ids in (compiled.eq_obj1id, compiled.eq_obj2id))
        a, b = compiled.eq_data[k][:2].tolist()
        at = [float(compiled.qpos0[compiled.jnt_qposadr[j]]) for j in (y, x)]
        found[compiled.joint(y).name] = Mimic(compiled.joint(x).name, b, a + at[0] - b * at[1])
    return found


def _lost(compiled: Any) -> list[str]:
    """Notes on physics of MuJoCo that the robot does not have."""
    lifted = [compiled.body(i).name for i in np.flatnonzero(compiled.body_gravcomp)]
    curved = [
        compiled.joint(j).name
        for j in range(compiled.njnt)
        if np.any(compiled.jnt_stiffnesspoly[j]) or np.any(compiled.dof_dampingpoly[compiled.jnt_dofadr[j]])
    ]
    notes = []
    if lifted:
        notes.append(
            f"gravcomp of {shorten(lifted)} is ignored: recorded torque is taken to carry the weight; if it does not, "
            f"state --gravity 0,0,0"
        )
    if curved:
        notes.append(f"polynomial stiffness and damping of {shorten(curved)} are ignored beyond their linear part")
    return notes


def _first(model: pin.Model, joint: int) -> int:
    """Index of the frame of the first body that a joint moves."""
    import pinocchio as pin

    return next(i for i, x in enumerate(model.frames) if x.parentJoint == joint and x.type == pin.FrameType.BODY)
