"""A model in one of the formats that it can be exported to."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from ...errors import OptionError
from ...model import Model
from .actuators import write_actuators
from .beyond import Exported as Exported
from .function import write_function
from .mjcf import write_mjcf
from .ros import write_isaaclab, write_ros
from .urdf import write_urdf

_WRITERS: dict[str, Callable[[Model], Exported]] = {
    "urdf": write_urdf,
    "actuators": write_actuators,
    "function": write_function,
    "ros": write_ros,
    "isaaclab": write_isaaclab,
}
KINDS = ("urdf", "mjcf", "actuators", "function", "ros", "isaaclab")


def export(model: Model, kind: str, package_dirs: Sequence[str | Path] = ()) -> Exported:
    """The text of a file that holds what its format can say of a model, and what it cannot say.

    Args:
        model: rigid bodies and laws.
        kind: "urdf" (the robot's own, with inertials, damping and friction), "mjcf" (for MuJoCo), "actuators" (the
            TOML file beside a description), "function" (the laws as Python that needs numpy alone), "ros" (parameters
            of a ROS 2 node) or "isaaclab" (an actuator group).
        package_dirs: folders in which an MJCF's meshes are looked for, beside those of example-robot-data.

    Raises:
        OptionError: there is no such kind.
        RobotError: the model has bodies that the format cannot hold, or no URDF to start from.
    """
    if kind == "mjcf":
        return write_mjcf(model, package_dirs)
    if kind not in _WRITERS:
        raise OptionError(f"there is no export to {kind!r}; choose from {', '.join(KINDS)}")
    return _WRITERS[kind](model)
