"""Robot arms with known drives for MuJoCo recordings: true base parameters and signid robots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from signid.regression.session import Session
from signid.robot import load_robot
from signid.types import Array, BaseMap, Law, Robot

from .plants.bodies import Drives
from .record_3r import CENTRE, DRIVES, JOINTS, RATE


@dataclass(frozen=True)
class Arm:
    """Robot, drives and centre of motion."""

    robot: str
    joints: int  # number of leading joints used; the others are held at zero
    rate: float  # recording rate [Hz]
    centre: tuple[float, ...]  # centre of the motion [rad]
    drives: Drives


ARMS = (
    Arm("3r", JOINTS, RATE, CENTRE, DRIVES),
    Arm(
        *("panda", 7, 250.0, (0.0, -0.3, 0.0, -1.8, 0.0, 1.8, 0.5)),
        Drives(
            (0.6, 0.6, 0.45, 0.6, 0.2, 0.2, 0.1),
            (0.8, 1.0, 0.6, 1.2, 0.5, 0.3, 0.3),
            (0.5, 0.8, 0.6, 1.2, 0.8, 0.3, 0.5),
            (-0.1, 0.3, 0.1, -0.2, 0.1, 0.05, -0.05),
        ),
    ),
    Arm(
        *("ur10", 6, 125.0, (0.0, -1.2, 1.2, -0.5, 0.5, 0.0)),
        Drives(
            (3.0, 3.0, 1.5, 0.4, 0.4, 0.4),
            (15.0, 14.0, 8.0, 2.5, 2.0, 2.0),
            (8.0, 8.0, 4.0, 2.0, 2.0, 1.8),
            (0.2, -0.7, 0.2, 0.05, 0.0, 0.04),
        ),
    ),
)


def load(arm: Arm) -> Robot:
    """Load the robot in signid with surplus joints held."""
    return load_robot(arm.robot, joints=[str(j + 1) for j in range(arm.joints)])


def truth(arm: Arm, session: Session) -> Array:
    """True base parameters (b,) [units of base] from the URDF's inertials and the plant's drives."""
    task = session.task
    return base_parameters(task.robot, task.base, task.laws, arm.drives)


def base_parameters(robot: Robot, base: BaseMap, laws: Sequence[Law], drives: Drives) -> Array:
    """Base parameters (b,) [units of base] of a robot with exact description and drives (n,).

    Args:
        robot: robot with the inertials of its description.
        base: base map of the robot with the laws.
        laws: single-joint laws, each linear in one drive parameter.
        drives: drive parameters of all joints.
    """
    bodies = [robot.model.inertias[i + 1].toDynamicParameters() for i in range(len(robot.links))]
    numbers = [float(getattr(drives, law.effect.name)[law.joints[0]]) for law in laws]
    return np.asarray(base.combination @ np.concatenate([*bodies, numbers]))
