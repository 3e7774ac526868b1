"""Export of the payload for Franka robots: the end effector that Desk imports, and the call of libfranka.

Source: RIDE documentation 1.1.1, End effector commissioning (`endeffector-config.json`); franka::Robot::setLoad.
"""

from __future__ import annotations

import json
import re

import numpy as np

from ....model import Model
from ...report import WRITTEN
from ..beyond import Exported, c_comment
from .flange import column_major, flange_of, rounded

FLANGE = "link8"  # of panda_link8, fr3_link8


def write_franka(model: Model, flange: str | None = None, tool: str | None = None) -> Exported:
    """Write the end effector as JSON; `beside` has the numbers of `setLoad` as a C++ header.

    JSON has no comments and Franka names all of its keys, so that frames, units and intervals stand in the header.

    Raises:
        OptionError: the model has no identifiable payload, or a frame is not known.
        RobotError: the payload has no positive mass.
    """
    found = flange_of(model, FLANGE, flange, tool)
    inertia = column_major(np.zeros((3, 3)) if found.inertia is None else found.inertia)
    slug = re.sub(r"[^a-z0-9]+", "-", model.robot.name.lower()).strip("-")
    document = {
        "id": f"payload-{slug}",
        "name": f"Payload of {model.robot.name}",
        "color": "#808080",
        "mass": rounded(np.array([found.mass]))[0],
        "centerOfMass": rounded(found.centre),
        "transformation": column_major(np.eye(4) if found.tool is None else found.tool.homogeneous),
        "inertia": inertia,
    }
    notes = [
        *found.notes,
        "Desk imports an archive that holds this file as endeffector-config.json; use it or setLoad, not both",
        *([] if found.inertia is not None else ["zeros stand for the inertia"]),
        *([] if tool is not None else ["the tool frame is the flange, since no --tool LINK is named"]),
    ]
    units = "mass [kg], centre of mass [m] in the flange frame, inertia [kg.m2] column by column"
    lines = [f"{WRITTEN}: numbers of franka::Robot::setLoad", units, *found.said, *notes]
    header = [
        *(f"// {c_comment(line)}" for line in lines),
        "#pragma once",
        "#include <array>",
        f"constexpr double load_mass = {document['mass']!r};",
        f"constexpr std::array<double, 3> F_x_Cload{{{{{_listed(document['centerOfMass'])}}}}};",
        f"constexpr std::array<double, 9> load_inertia{{{{{_listed(inertia)}}}}};",
        "// robot.setLoad(load_mass, F_x_Cload, load_inertia);",
    ]
    text = json.dumps(document, indent=2, ensure_ascii=False) + "\n"
    return Exported(text, tuple(notes), {"_load.h": "\n".join(header) + "\n"})


def _listed(values: object) -> str:
    return ", ".join(map(repr, values)) if isinstance(values, list) else ""
