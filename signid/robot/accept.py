"""Robots as users give them: loaded, as a path or name, or inside a model or a result."""

from __future__ import annotations

from pathlib import Path

from ..errors import unexpected
from ..types import Robot
from .load import load_robot


def as_robot(given: object, verb: str) -> Robot:
    """Robot that is given as such, as a path or name, or by a model or a result, whose `robot` it is.

    Raises:
        OptionError: anything else was given to the verb.
        RobotError: invalid description.
    """
    if isinstance(given, str | Path):
        return load_robot(given)
    for found in (given, getattr(given, "robot", None)):
        if isinstance(found, Robot):
            return found
    raise unexpected(verb, "a Robot", given, 'signid.load_robot("robot.urdf")')
