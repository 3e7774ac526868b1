"""Controlled robot simulated by MuJoCo, independent of signid's own dynamics."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ...errors import RobotError
from ...model import Model
from ...output.export import export
from ...regression.motion import Motion
from ...simulation.plant import Simulation, track
from ...simulation.plant.control import Tracking, sampled
from ...types import Trajectory

STEP = 5e-4  # time step of MuJoCo and sampling period of the controller [s]
DRY = [2 * STEP, 1], [0.9999, 0.9999, 0.001, 0.5, 2]  # solref and solimp of the dry-friction constraint
STEPS, TOLERANCE = 50, 1e-12  # iterations and tolerance of the constraint solver
LOST = 1.0  # tracking error at which a simulation is rejected [rad or m]


def run_plant(true: Model, known: Model, motion: Trajectory) -> Simulation:
    """Simulate the true robot along a motion and return ideal samples of every step.

    The motors apply the feed-forward torque of the known model and a position controller. Torque and acceleration
    belong to the same time; velocity is the mean of the values half a step before and after. The laws of the true robot
    are limited to those that MJCF can express.

    Raises:
        RobotError: MuJoCo cannot simulate the robot.
    """
    from mujoco import MjData, rollout

    t = np.asarray(np.arange(round(motion.t[-1] / STEP) + 2) * STEP, dtype=np.float64)
    loop, (q, v, a) = track(known, motion), sampled(motion, t)
    ahead = known.inverse(Motion(known.robot, t, q, v, a))
    model = _compile(true, loop)
    joints = [model.joint(name) for name in true.robot.joints]
    places, rates = ([int(getattr(joint, key)[0]) for joint in joints] for key in ("qposadr", "dofadr"))
    data = MjData(model)
    data.qpos[places], data.qvel[rates] = q[0], v[0]
    first = np.concatenate([[0.0], data.qpos, data.qvel])
    command = ahead + loop.stiffness * q + loop.damping * v
    with _listening() as warnings:
        states, torque = rollout.rollout(model, [data], first[None], command[None])
    states = np.vstack([first, states[0]])[:-1]  # each state with the torque of the step that starts there
    moved, speed = states[:, 1 : 1 + model.nq][:, places], states[:, 1 + model.nq :][:, rates]
    if warnings or not np.all(np.abs(moved - q) < LOST):
        raise RobotError(f"{true.robot.name} does not follow its motion in MuJoCo; use another robot")
    middle, rate = (speed[1:-1] + speed[2:]) / 2, np.diff(speed, axis=0)[1:] / STEP
    now, tau = moved[1:-1], torque[0, 1:-1]
    return Simulation(true.robot.joints, t[:-2], now, tau, q[1:-1], now, middle, rate, now, tau)


@contextmanager
def _listening() -> Iterator[list[str]]:
    """Collect MuJoCo's warnings instead of writing them to a file."""
    import mujoco

    heard, before = list[str](), mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(heard.append)
    try:
        yield heard
    finally:
        mujoco.set_mju_user_warning(before)


def _compile(true: Model, loop: Tracking) -> Any:
    """Compile the MuJoCo model: motors with position controllers, no geometry, no joint or motor limits."""
    import mujoco

    spec = mujoco.MjSpec.from_string(export(true, "mjcf").text)
    for part in (*spec.geoms, *spec.meshes):
        spec.delete(part)
    for motor, stiffness, damping in zip(spec.actuators, loop.stiffness, loop.damping, strict=True):
        motor.biastype = mujoco.mjtBias.mjBIAS_AFFINE
        motor.biasprm[:3] = 0, -stiffness, -damping
        motor.forcelimited = mujoco.mjtLimited.mjLIMITED_FALSE
        spec.add_sensor(
            type=mujoco.mjtSensor.mjSENS_ACTUATORFRC, objtype=mujoco.mjtObj.mjOBJ_ACTUATOR, objname=motor.name
        )
    spec.option.timestep, spec.option.integrator = STEP, mujoco.mjtIntegrator.mjINT_EULER
    spec.option.iterations, spec.option.tolerance = STEPS, TOLERANCE
    spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_LIMIT
    try:
        model = spec.compile()
    except ValueError as error:
        raise RobotError(f"MuJoCo rejects {true.robot.name}: {error}; use another robot") from None
    model.dof_solref[:], model.dof_solimp[:] = DRY
    return model
