"""Exported position drives beside signid's closed loop and the recording, rolled out without signid.

MuJoCo rolls out the exported MJCF, and the drives that the files of Isaac Lab and mjlab state, from the first row of
recordings of simulated robots with known drives (also at their limits), and of the real Go2 (needs SIGNID_DATA).
"""

from __future__ import annotations

import re
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import mujoco
import numpy as np
import polars as pl
from rich.console import Console

from signid.model import Model, load_model, with_servos
from signid.output.export import STARTED_KINDS, export, with_known_numbers
from signid.output.export.loop import loop_of
from signid.recording import Recordings, read_recording
from signid.robot import load_robot
from signid.servo.identify import identify_servos
from signid.servo.plant import roll_out
from signid.servo.plant.grid import command_speed
from signid.servos import Servo
from signid.types import Array

from .servo.drive import Drive, Truth
from .servo.identified import RATE, SECONDS, STEP, drawn, saturated
from .servo.plant import record
from .servo.robots import Bench, benches, data_folder, motion
from .summary import command_line, frame, one_thread, print_targets, write_json

CLOSE, BESIDE = 1.0, 1.0  # [mrad] targets: MJCF from signid, other simulators beyond the rounding of delays
STEPS = (0.005, 0.001)  # [s] of the physics in Isaac Lab and mjlab
KNOWN = "kp=20"  # of the Go2, as commanded [N.m/rad]
WIDTH = 150  # of the table
FIRST = 0.2  # [s] of a roll-out that are judged apart
IMPLICIT = "BuiltinPositionActuatorCfg"  # class whose gains are those of an actuator of MuJoCo
HEAVY = 1e6  # armature of a joint that follows the recording [kg.m2 or kg]
HARD = {"solref_friction": [0.0002, 1], "solimp_friction": [0.9999, 0.9999, 0.001, 0.5, 2]}
DELAYS = {"min_delay": "least", "delay_min_lag": "least", "max_delay": "most", "delay_max_lag": "most"}  # [steps]


@dataclass(frozen=True)
class Row:
    """Errors of all joints together of one roll-out [mrad]."""

    robot: str
    limits: str  # law at whose limit the drives are, or none
    file: str
    first_signid: float  # over the first 0.2 s
    first_recording: float
    whole_signid: float
    whole_recording: float
    rounding: float  # what whole steps of delay cost


def main() -> int:
    """Print the errors; return 1 if a target is missed."""
    parser = command_line("export_loop", __doc__)
    parser.add_argument("--robots", nargs="+", default=["pendulum", "go2_leg", "so101", "go2"])
    parser.add_argument("--seed", type=int, default=1)
    given, console = parser.parse_args(), Console(width=WIDTH)
    with tempfile.TemporaryDirectory() as place:
        rows = [row for case in cases(Path(place), given.robots, given.seed) for row in rolled(case, Path(place))]
    names = ("robot", "at limits", "export", ".2 s: signid", "recording", "whole: signid", "recording", "rounding")
    table = frame("rms position error of all joints [mrad]; rounding: of delays", names)
    for row in rows:
        robot, limits, file, *numbers = asdict(row).values()
        table.add_row(robot, limits, file, *(f"{x:.2f}" for x in numbers))
    console.print(table)
    write_json(given.json, {"rows": [asdict(row) for row in rows]})
    inside = [max(row.first_signid, row.whole_signid) for row in rows if row.file == "mjcf"]
    free = [row for row in rows if row.file != "mjcf" and row.limits == "none"]
    beyond = [row.whole_signid - row.rounding for row in free]
    targets = [
        (f"MJCF from signid: at most {max(inside):.2f} mrad (target {CLOSE:g})", max(inside) <= CLOSE),
        (f"others without limits, beyond the rounding: at most {max(beyond, default=0):.2f} mrad (target {BESIDE:g})",
         max(beyond, default=0) <= BESIDE),
    ]  # fmt: skip
    return 0 if print_targets(console, targets) else 1


class Case(NamedTuple):
    """A robot with its drives, and a recording of it."""

    robot: str
    limits: str
    model: Model
    recording: Path


def cases(folder: Path, names: Sequence[str], seed: int) -> Iterator[Case]:
    """Simulated robots with random drives, free and at the limits of each law, and the real Go2."""
    for bench in benches(folder, tuple(names)):
        rng = np.random.default_rng([seed, 3])
        drives = {joint: drawn(drive, rng) for joint, drive in bench.drives.items()}
        command = motion(bench, seed, SECONDS, RATE, fast=3.0)
        yield recorded(bench, drives, seed)
        for law in ("effort", "duty", "torque_speed"):
            limited = saturated(bench, drives, command, seed, law, rng)
            yield recorded(bench, limited, seed, law)
    data = data_folder()
    if "go2" in names and data:
        recording = data / "go2_dls" / "held_base_first.csv.gz"
        found = identify_servos(load_robot(data / "go2_dls" / "go2.urdf"), [recording], known=KNOWN)
        yield Case("go2, real", "one calf", found.model, recording)


