"""Closed-loop simulation and logging of a robot in MuJoCo.

Independent of signid: MuJoCo parses the URDF and computes the dynamics.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from .bodies import Body, Drives, drive
from .control import BANDWIDTH, COMMAND, KNOWN, STEP, Motion, Reference, Track, clock, draw_motion, gains
from .faults import Fault, check
from .laws import Laws
from .mujoco_model import Gear, build, dofs, gears, inverse, mean_inertia
from .record import log, misplaced, misread

__all__ = ["STEP", "Body", "Drives", "Motion", "Track", "draw_motion", "inertials", "log", "simulate"]

Array = NDArray[np.float64]


def simulate(
    body: Body,
    drives: Drives,
    motion: Reference,
    duration: float,
    rate: float,
    faults: Sequence[Fault] = (),
    start: float = 0.0,
    soft: bool = False,
    bandwidth: float = BANDWIDTH,
) -> Track:
    """Simulate PD control along a motion, with feed-forward of 90 % of the dynamics without friction.

    Torque and acceleration are simultaneous: the torque of a step moves the robot from k to k + 1, and the
    second difference of the positions k - 1, k, k + 1 is the acceleration of this step.

    Args:
        body: rigid bodies.
        drives: drive parameters of n joints.
        motion: reference motion of n joints.
        duration: duration [s].
        rate: rate of the log [Hz]; 1 / STEP logs every step.
        faults: planted faults, unknown to the controller.
        start: time of the first row [s], for motion and laws.
        soft: dry friction creeps with MuJoCo's default solver parameters instead of holding.
        bandwidth: bandwidth of the position loop [rad/s].

    Raises:
        ValueError: when the log period is not a multiple of the step, or for impossible faults.
    """
    check(faults, body.joints)
    t, every = clock(start, duration, rate)
    desired, velocity, acceleration = motion.at(t)
    known = build(body, drives, frictionless=True, weigh=False)
    stiffness, damping = gains(mean_inertia(known, body.joints, desired[:: max(len(t) // 20, 1)]), bandwidth)
    forward = _feed_forward(known, body.joints, motion, t)
    command = forward + stiffness * desired + damping * velocity
    encoder_error = misplaced(body.joints, faults)
    command -= stiffness * encoder_error
    model = build(body, drives, (stiffness, damping), faults=faults, soft=soft)
    true = drive(drives, body.joints, faults)
    laws = Laws(faults, body.joints, true.coulomb_friction, STEP)
    load = forward[0] / KNOWN - np.array(drives.armature) * acceleration[0]
    gearing = gears(model, body, faults)
    backlash = [gear for gear in gearing if gear.free]
    first = _begin(model, body, gearing, desired[0] - encoder_error, velocity[0], load)
    control = command - np.array(true.torque_offset)
    if laws.any or backlash:
        q, v = _step(model, body, laws, backlash, t, control, *first)
    else:
        q, v = _roll(model, body, control, *first)
    tau = command[:-1] - stiffness * q[:-1] - damping * v[1:]  # implicit integration damps with the next velocity
    track = misread(Track(t[:-1], q[:-1], tau), body.joints, faults)
    return Track(*(x[::every] for x in track))


def inertials(body: Body) -> dict[str, tuple[float, Array, Array]]:
    """Mass [kg], first moment (3,) [kg.m] and inertia (3, 3) [kg.m2] about the joint's frame of each moving link."""
    model = build(body, Drives.none(len(body.joints)))
    found = {}
    for joint in body.joints:
        i = int(model.joint(joint).bodyid[0])
        mass, centre, rotation = float(model.body_mass[i]), model.body_ipos[i], np.zeros(9)
        mujoco.mju_quat2Mat(rotation, model.body_iquat[i])
        axes = rotation.reshape(3, 3)
        inertia = axes @ np.diag(model.body_inertia[i]) @ axes.T
        moved = inertia + mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        found[model.body(i).name] = (mass, mass * centre, moved)
    return found


def _feed_forward(model: Any, joints: Sequence[str], motion: Reference, t: Array) -> Array:
    """Feed-forward torque (N, n) [N.m] at times (N,) [s]."""
    coarse = t[::COMMAND]
    torque = inverse(model, joints, *motion.at(coarse))
    return KNOWN * np.column_stack([np.interp(t, coarse, column) for column in torque.T])


def _begin(model: Any, body: Body, gearing: list[Gear], q: Array, v: Array, load: Array) -> tuple[Array, Array]:
    """Complete initial state from that of the n joints; the load (n,) [N.m] deflects the gears."""
    at = dofs(model, body.joints)
    if model.nq != model.nv or len(at) + len(gearing) != model.nv:
        raise ValueError("a joint has more than one position; only one-position joints can be simulated")
    position, velocity = np.zeros(model.nv), np.zeros(model.nv)
    position[at], velocity[at] = q, v
    for gear in gearing:
        carried = load[gear.joint]
        position[gear.at] = -carried / gear.stiffness - np.sign(carried) * gear.free
    return position, velocity


def _roll(model: Any, body: Body, control: Array, position: Array, velocity: Array) -> tuple[Array, Array]:
    """Joint positions and velocities (N, n) [rad, rad/s] from the initial state under commands (N, n) [N.m]."""
    at, n, first = dofs(model, body.joints), model.nv, np.concatenate([[0.0], position, velocity])
    states, _ = rollout.rollout(model, [mujoco.MjData(model)], first[None], control[None, :-1])
    states = np.vstack([first, states[0]])
    return states[:, 1 : 1 + n][:, at], states[:, 1 + n :][:, at]


def _step(
    model: Any, body: Body, laws: Laws, backlash: list[Gear], t: Array, control: Array, position: Array, velocity: Array
) -> tuple[Array, Array]:
    """Like `_roll`, with laws evaluated at each step for velocities at the time of the positions."""
    data, at = mujoco.MjData(model), dofs(model, body.joints)
    data.qpos[:], data.qvel[:] = position, velocity
    tip = int(model.joint(body.joints[-1]).bodyid[0])
    jacobian, load, acceleration = np.zeros((3, model.nv)), np.zeros(model.nv), np.zeros(model.nv)
    if laws.loaded:
        mujoco.mj_forward(model, data)
        load = data.qfrc_bias.copy()
    states = np.zeros((2, len(t), len(at)))
    states[:, 0] = position[at], velocity[at]
    for k in range(len(t) - 1):
        before = data.qvel.copy()
        now = before + STEP / 2 * acceleration
        torque, level = laws.at(t[k], data.qpos[at], now[at], load[at])
        if laws.tip:
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_jacBodyCom(model, data, jacobian, None, tip)
            data.qfrc_applied[:] = -jacobian.T @ laws.force(t[k], jacobian @ now)
        else:
            data.qfrc_applied[:] = 0
        data.qfrc_applied[at] -= torque
        for gear in backlash:
            data.qfrc_applied[gear.at] += gear.push(float(data.qpos[gear.at]), float(data.qvel[gear.at]))
        model.dof_frictionloss[at] = level
        data.ctrl[:] = control[k]
        mujoco.mj_step(model, data)
        acceleration = (data.qvel - before) / STEP
        if laws.loaded:
            data.qacc[:] = acceleration
            mujoco.mj_rne(model, data, 1, load)
        states[:, k + 1] = data.qpos[at], data.qvel[at]
        laws.advance(states[1, k + 1])
    return states[0], states[1]
