"""Export of a model's actuators: actuators.toml, and parameters of a ROS 2 node."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from ...errors import one_line
from ...model import Model
from ...recording.mapping import quoted
from ...robot.joints import name_pattern
from ...servos import MARK_KEYS, PASSIVE_LAWS, SERVO_NUMBERS, SERVO_UNITS, Servo, servos_document
from ...types import Actuators, Array
from .bodies import Exported, fixed_note, summed
from .drives import curved, left_out

_UNITS = {**SERVO_UNITS, "torque_constant": "N.m/A"}
_BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")
ROS_HEAD = """\
# Dynamics of {name} as parameters of a ROS 2 node: --param-file FILE of a controller's spawner, or parameters=[FILE] in
# a launch file. kg, m, s, rad, N, N.m; prismatic joints: N for N.m, m for rad, kg for kg.m2. Recorded torque = rigid
# bodies + armature * acceleration + viscous_friction * velocity + coulomb_friction * sign(velocity) + torque_offset.
# effort_limit is stated by the description. Inertia is about the centre of mass, along the axes of the link's joint
# frame.
"""
_Drive = tuple[str, list[str]]  # class and arguments
ISAACLAB_KEYS = {"armature": "armature", "viscous_friction": "viscous_friction", "coulomb_friction": "friction"}
_ISAACLAB_HEAD = '''\
"""Actuators of {name} for Isaac Lab 2.2 or newer on Isaac Sim 5: ArticulationCfg(actuators=ACTUATORS, ...).

kg.m2, N.m.s/rad and N.m; prismatic joints: kg, N.s/m and N. Friction is an effort (PhysX 5.6, PxJointFrictionParams),
static and dynamic alike. Set stiffness and damping of joints without a drive to the gains of your controller.{loop}
"""

{imports}from isaaclab.actuators import {classes}

'''
_MJLAB_HEAD = '''\
"""Actuators of {name} for mjlab 1.6 or newer: EntityArticulationInfoCfg(actuators=ACTUATORS, ...).

kg.m2, N.m.s/rad and N.m; prismatic joints: kg, N.s/m and N.{loop}
"""

{imports}from mjlab.actuator import {classes}

'''
_NEWTON_HEAD = '''\
"""Actuators of {name} for Newton 1.6 or newer: call add_actuators(builder) before builder.finalize().

kg.m2, N.m.s/rad and N.m; prismatic joints: kg, N.s/m and N. Targets are joint_target_q and joint_target_qd (drives) or
joint_act (torque of the others). A delay is a whole number of steps of the actuators.
"""

from newton.actuators import {classes}

PHYSICS_STEP = 0.005  # s; set it to the time step of the actuators
JOINTS = {{
{joints}}}


def add_actuators(builder):
    """Set armature, damping and friction of the joints, and add their actuators, in the place of the solver's."""
    for joint, label in enumerate(builder.joint_label):
        if (numbers := JOINTS.get(label.rsplit("/", 1)[-1])) is None:
            continue
        index = builder.joint_qd_start[joint]
        for key, number in ("target_ke", 0.0), ("target_kd", 0.0), *numbers["passive"].items():
            getattr(builder, f"joint_{{key}}")[index] = number
        builder.joint_armature[index] += 0.5 * PHYSICS_STEP * numbers["drive"]["kd"]  # an explicit kd acts like less
        steps = max(1, round(numbers["delay"] / PHYSICS_STEP + 0.5)) if numbers["delay"] else None
        builder.add_actuator(DrivePD, index=index, delay_steps=steps, clamping=numbers["clamping"], **numbers["drive"])
'''
_LOOP_SENTENCE = "\nCommands are positions; a delay between two steps varies between both."
_STEP_FUNCTIONS = '''\
PHYSICS_STEP = 0.005  # s; set it to the time step of the physics


def delayed(seconds):
    """Delay in physics steps, rounded down and up; half a step more, since a step applies a command that much early."""
    steps = seconds / PHYSICS_STEP + 0.5
    return {{"{least}": math.floor(steps + 1e-6), "{most}": math.ceil(steps - 1e-6)}}


def inertia(armature, damping):
    """Armature that, with the share of `damping` in a step (explicit: less, implicit: more), is as stated."""
    return max(armature + 0.5 * PHYSICS_STEP * damping, 0.0)


