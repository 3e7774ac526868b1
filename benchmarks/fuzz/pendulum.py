"""The robot that is read beside the files of other readers."""

from __future__ import annotations

from functools import cache

import signid
from signid.types import Robot


@cache
def pendulum() -> Robot:
    """The robot 1r."""
    return signid.load_robot("1r")
