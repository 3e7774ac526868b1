"""Laws that each format holds: one table, from which come the notes and flags of exports and the documentation.

A law that a format lacks is a flag if its torque is more than `MAX_UNFLAGGED_SHARE` of that of a joint, along a motion
within the limits of the robot.
"""

from __future__ import annotations

import ast
from collections.abc import Collection, Iterable, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ...effects import LISTED_LAWS, UNLISTED
from ...effects.base import FUNCTIONS, ActuatorLaw, RecordingLaw, TorqueLaw, TransmissionLaw
from ...effects.drive import DriveLaw
from ...errors import SignidError, shorten
from ...model import Model
from ...types import Array, Law, Robot
from .bodies import FRICTION_LAWS, summed

VENDORS = ("franka", "ur", "kuka")  # payload and tool alone
MAX_NAMES = 16  # maximum number of joints listed
BODY_LAWS = ("payload", "link_inertia")  # laws included in inertials
PASSIVE = (*FRICTION_LAWS, "armature")  # whose sums at a joint formats of simulators hold unless negative
MAX_UNFLAGGED_SHARE = 0.02  # [1] rms torque over that of the joint, below which a missing law has no flag
_LOOP = "servo_gain register_gain servo_damping error_damping command_delay effort_limit duty_limit speed_limit"
_MOTION_LAWS = """
    viscous_friction coulomb_friction torque_offset armature asymmetric_friction stribeck_friction quadratic_friction
    load_friction position_friction spring cable_torque counterbalance torque_ripple joint_coupling empirical
    gear_friction
"""
_OF_BODIES = "payload link_inertia base_tilt gravity"
OF_VECTORS = {"array", "cross"}  # functions of equations that scalar code lacks
EMPIRICAL_VARIABLES = ("q", "v", "a", "load")  # variable of an empirical torque, by its number


class Format(NamedTuple):
    """A format: its name in sentences, and names of effects and kinds of files with spaces between."""

    subject: str
    exact: str  # effects that it holds
    approximate: str = ""  # within what its README states
    driven: str = ""  # of these, held only at joints with a position drive
    beside: str = ""  # kinds of files that hold the rest, if they are written, too

    def grade(self, effect: str) -> str:
        """How the format holds an effect: "exact", "approximate" or ""."""
        exact, rough = self.exact.split(), self.approximate.split()
        return "exact" if effect in exact else "approximate" if effect in rough else ""


_SIMULATOR = f"{' '.join(PASSIVE)} {_LOOP.replace('command_delay', '')}"
_CODE = Format("the code", f"{_MOTION_LAWS} {_OF_BODIES}")
FORMATS = {
    "urdf": Format("a URDF", " ".join((*FRICTION_LAWS, *BODY_LAWS)), beside="actuators ros function mjcf"),
    "mjcf": Format(
        "an MJCF",
        f"{' '.join(PASSIVE)} {_OF_BODIES} {_LOOP} torque_offset spring torque_saturation quadratic_friction "
        f"cable_torque counterbalance torque_ripple joint_elasticity",
        "presliding_friction backlash",
        beside="function",
    ),
    "actuators": Format(
        "an actuators file",
        f"{' '.join(PASSIVE)} {_LOOP} torque_offset motor_friction dead_band profile_limit",
        beside="urdf function",
    ),
    "function": Format("this file", f"{_MOTION_LAWS} friction_drift external_contact fluid_drag", beside="urdf mjcf"),
    "ros": Format(
        "a ROS parameter file",
        f"{' '.join((*PASSIVE, *BODY_LAWS))} {_LOOP} torque_offset motor_friction dead_band profile_limit "
        "voltage_droop link_encoder",
        beside="function",
    ),
    "isaaclab": Format(
        "an actuator group of Isaac Lab", _SIMULATOR, "command_delay torque_offset", "torque_offset", "urdf"
    ),
    "mjlab": Format("an actuator of mjlab", _SIMULATOR, "command_delay torque_offset", "torque_offset", "urdf mjcf"),
    "newton": Format("an actuator of Newton", _SIMULATOR, "command_delay torque_offset", beside="urdf mjcf"),
    "c": _CODE,
    "arrays": _CODE,
    **dict.fromkeys(VENDORS, Format("a payload", "payload")),
}
ACTUATOR_LAWS = ("torque_offset", "counterbalance", "torque_ripple", "torque_saturation")  # in MJCF: not passive
OF_TORQUE = ("function", "c", "arrays")  # torque of a given motion: drives count as laws


