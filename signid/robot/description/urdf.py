"""Read URDF: Pinocchio builds the model from links and joints alone, without meshes, materials or plug-in tags."""

from __future__ import annotations

from xml.sax.saxutils import quoteattr

from ...errors import RobotError, shorten
from .document import Document
from .draft import Axis, Draft
from .inertials import inertial_notes
from .tree import HELD, MOVING, Inertial, Joint, Pose, Tree, read_tree


def read_urdf(document: Document) -> Draft:
    """Read a URDF; the base is held fixed.

    Raises:
        RobotError: the description is not a tree of links with at least one moving joint.
    """
    import pinocchio as pin

    tree = read_tree(document.root, document.stem)
    if not any(joint.kind in MOVING for joint in tree.joints):
        raise RobotError("the file has no moving joint (revolute, continuous, prismatic): nothing to identify")
    try:
        model = pin.buildModelFromXML(mechanism(tree))
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"Pinocchio cannot build it: {str(error).strip().splitlines()[-1]}") from None
    child = {joint.name: joint.child for joint in tree.joints}
    stray = [joint for joint in _moving(tree) if joint.mimic and joint.mimic.joint not in child]
    return Draft(
        name=tree.name,
        model=model,
        axes=tuple(
            _axis(joint, model.joints[model.getJointId(joint.name)].idx_v, joint in stray) for joint in _moving(tree)
        ),
        links=tuple(child[name] for name in list(model.names)[1:]),
        document=document.text,
        kind="urdf",
        notes=(
            *_name_note(document, tree),
            *_stray_notes(stray),
            *inertial_notes(tree),
            *_held_notes(tree),
            *_limit_notes(tree),
        ),
        still=frozenset(joint.name for joint in tree.joints if joint.kind not in MOVING),
    )


def mechanism(tree: Tree) -> str:
    """URDF text of links, inertials and joints alone, with placeholder limits."""
    lines = [f"<robot name={quoteattr(tree.name)}>"]
    lines += [f"<link name={quoteattr(link.name)}>{_inertial(link.inertial)}</link>" for link in tree.links]
    lines += [_joint(joint) for joint in tree.joints]
    return "\n".join([*lines, "</robot>"])


def _inertial(inertial: Inertial | None) -> str:
    if inertial is None:
        return ""
    xx, xy, xz, yy, yz, zz = inertial.moments
    return (
        f'<inertial>{_origin(inertial.pose)}<mass value="{inertial.mass!r}"/>'
        f'<inertia ixx="{xx!r}" ixy="{xy!r}" ixz="{xz!r}" iyy="{yy!r}" iyz="{yz!r}" izz="{zz!r}"/></inertial>'
    )


def _joint(joint: Joint) -> str:
    name, parent, child = (quoteattr(x) for x in (joint.name, joint.parent, joint.child))
    return (
        f'<joint name={name} type="{joint.kind}">{_origin(joint.pose)}'
        f"<parent link={parent}/><child link={child}/>"
        f'<axis xyz="{_words(joint.axis)}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
    )


def _origin(pose: Pose) -> str:
    return f'<origin xyz="{_words(pose.xyz)}" rpy="{_words(pose.rpy)}"/>'


def _words(vector: tuple[float, float, float]) -> str:
    return " ".join(map(repr, vector))


def _moving(tree: Tree) -> list[Joint]:
    return [joint for joint in tree.joints if joint.kind in MOVING]


def _axis(joint: Joint, row: int, stray: bool) -> Axis:
    return Axis(
        name=joint.name,
        row=row,
        prismatic=joint.kind == "prismatic",
        lower=joint.lower,
        upper=joint.upper,
        velocity=joint.velocity,
        effort=joint.effort,
        viscous=joint.viscous,
        coulomb=joint.coulomb,
        mimic=None if stray else joint.mimic,
    )


def _name_note(document: Document, tree: Tree) -> tuple[str, ...]:
    return () if document.root.get("name") else (f"the robot has no name; it is named {tree.name} after its file",)


def _stray_notes(stray: list[Joint]) -> tuple[str, ...]:
    each = [f"{joint.name} ({joint.mimic.joint})" for joint in stray if joint.mimic]
    return (f"treated as independent, because they mimic joints that do not exist: {shorten(each)}",) if stray else ()


def _held_notes(tree: Tree) -> tuple[str, ...]:
    held = [f"{joint.name} ({joint.kind})" for joint in tree.joints if joint.kind in HELD]
    return (f"held fixed at neutral: {shorten(held)}",) if held else ()


def _limit_notes(tree: Tree) -> tuple[str, ...]:
    lacking = {
        "position": [x.name for x in _moving(tree) if x.kind != "continuous" and x.upper - x.lower == float("inf")],
        "velocity": [x.name for x in _moving(tree) if x.velocity == float("inf")],
        "effort": [x.name for x in _moving(tree) if x.effort == float("inf")],
    }
    return tuple(f"no {what} limit is stated for {shorten(found)}" for what, found in lacking.items() if found)
