"""The part of a robot that a demonstration moves."""

from __future__ import annotations

from ...robot import hold, resting
from ...robot.dynamics import carrier, own_row
from ...types import Robot


def take_arm(robot: Robot) -> Robot:
    """The robot with all joints held but those of its longest limb, whose fingers are held as well.

    Fingers are what comes after the last branching of the limb, where that is the shorter part of it.
    """
    at = {carrier(robot.model, own_row(robot, j)): joint for j, joint in enumerate(robot.joints)}
    limb = max((_way(robot, i, at) for i in at), key=len)
    forks = [k for k, i in enumerate(limb, 1) if len(robot.model.children[i]) > 1]
    if forks and 2 * forks[-1] > len(limb):
        limb = limb[: forks[-1]]
    return hold(robot, resting(robot, but=[at[i] for i in limb]))


def _way(robot: Robot, last: int, at: dict[int, str]) -> list[int]:
    """The joints of the model from the base to the last one, those that move by themselves."""
    way = [last]
    while way[0]:
        way.insert(0, int(robot.model.parents[way[0]]))
    return [i for i in way if i in at]
