"""Known parameters of the drives of a robot, from an actuators file (TOML)."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ..errors import RobotError
from ..servos import CHOICES, number_fault
from ..toml_json import read_toml
from ..types import Actuators, Array, Robot
from .joints import find_joint

UNKNOWN_NUMBER = "find"  # in place of a number: not known, as if the key were absent
# numbers of a servo that cannot be zero
POSITIVE_KEYS = ("kp", "effort_limit", "speed_limit", "stall_torque", "voltage", "profile_speed", "kp_register")
NONNEGATIVE_KEYS = ("kd", "delay", "dead_band", "coulomb_friction", "viscous_friction", "load_friction", "armature")
SERVO_KEYS = ("law", "kp", "kd", "kd_on", *(key for key in POSITIVE_KEYS + NONNEGATIVE_KEYS if key not in ("kp", "kd")))
_KEYS = tuple(item.name for item in fields(Actuators))
_MAX_NUMBER = 1e100  # largest accepted magnitude [any]
_NONNEGATIVE_JOINT_KEYS = ("armature", "viscous_friction", "coulomb_friction")
ServoNumbers = dict[str, float | str]


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
                own = f"; {key} belongs below [joint.{name}.servo]" if key in SERVO_KEYS else ""
                raise RobotError(f"joint {name} has the unknown key {key!r}; choose from {', '.join(_KEYS)}{own}")
            else:
                values[key][joint] = _number(name, key, value)
    return {joint: stated for joint, stated in servo.items() if stated}


def _servo_numbers(name: str, table: object) -> ServoNumbers:
    """Stated numbers and words of a servo."""
    where, found = f"joint.{name}.servo", ServoNumbers()
    if not isinstance(table, Mapping):
        raise RobotError(f"{where!r} is not a table; write [{where}] and below it lines such as kp = 20.0")
    for key, value in table.items():
        if key not in SERVO_KEYS:
            close = get_close_matches(key, SERVO_KEYS, 1)
            advice = f"did you mean {close[0]}?" if close else f"choose from {', '.join(SERVO_KEYS)}"
            raise RobotError(f"[{where}] has the unknown key {key!r}; {advice}")
        if value == UNKNOWN_NUMBER:
            continue
        found[key] = _word(where, key, value) if key in CHOICES else _size(where, key, value)
    return found


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
    found: dict[tuple[str, str], Mapping[str, float]] = {}
    for file, joints in tables.items():
        form = f'[recording."{file}".JOINT] and below it kp_register = 400'
        if not isinstance(joints, Mapping):
            raise RobotError(f"'recording.{file}' is not a table of joints; write {form}")
        for name, table in joints.items():
            if not isinstance(table, Mapping) or any(isinstance(each, Mapping) for each in table.values()):
                raise RobotError(f"'recording.{file}.{name}' is no table of numbers; write {form}, with its quotes")
            joint, where = robot.joints[find_joint(name, robot)], f'recording."{file}".{name}'
            if strange := [key for key in table if key != "kp_register"]:
                raise RobotError(f"[{where}] has the unknown key {strange[0]!r}; expected kp_register")
            if (Path(file).name, joint) in found:
                raise RobotError(f"joint {joint} has two tables for the recording {file}; keep one")
            stated = {key: _size(where, key, value) for key, value in table.items() if value != UNKNOWN_NUMBER}
            if stated:
                found[Path(file).name, joint] = stated
    return found


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
