"""Export of the payload for Universal Robots: URScript.

Source: Universal Robots, Script Manual SW 10.6, set_target_payload: inertia [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] with its
origin in the centre of gravity, along the axes of the tool flange.
"""

from __future__ import annotations

import numpy as np
import pinocchio as pin

from ....model import Model
from ....types import Array
from ..beyond import Exported, remarks
from .flange import flange_of, rounded

FLANGE = "tool0"  # the controller's pose of an all-zero TCP (ur_description); `flange` and `ee_link` have other axes


def write_ur(model: Model, flange: str | None = None, tool: str | None = None) -> Exported:
    """Write `set_target_payload`, and `set_tcp` if a tool frame is named.

    Raises:
        OptionError: the model has no identifiable payload, or a frame is not known.
        RobotError: the payload has no positive mass.
    """
    found = flange_of(model, FLANGE, flange, tool)
    numbers = [_list(np.array([found.mass]))[1:-1], _list(found.centre)]
    calls = [f"set_target_payload({', '.join(numbers)})"]
    if found.inertia is not None:
        six = _list(found.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]])
        calls = [f"set_target_payload({', '.join(numbers)}, {six})"]
    if found.tool is not None:
        calls.append(f"set_tcp(p{_list(np.append(found.tool.translation, pin.log3(found.tool.rotation)))})")
    said = [
        *found.said,
        "mass [kg], centre of gravity [m] in the tool flange frame, inertia [Ixx, Iyy, Izz, Ixy, Ixz, Iyz] [kg.m2]",
        *(["tool: position [m], rotation vector [rad] in the tool flange frame"] if found.tool is not None else []),
        *found.notes,
        f"software without set_target_payload: set_payload({', '.join(numbers)})",
    ]
    return Exported(remarks(said) + "\n".join(calls) + "\n", found.notes)


def _list(values: Array) -> str:
    return repr(rounded(values))
