"""Servo models with their recordings, and their exported MJCF driven by the commands in MuJoCo."""

from __future__ import annotations

from pathlib import Path

import mujoco
import numpy as np
import polars as pl
from toys import joint, link, toy

from signid.model import Model, load_model, with_servos
from signid.output.export import export
from signid.robot import load_robot
from signid.servo.plant import grids_of_arrays, roll_out
from signid.servos import Servo, ServoGrid
from signid.types import Array, Robot

BODY = (
    '<inertial><origin xyz="0 0 -0.15"/><mass value="0.5"/>'
    '<inertia ixx="0.002" ixy="0" ixz="0" iyy="0.002" iyz="0" izz="0.001"/></inertial>'
)
RATE = 100.0  # [Hz]
SWING = Servo(
    kp=8.0, kd=0.15, delay=0.0123, armature=0.004, viscous_friction=0.02, coulomb_friction=0.08, torque_offset=0.05
)


def pendulum() -> Robot:
    return toy(link("base", ""), link("arm", BODY), joint("swing", "base", "arm", "continuous", "", "0 1 0"))


def driven(robot: Robot | str, servos: dict[str, Servo]) -> Model:
    return with_servos(load_model(load_robot(robot) if isinstance(robot, str) else robot), servos)


def motion(model: Model, seed: int, seconds: float = 10.0, rate: float = 100.0, repeats: int = 10) -> ServoGrid:
    """Commands about the middle of the ranges: sines and small steps, `rate` new ones a second, each in some rows.

    The robot begins at rest at the first command. Many rows make the substeps of the roll-out short, as it clips torque
    at the speed before each.
    """
    rng, robot = np.random.default_rng(seed), model.robot
    t = np.arange(int(seconds * rate) + 2) / rate
    ranged = np.isfinite(robot.lower) & np.isfinite(robot.upper)
    u = np.tile(
        np.where(ranged, np.where(ranged, robot.lower, 0) + np.where(ranged, robot.upper, 0), 0) / 2, (len(t), 1)
    )
    for j in range(len(robot.joints)):
        for f in rng.uniform(0.2, 1.6, 3):
            u[:, j] += 0.35 * rng.uniform(0.3, 1) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6)) / f**0.5
        u[:, j] += np.repeat(rng.uniform(-0.05, 0.05, len(t) // 150 + 1), 150)[: len(t)]
    held = np.repeat(u, repeats, axis=0)
    at = np.arange(len(held)) / (rate * repeats)
    q = np.repeat(u[:1], len(held), axis=0)
    speed = np.repeat(np.gradient(u, 1 / rate, axis=0), repeats, axis=0)
    return grids_of_arrays(robot.joints, at, q, held, command_speed=speed, rate=rate * repeats)[0]


def in_mujoco(model: Model, grid: ServoGrid) -> Array:
    """Positions (N, n) [rad or m] of the exported MJCF under the commands of a grid."""
    there = mujoco.MjModel.from_xml_string(export(model, "mjcf").text)
    data, h = mujoco.MjData(there), there.opt.timestep
    assert grid.command_speed is not None
    wanted = dict(zip(grid.joints, grid.command.T, strict=True))
    wanted |= {f"{name}_speed": x for name, x in zip(grid.joints, grid.command_speed.T, strict=True)}
    inputs = [(k, wanted[there.actuator(k).name]) for k in range(there.nactuator) if there.actuator(k).name in wanted]
    for k, values in inputs:
        count = int(there.actuator_history[k, 0])
        mujoco.mj_initCtrlHistory(there, data, k, np.arange(-count, 0) * h, np.full((count, 1), values[0]))
    rows = [there.joint(name).qposadr[0] for name in grid.joints]
    data.qpos[rows] = grid.q[0]
    found, parts = np.empty((len(grid), len(rows))), round(grid.step / h)
    for row in range(len(grid)):
        found[row] = data.qpos[rows]
        for k, values in inputs:
            data.ctrl[there.actuator_ctrladr[k]] = values[row]
        for _ in range(parts):
            mujoco.mj_step(there, data)
    return found


def pendulum_log(path: Path, servo: Servo, t: Array, u: Array, seed: int) -> Path:
    """A recording of the 1r with a drive under commands (N,) [rad], with noise of 0.3 mrad."""
    model = load_model("1r")
    (joint,) = model.robot.joints
    (grid,) = grids_of_arrays([joint], t, np.full_like(u, u[0]), u[:, None])
    q = roll_out(with_servos(model, {joint: servo}), {joint: servo}, grid)[:, 0]
    q = q + 3e-4 * np.random.default_rng(seed).standard_normal(len(q))
    pl.DataFrame({"t": t, f"q_{joint}": q, f"q_des_{joint}": u}).write_csv(path)
    return path


def recorded(
    model: Model, servos: dict[str, Servo], seconds: float, seed: int, size: float = 0.4, middle: float = 1.0
) -> ServoGrid:
    """A simulated recording of 12 bit encoders, whose commands are three sines from rest; `middle`: frequency [Hz]."""
    joints, rng = model.robot.joints, np.random.default_rng(seed)
    t, n = np.arange(int(seconds * RATE))[:, None] / RATE, len(joints)
    sines = (rng.uniform(0.3, 1, n) * np.sin(2 * np.pi * f * t + rng.uniform(0, 6, n)) for f in (0.3, middle, 2.3))
    u = size * np.minimum(t / 0.5, 1) * sum(sines)
    (ideal,) = grids_of_arrays(joints, t[:, 0], u * 0, u)
    q = roll_out(model, servos, ideal) + 3e-4 * rng.standard_normal(u.shape)
    return grids_of_arrays(joints, t[:, 0], np.round(q * 4096 / (2 * np.pi)) * 2 * np.pi / 4096, u)[0]
