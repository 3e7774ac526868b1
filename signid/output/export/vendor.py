"""Payload and tool of a model in the flange frame of a controller, with what every vendor's file states about them."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...errors import OptionError, RobotError, decimals, one_line, shorten
from ...model import Model
from ...payload import Load, carried
from ...robot.dynamics import own_body
from ...types import INERTIAL, TWO_SIDED, Array
from ..report import WRITTEN
from .bodies import Exported, c_comment, model_digest, principal, remarks

POINT_MASS_RADIUS = 1e-4  # [m] radius of gyration below which a load is a point mass
VECTOR_DIGITS = 9  # significant digits of the largest number of a vector in a file
FRANKA_FLANGE = "link8"  # of panda_link8, fr3_link8
KUKA_FLANGE = "tool0"  # the all-zero tool of ROS-Industrial's descriptions; `flange` has other axes
UR_FLANGE = "tool0"  # the controller's pose of an all-zero TCP (ur_description); `flange` and `ee_link` have other axes


class Flange(NamedTuple):
    """Payload about its centre, along the axes of the flange."""

    mass: float  # [kg]
    centre: Array  # (3,) [m]
    inertia: Array | None  # (3, 3) [kg.m2]; None: not known
    tool: pin.SE3 | None  # placement of the tool frame; None: not named
    said: tuple[str, ...]  # model, frames, units and intervals
    notes: tuple[str, ...]  # limits


def flange_of(model: Model, names: str, flange: str | None, tool: str | None) -> Flange:
    """Payload of a model in its flange frame: `flange`, or the one whose name matches the expression `names`.

    Raises:
        OptionError: the model has no payload, its mass or centre is not identifiable, or a frame is not known.
        RobotError: the payload has no positive mass.
    """
    load, robot = carried(model), model.robot
    if load is None:
        raise OptionError(
            f"the model of {robot.name} has no payload to export; `signid payload` identifies one and writes it to a "
            f"model.json (-o DIR)"
        )
    if not load.mass[0] > 0:
        raise RobotError(f"the payload of {robot.name} has a mass of {load.mass[0]:.3g} kg; identify it again")
    if not np.isfinite([load.mass[1], *load.centre[1]]).all():
        raise OptionError(
            f"mass and centre of the payload of {robot.name} are not identifiable; record motion of more joints for "
            f"`signid payload`"
        )
    if flange is None:
        frames = _frames(model)
        named = [name for name in frames if re.fullmatch(rf"(.*[_/])?{names}", name)]
        if len(named) != 1:
            among = " or ".join(named) or f"none of {shorten(list(frames))} has a usual name"
            raise OptionError(f"the flange frame of {robot.name} is not known ({among}); name it with --flange LINK")
        name, place = named[0], frames[named[0]]
    else:
        name, place = flange, _placed(model, flange, "--flange")
    seen = load.seen_from(place)
    inertia, warning = _inertia(seen)
    notes = [
        f"the payload is in the frame {name}; check that this is the flange frame of the controller",
        "the payload is what the model carries beyond its description: add tools that the description holds",
        *warning,
    ]
    where = None if tool is None else place.actInv(_placed(model, tool, "--tool"))
    said = [
        f"payload of {robot.name}, model.json with SHA-256 {model_digest(model)}",
        *_stated(seen, inertia, model, name),
    ]
    if where is not None:
        said.append(f"tool frame: {tool}")
    return Flange(seen.mass[0], seen.centre[0], inertia, where, tuple(map(_ascii, said)), tuple(map(_ascii, notes)))


def _ascii(text: str) -> str:
    """Text as a comment of a controller's file: one line of ASCII."""
    return one_line(text).encode("ascii", "replace").decode()


def _frames(model: Model) -> Mapping[str, pin.SE3]:
    """Placements in the frame of the last joint, by name, of the frames that are fixed to its link."""
    whole = model.robot.model
    tip = own_body(model.robot, len(model.robot.joints) - 1) + 1
    kinds = (pin.FrameType.BODY, pin.FrameType.OP_FRAME)
    return {frame.name: frame.placement for frame in whole.frames if frame.parentJoint == tip and frame.type in kinds}


def _placed(model: Model, name: str, option: str) -> pin.SE3:
    frames = _frames(model)
    if name not in frames:
        raise OptionError(
            f"{option} {name!r} is no frame that is fixed to the last link of {model.robot.name}; give one of "
            f"{shorten(list(frames))}"
        )
    return frames[name]