'''
_OFFSETS_TEXT = """
# Add these to the targets of positions: constant torque, which no actuator holds, over stiffness [rad or m].
TARGET_OFFSETS = {}
"""


def write_actuators(model: Model) -> Exported:
    """Write an actuators file (TOML): armature, friction, offset, torque constant and position drive of each joint.

    Values that the description states and the model lacks are zero, since the file overrides the description.
    """
    head = f"Actuators of {model.robot.name}; prismatic joints: N for N.m, m for rad, kg for kg.m2"
    lines = [f"# {one_line(head)}"]
    for joint, stated in _driven(model).items():
        table = f"joint.{joint if _BARE_KEY.fullmatch(joint) else quoted(joint)}"
        if stated:
            lines += ["", f"[{table}]", *(f"{key} = {value!r}  # {_UNITS[key]}" for key, value in stated.items())]
        if joint in model.servos:
            servo = model.servos[joint]
            numbers = [f'law = "{servo.law}"', *([f'kd_on = "{servo.kd_on}"'] if servo.kd_on != Servo.kd_on else [])]
            for key in (name for name in SERVO_NUMBERS if name not in (*PASSIVE_LAWS, "droop", *left_out(servo))):
                value = float(getattr(servo, key))
                if np.isfinite(value) and (value > 0 or key in ("kd", "delay")):
                    known = "; not identifiable, as stated before" if key in servo.not_identifiable else ""
                    numbers.append(f"{key} = {value!r}  # {SERVO_UNITS[key]}{known}")
            numbers += [] if servo.kp_register is None else [f"kp_register = {float(servo.kp_register)!r}"]
            lines += ["", f"[{table}.servo]", *numbers]
    return Exported("\n".join(lines) + "\n")


def _driven(model: Model) -> dict[str, dict[str, float]]:
    """Actuator parameters by joint and key."""
    values = dict[str, Array]()  # (n,) by key; NaN if not written
    for key in (item.name for item in fields(Actuators)):
        stated = getattr(model.robot.actuators, key)
        if key == "torque_constant":
            values[key] = np.asarray(stated)
            continue
        total = summed(model, key)
        if key != "torque_offset":
            total = np.where(total < 0, np.nan, total)
        values[key] = np.where(np.isnan(total) & np.isfinite(stated), 0.0, total)
    return {
        joint: {key: float(value[j]) for key, value in values.items() if np.isfinite(value[j])}
        for j, joint in enumerate(model.robot.joints)
    }


def write_ros(model: Model) -> Exported:
    """Write a parameter file (YAML): actuator parameters, effort limits and drives per joint, inertials per link."""
    from yaml import safe_dump

    robot, drives = model.robot, _driven(model)
    servos = servos_document(model.servos, robot.joints)
    for joint, servo in model.servos.items():
        servos[joint] = {key: x for key, x in servos[joint].items() if key not in (*left_out(servo), *MARK_KEYS)}
    for joint, limit in zip(robot.joints, robot.effort_limit.tolist(), strict=True):
        drives[joint] |= {"effort_limit": limit} if 0 < limit < np.inf else {}
    inertials = dict[str, Any]()
    for link, body in zip(robot.links, list(model.bodies().inertias)[1:], strict=True):
        xx, xy, xz, _, yy, yz, *_, zz = np.asarray(body.inertia).ravel().tolist()
        moments = {"ixx": xx, "ixy": xy, "ixz": xz, "iyy": yy, "iyz": yz, "izz": zz}
        centre = np.asarray(body.lever).tolist()
        inertials[link] = {"mass": float(body.mass), "centre_of_mass": centre, "inertia": moments}
    parameters = {
        "joints": list(robot.joints),
        "joint": {joint: stated for joint, stated in drives.items() if stated},
        "servo": servos,
        "link": inertials,
    }
    parameters = {key: x for key, x in parameters.items() if x}  # rcl takes what follows an empty map for its content
    notes = fixed_note(robot, "their links are listed nevertheless")
    text = safe_dump({"/**": {"ros__parameters": {"dynamics": parameters}}}, sort_keys=False, allow_unicode=True)
    return Exported(ROS_HEAD.format(name=one_line(robot.name)) + text, tuple(notes))


def write_isaaclab(model: Model) -> Exported:
    """Write a Python file with armature, viscous and dry friction of each joint, and with the drives of servo joints.

    `effort` and `duty` become DelayedPDActuatorCfg, `torque_speed` DCMotorCfg.
    """
    servos = model.servos
    groups = {
        pattern: (kind, [f"joint_names_expr=[{_text(pattern)}]", *lines])
        for pattern, kind, lines in _grouped(model, {j: _isaaclab_drive(model, j) for j in servos})
    }
    others = [joint for joint in model.robot.joints if joint not in servos]
    if others:
        rest = "others" if servos else "all"
        while rest in groups:
            rest += "_"
        numbers = {re.escape(joint): _passive(model, joint, ISAACLAB_KEYS) for joint in others}
        lines = [f"joint_names_expr={list(numbers)!r}", "stiffness=None", "damping=None"]
        for name in (*ISAACLAB_KEYS.values(), "dynamic_friction"):
            table = {joint: x[name.removeprefix("dynamic_")] for joint, x in numbers.items()}
            lines.append(f"{name}={table!r}")
        groups[rest] = ("ImplicitActuatorCfg", lines)
    notes = list[str]()
    if late := [f"{joint} ({1e3 * x.delay:.4g} ms)" for joint, x in servos.items() if curved(x) and x.delay > 0]:
        notes.append(f"DCMotorCfg cannot hold the delay of {', '.join(late)}")
    if free := [joint for joint, servo in servos.items() if not np.isfinite(servo.effort_limit)]:
        notes.append(f"the effort limit of {', '.join(free)} is that of the asset, since none was identified")
    notes += _velocity_notes(servos)
    body = "".join(f"    {_text(name)}: {_call(kind, lines)},\n" for name, (kind, lines) in groups.items())
    used, delay = {x for x, _ in groups.values()}, ("min_delay", "max_delay")
    return _python(_ISAACLAB_HEAD, model, used, delay, f"ACTUATORS = {{\n{body}}}\n", notes)


def _python(head: str, model: Model, used: set[str], delay: tuple[str, str], body: str, notes: list[str]) -> Exported:
    """A Python file; used: names of classes; delay: names of the least and the largest one."""
    servos = model.servos
    optional = {"loop": _LOOP_SENTENCE if servos else "", "imports": "import math\n\n" if servos else ""}
    text = head.format(name=_name(model), classes=", ".join(sorted(used)), **optional)
    text += _STEP_FUNCTIONS.format(least=delay[0], most=delay[1]) if servos else ""
    shifts = {joint: float(f"{-x.torque_offset / x.kp:.6g}") for joint, x in servos.items() if x.torque_offset}
    offsets = _OFFSETS_TEXT.format(json.dumps(shifts, ensure_ascii=False, indent=4)) if shifts else ""
    return Exported(text + body + offsets, tuple(notes))


def write_mjlab(model: Model) -> Exported:
    """Write a Python file with an actuator of mjlab for each joint; joints without a drive get a motor."""
    servos, notes = model.servos, list[str]()
    if any(servo.coulomb_friction > 0 for servo in servos.values()):
        notes.append('dry friction creeps unless joints have solreffriction="0.001 1" solimpfriction="0.9999 0.9999"')
    made = {joint: _mjlab_drive(model, joint) for joint in model.robot.joints}
    body = "".join(
        f"    {_call(kind, [f'target_names_expr=({_text(pattern)},)', *lines])},\n"
        for pattern, kind, lines in _grouped(model, made)
    )
    used, delay = {kind for kind, _ in made.values()}, ("delay_min_lag", "delay_max_lag")
    return _python(_MJLAB_HEAD, model, used, delay, f"ACTUATORS = (\n{body})\n", notes)


def write_newton(model: Model) -> Exported:
    """Write a Python file that adds drive, clamp and delay of each joint to a builder of Newton.

    A joint without a drive has no gains, and its effort limit is that of the description.
    """
    lines, offsets = "", np.nan_to_num(summed(model, "torque_offset")).tolist()
    for joint, described, offset in zip(model.robot.joints, model.robot.effort_limit.tolist(), offsets, strict=True):
        servo = model.servos.get(joint, _NO_DRIVE)
        limit = float(servo.effort_limit) if joint in model.servos else described
        kind, limits = "ClampingMaxEffort", {"max_effort": limit}
        if curved(servo):
            kind, limits = "ClampingDCMotor", {"saturation_effort": limit, "velocity_limit": float(servo.speed_limit)}
        clamping = f"[({kind}, {limits!r})]" if np.isfinite(limit) else None
        drive = {"kp": float(servo.kp), "kd": _kd(servo), "const_effort": -offset}
        passive, delay = _passive(model, joint, _NEWTON_KEYS), float(servo.delay)
        numbers = f'{{"passive": {passive!r}, "drive": {drive!r}, "delay": {delay!r}, "clamping": {clamping}}}'
        lines += f"    {_text(joint)}: {numbers},\n"
    used = [name for name in ("ClampingDCMotor", "ClampingMaxEffort", "DrivePD") if name in lines + "DrivePD"]
    text = _NEWTON_HEAD.format(name=_name(model), classes=", ".join(used), joints=lines)
    return Exported(text, tuple(_velocity_notes(model.servos)))


_NEWTON_KEYS = {"armature": "armature", "viscous_friction": "damping", "coulomb_friction": "friction"}
_NO_DRIVE = Servo(kp=0.0)


def _passive(model: Model, joint: str, keys: Mapping[str, str]) -> dict[str, float]:
    """Armature and friction of a joint by the keys of a format, without numbers of its drive that are not known.

    Below a duty limit, damping of the drive is friction, since it is not clipped.
    """
    servo, j = model.servos.get(joint, _NO_DRIVE), model.robot.index(joint)
    values = {effect: max(0.0, float(np.nan_to_num(summed(model, effect)[j]))) for effect in keys}
    if servo.law == "duty":
        values["viscous_friction"] = float(servo.damping)
    return {keys[effect]: x for effect, x in values.items() if x or effect not in left_out(servo)}


def _kd(servo: Servo) -> float:
    """Gain on the speed that a limit clips."""
    return 0.0 if servo.law == "duty" else float(servo.kd)


def _velocity_notes(servos: Mapping[str, Servo]) -> list[str]:
    still = [joint for joint, servo in servos.items() if servo.kd_on == "error" and servo.kd > 0]
    return [f"set velocity targets too for {', '.join(still)}: kd acts on the error of the speed"] if still else []


_MJLAB_KEYS = {"armature": "armature", "viscous_friction": "viscous_damping", "coulomb_friction": "frictionloss"}


def _grouped(model: Model, drives: Mapping[str, _Drive]) -> list[tuple[str, str, list[str]]]:
    """Pattern of names, class and arguments of each set of joints whose drives are the same."""
    joints, groups = model.robot.joints, dict[str, list[str]]()
    for joint, drive in drives.items():
        groups.setdefault(repr(drive), []).append(joint)
    return [(name_pattern(members, joints), *drives[members[0]]) for members in groups.values()]


def _isaaclab_drive(model: Model, joint: str) -> _Drive:
    """Class and arguments of a drive; numbers that are left out are those of the asset."""
    servo, passive = model.servos[joint], _passive(model, joint, ISAACLAB_KEYS)
    damping = None if "kd" in left_out(servo) and servo.law != "duty" else _kd(servo)
    written = {key: repr(x) for key, x in passive.items()}
    if "armature" in written:
        written["armature"] = f"inertia({written['armature']}, {damping or 0.0!r})"
    if "friction" in written:
        written["dynamic_friction"] = written["friction"]
    lines = [f"stiffness={float(servo.kp)!r}", f"damping={damping!r}", *_limit(servo)]
    lines += [f"{key}={value}" for key, value in written.items()]
    return ("DCMotorCfg", lines) if curved(servo) else ("DelayedPDActuatorCfg", [*lines, *_delay(servo)])


def _delay(servo: Servo) -> list[str]:
    return [] if "delay" in left_out(servo) else [f"**delayed({float(servo.delay)!r})"]


def _limit(servo: Servo) -> list[str]:
    lines = [f"effort_limit={float(servo.effort_limit)!r}"] if np.isfinite(servo.effort_limit) else []
    if curved(servo):
        lines += [f"saturation_effort={float(servo.effort_limit)!r}", f"velocity_limit={float(servo.speed_limit)!r}"]
    return lines


def _mjlab_drive(model: Model, joint: str) -> _Drive:
    """Class and arguments of a joint."""
    servo, numbers = model.servos.get(joint), _passive(model, joint, _MJLAB_KEYS)
    written = {key: repr(x) for key, x in numbers.items()}
    if servo is None:
        limit = float(model.robot.effort_limit[model.robot.index(joint)])
        kind, lines = "BuiltinMotorActuatorCfg", [f"effort_limit={limit if np.isfinite(limit) else 1e9!r}"]
    else:
        kind = (
            "BuiltinPositionActuatorCfg" if servo.law == "duty" or servo.kd_on == "velocity" else "IdealPdActuatorCfg"
        )
        kind = "DcMotorActuatorCfg" if curved(servo) else kind
        lines = [f"stiffness={float(servo.kp)!r}", f"damping={_kd(servo)!r}", *_limit(servo), *_delay(servo)]
        if "armature" in numbers:
            explicit = servo.law != "duty" and kind != "BuiltinPositionActuatorCfg"
            # damping on the speed before a step less damping on the speed after it [N.m.s/rad]
            damping = float(servo.kd - servo.viscous_friction if explicit else -servo.damping)
            written["armature"] = f"inertia({numbers['armature']!r}, {damping!r})"
    return kind, [*lines, *(f"{key}={x}" for key, x in written.items())]


def _call(kind: str, lines: list[str]) -> str:
    return f"{kind}(\n{''.join(f'        {line},{chr(10)}' for line in lines)}    )"


def _text(text: str) -> str:
    """Text as a string of Python, whose escapes are those of JSON as long as only ASCII is escaped."""
    return json.dumps(text, ensure_ascii=False)


def _name(model: Model) -> str:
    return one_line(model.robot.name).replace('"', "'").replace("\\", "/")
