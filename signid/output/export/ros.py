"""A model's drives and inertials as parameters of a ROS 2 node, of a controller for ros2_control for one."""

from __future__ import annotations

from typing import Any

import numpy as np
import pinocchio as pin

from ...model import Model
from .actuators import driven
from .beyond import BODIES, Exported, fixed_note, remarks

HEAD = """\
# Dynamics of {name} as parameters of a ROS 2 node: ros2 param load NODE FILE, or parameters=[FILE] in a launch file.
# kg, m, s, rad, N, N.m; prismatic joints: N for N.m, m for rad, kg for kg.m2. Recorded torque = rigid bodies + armature
# * acceleration + viscous_friction * velocity + coulomb_friction * sign(velocity) + torque_offset. Inertia is about the
# centre of mass, along the axes of the link's joint frame.
"""


def write_ros(model: Model) -> Exported:
    """A parameter file (YAML): what an actuators file holds of each joint, and the inertials of each link."""
    from yaml import safe_dump

    drives, notes = driven(model, BODIES)
    links = dict(zip(model.robot.links, list(model.bodies().inertias)[1:], strict=True))
    parameters = {
        "joints": list(model.robot.joints),
        "joint": {joint: stated for joint, stated in drives.items() if stated},
        "link": {link: _inertial(body) for link, body in links.items()},
    }
    told = [*(f"a ROS parameter file cannot hold {beyond}" for beyond in notes)]
    told += fixed_note(model.robot, "their links are listed all the same")
    text = safe_dump({"/**": {"ros__parameters": {"dynamics": parameters}}}, sort_keys=False, allow_unicode=True)
    return Exported(HEAD.format(name=" ".join(model.robot.name.split())) + remarks(told) + text, tuple(told))


def _inertial(body: pin.Inertia) -> dict[str, Any]:
    inertia = np.asarray(body.inertia)
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    return {
        "mass": float(body.mass),
        "centre_of_mass": np.asarray(body.lever).tolist(),
        "inertia": {name: float(inertia[place]) for name, place in names.items()},
    }