def held(model: Model, kind: str, floating: bool = False) -> list[Law]:
    """Laws of a model that a file holds; numbers of a joint that are negative only code can hold."""
    table, driven = FORMATS[kind], {model.robot.index(joint) for joint in model.servos}
    sums = {} if kind in OF_TORQUE else {effect: summed(model, effect) for effect in (*PASSIVE, "quadratic_friction")}
    listed, laws = {*LISTED_LAWS, *UNLISTED.split()}, list[Law]()
    for law in model.laws:
        name, effect = law.effect.name, law.effect
        known = bool(table.grade(name))
        if not known and kind in OF_TORQUE and name not in listed:  # of a new file or another package
            known = isinstance(effect, TorqueLaw) and not effect.memory if kind == "function" else writable(law)
        if (
            known
            and (name not in table.driven.split() or driven.issuperset(law.joints))
            and (name not in sums or sums[name][law.joints[0]] >= 0)
            and (kind != "mjcf" or _in_mjcf(model, law, driven))
            and not (floating and effect.scope == "robot")  # such a base takes its direction from the simulation
        ):
            laws.append(law)
    return laws


def writable(law: Law) -> bool:
    """Whether the torque of a law is a function of position, velocity, acceleration and rigid-body torque."""
    effect = law.effect
    if not isinstance(effect, TorqueLaw) or effect.memory or effect.scope not in ("joint", "pair", "robot", "any"):
        return False
    used = equation_names(effect.equation)
    numbers = {"variable", "knots", "values", *effect.filled(law.parameters)}
    return used is not None and used <= {*EMPIRICAL_VARIABLES, *numbers, *FUNCTIONS} - OF_VECTORS


def equation_names(equation: str) -> set[str] | None:
    """Names in an equation; None if it is none."""
    try:
        return {node.id for node in ast.walk(ast.parse(equation, mode="eval")) if isinstance(node, ast.Name)}
    except SyntaxError:
        return None


def equation_numbers(law: Law) -> tuple[dict[str, Any], str]:
    """Numbers in the equation of a law, and the signal that is the variable of an empirical one ("": another law)."""
    numbers: dict[str, Any] = {key: float(x) for key, x in law.effect.filled(law.parameters).items()}
    if law.effect.name != "empirical":
        return numbers, ""
    lists = {key + "s": [x for k, x in numbers.items() if k.startswith(f"{key}_")] for key in ("knot", "value")}
    return lists, EMPIRICAL_VARIABLES[int(numbers["variable"])]


def _in_mjcf(model: Model, law: Law, driven: Collection[int]) -> bool:
    """Whether MuJoCo takes the numbers of a law that MJCF has a place for."""
    name, robot, numbers = law.effect.name, model.robot, law.parameters
    alike = [other for other in model.laws if other.effect.name == name and other.joints == law.joints]
    spring, rest = stiffness(model).get(law.joints[0], (0.0, 0.0))
    if name == "spring":
        return spring > 0
    if name == "cable_torque":  # one polynomial about one position
        return len(alike) == 1 and numbers["cubic"] > 0 and (spring <= 0 or rest == numbers["centre"])
    if isinstance(law.effect, TransmissionLaw):
        gears, rows = [x for x in model.of(TransmissionLaw) if x.joints == law.joints], robot.drive[:, law.joints[0]]
        return len(gears) == 1 and np.count_nonzero(rows) == 1 and bool(summed(model, "armature")[law.joints[0]] > 0)
    beside_drives = ("quadratic_friction", "counterbalance", "torque_ripple", "presliding_friction")
    return name not in beside_drives or law.joints[0] not in driven


def stiffness(model: Model) -> dict[int, tuple[float, float]]:
    """Total stiffness [N.m/rad or N/m] and rest position [rad or m] of all springs, by joint."""
    springs = dict[int, tuple[float, float]]()  # stiffness, and torque at zero
    for law in (law for law in model.laws if law.effect.name == "spring"):
        (j,), k = law.joints, law.parameters["stiffness"]
        total, moment = springs.get(j, (0.0, 0.0))
        springs[j] = total + k, moment + k * law.parameters["rest"]
    return {j: (total, moment / total if total else 0.0) for j, (total, moment) in springs.items()}


def among(law: Law, laws: Iterable[Law]) -> bool:
    """Whether a law itself, not an equal one, is among some laws."""
    return any(law is other for other in laws)


