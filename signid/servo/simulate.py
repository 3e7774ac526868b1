"""Models with position drives and commands -> simulated recordings: the closed loop from the commands alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..effects.base import BodyLaw
from ..effects.drive import DriveLaw
from ..effects.packing import with_law
from ..errors import OptionError, RecordingError, shorten
from ..model import Model, ModelSource, as_model, command_model, with_servos
from ..recording import as_recording
from ..recording.source import Source
from ..servos import JOINT_LAWS, PASSIVE_LAWS, SERVO_NUMBERS, Servo, ServoGrid
from ..simulation.plant import Sensors, record_held
from ..simulation.rollout import restrict_joints
from ..typed import typed
from ..types import Array, Law, Recording, Result, Robot, Trajectory
from .given import stated_servos
from .plant import grids_of_arrays, roll_out, saturated_share, servo_grid, servo_grids

STEP = 1e-3  # [s] of the simulation
MOST_SPEED = 1e4  # [rad/s or m/s] from which on a simulation has diverged


@dataclass(frozen=True, eq=False)
class ServoSimulation(Result):
    """Closed loops of a model, driven by commands: K instants of n joints, and the recording of it."""

    model: Model  # with `servos`, of the joints that move
    injected: tuple[str, ...]  # laws and numbers that were added, as given
    t: Array  # (K,) [s]
    q: Array  # (K, n) [rad or m] true positions
    v: Array  # (K, n) [rad/s or m/s]
    command: Array  # (K, n) [rad or m] in force at each instant
    columns: Mapping[str, Array]  # (N,) each, as recorded [units of their names]
    sensors: Sensors
    notes: tuple[str, ...]
    saturated: Array  # (n,) [1] share of time at which the limit cuts the torque of the drive

    @property
    def error_rms(self) -> Array:
        """Rms of command - position (n,) [rad or m]; NaN for joints without a drive."""
        driven = np.array([joint in self.model.servos for joint in self.model.robot.joints])
        return np.where(driven, np.sqrt(np.mean((self.command - self.q) ** 2, axis=0)), np.nan)


@typed
def simulate_servos(
    model: ModelSource,
    commands: Recording | Source | Trajectory,
    sensors: Sensors | None = None,
    *,
    inject: Sequence[Law] = (),
    numbers: Mapping[str, Mapping[str, float]] | None = None,
    injected: Sequence[str] = (),
    seed: int = 0,
) -> ServoSimulation:
    """Simulate drives that follow commands, and record the positions, the commands and whether the drives hold.

    Args:
        model: with `servos`, or with drives that its actuators file states.
        commands: a recording with q_des_J, or a motion, each of whose positions is held until the next.
        sensors: encoders and logger; without a rate, that of the commands.
        inject: laws of bodies, frictions, armature and offset, added to those of the model; laws of drives replace
            the numbers of the drives of the model.
        numbers: numbers of drives by joint, in place of those of the model.
        injected: description of both, kept in the result.
        seed: of sampling times, encoder zeros and losses.

    Raises:
        OptionError: no joint has a drive and a command, a law cannot be injected, or the simulation diverges.
        RecordingError: the recording cannot be used.
    """
    sensors, model = sensors or Sensors(), as_model(model, "simulate_servos")
    if not isinstance(commands, Trajectory):
        commands = as_recording(commands, model.robot, "simulate_servos")
    grid, model, notes = _grid(model, commands)
    servos = _injected(model.robot, dict(model.servos), inject, numbers or {})
    bodies = tuple(law for law in inject if isinstance(law.effect, BodyLaw) and law.effect.name not in PASSIVE_LAWS)
    model = with_servos(replace(model, laws=(*model.laws, *bodies)), servos, complete=True)
    with np.errstate(all="ignore"):
        q = roll_out(model, servos, grid)
        v = np.gradient(q, grid.step, axis=0)
    if not (np.abs(v) < MOST_SPEED).all():
        wrong = [joint for joint, x in zip(grid.joints, v.T, strict=True) if not (np.abs(x) < MOST_SPEED).all()]
        raise OptionError(f"the closed loop diverges at {shorten(wrong)}; check kp, kd, delay and inertias")
    rows = commands.t if isinstance(commands, Trajectory) else commands.read().t
    steps = max(1, round(float(np.median(np.diff(rows))) / STEP))  # of a row
    sensors = replace(sensors, rate=sensors.rate or 1 / (STEP * steps))
    at = {joint: j for j, joint in enumerate(grid.joints) if joint in servos}
    kinds = {"q_des": grid.command, "dq_des": grid.command_speed, "tau_ff": grid.feed_forward, "on": grid.on}
    held = {kind: {joint: x[:, j] for joint, j in at.items()} for kind, x in kinds.items() if x is not None}
    prismatic = model.robot.prismatic
    columns = record_held(prismatic, grid.joints, grid.step, q, v, held=held, sensors=sensors, seed=seed)
    t = np.asarray(np.arange(len(grid)) * grid.step)
    saturated = saturated_share(servos, replace(grid, q=q), v)
    return ServoSimulation(model, tuple(injected), t, q, v, grid.command, columns, sensors, tuple(notes), saturated)


def _grid(model: Model, commands: Recording | Trajectory) -> tuple[ServoGrid, Model, list[str]]:
    """Commands in steps of the simulation, the model of their joints with its drives, and notes."""
    servos = {**stated_servos(model.robot), **model.servos}
    if isinstance(commands, Trajectory):
        x = commands
        grid = grids_of_arrays(x.joints, x.t, x.q, x.q, command_speed=x.v, rate=1 / STEP)[0]
        restricted, notes = model, []
        given = "the motion"
    else:
        given = commands.path or "the recording"
        if not any(commands.columns["q_des"]):
            raise RecordingError(f"{given} has no commanded position; add columns q_des_J, or give it as --motion")
        restricted, remarks = restrict_joints(model, [commands])
        robot = replace(restricted.robot, servo=registered(restricted.robot, servos))
        grid, notes = servo_grid(commands, robot, rate=1 / STEP), list(remarks)
        if len(servo_grids(commands, robot)) > 1:
            notes.append("only the longest stretch without gaps is simulated")
    kept = {j: s for j, s in servos.items() if j in grid.joints and grid.driven[grid.joints.index(j)]}
    if not kept:
        raise OptionError(
            f"{model.robot.name} has no drive of a joint that {given} commands; identify it with signid identify, or "
            f"state kp below [joint.{grid.joints[0]}.servo] in actuators.toml"
        )
    if free := [joint for joint in grid.joints if joint not in kept]:
        notes.append(f"{shorten(free)} without a drive follow the given motion")
    driven, left = command_model(restricted, kept)
    return grid, driven, [*notes, *left]


def registered(robot: Robot, servos: Mapping[str, Servo]) -> dict[str, Mapping[str, float | str]]:
    """Stated numbers of the drives of a robot, with the registers that the kp of other drives belong to."""
    stated: dict[str, Mapping[str, float | str]] = {joint: dict(robot.servo.get(joint, {})) for joint in robot.joints}
    for joint, servo in servos.items():
        if servo.kp_register is not None and joint in stated:
            stated[joint] = {**stated[joint], "kp_register": servo.kp_register}
    return stated


def _injected(
    robot: Robot, servos: dict[str, Servo], laws: Sequence[Law], numbers: Mapping[str, Mapping[str, float]]
) -> dict[str, Servo]:
    """Drives with the laws added to their numbers, and with other numbers."""
    for law in laws:
        name = law.effect.name
        if name not in (*PASSIVE_LAWS, *JOINT_LAWS) and not isinstance(law.effect, DriveLaw):
            if isinstance(law.effect, BodyLaw):
                continue
            own = "; the friction of a drive by its motor torque is servo@JOINT:load_friction=0.1" * ("load_" in name)
            known = ", ".join((*PASSIVE_LAWS, *JOINT_LAWS))
            raise OptionError(f"--servo cannot inject {name}; choose laws of bodies or drives, or {known}{own}")
        for j in law.joints:
            if (joint := robot.joints[j]) not in servos:
                raise OptionError(f"--inject {name} is at {joint}, which has no drive; name a joint with a drive")
            servos[joint] = with_law(servos[joint], law)
    for joint, given in numbers.items():
        if joint not in servos:
            raise OptionError(f"--inject servo@{joint}: {joint} has no drive; choose from {', '.join(servos)}")
        if unknown := sorted(set(given) - set(SERVO_NUMBERS)):
            raise OptionError(f"a drive has no number {unknown[0]!r}; choose from {', '.join(SERVO_NUMBERS)}")
        servos[joint] = servos[joint].with_(**given)
    return servos
