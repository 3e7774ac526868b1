"""Roll exported position drives out from commands alone, beside signid and the recording (written by signid).

    python arm_check_loop.py arm.xml arm_loop.json [--actuators arm_isaaclab.py] [--within 1]

Needs numpy and mujoco 3.5 or newer, and nothing else. The MJCF starts from its keyframe `start`. With --actuators, a
file of Isaac Lab or mjlab drives the bodies of the MJCF instead, from its START: torque by the law of the actuator
class in each step of the physics, commands late by whole steps, joints with the armature, friction and damping of the
file. Prints the rms error [mrad or mm] over the first 0.2 s and the whole recording, and what whole steps of delay
cost.
"""

from __future__ import annotations

import argparse
import ast
import json
import math
import re
import sys
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

FIRST = 0.2  # [s]
START = "start"  # name of the keyframe
IMPLICIT = "BuiltinPositionActuatorCfg"  # class whose gains are those of an actuator of MuJoCo
CONSTANTS = ("PHYSICS_STEP", "ACTUATORS", "START", "HELD", "TARGET_OFFSETS")  # of a file of Isaac Lab or mjlab
HARD = {"solref_friction": [0.0002, 1], "solimp_friction": [0.9999, 0.9999, 0.001, 0.5, 2]}


class Table(NamedTuple):
    """Columns of the recording: N rows of n joints, D of them with a drive."""

    t: np.ndarray  # (N,) [s]
    joints: list[str]  # n
    recorded: np.ndarray  # (N, n) [rad or m]
    signid: np.ndarray  # (N, n) roll-out of signid
    driven: list[str]  # D
    command: np.ndarray  # (N, D) held until the next row
    speed: np.ndarray  # (N, D) of the command [rad/s or m/s]; 0 where no drive uses it


class Run(NamedTuple):
    """A roll-out."""

    title: str
    q: np.ndarray  # (N, n) [rad or m]
    rounded: list[float]  # by driven joint: delay beyond that of the drive [s]


class Wrong(Exception):
    """A file that cannot be used, in one sentence."""


