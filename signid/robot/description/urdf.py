"""Read URDF: Pinocchio builds the model from links and joints alone, without meshes, materials or plug-in tags."""

from __future__ import annotations

from collections.abc import Container, Iterator
from dataclasses import replace
from math import inf
from xml.sax.saxutils import quoteattr

import numpy as np

from ...errors import RobotError, shorten
from ...types import Array
from .document import Document, Draft, impossible_notes, massless_note
from .left_out import left_out_notes
from .tree import HELD, MOMENTS, MOVING, Joint, Pose, Tree, read_tree


def read_urdf(document: Document) -> Draft:
    """Read a URDF; the base is held fixed.

    Raises:
        RobotError: the description is not a tree of links with at least one moving joint.
    """
    import pinocchio as pin

    tree = read_tree(document.root, document.stem)
    moving = [joint for joint in tree.joints if joint.kind in MOVING]
    if not moving:
        raise RobotError("the file has no moving joint (revolute, continuous, prismatic): nothing to identify")
    try:
        model = pin.buildModelFromXML(_mechanism(tree))
    except (ValueError, RuntimeError) as error:
        raise RobotError(f"Pinocchio cannot build it: {str(error).strip().splitlines()[-1]}") from None
    child = {joint.name: joint.child for joint in tree.joints}
    axes = []
    for axis in (joint.axis for joint in moving):
        known = axis.mimic if axis.mimic and axis.mimic.joint in child else None
        axes.append(replace(axis, row=model.joints[model.getJointId(axis.name)].idx_v, mimic=known))
    unnamed = () if document.root.get("name") else (f"the robot has no name; it is named {tree.name} after its file",)
    return Draft(
        name=tree.name,
        model=model,
        axes=tuple(axes),
        links=tuple(child[name] for name in list(model.names)[1:]),
        document=document.text,
        kind="urdf",
        notes=(*unnamed, *_notes(tree, moving, child), *left_out_notes(document.root, _massless(tree))),
        still=frozenset(joint.name for joint in tree.joints if joint.kind not in MOVING),
    )


def _mechanism(tree: Tree) -> str:
    """URDF text of links, inertials and joints alone, with placeholder limits."""
    lines = [f"<robot name={quoteattr(tree.name)}>"]
    for link, inertial in tree.links.items():
        content = ""
        if inertial is not None:
            moments = " ".join(f'{key}="{x!r}"' for key, x in zip(MOMENTS, inertial.moments, strict=True))
            content = f'{_origin(inertial.pose)}<mass value="{inertial.mass!r}"/><inertia {moments}/>'
            content = f"<inertial>{content}</inertial>"
        lines.append(f"<link name={quoteattr(link)}>{content}</link>")
    for joint in tree.joints:
        name, parent, child = (quoteattr(x) for x in (joint.name, joint.parent, joint.child))
        lines.append(
            f'<joint name={name} type="{joint.kind}">{_origin(joint.pose)}'
            f"<parent link={parent}/><child link={child}/>"
            f'<axis xyz="{_words(joint.direction)}"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        )
    return "\n".join([*lines, "</robot>"])


def _origin(pose: Pose) -> str:
    return f'<origin xyz="{_words(pose.xyz)}" rpy="{_words(pose.rpy)}"/>'


def _words(vector: tuple[float, float, float]) -> str:
    return " ".join(map(repr, vector))


def _notes(tree: Tree, moving: list[Joint], known: Container[str]) -> Iterator[str]:
    """One sentence for each kind of defect of the moving joints and links."""
    mimics = [(joint.name, joint.axis.mimic.joint) for joint in moving if joint.axis.mimic]
    if stray := [f"{name} ({followed})" for name, followed in mimics if followed not in known]:
        yield f"treated as independent, because they mimic joints that do not exist: {shorten(stray)}"
    yield from _inertial_notes(tree)
    if held := [f"{joint.name} ({joint.kind})" for joint in tree.joints if joint.kind in HELD]:
        yield f"held fixed at neutral: {shorten(held)}"
    lacking = {
        "position": [x.name for x in moving if x.kind != "continuous" and x.axis.upper - x.axis.lower == inf],
        "velocity": [x.name for x in moving if x.axis.velocity == inf],
        "effort": [x.name for x in moving if x.axis.effort == inf],
    }
    yield from (f"no {what} limit is stated for {shorten(found)}" for what, found in lacking.items() if found)


def _inertial_notes(tree: Tree) -> tuple[str, ...]:
    """Notes on moving links; a link counts with those rigidly attached to it."""
    carried = _carriers(tree)
    bodies: dict[str, float] = {}
    stated: dict[str, tuple[float, Array]] = {}
    for link, inertial in tree.links.items():
        if name := carried.get(link):
            bodies[name] = bodies.get(name, 0.0) + (inertial.mass if inertial else 0.0)
            if inertial:
                stated[link] = inertial.mass, np.array(inertial.moments)[[[0, 1, 2], [1, 3, 4], [2, 4, 5]]]
    return massless_note(bodies) + impossible_notes(stated)


def _massless(tree: Tree) -> frozenset[str]:
    """Moving links without mass, and those rigidly attached to them."""
    carried = _carriers(tree)
    mass = dict.fromkeys(carried.values(), 0.0)
    for link, inertial in tree.links.items():
        mass[carried[link]] += inertial.mass if inertial else 0.0
    return frozenset(link for link, name in carried.items() if name and mass[name] == 0)


def _carriers(tree: Tree) -> dict[str, str | None]:
    """Moving link that each link is rigidly attached to (itself if it moves); None at the base."""
    below: dict[str, list[Joint]] = {}
    for joint in tree.joints:
        below.setdefault(joint.parent, []).append(joint)
    result: dict[str, str | None] = {tree.root: None}
    stack = [tree.root]
    while stack:
        parent = stack.pop()
        for joint in below.get(parent, ()):
            result[joint.child] = result[parent] if joint.kind == "fixed" else joint.child
            stack.append(joint.child)
    return result
