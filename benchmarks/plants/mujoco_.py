"""Model, closed-loop simulation and logging of a robot in MuJoCo.

Independent of signid: MuJoCo parses the URDF and computes the dynamics.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from mujoco import rollout

from .bodies import Body, Drives, bare, drive, tilted
from .control import (
    BANDWIDTH,
    COMMAND,
    KNOWN,
    STEP,
    Array,
    Motion,
    Reference,
    Track,
    clock,
    draw_motion,
    gains,
    log,
    misplaced,
    misread,
)
from .faults import Fault, check
from .laws import Laws

GEARS = ("backlash", "joint_elasticity")
SOFT, PRESSED = 0.05, 0.5  # damping ratios of an elastic gear and of a gear with backlash in contact [1]
STOP = 0.4  # angular frequency of a gear with backlash in contact, times the step [rad]
POSES = 8  # poses for the largest vibration frequency of a gear


class Gear(NamedTuple):
    """Gear between the motor and the link of one joint."""

    at: int  # index of its degree of freedom
    joint: int
    free: float  # half of the backlash [rad]
    stiffness: float  # N.m/rad
    damping: float  # N.m.s/rad

    def push(self, x: float, v: float) -> float:
        """Contact torque [N.m] on the link of a gear with backlash, deflected by x [rad]; never pulling."""
        if abs(x) <= self.free:
            return 0.0
        side = 1.0 if x > 0 else -1.0
        return -side * max(self.stiffness * (abs(x) - self.free) + self.damping * side * v, 0.0)


def build(
    body: Body,
    drives: Drives,
    gains: tuple[Array, Array] | None = None,
    frictionless: bool = False,
    weigh: bool = True,
    faults: Sequence[Fault] = (),
    soft: bool = False,
) -> Any:
    """Compile the model with a motor for each joint.

    Args:
        body: rigid bodies.
        drives: drive parameters of n joints.
        gains: gains of a position loop in the motors, (n,) each [N.m/rad, N.m.s/rad].
        frictionless: omit the drives' friction.
        weigh: use the true link masses instead of those of the URDF.
        faults: all planted faults; only those that are part of the model are used.
        soft: dry friction creeps with MuJoCo's default solver parameters.

    Raises:
        ValueError: for faults that MuJoCo does not support.
    """
    spec = mujoco.MjSpec.from_string(bare(body, faults))
    drives = drive(drives, body.joints, faults)
    _couple(spec, faults)
    _split(spec, body, drives, faults)
    for i, name in enumerate(body.joints):
        motor = spec.add_actuator(name=f"motor_{i + 1}", target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT)
        motor.gainprm[0] = 1
        if gains is not None:
            motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
            motor.biasprm[:3] = 0, -gains[0][i], -gains[1][i]
    model = spec.compile()
    for link, factor in body.heavier.items() if weigh else ():
        model.body(link).mass *= factor
        model.body(link).inertia *= factor
    at = dofs(model, body.joints)
    model.dof_armature[at] = drives.armature
    model.dof_damping[at] = 0 if frictionless else drives.viscous_friction
    model.dof_frictionloss[at] = 0 if frictionless else drives.coulomb_friction
    _solve_stiffly(model, soft)
    model.opt.gravity[:] = tilted(model.opt.gravity.copy(), faults)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    _plant(model, body, drives, faults)
    return model


def dofs(model: Any, joints: Sequence[str]) -> list[int]:
    """Indices of the joints among the model's degrees of freedom, equal to those of its positions."""
    return [int(model.joint(name).dofadr[0]) for name in joints]


def mean_inertia(model: Any, joints: Sequence[str], positions: Array) -> Array:
    """Diagonal of the mass matrix (n,) [kg.m2], averaged over positions (N, n) [rad]."""
    data, at = mujoco.MjData(model), dofs(model, joints)
    full, diagonal = np.zeros((model.nv, model.nv)), np.zeros((len(positions), len(at)))
    for k, q in enumerate(positions):
        data.qpos[at] = q
        mujoco.mj_forward(model, data)
        mujoco.mj_fullM(model, data, full)
        diagonal[k] = np.diag(full)[at]
    return np.asarray(diagonal.mean(0))