def recorded(bench: Bench, drives: dict[str, Drive], seed: int, limits: str = "none") -> Case:
    """Record a robot in MuJoCo; its model has the true numbers of the drives."""
    path = bench.urdf.with_name(f"{bench.name}_{limits}.csv")
    columns = record(bench.urdf, Truth(drives), motion(bench, seed, SECONDS, RATE, fast=3.0), RATE, seed, step=STEP)
    pl.DataFrame(columns).write_csv(path)
    numbers = {joint: {k: x for k, x in asdict(drive).items() if k != "backlash"} for joint, drive in drives.items()}
    servos = {joint: Servo(**{**x, "delay": x["delay"] - STEP / 2}) for joint, x in numbers.items()}
    return Case(bench.name, limits, with_servos(load_model(bench.urdf), servos), path)


def rolled(case: Case, folder: Path) -> Iterator[Row]:
    """Roll-outs of all exports of a model."""
    model, read = case.model, read_recording(case.recording, case.model.robot)
    texts = {kind: export(model, kind, start=read).text for kind in STARTED_KINDS}
    (folder / "arm.xml").write_text(texts["mjcf"], encoding="utf-8")
    table = table_of(with_known_numbers(model, gain=True)[0], read)
    yield Row(case.robot, case.limits, "mjcf", *errors(of_mjcf(folder / "arm.xml", table), table))
    for kind in STARTED_KINDS[1:]:
        for step in STEPS:
            each = [errors(run, table) for run in configured(folder / "arm.xml", executed(texts[kind], step), table)]
            best = min(each, key=lambda numbers: numbers[-1])  # of delays rounded down and up
            yield Row(case.robot, case.limits, f"{kind}, {1e3 * step:g} ms", *best)


class Table(NamedTuple):
    """A recording of n joints with N rows, D joints with a drive."""

    t: Array  # (N,) [s] from 0
    joints: Sequence[str]  # n
    recorded: Array  # (N, n) [rad or m]
    signid: Array  # (N, n) roll-out of signid
    driven: list[str]  # D
    delay: list[float]  # D [s]
    command: Array  # (N, D) held until the next row
    speed: Array  # (N, D) of the command [rad/s or m/s]; 0 where no drive uses it


class Run(NamedTuple):
    """A roll-out."""

    q: Array  # (N, n) [rad or m]
    rounded: list[float]  # by driven joint: delay beyond that of the drive [s]


def table_of(model: Model, recording: Recordings) -> Table:
    """The recording, its commands and the roll-out of signid."""
    loop = loop_of(model, recording)
    grid, servos = loop.grid, loop.model.servos
    at = [j for j, joint in enumerate(grid.joints) if joint in servos]
    speed = np.zeros((len(grid), len(at)))
    for k, j in enumerate(at):
        if (servo := servos[grid.joints[j]]).kd_on == "error" and servo.kd > 0:
            speed[:, k] = command_speed(grid, j)
    rolled = roll_out(loop.model, servos, grid, start=(loop.q, loop.v))
    driven = [grid.joints[j] for j in at]
    delay = [servos[joint].delay for joint in driven]
    return Table(
        np.arange(len(grid)) * grid.step, grid.joints, grid.q, rolled, driven, delay, grid.command[:, at], speed
    )