def _inertia(load: Load) -> tuple[Array | None, list[str]]:
    """Inertia about the centre (3, 3) [kg.m2] with a note if it is uncertain, or why it is left out."""
    (xx, xy, yy, xz, yz, zz), std = load.inertia
    inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    size = load.mass[0] * POINT_MASS_RADIUS**2
    if np.abs(inertia).max() < size:
        why = "the model knows no inertia about its centre, as of a point mass"
    elif not np.isfinite(std).all():
        why = "it is not identifiable"
    elif principal(load.inertial) is None:
        moments = ", ".join(f"{x:.3g}" for x in np.linalg.eigvalsh(inertia))
        why = f"no body has its principal moments, {moments} kg.m2"
    else:
        zero = (np.abs([xx, yy, zz]) < TWO_SIDED * std[[0, 2, 5]]).all()
        return inertia, ["the inertia of the payload is uncertain: its intervals contain zero"] if zero else []
    return None, [f"the inertia of the payload is left out: {why}"]


def _stated(load: Load, inertia: Array | None, model: Model, frame: str) -> Iterable[str]:
    """Frame, and numbers with their intervals."""
    yield f"centre of mass from the origin of the frame {frame}; inertia about the centre of mass, along its axes"
    if model.payload_covariance is None:
        yield "the model states no uncertainty of the payload"
        return
    parts: list[tuple[Sequence[str], Array, Array, str]] = [
        (["mass"], np.array([load.mass[0]]), np.array([load.mass[1]]), "kg"),
        (["x", "y", "z"], *load.centre, "m"),
    ]
    if inertia is not None:
        parts.append((INERTIAL[4:], *load.inertia, "kg.m2"))
    for names, values, stds, unit in parts:
        intervals = []  # value and half width, both with the decimals of two digits of the half width
        for name, value, half in zip(names, values.tolist(), (TWO_SIDED * stds).tolist(), strict=True):
            places = max(0, 1 - int(np.floor(np.log10(half)))) if half > 0 else 6
            intervals.append(f"{name} {value:.{places}f} +- {decimals(half, 2)}")
        yield f"95 % intervals: {', '.join(intervals)} {unit}"


def rounded(values: Array) -> list[float]:
    """Round values: (k,) [one unit], to the digits of the largest one, without a negative zero."""
    largest = float(np.abs(values).max(initial=0.0))
    places = VECTOR_DIGITS - 1 - int(np.floor(np.log10(largest))) if largest > 0 else 0
    return [float(x) + 0.0 for x in np.round(values, places)]


def column_major(matrix: Array) -> list[float]:
    """Entries of a matrix: (k, l) [any unit], column by column."""
    return rounded(matrix.ravel(order="F"))


def write_franka(model: Model, flange: str | None = None, tool: str | None = None) -> Exported:
    """Write the end effector as JSON; `beside` has the numbers of `setLoad` as a C++ header.

    JSON has no comments and Franka names all of its keys, so that frames, units and intervals stand in the header.
    """
    payload = flange_of(model, FRANKA_FLANGE, flange, tool)
    inertia = column_major(np.zeros((3, 3)) if payload.inertia is None else payload.inertia)
    mass, centre = rounded(np.array([payload.mass]))[0], rounded(payload.centre)
    slug = re.sub(r"[^a-z0-9]+", "-", model.robot.name.lower()).strip("-")
    document = {
        "id": f"payload-{slug}",
        "name": f"Payload of {model.robot.name}",
        "color": "#808080",
        "mass": mass,
        "centerOfMass": centre,
        "transformation": column_major(np.eye(4) if payload.tool is None else payload.tool.homogeneous),
        "inertia": inertia,
    }
    notes = [
        *payload.notes,
        "Desk imports an archive that holds this file as endeffector-config.json; use it or setLoad, not both",
        *([] if payload.inertia is not None else ["zeros stand for the inertia"]),
        *([] if tool is not None else ["the tool frame is the flange, since no --tool LINK is named"]),
    ]
    units = "mass [kg], centre of mass [m] in the flange frame, inertia [kg.m2] column by column"
    lines = [f"{WRITTEN}: numbers of franka::Robot::setLoad", units, *payload.said, *notes]
    header = [
        *(f"// {c_comment(line)}" for line in lines),
        "#pragma once",
        "#include <array>",
        f"constexpr double load_mass = {mass!r};",
        f"constexpr std::array<double, 3> F_x_Cload{{{{{', '.join(map(repr, centre))}}}}};",
        f"constexpr std::array<double, 9> load_inertia{{{{{', '.join(map(repr, inertia))}}}}};",
        "// robot.setLoad(load_mass, F_x_Cload, load_inertia);",
    ]
    text = json.dumps(document, indent=2, ensure_ascii=False) + "\n"
    return Exported(text, tuple(notes), {"_load.h": "\n".join(header) + "\n"})