def inverse(model: Any, joints: Sequence[str], q: Array, v: Array, a: Array) -> Array:
    """Inverse dynamics (N, n) [N.m] of a motion, (N, n) each [rad, rad/s, rad/s2]."""
    data, at = mujoco.MjData(model), dofs(model, joints)
    torque = np.zeros_like(q)
    for k in range(len(q)):
        data.qpos[at], data.qvel[at], data.qacc[at] = q[k], v[k], a[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse[at]
    return torque


def gears(model: Any, body: Body, faults: Sequence[Fault]) -> list[Gear]:
    """Elastic gears and gears with backlash; the contact of the latter is as stiff as the step allows.

    Raises:
        ValueError: for an elastic gear that is too stiff for the step.
    """
    found = []
    for fault in faults:
        if fault.effect not in GEARS:
            continue
        at, p = int(model.joint(f"{fault.joint}_gear").dofadr[0]), fault.numbers
        mobility, soft = _mobility(model, at), fault.effect == "joint_elasticity"
        frequency = np.sqrt(p["stiffness"] * mobility) if soft else STOP / STEP  # [rad/s], other joints free
        if frequency * STEP > 1:
            raise ValueError(
                f"{fault.joint}: {frequency:.0f} rad/s is too fast for steps of {STEP:g} s; reduce the stiffness"
            )
        stiffness = frequency**2 / mobility
        damping = 2 * (SOFT if soft else PRESSED) * stiffness / frequency
        free = 0.0 if soft else p["gap"] / 2
        found.append(Gear(at, body.joints.index(str(fault.joint)), free, float(stiffness), float(damping)))
    return found


def _mobility(model: Any, at: int) -> float:
    """Mobility [1/(kg.m2)] of one degree of freedom with the others free, largest over POSES poses."""
    data, rng, found = mujoco.MjData(model), np.random.default_rng(0), []
    unit, answer = np.zeros((1, model.nv)), np.zeros((1, model.nv))
    unit[0, at] = 1
    for _ in range(POSES):
        mujoco.mj_forward(model, data)
        mujoco.mj_solveM(model, data, answer, unit)
        found.append(float(answer[0, at]))
        data.qpos[:] = rng.uniform(-np.pi, np.pi, model.nq)
    return max(found)


def _solve_stiffly(model: Any, soft: bool) -> None:
    """Set time step and nearly rigid constraints (unless soft); disable contacts and limits."""
    if not soft:
        model.dof_solref[:], model.dof_solimp[:] = (
            [2 * STEP, 1],
            [0.9999, 0.9999, 0.001, 0.5, 2],
        )  # sliding velocity 1 mm/s
    model.jnt_actfrclimited[:] = 0
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.iterations, model.opt.tolerance = 50, 1e-12
    if model.ntendon:
        model.tendon_solref_fri[:], model.tendon_solimp_fri[:] = model.dof_solref[0], model.dof_solimp[0]


def _couple(spec: Any, faults: Sequence[Fault]) -> None:
    """Add a tendon on the sum of both joints' velocities; `_plant` removes the diagonal terms."""
    for i, fault in enumerate(f for f in faults if f.effect == "joint_coupling"):
        p, tendon = fault.numbers, spec.add_tendon(name=f"coupling_{i + 1}")
        tendon.wrap_joint(str(fault.joint), 1.0)
        tendon.wrap_joint(fault.partner, 1.0)
        tendon.armature, tendon.frictionloss, tendon.damping[0] = p["inertia"], p["coulomb"], p["viscous"]


def _split(spec: Any, body: Body, drives: Drives, faults: Sequence[Fault]) -> None:
    """Add a second joint between motor and link; the motor then needs rotor inertia."""
    for fault in faults:
        if fault.effect in GEARS:
            motor = spec.joint(str(fault.joint))
            if len(motor.parent.joints) > 1:
                raise ValueError(f"{fault.joint} already has elasticity or backlash; plant only one of them")
            motor.armature = drives.armature[body.joints.index(str(fault.joint))]
            if motor.armature <= 0:
                raise ValueError(f"{fault.effect} of {fault.joint} needs rotor inertia; give the joint an armature")
            motor.parent.add_joint(name=f"{fault.joint}_gear", type=motor.type, axis=motor.axis, pos=motor.pos)


def _plant(model: Any, body: Body, drives: Drives, faults: Sequence[Fault]) -> None:
    for fault in faults:
        p = fault.numbers
        if fault.effect == "spring":
            joint = model.joint(fault.joint)
            at, old = joint.id, float(model.jnt_stiffness[joint.id])
            place = int(joint.qposadr[0])
            total = old + p["stiffness"]
            model.qpos_spring[place] = (old * model.qpos_spring[place] + p["stiffness"] * p["rest"]) / (total or 1.0)
            model.jnt_stiffness[at] = total
        elif fault.effect == "joint_coupling":
            pair = dofs(model, (str(fault.joint), fault.partner))
            model.dof_armature[pair] -= p["inertia"]
            model.dof_damping[pair] -= p["viscous"]
        elif fault.effect == "torque_saturation":
            i = body.joints.index(str(fault.joint))
            model.actuator_forcelimited[i] = 1
            model.actuator_forcerange[i] = np.array([-1, 1]) * p["limit"] - drives.torque_offset[i]
    for gear in gears(model, body, faults):
        if not gear.free:
            model.jnt_stiffness[model.dof_jntid[gear.at]], model.dof_damping[gear.at] = gear.stiffness, gear.damping


__all__ = ["STEP", "Body", "Drives", "Motion", "Track", "draw_motion", "inertials", "log", "simulate"]


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
