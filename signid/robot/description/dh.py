"""URDF from a table of Denavit-Hartenberg parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, inf, isfinite, pi, sin
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import ArrayLike

from ...errors import RobotError
from ...typed import typed

_DIGITS = 12  # decimals of computed numbers, so that cos(pi/2) is 0


@dataclass(frozen=True)
class DHLink:
    """A joint and its link in standard Denavit-Hartenberg parameters.

    The pose of the link frame in the previous one is Rot_z(theta) Trans_z(d) Trans_x(a) Rot_x(alpha). The joint
    position adds to theta, or to d of a prismatic joint. Mass, centre and inertia are given in the link frame.
    """

    alpha: float  # [rad]
    a: float  # [m]
    d: float  # [m]
    theta: float = 0.0  # [rad]
    prismatic: bool = False
    mass: float = 0.0  # [kg]
    centre: Sequence[float] = (0.0, 0.0, 0.0)  # (3,) centre of mass [m]
    inertia: ArrayLike = (0.0, 0.0, 0.0)  # about the centre: (3,) principal, (6,) Ixx Ixy Iyy Ixz Iyz Izz, or (3, 3)
    box: Sequence[float] | None = None  # (3,) size of the visual box around the centre [m]
    lower: float = -pi  # [rad or m]
    upper: float = pi  # [rad or m]
    velocity: float = 10.0  # limit [rad/s or m/s]
    effort: float = 1000.0  # limit [N.m or N]


@typed
def urdf_from_dh(name: str, links: Sequence[DHLink]) -> str:
    """Generate the URDF of a serial robot.

    >>> urdf = signid.urdf_from_dh("arm", [signid.robot.DHLink(alpha=0.0, a=0.3, d=0.1, mass=1.0)])

    Joints are `joint_1`..., links `base_link`, `link_1`..., and `tool` at the last frame. A URDF joint moves about its
    own frame, so the frame of `link_i` is that of DH link i - 1, moved by the joint.

    Args:
        name: name of the robot.
        links: rows of the table, from the base.

    Raises:
        RobotError: no link, a number that is not finite, or an array of another shape.

    Source: Siciliano, Sciavicco, Villani, Oriolo, Robotics, 2009, section 2.8.2.
    """
    if not links:
        raise RobotError("the table of Denavit-Hartenberg parameters has no row; give at least one link")
    lines = ['<?xml version="1.0" encoding="utf-8"?>', f"<robot name={quoteattr(name)}>", '  <link name="base_link"/>']
    origin, parent = _dh_origin((0.0, 0.0, 0.0), 0.0, 0.0), "base_link"
    for i, link in enumerate(links, 1):
        _check_link(link, i)
        limits = {"lower": link.lower, "upper": link.upper, "velocity": link.velocity, "effort": link.effort}
        stated = " ".join(f'{key}="{_text(value)}"' for key, value in limits.items() if isfinite(value))
        kind, more = "prismatic" if link.prismatic else "revolute", ('<axis xyz="0 0 1"/>', f"<limit {stated}/>")
        lines += [*_dh_joint(f"joint_{i}", kind, parent, f"link_{i}", origin, *more), *_dh_link(i, link)]
        origin, parent = _dh_origin(_translation(link), link.alpha, link.theta), f"link_{i}"
    tool = _dh_joint("tool_joint", "fixed", parent, "tool", origin)
    return "\n".join([*lines, *tool, '  <link name="tool"/>', "</robot>", ""])


def _dh_joint(name: str, kind: str, parent: str, child: str, origin: str, *more: str) -> list[str]:
    inside = [origin, f'<parent link="{parent}"/>', f'<child link="{child}"/>', *more]
    return [f'  <joint name="{name}" type="{kind}">', *(f"    {element}" for element in inside), "  </joint>"]


def _dh_link(i: int, link: DHLink) -> list[str]:
    """Link with inertial and box in the axes of the DH frame."""
    (ct, st), (ca, sa) = (cos(link.theta), sin(link.theta)), (cos(link.alpha), sin(link.alpha))
    rotation = np.array([[ct, -st * ca, st * sa], [st, ct * ca, -ct * sa], [0.0, sa, ca]])  # Rot_z(theta) Rot_x(alpha)
    centre = tuple(np.add(_translation(link), rotation @ np.asarray(link.centre, float)))
    origin = _dh_origin(centre, link.alpha, link.theta)
    inertia = np.asarray(link.inertia, float)
    if inertia.ndim == 1:  # principal moments, or six in Pinocchio's order
        inertia = np.diag(inertia) if len(inertia) == 3 else inertia[[[0, 1, 3], [1, 2, 4], [3, 4, 5]]]
    moments = zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), inertia[np.triu_indices(3)], strict=True)
    six = " ".join(f'{key}="{_text(value)}"' for key, value in moments)
    parts = {"inertial": [origin, f'<mass value="{_text(link.mass)}"/>', f"<inertia {six}/>"]}
    if link.box is not None:
        parts["visual"] = [origin, f'<geometry><box size="{" ".join(map(_text, link.box))}"/></geometry>']
    lines = [f'  <link name="link_{i}">']
    for tag, inside in parts.items():
        lines += [f"    <{tag}>", *(f"      {element}" for element in inside), f"    </{tag}>"]
    return [*lines, "  </link>"]


def _translation(link: DHLink) -> tuple[float, float, float]:
    return link.a * cos(link.theta), link.a * sin(link.theta), link.d


def _dh_origin(xyz: Sequence[float], alpha: float, theta: float) -> str:
    """Origin element; roll and yaw of the URDF equal alpha and theta."""
    position = " ".join(_text(round(x, _DIGITS)) for x in xyz)
    return f'<origin xyz="{position}" rpy="{_text(alpha)} 0 {_text(theta)}"/>'


def _text(value: float) -> str:
    """Shortest text of a number without loss of precision."""
    return repr(float(value) + 0.0).removesuffix(".0")


def _check_link(link: DHLink, i: int) -> None:
    numbers = [link.alpha, link.a, link.d, link.theta, link.mass]
    shapes = [np.shape(link.centre) == (3,), link.box is None or np.shape(link.box) == (3,)]
    inertia = np.asarray(link.inertia, float)
    if not all(shapes) or inertia.shape not in ((3,), (6,), (3, 3)):
        raise RobotError(f"row {i} of the table: give 3 numbers for centre and box, and 3, 6 or 3 x 3 for inertia")
    if not np.isfinite([*numbers, *link.centre, *inertia.ravel(), *(link.box or ())]).all():
        raise RobotError(f"row {i} of the table has a number that is not finite; give finite numbers")
    if inertia.shape == (3, 3) and not np.allclose(inertia, inertia.T):
        raise RobotError(f"row {i} of the table has an inertia that is not symmetric; give a symmetric 3 x 3 matrix")
    if not -inf <= link.lower < link.upper <= inf:
        raise RobotError(f"row {i} of the table has limits {link.lower} to {link.upper}; give the lower one first")