def write_kuka(model: Model, flange: str | None = None, tool: str | None = None) -> Exported:
    """Write `LOAD_DATA[1]`, and `TOOL_DATA[1]` if a tool frame is named."""
    payload = flange_of(model, KUKA_FLANGE, flange, tool)
    moments, axes = np.linalg.eigh(np.zeros((3, 3)) if payload.inertia is None else payload.inertia)
    order = list(
        max(permutations(range(3)), key=lambda axis_order: float(np.abs(np.diag(axes[:, list(axis_order)])).sum()))
    )
    axes = axes[:, order] * np.where(np.diag(axes[:, order]) < 0, -1.0, 1.0)
    if np.linalg.det(axes) < 0:
        axes[:, np.argmin(np.diag(axes))] *= -1.0
    moments = moments[order]
    load = f"{{M {_real(payload.mass)},CM {_pose(payload.centre, axes)},J {_labelled('XYZ', moments)}}}"
    lines = [f"LOAD_DATA[1]={load}"]
    if payload.tool is not None:
        lines.append(f"TOOL_DATA[1]={_pose(payload.tool.translation, payload.tool.rotation)}")
    notes = [
        *payload.notes,
        "the index 1 stands for the number of the tool",
        *([] if payload.inertia is not None else ["zeros stand for the moments of inertia J"]),
    ]
    said = [
        *payload.said,
        "M [kg]; X, Y, Z [mm] and A, B, C [deg] of CM: centre of mass and principal axes in the flange frame",
        "A, B, C: rotations about Z, the new Y and the new X; J: principal moments [kg.m2] about the centre of mass",
        *notes,
    ]
    return Exported("".join(f"; {line}\n" for line in said) + "\n".join(lines) + "\n", tuple(notes))


def _pose(position: Array, rotation: Array) -> str:
    """KRL frame of a position [m] and a rotation (3, 3) [1]."""
    roll, pitch, yaw = pin.rpy.matrixToRpy(rotation)
    return _labelled("XYZABC", [*(1e3 * position), *np.degrees([yaw, pitch, roll])])


def _labelled(names: str, values: Array | list[float]) -> str:
    return f"{{{','.join(f'{name} {_real(x)}' for name, x in zip(names, values, strict=True))}}}"


def _real(value: float) -> str:
    """Number of KRL with seven significant digits, without an exponent."""
    return np.format_float_positional(float(f"{np.round(value, 9):.7g}") + 0.0, trim="0")


def write_ur(model: Model, flange: str | None = None, tool: str | None = None) -> Exported:
    """Write `set_target_payload`, and `set_tcp` if a tool frame is named."""
    payload = flange_of(model, UR_FLANGE, flange, tool)
    numbers = [_rounded_text(np.array([payload.mass]))[1:-1], _rounded_text(payload.centre)]
    calls = [f"set_target_payload({', '.join(numbers)})"]
    if payload.inertia is not None:
        six = _rounded_text(payload.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        calls = [f"set_target_payload({', '.join(numbers)}, {six})"]
    if payload.tool is not None:
        calls.append(f"set_tcp(p{_rounded_text(np.append(payload.tool.translation, pin.log3(payload.tool.rotation)))})")
    said = [
        *payload.said,
        "mass [kg], centre of gravity [m] in the tool flange frame, inertia [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] [kg.m2]",
        *(["tool: position [m], rotation vector [rad] in the tool flange frame"] if payload.tool is not None else []),
        *payload.notes,
        f"software without set_target_payload: set_payload({', '.join(numbers)})",
    ]
    return Exported(remarks(said) + "\n".join(calls) + "\n", payload.notes)


def _rounded_text(values: Array) -> str:
    return repr(rounded(values))