def left_out(
    model: Model, kind: str, floating: bool = False, beside: Collection[str] = ()
) -> tuple[list[str], list[str]]:
    """Flags and notes on the laws that a file lacks; `beside`: kinds of files that are written with it."""
    if kind in VENDORS:
        return [], []
    table, robot, inside = FORMATS[kind], model.robot, held(model, kind, floating)
    lacked = [law for law in model.laws if not among(law, inside)]
    notes, lead = list[str](), f"{table.subject} cannot hold"
    if model.servos and not table.grade("servo_gain"):
        notes.append(f"{lead} the position drives of {shorten(list(model.servos), MAX_NAMES)}")
        lacked = [law for law in lacked if not isinstance(law.effect, DriveLaw)]
    if rough := [law for law in inside if table.grade(law.effect.name) == "approximate"]:
        notes.append(f"{table.subject} holds {lacking(robot, rough)} approximately")
    near = {name: held(model, name) for name in table.beside.split() if kind == "function" or name in beside}
    judged = [law for law in lacked if not any(among(law, laws) for laws in near.values())]
    shares = dict(zip(map(id, judged), _shares(model, judged), strict=True))
    groups, large = dict[str, list[Law]](), list[tuple[float, int, Law]]()  # by the end of the sentence; flagged
    for law in lacked:
        if there := [name for name, laws in near.items() if among(law, laws)]:
            end = f", held by {', '.join(there)}"
        elif isinstance(law.effect, RecordingLaw):
            end = ", an error of the recording, not of the robot"
        elif isinstance(law.effect, DriveLaw):
            end = ""
        elif (share := shares.get(id(law))) is None:
            end = ", whose share of the torque is unknown"
        elif share.max(initial=0.0) <= MAX_UNFLAGGED_SHARE:
            end = f", below {100 * MAX_UNFLAGGED_SHARE:.0f} % of the torque"
        else:
            large.append((float(share.max()), int(np.argmax(share)), law))
            continue
        groups.setdefault(end, []).append(law)
    others = {name: held(model, name) for name in FORMATS if name not in (*VENDORS, kind)} if large else {}
    flagged = dict[tuple[str, str], list[tuple[float, int, Law]]]()  # by effect and formats that hold it
    for size, joint, law in large:
        holding = ", ".join(name for name, laws in others.items() if among(law, laws)) or "no format"
        flagged.setdefault((law.effect.name, holding), []).append((size, joint, law))
    flags = [
        f"{lead} {lacking(robot, [law for *_, law in laws])}: {100 * size:.0f} % of the torque of "
        f"{robot.joints[joint]} along a simulated motion; held by {holding}"
        for (_, holding), laws in flagged.items()
        for size, joint, _ in [max(laws, key=lambda entry: entry[0])]
    ]
    return flags, [*notes, *(f"{lead} {lacking(robot, laws)}{end}" for end, laws in groups.items())]


def _shares(model: Model, laws: Sequence[Law]) -> list[Array | None]:
    """Rms torque (n,) of each law over that of its joint [1]; None: unknown."""
    from ...regression.motion import Motion
    from ...simulation.excite.families import rest_to_rest_motion

    unknown = [isinstance(law.effect, RecordingLaw | ActuatorLaw | DriveLaw) for law in laws]
    if all(unknown):
        return [None] * len(laws)
    try:
        moved = rest_to_rest_motion(model.robot, duration=10.0, step=0.01, seed=0)
        motion = Motion(model.robot, moved.t, moved.q, moved.v, moved.a)
        whole = model.inverse(motion)
        without = [replace(model, laws=tuple(x for x in model.laws if x is not law), marks={}) for law in laws]
        parts = [None if none else whole - x.inverse(motion) for x, none in zip(without, unknown, strict=True)]
    except SignidError:  # no limits, or laws that cannot act together
        return [None] * len(laws)
    size = np.maximum(np.sqrt(np.mean(whole**2, axis=0)), np.finfo(float).tiny)
    shares = [None if part is None else np.sqrt(np.mean(part**2, axis=0)) / size for part in parts]
    return [share if share is not None and np.isfinite(share).all() else None for share in shares]


def lacking(robot: Robot, laws: Iterable[Law]) -> str:
    """Laws in words: `torque_offset of joint_1, joint_2; backlash of joint_3`."""
    where: dict[str, list[str]] = {}
    for law in laws:
        every = law.effect.scope in ("robot", "any") and len(law.joints) == len(robot.joints)
        said = law.effect.meaning(law.parameters)
        name = f"{law.effect.name} ({said})" if said else law.effect.name
        where.setdefault(name, []).extend([] if every else [robot.joints[j] for j in law.joints])
    return "; ".join(f"{name} of {shorten(joints, MAX_NAMES)}" if joints else name for name, joints in where.items())
