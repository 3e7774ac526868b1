"""Export of the payload for KUKA KR C controllers: load data in KRL.

Source: KUKA, MA KR IONTEC V4, Load center of gravity and mass moment of inertia: A turns about Z, then B about the new
Y, then C about the new X; principal moments about the centre of mass.
"""

from __future__ import annotations

from itertools import permutations

import numpy as np
import pinocchio as pin

from ....model import Model
from ....types import Array
from ..beyond import Exported
from .flange import flange_of

FLANGE = "tool0"  # the all-zero tool of ROS-Industrial's descriptions; `flange` has other axes


def write_kuka(model: Model, flange: str | None = None, tool: str | None = None) -> Exported:
    """Write `LOAD_DATA[1]`, and `TOOL_DATA[1]` if a tool frame is named.

    Raises:
        OptionError: the model has no identifiable payload, or a frame is not known.
        RobotError: the payload has no positive mass.
    """
    found = flange_of(model, FLANGE, flange, tool)
    moments, axes = _principal(np.zeros((3, 3)) if found.inertia is None else found.inertia)
    load = f"{{M {_real(found.mass)},CM {_pose(found.centre, axes)},J {_labelled('XYZ', moments)}}}"
    lines = [f"LOAD_DATA[1]={load}"]
    if found.tool is not None:
        lines.append(f"TOOL_DATA[1]={_pose(found.tool.translation, found.tool.rotation)}")
    notes = [
        *found.notes,
        "the index 1 stands for the number of the tool",
        *([] if found.inertia is not None else ["zeros stand for the moments of inertia J"]),
    ]
    said = [
        *found.said,
        "M [kg]; X, Y, Z [mm] and A, B, C [deg] of CM: centre of mass and principal axes in the flange frame",
        "A, B, C: rotations about Z, the new Y and the new X; J: principal moments [kg.m2] about the centre of mass",
        *notes,
    ]
    return Exported("".join(f"; {line}\n" for line in said) + "\n".join(lines) + "\n", tuple(notes))


def _principal(inertia: Array) -> tuple[Array, Array]:
    """Principal moments (3,) [kg.m2] and axes as columns (3, 3) [1], nearest to those of the flange."""
    moments, axes = np.linalg.eigh(inertia)
    order = list(max(permutations(range(3)), key=lambda some: float(np.abs(np.diag(axes[:, list(some)])).sum())))
    axes = axes[:, order] * np.where(np.diag(axes[:, order]) < 0, -1.0, 1.0)
    if np.linalg.det(axes) < 0:
        axes[:, np.argmin(np.diag(axes))] *= -1.0
    return moments[order], axes


def _pose(position: Array, rotation: Array) -> str:
    """KRL frame of a position [m] and a rotation (3, 3) [1]."""
    roll, pitch, yaw = pin.rpy.matrixToRpy(rotation)
    return _labelled("XYZABC", [*(1e3 * position), *np.degrees([yaw, pitch, roll])])


def _labelled(names: str, values: Array | list[float]) -> str:
    return f"{{{','.join(f'{name} {_real(x)}' for name, x in zip(names, values, strict=True))}}}"


def _real(value: float) -> str:
    """Number of KRL with seven significant digits, without an exponent."""
    return np.format_float_positional(float(f"{np.round(value, 9):.7g}") + 0.0, trim="0")
