"""Detect joint numbers in columns that may not follow the joint order of the description."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Robot

WHEEL = re.compile(r"wheel|caster|castor|rotor|propeller", re.IGNORECASE)
FINGER = re.compile(r"finger|thumb|gripper|jaw|hand", re.IGNORECASE)
LONG = 150  # maximum length of a map within a message [characters]
ARM = "arm joint"  # a revolute joint that is no wheel and no finger


class _Numbered(NamedTuple):
    """Joints and the numbers by which columns name them, in ascending order of the numbers."""

    joints: tuple[int, ...]
    numbers: tuple[int, ...]


def check_numbering(source: str, robot: Robot, joints: Sequence[int]) -> tuple[str, ...]:
    """Flags for joint numbers that may not follow the order of the description.

    Numbers are certain if every moving joint has one, if they match digits in the joint names, or if no other chain of
    arm joints has the same length.

    Args:
        source: name of the recording.
        robot: the robot.
        joints: indices of the joints whose position column has a number.

    Raises:
        RecordingError: the numbers belong to joints of several kinds, and an arm has the same number of joints.
    """
    named = sorted(joints, key=lambda j: robot.numbers[j])
    given = _Numbered(tuple(named), tuple(robot.numbers[j] for j in named))
    if robot.model is None or len(joints) < 2 or len(joints) == len(robot.joints) or _agree(given, robot):
        return ()
    parents = _parents(robot)
    rivals = [rival for rival in _chains(robot, parents, len(joints)) if set(rival) != set(joints)]
    kinds = {_kind(robot, parents, j) for j in joints}
    if not rivals or (kinds == {ARM} and _is_chain(joints, parents)):
        return ()
    rival = max(rivals, key=lambda r: _digits(robot, r) == list(given.numbers))
    sentence = _sentence(source, robot, given, rival)
    if len(kinds) > 1:
        raise RecordingError(sentence)
    return (sentence,)


def _agree(given: _Numbered, robot: Robot) -> bool:
    """Whether the joint names contain the numbers, such as 3 in panda_joint3."""
    return _digits(robot, given.joints) == list(given.numbers)


def _digits(robot: Robot, joints: Sequence[int]) -> list[int]:
    """Last number in each joint name, 0 if there is none."""
    found = (re.findall(r"\d+", robot.joints[j]) for j in joints)
    return [int(numbers[-1]) if numbers else 0 for numbers in found]


def _parents(robot: Robot) -> list[list[int]]:
    """Ancestors of each joint, nearest last."""
    place = {robot.model.getJointId(name): j for j, name in enumerate(robot.joints)}
    out = []
    for name in robot.joints:
        above = list(robot.model.supports[robot.model.getJointId(name)])[:-1]
        out.append([place[k] for k in above if k in place])
    return out


def _kind(robot: Robot, parents: Sequence[Sequence[int]], joint: int) -> str:
    """Kind of a joint: wheel, finger, slide or arm joint."""
    name = robot.joints[joint]
    alone = not parents[joint] and not any(joint in above for above in parents)
    if WHEEL.search(name) or (alone and not np.isfinite(robot.lower[joint]) and not robot.prismatic[joint]):
        return "wheel"
    if FINGER.search(name):
        return "finger"
    return "slide" if robot.prismatic[joint] else ARM


def _is_chain(joints: Sequence[int], parents: Sequence[Sequence[int]]) -> bool:
    """Whether the joints form a serial chain."""
    order = sorted(joints, key=lambda j: len(parents[j]))
    return all(set(order[:k]) <= set(parents[j]) for k, j in enumerate(order))


def _chains(robot: Robot, parents: Sequence[Sequence[int]], count: int) -> Iterator[tuple[int, ...]]:
    """Serial chains of `count` arm joints that are consecutive in the description."""
    for start in range(len(robot.joints) - count + 1):
        run = tuple(range(start, start + count))
        if _is_chain(run, parents) and all(_kind(robot, parents, j) == ARM for j in run):
            yield run


def _sentence(source: str, robot: Robot, given: _Numbered, rival: Sequence[int]) -> str:
    first, last = given.numbers[0], given.numbers[-1]
    lines = [f'{robot.joints[j]} = "{k}"' for j, k in zip(rival, given.numbers, strict=True)]
    whole = f"joints = {{ {', '.join(lines)} }}"
    meant = whole if len(whole) <= LONG else f"below [joints] {lines[0]}, {lines[1]} to {lines[-1]}, a line each"
    return (
        f"{source}: in the order of the description, columns {first} to {last} belong to "
        f"{shorten([robot.joints[j] for j in given.joints], 3)}, but {robot.joints[rival[0]]} to "
        f"{robot.joints[rival[-1]]} may be meant; state the joints in a column map (--columns): {meant}"
    )
