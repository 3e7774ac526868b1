"""Actuators file (TOML): known parameters of the drives."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

from ..errors import RobotError
from ..toml_json import read_toml
from ..types import Actuators, Array, Robot
from .joints import find

_KEYS = tuple(item.name for item in fields(Actuators))
_LARGEST = 1e100  # largest accepted magnitude [any]
_NEVER_NEGATIVE = ("armature", "viscous_friction", "coulomb_friction")


def read_actuators(path: Path, robot: Robot) -> Actuators:
    """Parameters of the drives from a file; the robot's own where the file states none.

    Raises:
        RobotError: unreadable file, or an invalid joint, key or value.
    """
    values = {key: getattr(robot.actuators, key).copy() for key in _KEYS}
    try:
        _fill(values, _read(path), robot)
    except RobotError as error:
        raise RobotError(f"{path.name or path}: {error}") from None
    return Actuators(**values)


def _read(path: Path) -> dict[str, Any]:
    try:
        content = read_toml(path)
    except OSError as error:
        raise RobotError(f"the file cannot be read ({error.strerror}); check the path of the actuators file") from None
    except UnicodeDecodeError:
        raise RobotError("the file is not UTF-8 text; save the actuators file as UTF-8") from None
    except ValueError as error:
        raise RobotError(f"the file is not valid TOML: {error}") from None
    if unknown := sorted(content.keys() - {"joint"}):
        raise RobotError(f"there is no entry {unknown[0]!r} in an actuators file; write tables [joint.NAME]")
    tables = content.get("joint", {})
    if not isinstance(tables, dict):
        raise RobotError("'joint' is not a table; write tables [joint.NAME]")
    return tables


def _fill(values: dict[str, Array], tables: dict[str, Any], robot: Robot) -> None:
    seen: set[int] = set()
    for name, table in tables.items():
        joint = find(name, robot)
        if joint in seen:
            raise RobotError(f"joint {robot.joints[joint]} has two tables, by name and by number; keep one")
        seen.add(joint)
        if not isinstance(table, dict):
            raise RobotError(f"'joint.{name}' is not a table; write [joint.{name}] and below it key = number")
        for key, value in table.items():
            if key not in _KEYS:
                raise RobotError(f"joint {name} has the unknown key {key!r}; choose from {', '.join(_KEYS)}")
            values[key][joint] = _number(name, key, value)


def _number(joint: str, key: str, value: object) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < _LARGEST:
        raise RobotError(f"joint {joint} has {key} = {value!r}; expected a finite number")
    if value < 0 and key in _NEVER_NEGATIVE:
        raise RobotError(f"joint {joint} has {key} = {value!r}; it cannot be negative")
    if value == 0 and key == "torque_constant":
        raise RobotError(f"joint {joint} has torque_constant = 0; give its value in N.m/A, or remove the key")
    return float(value)
