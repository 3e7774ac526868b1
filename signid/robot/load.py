"""Load a Robot from a path, a name or a text, with the known parameters of its drives in an actuators file."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np

from ..errors import CONTROL, OptionError, RobotError, one_line, shorten, unexpected
from ..servos import CHOICES, number_fault
from ..toml_json import read_toml
from ..typed import typed
from ..types import Actuators, Array, Robot
from .document import Axis, Document, Draft, parse, read_document
from .joints import find_joint, hold, resting, with_gravity
from .locate import locate

ASSIGNMENT = re.compile(r"[A-Za-z_][\w.\-/]*:=")  # begins an argument and its value
MAX_VALUE_LETTERS = 10_000  # value of an argument [characters]
MAX_ARGUMENTS = 1000  # arguments
UNKNOWN_NUMBER = "find"  # in place of a number: not known, as if the key were absent
# numbers of a servo that cannot be zero
# numbers of a servo that cannot be zero
POSITIVE_KEYS = ("kp", "effort_limit", "speed_limit", "stall_torque", "voltage", "profile_speed", "kp_register")
NONNEGATIVE_KEYS = ("kd", "delay", "dead_band", "coulomb_friction", "viscous_friction", "load_friction", "armature")
SERVO_KEYS = ("law", "kp", "kd", "kd_on", *(key for key in POSITIVE_KEYS + NONNEGATIVE_KEYS if key not in ("kp", "kd")))
_KEYS = tuple(item.name for item in fields(Actuators))
_MAX_NUMBER = 1e100  # largest accepted magnitude [any]
_NONNEGATIVE_JOINT_KEYS = ("armature", "viscous_friction", "coulomb_friction")
ServoNumbers = dict[str, float | str]


@typed
def load_robot(
    source: str | Path,
    *,
    lock: Mapping[str, float] | None = None,
    joints: Sequence[str] | None = None,
    actuators: str | Path | None = None,
    package_dirs: Sequence[str | Path] = (),
    gravity: Sequence[float] | None = None,
    xacro: Mapping[str, object] | None = None,
) -> Robot:
    """Load a robot from a URDF, xacro or MJCF file, with a fixed base; meshes are not required.

    >>> signid.load_robot("3r").joints
    ('joint_1', 'joint_2', 'joint_3')

    Joints are given by name or by their 1-based number among the moving joints in the order of the file.

    Args:
        source: path of the description, or the name of a robot (see `names`).
        lock: positions [rad or m] of joints to be held fixed.
        joints: joints that move; all others are held at zero, or at the nearest position within their limits.
        actuators: TOML file with parameters of the drives; by default the `actuators.toml` beside the description.
        package_dirs: folders that xacro searches for packages.
        gravity: (3,) [m/s2] in the frame of the root link, if the robot is not mounted as described; zeros: the
            recorded torque carries no weight. By default that of the description, or (0, 0, -9.81).
        xacro: values of the arguments of a xacro file by name: {"name": "ur5e"}. The robot holds the expanded text.

    Raises:
        RobotError: invalid description, joint name or actuators file; a xacro argument that is missing or unknown.
        OptionError: the source is neither a path nor a name, gravity is not a vector, or xacro has invalid values.
    """
    if not isinstance(source, str | Path):
        raise unexpected("load_robot", "a path or the name of a robot", source, '"robot.urdf" or "panda"')
    arguments = as_arguments(xacro)
    path = locate(source)
    try:
        document = read_document(path, package_dirs, arguments)
        robot = _assemble(_draft(document), document)
    except RobotError as error:
        raise RobotError(f"{path.name}: {error}") from None
    beside = path.with_name("actuators.toml")
    stated = Path(actuators) if actuators is not None else beside if beside.is_file() else None
    if stated is not None:
        robot = state_actuators(robot, stated)
    return hold(with_gravity(robot, gravity), _held_joints(robot, joints, lock or {}))


def robot_from_text(
    text: str, kind: str, name: str, *, lock: Mapping[str, float] | None = None, gravity: Sequence[float] | None = None
) -> Robot:
    """Load a robot from the text of its description, its `document`.

    `kind` is "urdf" or "mjcf"; `name` counts if the text has none. Joints of `lock` are held fixed at these positions
    [rad or m], mimic joints excepted. gravity: (3,) [m/s2] in the frame of the root link; None: that of the text.

    Raises:
        RobotError: invalid text or joint name.
    """
    document = Document("", name, text, parse(text), sha256(text.encode()).hexdigest())
    draft = _draft(document)
    if draft.kind != kind:
        raise RobotError(f"the description of {name} is declared as {kind!r}, but is {draft.kind!r}; correct its kind")
    follow = {axis.name for axis in draft.axes if axis.mimic}
    held = {joint: value for joint, value in (lock or {}).items() if joint not in follow}
    return hold(with_gravity(_assemble(draft, document), gravity), held)


def held_positions(robot: Robot) -> dict[str, float]:
    """Positions [rad or m] of the joints that are held fixed, without those of the description itself."""
    whole = robot_from_text(robot.document, robot.kind, robot.name)
    shift = robot.rest - whole.rest
    held = {}
    for j, joint in enumerate(whole.joints):
        row = int(np.argmin(np.abs(whole.drive[:, j] - 1)))  # a joint drives its own row with factor one
        if joint not in robot.joints:
            held[joint] = float(shift[row] / whole.drive[row, j])
    return held


def described_gravity(robot: Robot) -> Array:
    """Gravity (3,) [m/s2] that the description itself states, or implies."""
    return np.array(robot_from_text(robot.document, robot.kind, robot.name).model.gravity.linear)


def _draft(document: Document) -> Draft:
    if document.root.tag == "mujoco":
        from .mjcf import read_mjcf as read
    else:
        from .urdf import read_urdf as read
    return read(document)


def _assemble(draft: Draft, document: Document) -> Robot:
    """Build the robot with all its joints; mimic joints become rows of the drive."""
    free = [axis for axis in draft.axes if axis.mimic is None]
    if not free:
        raise RobotError("the file has no joint that moves by itself, so there is nothing to identify")
    column = {axis.name: i for i, axis in enumerate(free)}
    drive, rest = np.zeros((draft.model.nv, len(free))), np.zeros(draft.model.nv)
    for axis in draft.axes:
        leader, scale, offset = _resolve_mimic(axis, draft)
        rest[axis.row] = offset
        if leader is not None:
            drive[axis.row, column[leader]] = scale
    stiffness, moment = np.zeros(len(free)), np.zeros(len(free))
    for axis in draft.axes:
        weight, (stated, place) = drive[axis.row], axis.spring
        stiffness += weight**2 * stated
        moment += weight * stated * (place - rest[axis.row])
    springs = zip(column, stiffness.tolist(), moment.tolist(), strict=True)
    return Robot(
        name=one_line(draft.name) or "robot",
        model=draft.model,
        joints=tuple(column),
        numbers=tuple(range(1, len(free) + 1)),
        links=draft.links,
        drive=drive,
        rest=rest,
        prismatic=np.array([axis.prismatic for axis in free]),
        lower=np.array([axis.lower for axis in free]),
        upper=np.array([axis.upper for axis in free]),
        velocity_limit=np.array([axis.velocity for axis in free]),
        effort_limit=np.array([axis.effort for axis in free]),
        actuators=_stated_actuators(draft, drive),
        document=draft.document,
        kind=draft.kind,
        path=document.path,
        sha256=document.sha256,
        notes=draft.notes,
        springs={joint: (total, part / total) for joint, total, part in springs if total},
    )


def _resolve_mimic(axis: Axis, draft: Draft) -> tuple[str | None, float, float]:
    """Independent joint that an axis follows (None: fixed), multiplier and offset, through chains of mimic joints."""
    known = {other.name: other for other in draft.axes}
    seen, leader, scale, offset = {axis.name}, axis, 1.0, 0.0
    while leader.mimic is not None:
        followed = leader.mimic
        offset, scale = offset + scale * followed.offset, scale * followed.multiplier
        if followed.joint in draft.still:
            return None, 0.0, offset
        if followed.joint not in known:
            raise RobotError(f"joint {leader.name!r} mimics a joint {followed.joint!r} that the file does not have")
        if followed.joint in seen:
            raise RobotError(f"joint {axis.name!r} mimics itself in a circle; remove one <mimic> of the circle")
        seen.add(followed.joint)
        leader = known[followed.joint]
    return leader.name, scale, offset


def _stated_actuators(draft: Draft, drive: Array) -> Actuators:
    """Friction and armature stated by the description; those of mimic joints are added to the joint they follow."""
    nothing = np.full(drive.shape[1], np.nan)

    def reflected(key: str, weight: Array) -> Array:
        total = nothing.copy()
        for axis in draft.axes:
            if not np.isnan(value := getattr(axis, key)):
                columns = np.flatnonzero(drive[axis.row])
                total[columns] = np.nan_to_num(total[columns]) + weight[axis.row, columns] * value
        return total

    armature, viscous = (reflected(key, drive**2) for key in ("armature", "viscous"))
    return Actuators(armature, viscous, reflected("coulomb", np.abs(drive)), nothing, nothing)


def _held_joints(robot: Robot, joints: Sequence[str] | None, lock: Mapping[str, float]) -> dict[str, float]:
    """Positions of the held joints: those locked, and those not among `joints`."""
    locked = {robot.joints[find_joint(joint, robot)]: joint for joint in lock}
    held = {name: lock[joint] for name, joint in locked.items()}
    if len(held) < len(lock):
        raise RobotError(f"a joint of {robot.name} is locked twice, by name and by number; give one position for it")
    if joints is None:
        return held
    wanted = [joints] if isinstance(joints, str) else joints
    moving = {robot.joints[find_joint(joint, robot)] for joint in wanted}
    if both := sorted(moving & held.keys()):
        raise RobotError(f"{shorten(both)} would both move and be locked; name a joint only once")
    return resting(robot, but=moving) | held


def as_robot(robot: object, verb: str) -> Robot:
    """Robot that is given as such, as a path or name, or by a model or a result, whose `robot` it is.

    Raises:
        OptionError: anything else was given to the verb.
        RobotError: invalid description.
    """
    if isinstance(robot, str | Path):
        return load_robot(robot)
    for candidate in (robot, getattr(robot, "robot", None)):
        if isinstance(candidate, Robot):
            return candidate
    raise unexpected(verb, "a Robot", robot, 'signid.load_robot("robot.urdf")')


def parse_arguments(texts: Sequence[str]) -> dict[str, str]:
    """Values of xacro arguments by name, from texts NAME:=VALUE.

    Raises:
        OptionError: a text of another form, or two values for one name.
    """
    arguments: dict[str, str] = {}
    for text in texts:
        if not ASSIGNMENT.match(text):
            raise OptionError(f"--xacro {text[:80]!r} is not an argument and its value; write NAME:=VALUE")
        name, _, value = text.partition(":=")
        if name in arguments:
            raise OptionError(f"--xacro names the argument {name} twice; give one value for it")
        arguments[name] = value
    return as_arguments(arguments)


def as_arguments(arguments: Mapping[str, object] | None) -> dict[str, str]:
    """Values of xacro arguments as texts, as xacro takes them: True becomes true.

    Raises:
        OptionError: not a mapping of names to texts, numbers or truth values, or too many or too long ones.
    """
    if arguments is None:
        return {}
    if not isinstance(arguments, Mapping):
        raise unexpected("xacro", "values by name of the argument", arguments, '{"name": "ur5e"}')
    if len(arguments) > MAX_ARGUMENTS:
        raise OptionError(f"xacro has {len(arguments)} arguments; give {MAX_ARGUMENTS} at most")
    for name in arguments:
        if not isinstance(name, str) or not ASSIGNMENT.fullmatch(f"{name}:="):
            raise OptionError(f"xacro has {str(name)[:80]!r} as the name of an argument; give letters, digits and _")
    return {name: _argument_text(name, value) for name, value in arguments.items()}


def _argument_text(name: str, value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if not isinstance(value, str | int | float):
        kind = type(value).__name__
        raise OptionError(f"the xacro argument {name} is of type {kind}; give a text, a number, True or False")
    text = value if isinstance(value, str) else repr(value)
    if len(text) > MAX_VALUE_LETTERS or CONTROL.search(text) or any("\ud800" <= letter <= "\udfff" for letter in text):
        raise OptionError(f"the value of the xacro argument {name} is no text of one line; give one of UTF-8")
    return text


def state_actuators(robot: Robot, path: Path) -> Robot:
    """The robot with the parameters of its drives that an actuators file states; its own where there are none.

    Raises:
        RobotError: unreadable file, or an invalid joint, key or value.
    """
    values = {key: getattr(robot.actuators, key).copy() for key in _KEYS}
    try:
        content = _read_tables(path)
        servo = _fill(values, _tables(content, "joint", "[joint.NAME]"), robot)
        registers = dict(_registers(_tables(content, "recording", '[recording."FILE NAME".JOINT]'), robot))
    except RobotError as error:
        raise RobotError(f"{path.name or path}: {error}") from None
    return replace(robot, actuators=Actuators(**values), servo=servo, registers=registers)


def _read_tables(path: Path) -> dict[str, Any]:
    try:
        content = read_toml(path)
    except OSError as error:
        raise RobotError(f"the file cannot be read ({error.strerror}); check the path of the actuators file") from None
    except UnicodeDecodeError:
        raise RobotError("the file is not UTF-8 text; save the actuators file as UTF-8") from None
    except ValueError as error:
        raise RobotError(f"the file is not valid TOML: {error}") from None
    if unknown := sorted(content.keys() - {"joint", "recording"}):
        raise RobotError(f"there is no entry {unknown[0]!r} in an actuators file; write tables [joint.NAME]")
    return content


def _tables(content: Mapping[str, Any], key: str, form: str) -> Mapping[str, Any]:
    tables = content.get(key, {})
    if not isinstance(tables, Mapping):
        raise RobotError(f"{key!r} is not a table; write tables {form}")
    return tables


def _fill(values: dict[str, Array], tables: Mapping[str, Any], robot: Robot) -> dict[str, Mapping[str, float | str]]:
    """Fill the values (n,) of the drives, by key; return stated numbers of servos by joint."""
    seen: set[int] = set()
    servo: dict[str, Mapping[str, float | str]] = {}
    for name, table in tables.items():
        joint = find_joint(name, robot)
        if joint in seen:
            raise RobotError(f"joint {robot.joints[joint]} has two tables, by name and by number; keep one")
        seen.add(joint)
        if not isinstance(table, Mapping):
            raise RobotError(f"'joint.{name}' is not a table; write [joint.{name}] and below it key = number")
        for key, value in table.items():
            if key == "servo":
                servo[robot.joints[joint]] = _servo_numbers(name, value)
            elif key not in _KEYS:
                advice = f"; {key} belongs below [joint.{name}.servo]" if key in SERVO_KEYS else ""
                raise RobotError(f"joint {name} has the unknown key {key!r}; choose from {', '.join(_KEYS)}{advice}")
            else:
                values[key][joint] = _number(name, key, value)
    return {joint: stated for joint, stated in servo.items() if stated}


def _servo_numbers(name: str, table: object) -> ServoNumbers:
    """Stated numbers and words of a servo."""
    where, stated = f"joint.{name}.servo", ServoNumbers()
    if not isinstance(table, Mapping):
        raise RobotError(f"{where!r} is not a table; write [{where}] and below it lines such as kp = 20.0")
    for key, value in table.items():
        if key not in SERVO_KEYS:
            close = get_close_matches(key, SERVO_KEYS, 1)
            advice = f"did you mean {close[0]}?" if close else f"choose from {', '.join(SERVO_KEYS)}"
            raise RobotError(f"[{where}] has the unknown key {key!r}; {advice}")
        if value == UNKNOWN_NUMBER:
            continue
        stated[key] = _word(where, key, value) if key in CHOICES else _size(where, key, value)
    return stated


def _word(where: str, key: str, value: object) -> str:
    known = CHOICES[key]
    if isinstance(value, str) and value in known:
        return value
    close = get_close_matches(value, known, 1) if isinstance(value, str) else []
    advice = f"did you mean {close[0]!r}?" if close else f"expected {', '.join(known)} or {UNKNOWN_NUMBER}"
    raise RobotError(f"[{where}] has {key} = {value!r}; {advice}")


def _size(where: str, key: str, value: object) -> float:
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < float("inf")
    if not (number and isinstance(value, int | float)):
        raise RobotError(f'[{where}] has {key} = {value!r}; expected a finite number, or "{UNKNOWN_NUMBER}"')
    if fault := number_fault(key, value, key in POSITIVE_KEYS):
        given = f"{float(value):g}" if abs(value) < _MAX_NUMBER else f"a number beyond {_MAX_NUMBER:.0e}"
        raise RobotError(f"[{where}] has {key} = {given}; {fault}")
    return float(value)


def _registers(tables: Mapping[str, Any], robot: Robot) -> dict[tuple[str, str], Mapping[str, float]]:
    """Firmware gains by name of a recording and joint."""
    registers: dict[tuple[str, str], Mapping[str, float]] = {}
    for file, joints in tables.items():
        form = f'[recording."{file}".JOINT] and below it kp_register = 400'
        if not isinstance(joints, Mapping):
            raise RobotError(f"'recording.{file}' is not a table of joints; write {form}")
        for name, table in joints.items():
            if not isinstance(table, Mapping) or any(isinstance(entry, Mapping) for entry in table.values()):
                raise RobotError(f"'recording.{file}.{name}' is no table of numbers; write {form}, with its quotes")
            joint, where = robot.joints[find_joint(name, robot)], f'recording."{file}".{name}'
            if strange := [key for key in table if key != "kp_register"]:
                raise RobotError(f"[{where}] has the unknown key {strange[0]!r}; expected kp_register")
            if (Path(file).name, joint) in registers:
                raise RobotError(f"joint {joint} has two tables for the recording {file}; keep one")
            stated = {key: _size(where, key, value) for key, value in table.items() if value != UNKNOWN_NUMBER}
            if stated:
                registers[Path(file).name, joint] = stated
    return registers


def _number(joint: str, key: str, value: object) -> float:
    if isinstance(value, int) and abs(value) >= _MAX_NUMBER:
        raise RobotError(f"joint {joint} has {key} beyond {_MAX_NUMBER:.0e}; expected a finite number")
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _MAX_NUMBER:
        raise RobotError(f"joint {joint} has {key} = {value!r}; expected a finite number")
    if value < 0 and key in _NONNEGATIVE_JOINT_KEYS:
        raise RobotError(f"joint {joint} has {key} = {value!r}; it cannot be negative")
    if value == 0 and key == "torque_constant":
        raise RobotError(f"joint {joint} has torque_constant = 0; give its value in N.m/A, or remove the key")
    return float(value)
