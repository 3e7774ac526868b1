"""Limits of descriptions: magnitude of numbers, number of joints, size of files, and names that Pinocchio reserves."""

from __future__ import annotations

from collections.abc import Iterable
from math import isfinite
from pathlib import Path

from ...errors import CONTROL, RobotError, one_line

LARGEST = 1e9  # magnitude of a mass, length, inertia, multiplier or friction [SI units]
SMALLEST = 1e-100  # numbers below count as 0; products of smaller ones underflow
MOST_LINKS = 1000
MOST_JOINTS = 120  # moving joints of a file; base parameters of 120 joints need 20 s
MOST_BYTES = 100_000_000  # of a file
UNIVERSE = "universe"  # name of the fixed joint and frame of every model of Pinocchio
RESERVED = {"joint": (UNIVERSE,), "body": (UNIVERSE,), "link": ()}


def bounded(value: float, stated: str) -> float:
    """The number, 0 if it is negligible; `stated` begins the message: "link 'a' has mass='1e300'".

    Raises:
        RobotError: the number is not finite or too large.
    """
    if not isfinite(value):
        raise RobotError(f"{stated}; expected a finite number")
    if abs(value) > LARGEST:
        raise RobotError(f"{stated}; expected a number up to {LARGEST:.0e}, in SI units")
    return 0.0 if abs(value) < SMALLEST else value


def not_negative(value: float, stated: str) -> float:
    """The number of a friction, damping or armature, also NaN; `stated` begins the message.

    Raises:
        RobotError: the number is negative.
    """
    if value < 0:
        raise RobotError(f"{stated}, and would drive the joint; expected 0 or more")
    return value


def check_count(links: int, joints: int, noun: str = "links") -> None:
    """Check the number of links, or bodies, and of moving joints.

    Raises:
        RobotError: there are more than can be processed in reasonable time.
    """
    if links > MOST_LINKS:
        raise RobotError(f"the file has more than {MOST_LINKS} {noun}; give the description of one robot")
    if joints > MOST_JOINTS:
        advice = "give the description of one robot, or declare some of its joints fixed"
        raise RobotError(f"the file has {joints} moving joints, more than {MOST_JOINTS}; {advice}")


def check_names(**names: Iterable[str | None]) -> None:
    """Check names by what they name ("joint", "body", "link") before Pinocchio reads them.

    Raises:
        RobotError: a name is reserved, and would damage Pinocchio's memory, or has control characters.
    """
    for what, mine in names.items():
        for name in mine:
            if CONTROL.search(name or ""):
                shown = f"a {what} is named {one_line(name or '')!r}, with a line end or another control character"
                raise RobotError(f"{shown}; give it a name of one line")
            if name in RESERVED[what]:
                raise RobotError(f"a {what} is named {name!r}, which Pinocchio uses itself; give it another name")


def read_bytes(path: Path) -> bytes:
    """Content of a regular file.

    Raises:
        OSError: unreadable file.
        RobotError: a device or pipe, or a file that is too large.
    """
    if path.exists() and not path.is_file():
        raise RobotError("it is no regular file; give a URDF, xacro or MJCF file")
    if path.exists() and path.stat().st_size > MOST_BYTES:
        raise RobotError(f"it has more than {MOST_BYTES / 1e6:.0f} MB; give the description of one robot")
    return path.read_bytes()
