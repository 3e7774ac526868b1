"""Columns that name joints by number -> whether they may count other joints than those of the description's order."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import RecordingError, shorten
from ..types import Robot

WHEEL = re.compile(r"wheel|caster|castor|rotor|propeller", re.IGNORECASE)
FINGER = re.compile(r"finger|thumb|gripper|jaw|hand", re.IGNORECASE)
LONG = 150  # characters of a map within a sentence
ARM = "arm joint"  # a joint that turns, and is no wheel and no finger


class _Numbered(NamedTuple):
    """Joints that columns name by their numbers in the description, in the order of these numbers."""

    joints: tuple[int, ...]
    numbers: tuple[int, ...]


def doubt_numbers(source: str, robot: Robot, joints: Sequence[int]) -> tuple[str, ...]:
    """A sentence for a flag where numbers of columns may count other joints than those of the description's order.

    Numbers are not doubted where every joint that moves has one, where the joints' own names have them, or where no
    other chain of joints of one kind has as many.

    Args:
        source: name of the recording.
        robot: gives the joints.
        joints: columns of the robot's joints whose position is named by a number.

    Raises:
        RecordingError: the numbers are those of wheels, fingers or joints of several kinds, and an arm has as many.
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
    """Whether the names of the joints have the numbers, such as 3 of panda_joint3."""
    return _digits(robot, given.joints) == list(given.numbers)


def _digits(robot: Robot, joints: Sequence[int]) -> list[int]:
    """The last number in each joint's name, 0 where there is none."""
    found = (re.findall(r"\d+", robot.joints[j]) for j in joints)
    return [int(numbers[-1]) if numbers else 0 for numbers in found]


def _parents(robot: Robot) -> list[list[int]]:
    """Per joint, those that move it, the nearest last."""
    place = {robot.model.getJointId(name): j for j, name in enumerate(robot.joints)}
    out = []
    for name in robot.joints:
        above = list(robot.model.supports[robot.model.getJointId(name)])[:-1]
        out.append([place[k] for k in above if k in place])
    return out


def _kind(robot: Robot, parents: Sequence[Sequence[int]], joint: int) -> str:
    """A wheel, a finger, a slide or an arm joint."""
    name = robot.joints[joint]
    alone = not parents[joint] and not any(joint in above for above in parents)
    if WHEEL.search(name) or (alone and not np.isfinite(robot.lower[joint]) and not robot.prismatic[joint]):
        return "wheel"
    if FINGER.search(name):
        return "finger"
    return "slide" if robot.prismatic[joint] else ARM


def _is_chain(joints: Sequence[int], parents: Sequence[Sequence[int]]) -> bool:
    """Whether each joint moves all others that come after it, in one direction or the other."""
    order = sorted(joints, key=lambda j: len(parents[j]))
    return all(set(order[:k]) <= set(parents[j]) for k, j in enumerate(order))


def _chains(robot: Robot, parents: Sequence[Sequence[int]], count: int) -> Iterator[tuple[int, ...]]:
    """So many arm joints that follow one another in the description and in the robot."""
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
        f"{source}: by the description's order columns {first} to {last} are of "
        f"{shorten([robot.joints[j] for j in given.joints], 3)}, but {robot.joints[rival[0]]} to "
        f"{robot.joints[rival[-1]]} may be meant; say which in a column map (--columns): {meant}"
    )
