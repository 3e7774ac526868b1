"""What simulated robots are, and what they are to follow: from arguments to the library."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import OptionError
from .arguments import given_inputs, given_recording, given_robot

if TYPE_CHECKING:
    from ..model import Model
    from ..simulation.plant import Torques
    from ..types import Input, Robot, Trajectory


class Source(NamedTuple):
    """What is to be simulated, as it was asked for."""

    name: str  # a robot or a model.json
    joints: str | None = None
    lock: list[str] | None = None
    actuators: str | None = None
    packages: list[str] | None = None

    @property
    def saved(self) -> bool:
        """Whether it is a model.json, which states all of this itself."""
        return self.name.endswith(".json")

    def inputs(self, robot: Robot, **files: str | None) -> list[Input]:
        """Everything that was read, by what it holds."""
        from ..recording.source import digest_of
        from ..types import Input

        if not self.saved:
            return given_inputs(self.name, robot, self.actuators, **files)
        read = {"model": self.name, **{role: file for role, file in files.items() if file is not None}}
        return [Input(path, digest_of(Path(path)), role) for role, path in read.items()]


def given_model(
    source: Source, motion: str | None = None, torque: str | None = None
) -> tuple[Model, Trajectory | Torques | None]:
    """The model, its joints held that the motion or the recording does not have, and what these files hold.

    Raises:
        OptionError: what was given contradicts itself.
    """
    from ..model import Model, load_model, stated_inertials, stated_laws
    from ..robot import hold, resting
    from ..simulation.plant import read_motion, recorded_torques

    if motion is not None and torque is not None:
        raise OptionError("--motion and --torque both say what moves the robot; give one of them")
    if source.saved and any((source.joints, source.lock, source.actuators, source.packages)):
        raise OptionError(f"{source.name} states its joints and drives itself; leave --joints, --lock, --actuators out")
    model = load_model(source.name) if source.saved else None
    robot = model.robot if model else given_robot(*source)
    asked: Trajectory | Torques | None = None
    moving = robot.joints
    if motion is not None:
        asked = read_motion(motion, robot)
        moving = asked.joints
    if torque is not None:
        recording = given_recording(torque, robot, None)
        asked, moving = recorded_torques(recording), recording.joints
    if model is None:
        robot = hold(robot, resting(robot, but=moving))
        model = Model(robot, stated_inertials(robot), stated_laws(robot))
    if moving != robot.joints:
        lacking = ", ".join(joint for joint in robot.joints if joint not in moving)
        raise OptionError(f"{motion or torque} has no position of {lacking}; {source.name} moves all of its joints")
    return model, asked