def of_mjcf(path: Path, table: Table) -> Run:
    """Roll-out of the MJCF as it is written, from its keyframe."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data, inputs = mujoco.MjData(model), {}
    mujoco.mj_resetDataKeyframe(model, data, model.key("start").id)
    for k, place in enumerate(getattr(model, "actuator_ctrladr", range(model.nu))):
        inputs[mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, k)] = place
        count = int(model.actuator_history[k, 0])
        if place >= 0 and count:  # a keyframe does not hold the commands before it
            mujoco.mj_initCtrlHistory(model, data, k, None, np.full((count, 1), data.ctrl[place]))
    follow = Followers(model, data, table)
    at = np.round(table.t / model.opt.timestep).astype(int)
    q = np.empty_like(table.recorded)
    for row, steps in enumerate(np.diff(at, append=at[-1])):
        q[row] = data.qpos[follow.places]
        for joint, u, speed in zip(table.driven, table.command[row], table.speed[row], strict=True):
            data.ctrl[inputs[joint]] = u
            if f"{joint}_speed" in inputs:
                data.ctrl[inputs[f"{joint}_speed"]] = speed
        follow.step(row, int(steps))
    return Run(q, [0.0] * len(table.driven))


class Followers:
    """Joints without a drive, which follow the recording or rest: heavy, and moved with the recorded acceleration."""

    def __init__(self, model: Any, data: Any, table: Table) -> None:
        self.model, self.data = model, data
        self.places = [int(model.joint(joint).qposadr[0]) for joint in table.joints]
        tied = model.eq_obj1id.tolist()  # mimic joints move with their leaders
        free = [k for k in range(model.njnt) if model.joint(k).name not in table.driven and k not in tied]
        self.rows, self.at = model.jnt_dofadr[free], model.jnt_qposadr[free]
        self.q = np.tile(data.qpos[self.at], (len(table.t), 1))
        for column, place in enumerate(self.at):
            if place in self.places:
                self.q[:, column] = table.recorded[:, self.places.index(place)]
        self.v = np.gradient(self.q, table.t, axis=0)
        model.dof_armature[self.rows] += HEAVY
        self.force = model.dof_armature[self.rows] * np.gradient(self.v, table.t, axis=0)

    def step(self, row: int, steps: int) -> None:
        """Simulate some steps from the row of the table."""
        self.data.qpos[self.at], self.data.qvel[self.rows] = self.q[row], self.v[row]
        self.data.qfrc_applied[self.rows] = self.force[row]
        if steps:
            mujoco.mj_step(self.model, self.data, steps)


def executed(text: str, step: float) -> dict[str, Any]:
    """Names of a file of Isaac Lab or mjlab at a time step; configurations as their class (`kind`) and arguments."""
    (line, classes), *_ = re.findall(r"^(from (?:isaaclab|mjlab)\S* import (.*))$", text, re.MULTILINE)
    found: dict[str, Any] = {kind: partial(dict, kind=kind) for kind in classes.split(", ")}
    exec(text.replace(line, "").replace("PHYSICS_STEP = 0.005", f"PHYSICS_STEP = {step}"), found)
    return found


def configured(mjcf: Path, written: Mapping[str, Any], table: Table) -> Iterator[Run]:
    """Roll-outs of the drives in a file of Isaac Lab or mjlab, with delays rounded down and up."""
    step, start = written["PHYSICS_STEP"], written["START"]
    spec = mujoco.MjSpec.from_file(str(mjcf))
    for item in (*spec.actuators, *spec.keys):
        spec.delete(item)
    spec.option.timestep = step
    drives = {joint.name: drive_of(joint.name, written["ACTUATORS"]) for joint in spec.joints}
    for name in (*table.driven, *(drives.keys() - set(table.driven))):  # actuators in the order of the commands
        prepare(spec, spec.joint(name), drives[name])
    model = spec.compile()
    lags = [[drives[joint].get(key, 0) for joint in table.driven] for key in ("least", "most")]
    late = [
        delay / step + 0.5 if "least" in drives[joint] else 0.0
        for joint, delay in zip(table.driven, table.delay, strict=True)
    ]
    shift = np.array([written.get("TARGET_OFFSETS", {}).get(joint, 0.0) for joint in table.driven])
    table = table._replace(command=table.command + shift)
    held = shift + [written["HELD"][joint] for joint in table.driven]
    for steps in lags if lags[0] != lags[1] else lags[:1]:
        data = mujoco.MjData(model)
        for name, at in start["joint_pos"].items():
            joint = model.joint(re.sub(r"\\(.)", r"\1", name))  # the name of a pattern that matches it alone
            data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = at, start["joint_vel"][name]
        q = stepped(model, data, table, [drives[j] for j in table.driven], (steps, held))
        yield Run(q, [step * (lag - exact) for lag, exact in zip(steps, late, strict=True)])


def stepped(model: Any, data: Any, table: Table, drives: list[Any], commands: tuple[list[int], Array]) -> Array:
    """Positions (N, n) with the torque of the drives at each step of the physics; commands: steps late, held before."""
    h, (lags, held), follow = model.opt.timestep, commands, Followers(model, data, table)
    t = table.t
    count, every = int(np.ceil(t[-1] / h - 1e-6)) + 1, np.arange(len(drives))
    row = np.searchsorted(t, np.arange(count) * h + 1e-9, side="right") - 1
    at = np.array([model.joint(joint).qposadr[0] for joint in table.driven])
    rows = np.array([model.joint(joint).dofadr[0] for joint in table.driven])
    inner = [k for k, drive in enumerate(drives) if drive["kind"] == IMPLICIT]
    outer = [k for k in every.tolist() if k not in inner]
    law = Law([drives[k] for k in outer])
    q = np.empty((count, len(table.joints)))
    for i in range(count):
        q[i] = data.qpos[follow.places]
        then = i - np.array(lags, int)
        known = row[np.maximum(then, 0)]
        u, speed = np.where(then >= 0, table.command[known, every], held), table.speed[known, every]
        data.ctrl[: len(inner)] = u[inner]
        q_error, v_error = u[outer] - data.qpos[at[outer]], speed[outer] - data.qvel[rows[outer]]
        data.qfrc_applied[rows[outer]] = law.torque(q_error, v_error, data.qvel[rows[outer]])
        follow.step(row[i], 1)
    return np.column_stack([np.interp(t, np.arange(count) * h, x) for x in q.T])


class Law:
    """IdealPD, DelayedPD and DCMotor of Isaac Lab, IdealPd and DcMotor of mjlab (actuator_pd.py, dc_actuator.py)."""

    def __init__(self, drives: list[Any]) -> None:
        self.kp, self.kd = self._numbers(drives, "stiffness", 0.0), self._numbers(drives, "damping", 0.0)
        self.limit = self._numbers(drives, "effort_limit", np.inf)
        self.stall, self.top = (self._numbers(drives, x, np.inf) for x in ("saturation_effort", "velocity_limit"))

    @staticmethod
    def _numbers(drives: list[Any], name: str, none: float) -> Array:
        return np.array([none if drive.get(name) is None else drive[name] for drive in drives], float)

    def torque(self, error: Array, speed_error: Array, v: Array) -> Array:
        """Torque by errors of position and speed, clipped by the limit and, of a motor, by its torque-speed line."""
        pull, high = self.kp * error + self.kd * speed_error, self.limit.copy()
        low, motor = -high, np.isfinite(self.stall)
        stall, top = self.stall[motor], self.top[motor]
        corner = top * (1 + self.limit[motor] / stall)
        share = np.clip(v[motor], -corner, corner) / top
        high[motor] = np.minimum(stall * (1 - share), high[motor])
        low[motor] = np.maximum(stall * (-1 - share), low[motor])
        return np.asarray(np.minimum(np.maximum(pull, low), high))


def prepare(spec: Any, joint: Any, drive: Mapping[str, Any]) -> None:
    """Armature, friction and damping of a joint as its configuration states them; the actuator, if it is of MuJoCo."""
    joint.armature = drive.get("armature") or 0.0
    damping = drive.get("viscous_friction", drive.get("viscous_damping")) or 0.0
    joint.damping = [damping, 0, 0] if np.ndim(joint.damping) else damping
    joint.frictionloss = drive.get("dynamic_friction", drive.get("frictionloss")) or 0.0
    joint.actfrclimited = 0
    for key, value in HARD.items():
        setattr(joint, key, value)
    if drive["kind"] == IMPLICIT:
        made, limit = spec.add_actuator(name=joint.name, target=joint.name), drive.get("effort_limit")
        made.trntype, made.biastype = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtBias.mjBIAS_AFFINE
        made.gainprm[0], made.biasprm[1], made.biasprm[2] = drive["stiffness"], -drive["stiffness"], -drive["damping"]
        if limit is not None:
            made.forcelimited, made.forcerange = 1, [-limit, limit]


def drive_of(joint: str, actuators: Any) -> dict[str, Any]:
    """Configuration of a joint, with its delays as `least` and `most`: of the first group whose pattern matches it."""
    for group in actuators.values() if isinstance(actuators, dict) else actuators:
        patterns = group.get("joint_names_expr", group.get("target_names_expr", ()))
        if any(re.fullmatch(pattern, joint) for pattern in patterns):
            return {DELAYS.get(key, key): of_joint(joint, value) for key, value in group.items()}
    return {"kind": ""}


def of_joint(joint: str, value: Any) -> Any:
    """The value of a joint, where a table states one by pattern."""
    if not isinstance(value, dict):
        return value
    return next((x for pattern, x in value.items() if re.fullmatch(pattern, joint)), None)


def errors(run: Run, table: Table) -> list[float]:
    """Errors of the driven joints together, the last numbers of a Row [mrad or mm]."""
    at, first = [table.joints.index(joint) for joint in table.driven], table.t < FIRST
    signid, recorded = table.signid[:, at], table.recorded[:, at]
    late = np.column_stack([np.interp(table.t - x, table.t, q) for x, q in zip(run.rounded, signid.T, strict=True)])
    found = [(run.q[:, at] - other)[rows] for rows in (first, slice(None)) for other in (signid, recorded)]
    return [float(1e3 * np.sqrt(np.mean(x**2))) for x in (*found, late - signid)]


if __name__ == "__main__":
    one_thread()
    raise SystemExit(main())
