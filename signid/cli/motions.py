"""What simulated robots are, what moves them, and where their recordings go: from arguments to the library."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from ..errors import OptionError
from .arguments import given_inputs, given_recording, given_robot

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from ..model import Model
    from ..simulate import Torques
    from ..simulate.control import Tracking
    from ..types import Array, Input, Robot, Trajectory

DURATION = 20.0  # [s] of motions at random


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


class Loop(NamedTuple):
    """The controller, as it was asked for."""

    bandwidth: float | None
    kp: str | None
    kd: str | None
    feed_forward: float | None


def given_model(
    source: Source, motion: str | None = None, torque: str | None = None
) -> tuple[Model, Trajectory | Torques | None]:
    """The model, its joints held that the motion or the recording does not have, and what these files hold.

    Raises:
        OptionError: what was given contradicts itself.
    """
    from ..model import Model, load_model, stated_inertials, stated_laws
    from ..robot import hold, resting
    from ..simulate import read_motion, recorded_torques

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


def given_drive(
    known: Model, asked: Trajectory | Torques | None, loop: Loop, duration: float | None, step: float, seed: int
) -> tuple[Tracking | Torques, float]:
    """What moves the robot, and for how long [s].

    Raises:
        OptionError: what was given contradicts itself.
    """
    from ..excite.draw import draw_motion
    from ..simulate import Torques, track
    from ..simulate.run import instants

    if isinstance(asked, Torques):
        if any(option is not None for option in loop):
            raise OptionError("--torque is played back open loop; leave --bandwidth, --kp, --kd, --feed-forward out")
        return asked, float(asked.t[-1]) if duration is None else duration
    if asked is None:
        t = instants(DURATION if duration is None else duration, step)
        asked = draw_motion(known.robot, len(t) * step, step, seed)
    gains = None
    if loop.kp is not None or loop.kd is not None:
        if loop.kp is None or loop.kd is None or loop.bandwidth is not None:
            raise OptionError("--kp and --kd go together and leave no room for --bandwidth; give both or neither")
        gains = (given_numbers("--kp", loop.kp, known.robot), given_numbers("--kd", loop.kd, known.robot))
    options = {"bandwidth": loop.bandwidth, "feed_forward": loop.feed_forward}
    given = {key: value for key, value in options.items() if value is not None}
    if not all(abs(value) < float("inf") for value in given.values()):
        raise OptionError("--bandwidth and --feed-forward are finite numbers; give the bandwidth in Hz and a share")
    return track(known, asked, gains=gains, **given), float(asked.t[-1]) if duration is None else duration


def given_numbers(option: str, text: str, robot: Robot) -> Array:
    """A number for all joints, or one for each: (n,) or ().

    Raises:
        OptionError: it is neither.
    """
    import numpy as np

    n = len(robot.joints)
    try:
        values = np.array([float(part) for part in text.split(",")])
    except ValueError:
        values = np.empty(0)
    if len(values) not in (1, n) or not np.isfinite(values).all():
        raise OptionError(f"{option} {text!r} is neither a number nor one for each of the {n} joints, with commas")
    return values[0] if len(values) == 1 else values


def check_output(output: str | None, json: bool) -> None:
    """Find out at once whether the recording can be written.

    Raises:
        OptionError: no file was named, or files of its kind are only read.
        RecordingError: its name is of no known format.
        OutputError: its folder cannot be written to.
    """
    from ..formats.find import find_format
    from ..report import probe_folder

    if output == "" or (output is None and not json):
        raise OptionError("no file for the result was named; add -o FILE, or --json to print what is told of it")
    if output is not None:
        form = find_format(Path(output))
        if not form.writes:
            form.encode({}, output)
        probe_folder(Path(output).parent)


def write_columns(output: str | None, columns: Mapping[str, Array]) -> Sequence[Path]:
    """The file, if one was named; it appears when it is complete.

    Args:
        output: its name.
        columns: (N,) each, by name [units of the columns of these names].
    """
    from ..formats.find import find_format
    from ..report import write_files

    if output is None:
        return []
    path = Path(output)
    return write_files(path.parent, {path.name: find_format(path).encode(columns, path.name)})
