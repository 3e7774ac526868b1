"""A robot and what is wrong with it as a model of MuJoCo's: what no law need step for."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from .bodies import Body, Drives, bare, drive, tilted
from .control import STEP
from .faults import Fault

Array = NDArray[np.float64]

GEAR_DAMPING = 0.05  # of a soft joint's own vibration, as a share of critical


def build(
    body: Body,
    drives: Drives,
    gains: tuple[Array, Array] | None = None,
    frictionless: bool = False,
    weigh: bool = True,
    faults: Sequence[Fault] = (),
) -> Any:
    """The compiled model, with a motor for each joint.

    Args:
        body: rigid bodies.
        drives: n joints.
        gains: (n,) each [N.m/rad, N.m.s/rad] of a position loop in the motors.
        frictionless: leave the drives' friction out.
        weigh: whether the links are as heavy as they truly are, or as the URDF states.
        faults: all that is planted; those count that are part of the model.

    Raises:
        ValueError: for what MuJoCo cannot do.
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
    _solve_stiffly(model, faults)
    model.opt.gravity[:] = tilted(model.opt.gravity.copy(), faults)
    mujoco.mj_setConst(model, mujoco.MjData(model))
    _plant(model, body, drives, faults)
    return model


def dofs(model: Any, joints: Sequence[str]) -> list[int]:
    """Where the joints are among the model's degrees of freedom, and among its positions."""
    return [int(model.joint(name).dofadr[0]) for name in joints]


def gear(model: Any, fault: Fault) -> int:
    """Where the deflection of a soft or loose joint is, likewise."""
    return int(model.joint(f"{fault.joint}_gear").dofadr[0])


def _solve_stiffly(model: Any, faults: Sequence[Fault]) -> None:
    """Steps and constraints as nearly rigid as MuJoCo has them; no contacts, no limits but those of a backlash."""
    model.dof_solref[:], model.dof_solimp[:] = [2 * STEP, 1], [0.9999, 0.9999, 0.001, 0.5, 2]  # sliding at 1 mm/s
    model.jnt_actfrclimited[:] = 0
    model.opt.timestep, model.opt.integrator = STEP, mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT | mujoco.mjtDisableBit.mjDSBL_CONTACT
    model.opt.iterations, model.opt.tolerance = 50, 1e-12
    if model.ntendon:
        model.tendon_solref_fri[:], model.tendon_solimp_fri[:] = model.dof_solref[0], model.dof_solimp[0]
    gaps = [model.joint(f"{f.joint}_gear").id for f in faults if f.effect == "backlash"]
    if gaps:
        model.opt.disableflags &= ~int(mujoco.mjtDisableBit.mjDSBL_LIMIT)
        model.jnt_limited[:] = 0
        model.jnt_limited[gaps] = 1
        model.jnt_solref[:], model.jnt_solimp[:] = model.dof_solref[0], model.dof_solimp[0]


def _couple(spec: Any, faults: Sequence[Fault]) -> None:
    """A tendon over both joints moves with the sum of their velocities; what it is too much alone is taken back."""
    for i, fault in enumerate(f for f in faults if f.effect == "joint_coupling"):
        p, tendon = fault.numbers, spec.add_tendon(name=f"coupling_{i + 1}")
        tendon.wrap_joint(str(fault.joint), 1.0)
        tendon.wrap_joint(fault.partner, 1.0)
        tendon.armature, tendon.frictionloss, tendon.damping[0] = p["inertia"], p["coulomb"], p["viscous"]


def _split(spec: Any, body: Body, drives: Drives, faults: Sequence[Fault]) -> None:
    """A second joint between motor and link; a motor with a gear behind it needs a rotor."""
    for fault in faults:
        if fault.effect in ("backlash", "joint_elasticity"):
            motor = spec.joint(str(fault.joint))
            if len(motor.parent.joints) > 1:
                raise ValueError(f"{fault.joint} has a soft or loose gear already; plant one of them")
            motor.armature = drives.armature[body.joints.index(str(fault.joint))]
            if motor.armature <= 0:
                raise ValueError(f"{fault.effect} of {fault.joint} needs a rotor: give the joint an armature")
            link = motor.parent.add_joint(name=f"{fault.joint}_gear", type=motor.type, axis=motor.axis, pos=motor.pos)
            if fault.effect == "backlash":
                link.range = np.array([-0.5, 0.5]) * fault.numbers["gap"]


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
        elif fault.effect == "joint_elasticity":
            _soften(model, fault)


def _soften(model: Any, fault: Fault) -> None:
    """Stiffness and slight damping of a soft gear."""
    data, unit, at = mujoco.MjData(model), np.zeros((1, model.nv)), gear(model, fault)
    mujoco.mj_forward(model, data)
    unit[0, at] = 1
    mobility = np.zeros_like(unit)
    mujoco.mj_solveM(model, data, mobility, unit)
    stiffness = fault.numbers["stiffness"]
    frequency = np.sqrt(stiffness * mobility[0, at])  # rad/s, with the other joints free
    if frequency * STEP > 1:
        raise ValueError(f"{fault.joint} would vibrate at {frequency / 6.28:.0f} Hz: too fast for steps of {STEP:g} s")
    model.jnt_stiffness[model.dof_jntid[at]] = stiffness
    model.dof_damping[at] = 2 * GEAR_DAMPING * stiffness / frequency
