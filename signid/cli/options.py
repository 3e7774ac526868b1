"""Options that several commands share."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Annotated

import typer

from ..effects import EFFECT_NAMES
from .app import Text, Texts, complete_known, complete_law, complete_number, complete_robot, option

SimulationName = Annotated[
    str,
    typer.Argument(
        metavar="SIMULATION",
        help="A model.json, a URDF, xacro or MJCF file, or a name such as panda.",
        autocompletion=complete_robot,
    ),
]
RobotName = Annotated[
    str,
    typer.Argument(
        metavar="ROBOT", help="A URDF, xacro or MJCF file, or a name such as panda.", autocompletion=complete_robot
    ),
]
RECORDING_ARGUMENT = typer.Argument(metavar="RECORDING", help="CSV, Parquet, NPZ, ROS bag or LeRobot dataset.")
RecordingName = Annotated[str, RECORDING_ARGUMENT]
Recordings = Annotated[list[str], RECORDING_ARGUMENT]
OptionalRecordings = Annotated[Texts, RECORDING_ARGUMENT]
Columns = Annotated[Text, typer.Option(metavar="FILE", help='TOML of other column names: q_elbow = "elbow_pos".')]
Rate = Annotated[
    float | None,
    typer.Option(
        metavar="HZ", help="Rate of rows without times [Hz]; 0: postures at rest. Default: their column of time."
    ),
]
Effects = Annotated[
    Text,
    typer.Option(
        metavar="A,B",
        help=f"Laws at every joint, or none. Default: {', '.join(EFFECT_NAMES)}.",
        autocompletion=complete_law,
    ),
]
Cutoff = Annotated[
    float | None,
    typer.Option(metavar="HZ", help="Filter cut-off [Hz]; inf disables filtering. Default: from the data."),
]
PackageDir = Annotated[
    Texts, typer.Option(metavar="DIR", help="Folder with packages of meshes and xacro files. Repeatable.")
]
Xacro = Annotated[
    Texts,
    typer.Option(
        "--xacro",
        metavar="NAME:=VALUE",
        help="Argument of a xacro file; also as a word of its own after the file. Default: that of the file. "
        "Repeatable.",
    ),
]
Gravity = Annotated[
    Text,
    typer.Option(
        metavar="X,Y,Z",
        help="Gravity [m/s2] in the frame of the root link; 0,0,0: the torque carries no weight. Default: 0,0,-9.81.",
    ),
]
Unsigned = Annotated[bool, typer.Option("--unsigned", help="Discard the signs of the torques.")]
TimeLimit = Annotated[
    float, typer.Option(metavar="S", help="Time limit for searches [s]; truncated results are flagged.")
]
Rrd = Annotated[Text, typer.Option("--rrd", metavar="FILE", help="Log for Rerun (extra viewers). Default: none.")]
Mcap = Annotated[
    Text,
    typer.Option(
        "--mcap", metavar="FILE", help="Log for Foxglove, RViz and PlotJuggler (extra viewers). Default: none."
    ),
]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON and nothing else.")]


@dataclass(frozen=True, kw_only=True)
class RobotOptions:
    """How a robot description is read."""

    joints: Text = option(None, "Joints that move; others are held. Default: all.", metavar="A,B")
    lock: Texts = option(None, "Hold joint J at this position [rad or m]. Repeatable.", metavar="J=VALUE")
    actuators: Text = option(None, "TOML of the actuators. Default: actuators.toml.", metavar="FILE")
    package_dir: PackageDir = None
    gravity: Gravity = None
    xacro: Xacro = None


@dataclass(frozen=True, kw_only=True)
class SimulationArguments(RobotOptions):
    """A simulation: a robot description or a saved model."""

    simulation: SimulationName

    @property
    def saved(self) -> bool:
        """Whether it is a saved or published model, which states joints and actuators itself."""
        from ..robot import saved_model

        described = any((self.joints, self.lock, self.actuators, self.xacro)) and not self.simulation.endswith(".json")
        return not described and saved_model(self.simulation) is not None


@dataclass(frozen=True, kw_only=True)
class RobotArguments(RobotOptions):
    """A robot description."""

    robot: RobotName

    @property
    def simulation(self) -> SimulationArguments:
        """The simulation that the description states."""
        shared = {item.name: getattr(self, item.name) for item in fields(RobotOptions)}
        return SimulationArguments(simulation=self.robot, **shared)


@dataclass(frozen=True, kw_only=True)
class RowOptions:
    """How recordings are read and turned into regression rows."""

    columns: Columns = None
    rate: Rate = None
    effects: Effects = None
    cutoff: Cutoff = None
    derivatives: str = option(
        "auto", "Source of velocity and acceleration: computed (from q_J), recorded, or auto.", metavar="WHICH"
    )
    no_instruments: bool = option(False, "Do not use q_des_J columns as instruments.", "--no-instruments")
    white: bool = option(False, "Assume white torque noise instead of coloured noise.", "--white")


@dataclass(frozen=True, kw_only=True)
class DriveOptions:
    """Position drives: joints with commanded positions and without torque."""

    servo: bool = option(False, "Identify position drives even if torque is recorded.", "--servo")
    known: Texts = option(
        None,
        "Servo mode: scale of torque, masses, nothing or kp=20 [N.m/rad]; default: stated kp, else masses. Or a number "
        "that is not fitted: NAME=VALUE, or NAME@PATTERN=VALUE at joints that a pattern matches. Repeatable.",
        metavar="WHAT",
        autocompletion=complete_known,
    )
    prior: Texts = option(
        None,
        "Prior of a number of a drive: NAME=MEAN+-STD or NAME@PATTERN=MEAN+-STD. Repeatable.",
        metavar="PRIOR",
        autocompletion=complete_number,
    )
    equal: Texts = option(
        None,
        "Regular expression of joints with equal drives, fitted as one: '.*_hip_joint'. Repeatable.",
        metavar="PATTERN",
    )
    law: Texts = option(
        None,
        "Law of the drives, or J=LAW: effort, duty or torque_speed. Default: by evidence. Repeatable.",
        metavar="LAW",
    )
    compare_models: bool = option(
        False, "Compare friction models (M1 to M6 of BAM, PACE) by held-out error and evidence.", "--compare-models"
    )


@dataclass(frozen=True, kw_only=True)
class RunOptions:
    """Options of every command that computes."""

    seed: int = option(0, "Seed of the random generator.", metavar="N", min=0)
    json: Json = False
