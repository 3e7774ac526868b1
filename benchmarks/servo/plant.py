"""A robot with position drives in MuJoCo: hard dry friction, exact delay of the held command, 12 bit encoders."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from .drive import Array, Drive, Torque, Truth, column

TICK = 2 * np.pi / 4096  # [rad] 12 bit
NOISE = 3e-4  # [rad] standard deviation before the encoder rounds
DRY = {"solimp_friction": [0.9999, 0.9999, 0.001, 0.5, 2], "solref_friction": [0.0004, 1]}


def build(urdf: Path, truth: Truth, step: float) -> tuple[Any, list[str]]:
    """Compile a MuJoCo model of a URDF with these drives; return it and its driven joints."""
    spec = mujoco.MjSpec.from_file(str(urdf))
    spec.compiler.discardvisual = True
    spec.option.timestep = step
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    bare = spec.compile()  # its joints are in the order of qpos
    names = [bare.joint(k).name for k in range(bare.njnt)]
    for name in names:
        _drive(spec, spec.joint(name), truth.drives[name])
    if truth.payload:
        last = names[-1]
        body = next(joint.parent for joint in spec.joints if joint.name == last)
        body.add_body(name="payload", pos=truth.payload_at).add_geom(
            type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[0.005, 0, 0], mass=truth.payload, contype=0, conaffinity=0
        )
    return spec.compile(), names


def record(
    urdf: Path,
    truth: Truth,
    command: Array,
    rate: float,
    seed: int,
    step: float = 2e-4,
    on: Array | None = None,
    tick: float = TICK,
    noise: float = NOISE,
) -> dict[str, Array]:
    """Columns t, q_J, q_des_J of a recording; `command` (N, n) is held from row to row."""
    model, names = build(urdf, truth, step)
    drives = [truth.drives[name] for name in names]
    q = (
        _native(model, drives, command, rate)
        if all(d.native for d in drives)
        else _stepped(model, names, drives, command, rate)
    )
    rng = np.random.default_rng([seed, 7])
    q = np.round((q + noise * rng.standard_normal(q.shape)) / tick) * tick
    columns = {"t": np.arange(len(q)) / rate}
    for j, name in enumerate(names):
        columns |= {f"q_{name}": q[:, j], f"q_des_{name}": command[:, j]}
    return columns


def _drive(spec: Any, joint: Any, drive: Drive) -> None:
    """Armature, frictions and actuator of one joint, with a second hinge for play."""
    joint.limited, joint.actfrclimited, joint.armature = 0, 0, drive.armature  # effort of a URDF would clip
    damping = drive.viscous_friction + (drive.kd if drive.law == "duty" and drive.native else 0.0)
    joint.damping = np.r_[damping, 0, 0] if np.ndim(joint.damping) else damping
    joint.frictionloss = max(drive.coulomb_friction, 1e-9)
    for key, value in DRY.items():
        setattr(joint, key, value)
    actuator = spec.add_actuator()
    actuator.name, actuator.target = f"drive_{joint.name}", joint.name
    actuator.trntype, actuator.biastype = mujoco.mjtTrn.mjTRN_JOINT, mujoco.mjtBias.mjBIAS_AFFINE
    if drive.native:
        actuator.gainprm[0], actuator.biasprm[1] = drive.kp, -drive.kp
        actuator.biasprm[2] = 0.0 if drive.law == "duty" else -drive.kd
        if np.isfinite(drive.effort_limit):
            actuator.forcelimited, actuator.forcerange = 1, [-drive.effort_limit, drive.effort_limit]
    if drive.backlash:
        play = joint.parent.add_joint(name=f"play_{joint.name}", type=joint.type, axis=joint.axis, pos=joint.pos)
        play.limited, play.range = 1, [-drive.backlash / 2, drive.backlash / 2]
        play.solref_limit, play.solimp_limit = [0.002, 1], [0.99, 0.9999, 1e-4, 0.5, 2]
        play.armature = 1e-6


def _events(command: Array, delays: Array, rate: float, step: float) -> tuple[int, list[Array]]:
    """Substeps of a row, and the row of the command in force (n,) at each substep of row 0, shifted by k for row k."""
    m = int(round(1 / rate / step))
    late = np.round(delays / step).astype(int)
    return m, [(s - late) // m for s in range(m)]


def _native(model: Any, drives: Sequence[Drive], command: Array, rate: float) -> Array:
    data, offset = mujoco.MjData(model), column(list(drives), "torque_offset")
    m, rows = _events(command, column(list(drives), "delay"), rate, model.opt.timestep)
    starts = [0, *[s for s in range(1, m) if np.any(rows[s] != rows[s - 1])], m]
    data.qpos[:], data.qfrc_applied[:] = command[0], -offset
    q, every = np.empty_like(command), np.arange(command.shape[1])
    for k in range(len(command)):
        q[k] = data.qpos
        for s, end in zip(starts, starts[1:], strict=False):
            data.ctrl[:] = command[np.maximum(k + rows[s], 0), every]
            mujoco.mj_step(model, data, end - s)
    return q


def _stepped(model: Any, names: list[str], drives: list[Drive], command: Array, rate: float) -> Array:
    """Torque by the law of the drive at every substep."""
    data, step, torque = mujoco.MjData(model), model.opt.timestep, Torque(drives)
    m, rows = _events(command, column(drives, "delay"), rate, step)
    own = np.array([model.joint(name).qposadr[0] for name in names])
    play = np.array(
        [model.joint(f"play_{n}").qposadr[0] if d.backlash else -1 for n, d in zip(names, drives, strict=True)]
    )
    has, every = play >= 0, np.arange(len(names))
    model.actuator_gainprm[:, :3], model.actuator_biasprm[:, :3] = [1, 0, 0], 0
    model.actuator_forcelimited[:] = 0
    dry, mu, offset = (
        column(drives, "coulomb_friction"),
        column(drives, "load_friction"),
        column(drives, "torque_offset"),
    )
    data.qpos[own], data.qfrc_applied[own] = command[0], -offset
    q = np.empty_like(command)
    for k in range(len(command)):
        for s in range(m):
            at, v = data.qpos[own] + has * data.qpos[play], data.qvel[own] + has * data.qvel[play]
            if s == 0:
                q[k] = at
            pull = torque(command[np.maximum(k + rows[s], 0), every], at, v, step)
            data.ctrl[:] = pull
            if mu.any():
                model.dof_frictionloss[own] = np.maximum(dry + mu * np.abs(pull), 1e-9)
            mujoco.mj_step(model, data)
    return q
