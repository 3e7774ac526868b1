"""A model's drives as an actuator group of Isaac Lab."""

from __future__ import annotations

import re

import numpy as np

from ...model import Model
from .beyond import BODIES, Exported, held, lacking, remarks, summed

FIELDS = {"armature": "armature", "viscous_friction": "viscous_friction", "coulomb_friction": "friction"}
HEAD = '''\
"""Actuators of {name} for Isaac Lab 2.2 or newer on Isaac Sim 5: ArticulationCfg(actuators=ACTUATORS, ...).

kg.m2, N.m.s/rad and N.m; prismatic joints: kg, N.s/m and N. Friction is an effort (PhysX 5.6, PxJointFrictionParams),
static and dynamic alike. Stiffness and damping are gains of your controller: put them in.
"""

from isaaclab.actuators import ImplicitActuatorCfg

'''


def write_isaaclab(model: Model) -> Exported:
    """A Python file with armature, viscous and dry friction of each joint."""
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
    head = HEAD.format(name=" ".join(robot.name.split()).replace('"', "'").replace("\\", "/"))
    return Exported(
        f'{head}{remarks(notes)}ACTUATORS = {{\n    "all": ImplicitActuatorCfg(\n{body}    )\n}}\n', tuple(notes)
    )