def main(arguments: list[str] | None = None) -> int:
    """Print the errors; return 1 if one of signid's joints is further off than --within, 2 if a file is not usable."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("mjcf", help="arm.xml of signid export --mjcf arm.xml --start RECORDING")
    parser.add_argument("loop", help="arm_loop.json, written beside it")
    parser.add_argument("--actuators", metavar="FILE", help="file of --isaaclab or --mjlab, of the same export")
    parser.add_argument("--within", type=float, metavar="MRAD", help="largest rms from signid's positions of any joint")
    given = parser.parse_args(arguments)
    try:
        table = read_table(given.loop)
        runs = configured(given.mjcf, given.actuators, table) if given.actuators else [of_mjcf(given.mjcf, table)]
        worst = max(report(run, table) for run in runs)
    except (OSError, SyntaxError, ValueError, KeyError, Wrong) as error:
        sys.stderr.write(f"{parser.prog}: {error.args[0] if isinstance(error, Wrong) else f'unusable file: {error}'}\n")
        return 2
    return int(given.within is not None and not worst <= given.within)


def read_table(path: str) -> Table:
    """Read the rows of the recording."""
    with open(path, encoding="utf-8") as file:
        content = json.load(file)
    if not isinstance(content, dict) or content.get("schema") != "signid.loop/1":
        raise Wrong(f"{path} is no loop of signid; give the _loop.json that signid export --start wrote")
    joints, columns = content["joints"], {name: np.array(x, float) for name, x in content["columns"].items()}
    driven = [joint for joint in joints if f"q_des_{joint}" in columns]
    still = np.zeros(len(columns["t"]))
    parts = [("q", joints), ("signid", joints), ("q_des", driven), ("dq_des", driven)]
    q, own, command, speed = (
        np.column_stack([columns.get(f"{what}_{joint}", still) for joint in names]) for what, names in parts
    )
    return Table(columns["t"], joints, q, own, driven, command, speed)


def of_mjcf(path: str, table: Table) -> Run:
    """Roll-out of the MJCF as it is written."""
    if not hasattr(mujoco, "mj_initCtrlHistory"):
        raise Wrong(f"MuJoCo {mujoco.__version__} has no delayed actuators; install 3.5 or newer")
    model = mujoco.MjModel.from_xml_path(path)
    data, inputs = mujoco.MjData(model), {}
    if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_KEY, START) < 0:
        raise Wrong(f"{path} has no keyframe {START!r}; write it with signid export --mjcf {path} --start RECORDING")
    mujoco.mj_resetDataKeyframe(model, data, model.key(START).id)
    places = getattr(model, "actuator_ctrladr", range(model.nu))
    for k, place in enumerate(places):
        inputs[mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_ACTUATOR, k)] = place
        count = int(model.actuator_history[k, 0])
        if place >= 0 and count:  # a keyframe does not hold the commands before it
            mujoco.mj_initCtrlHistory(model, data, k, None, np.full((count, 1), data.ctrl[place]))
    follow = Followers(model, data, table)
    at = np.round((table.t - table.t[0]) / model.opt.timestep).astype(int)
    q = np.empty_like(table.recorded)
    for row, steps in enumerate(np.diff(at, append=at[-1])):
        q[row] = data.qpos[follow.places]
        for joint, u, speed in zip(table.driven, table.command[row], table.speed[row], strict=True):
            data.ctrl[inputs[joint]] = u
            if f"{joint}_speed" in inputs:
                data.ctrl[inputs[f"{joint}_speed"]] = speed
        follow.step(row, int(steps))
    return Run("MJCF", q, [0.0] * len(table.driven))


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
        model.dof_armature[self.rows] += 1e6
        self.force = model.dof_armature[self.rows] * np.gradient(self.v, table.t, axis=0)

    def step(self, row: int, steps: int) -> None:
        """Simulate some steps from the row of the table."""
        self.data.qpos[self.at], self.data.qvel[self.rows] = self.q[row], self.v[row]
        self.data.qfrc_applied[self.rows] = self.force[row]
        if steps:
            mujoco.mj_step(self.model, self.data, steps)


def configured(mjcf: str, path: str, table: Table) -> Iterator[Run]:
    """Roll-outs of the drives in a file of Isaac Lab or mjlab, with delays rounded down and up."""
    written = read_configuration(path)
    if lacking := [name for name in CONSTANTS[:4] if name not in written]:
        raise Wrong(
            f"{path} has no {lacking[0]}; write it with signid export --isaaclab or --mjlab, and --start RECORDING"
        )
    step, start = written["PHYSICS_STEP"], written["START"]
    spec = mujoco.MjSpec.from_file(mjcf)
    for item in (*spec.actuators, *spec.keys):
        spec.delete(item)
    spec.option.timestep = step
    drives = {joint.name: drive_of(joint.name, written["ACTUATORS"]) for joint in spec.joints}
    for name in (*table.driven, *(drives.keys() - set(table.driven))):  # actuators in the order of the commands
        prepare(spec, spec.joint(name), drives[name])
    model = spec.compile()
    late = [drives[joint]["late"] / step + 0.5 if "late" in drives[joint] else 0.0 for joint in table.driven]
    lags = {"down": [math.floor(x + 1e-6) for x in late], "up": [math.ceil(x - 1e-6) for x in late]}
    shift = np.array([written.get("TARGET_OFFSETS", {}).get(joint, 0.0) for joint in table.driven])
    table = table._replace(command=table.command + shift)
    held = shift + [written["HELD"][joint] for joint in table.driven]
    for rounded in lags if lags["down"] != lags["up"] else ("down",):
        data = mujoco.MjData(model)
        for name, at in start["joint_pos"].items():
            joint = model.joint(plain(name))
            data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = at, start["joint_vel"][name]
        q = stepped(model, data, table, [drives[j] for j in table.driven], (lags[rounded], held))
        off = [step * (lag - exact) for lag, exact in zip(lags[rounded], late, strict=True)]
        yield Run(f"{path}, steps of {1e3 * step:g} ms, delays rounded {rounded}", q, off)


def stepped(
    model: Any, data: Any, table: Table, drives: list[Any], commands: tuple[list[int], np.ndarray]
) -> np.ndarray:
    """Positions (N, n) with the torque of the drives at each step of the physics; commands: steps late, held before."""
    h, (lags, held), follow = model.opt.timestep, commands, Followers(model, data, table)
    t = table.t - table.t[0]
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
    def _numbers(drives: list[Any], name: str, none: float) -> np.ndarray:
        return np.array([none if drive.get(name) is None else drive[name] for drive in drives], float)

    def torque(self, error: np.ndarray, speed_error: np.ndarray, v: np.ndarray) -> np.ndarray:
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
    armature = drive.get("armature") or 0.0
    if isinstance(armature, tuple):  # inertia(armature, damping)
        armature = max(armature[0] + 0.5 * spec.option.timestep * armature[1], 0.0)
    joint.armature = armature
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


def read_configuration(path: str) -> dict[str, Any]:
    """Constants of a Python file without running it; configurations as their class (`kind`) and arguments."""
    with open(path, encoding="utf-8") as file:
        body = ast.parse(file.read()).body
    return {
        target.id: value_of(node.value)
        for node in body
        if isinstance(node, ast.Assign)
        for target in node.targets
        if isinstance(target, ast.Name) and target.id in CONSTANTS
    }


def value_of(node: ast.expr) -> Any:
    """A literal, or a configuration; `**delayed(s)` is `late` [s]."""
    if isinstance(node, ast.Dict):
        return {value_of(key): value_of(x) for key, x in zip(node.keys, node.values, strict=True) if key}
    if isinstance(node, ast.List | ast.Tuple):
        return [value_of(x) for x in node.elts]
    if not isinstance(node, ast.Call):
        return ast.literal_eval(node)
    name: str = node.func.id  # type: ignore[attr-defined]
    if name in ("delayed", "inertia"):
        numbers = [value_of(x) for x in node.args]
        return numbers[0] if name == "delayed" else tuple(numbers)
    return {"kind": name, **{word.arg or "late": value_of(word.value) for word in node.keywords}}


def drive_of(joint: str, actuators: Any) -> dict[str, Any]:
    """Configuration of a joint: of the first group of which a pattern matches its name."""
    for group in actuators.values() if isinstance(actuators, dict) else actuators:
        patterns = group.get("joint_names_expr", group.get("target_names_expr", ()))
        if any(re.fullmatch(pattern, joint) for pattern in patterns):
            return {key: of_joint(joint, value) for key, value in group.items()}
    return {"kind": ""}


def of_joint(joint: str, value: Any) -> Any:
    """The value of a joint, where a table states one by pattern."""
    if not isinstance(value, dict):
        return value
    return next((x for pattern, x in value.items() if re.fullmatch(pattern, joint)), None)


def plain(pattern: str) -> str:
    """The name of a pattern that matches it alone."""
    return re.sub(r"\\(.)", r"\1", pattern)


def report(run: Run, table: Table) -> float:
    """Print the errors of the driven joints; return the largest rms from signid's positions [mrad or mm]."""
    at, first = [table.joints.index(joint) for joint in table.driven], table.t < table.t[0] + FIRST
    signid, recorded = table.signid[:, at], table.recorded[:, at]
    late = np.column_stack([np.interp(table.t - x, table.t, q) for x, q in zip(run.rounded, signid.T, strict=True)])
    columns = [rms((run.q[:, at] - other)[rows]) for rows in (first, slice(None)) for other in (signid, recorded)]
    columns.append(rms(late - signid))
    wide, blank = max(map(len, ("joint", *table.driven))), ""
    head = ("signid", "recording", "signid", "recording", "rounding")
    lines = [f"{run.title}: rms error [mrad or mm]"]
    lines.append(f"{blank:{wide}}  {'first 0.2 s, from':>20}  {'whole, from':>20}  {'of delays':>9}")
    lines.append(f"{'joint':{wide}}" + "".join(f"  {name:>9}" for name in head))
    whole = np.sqrt(np.mean(np.square(columns), axis=1))
    for joint, x in (*zip(table.driven, np.transpose(columns), strict=True), ("all", whole)):
        lines.append(f"{joint:{wide}}" + "".join(f"  {value:9.3f}" for value in x))
    sys.stdout.write("\n".join(lines) + "\n\n")
    return float(np.max(columns[2]))


def rms(errors: np.ndarray) -> np.ndarray:
    """Root mean square over the rows [mrad or mm]."""
    return np.asarray(1e3 * np.sqrt(np.mean(errors**2, axis=0)))


if __name__ == "__main__":
    raise SystemExit(main())
