"""MuJoCo model of a robot with the planted faults that need no evaluation at each step."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from .bodies import Body, Drives, bare, drive, tilted
from .control import STEP
from .faults import Fault

Array = NDArray[np.float64]

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
