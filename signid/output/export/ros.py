"""Export of actuators and inertials as parameters of a ROS 2 node, and as an actuator group of Isaac Lab."""

from __future__ import annotations

import re
from typing import Any

import numpy as np
import pinocchio as pin

from ...model import Model
from .actuators import driven
from .beyond import BODIES, Exported, fixed_note, held, lacking, remarks, summed

HEAD = """\
# Dynamics of {name} as parameters of a ROS 2 node: ros2 param load NODE FILE, or parameters=[FILE] in a launch file.
# kg, m, s, rad, N, N.m; prismatic joints: N for N.m, m for rad, kg for kg.m2. Recorded torque = rigid bodies + armature
# * acceleration + viscous_friction * velocity + coulomb_friction * sign(velocity) + torque_offset. Inertia is about the
# centre of mass, along the axes of the link's joint frame.
"""


FIELDS = {"armature": "armature", "viscous_friction": "viscous_friction", "coulomb_friction": "friction"}

ISAAC_HEAD = '''\
"""Actuators of {name} for Isaac Lab 2.2 or newer on Isaac Sim 5: ArticulationCfg(actuators=ACTUATORS, ...).

kg.m2, N.m.s/rad and N.m; prismatic joints: kg, N.s/m and N. Friction is an effort (PhysX 5.6, PxJointFrictionParams),
static and dynamic alike. Set stiffness and damping to the gains of your controller.
"""

from isaaclab.actuators import ImplicitActuatorCfg

'''


def write_ros(model: Model) -> Exported:
    """Write a parameter file (YAML) with actuator parameters per joint and inertials per link."""
    from yaml import safe_dump

    drives, notes = driven(model, BODIES)
    links = dict(zip(model.robot.links, list(model.bodies().inertias)[1:], strict=True))
    parameters = {
        "joints": list(model.robot.joints),
        "joint": {joint: stated for joint, stated in drives.items() if stated},
        "link": {link: _inertial(body) for link, body in links.items()},
    }
    lacks = [*(f"a ROS parameter file cannot hold {beyond}" for beyond in notes)]
    lacks += fixed_note(model.robot, "their links are listed nevertheless")
    text = safe_dump({"/**": {"ros__parameters": {"dynamics": parameters}}}, sort_keys=False, allow_unicode=True)
    return Exported(HEAD.format(name=" ".join(model.robot.name.split())) + remarks(lacks) + text, tuple(lacks))


def _inertial(body: pin.Inertia) -> dict[str, Any]:
    inertia = np.asarray(body.inertia)
    names = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    return {
        "mass": float(body.mass),
        "centre_of_mass": np.asarray(body.lever).tolist(),
        "inertia": {name: float(inertia[place]) for name, place in names.items()},
    }


def write_isaaclab(model: Model) -> Exported:
    """Write a Python file with armature, viscous and dry friction of each joint."""
    robot = model.robot
    names = [re.escape(joint) for joint in robot.joints]
    carried = [*held(model, FIELDS), *(law for law in model.laws if law.effect.name in BODIES)]
    beyond = lacking(robot, model.laws, carried)
    notes = [f"an actuator group of Isaac Lab cannot hold {beyond}"] if beyond else []
    lines = [f"joint_names_expr={names!r}", "stiffness=None", "damping=None"]
    for effect, field in FIELDS.items():
        value = np.maximum(0.0, np.nan_to_num(summed(model, effect)))
        table = repr(dict(zip(names, value.tolist(), strict=True)))
        lines += [f"{name}={table}" for name in ([field, "dynamic_friction"] if field == "friction" else [field])]
    body = "".join(f"        {line},\n" for line in lines)
    head = ISAAC_HEAD.format(name=" ".join(robot.name.split()).replace('"', "'").replace("\\", "/"))
    return Exported(
        f'{head}{remarks(notes)}ACTUATORS = {{\n    "all": ImplicitActuatorCfg(\n{body}    )\n}}\n', tuple(notes)
    )
