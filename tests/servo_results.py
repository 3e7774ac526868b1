"""A servo identification of the 3r with given numbers, without a fit."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from signid.model import load_model, with_servos
from signid.servo.identify import ServoIdentification, ServoJoint, ServoNumber, ServoRollOut, ServoScale, ServoTrace
from signid.servos import Servo
from signid.types import Input, Robot

PATH = "held <b>out</b>.csv"


def invented(
    robot: Robot | None = None, flags: Sequence[str] = ("joint_1: no sample saturated",)
) -> ServoIdentification:
    """Drives of a robot with three joints: one identified, one stated, one not identifiable."""
    model = load_model("3r" if robot is None else robot)
    names = model.robot.joints
    servos = {joint: Servo(law="duty", kp=20.0, kd=0.5, delay=0.01, coulomb_friction=0.1) for joint in names}
    joints = (_identified(names[0]), _stated(names[1]), _unknown(names[2]))
    rms = np.array([0.0123, 0.0456, 0.00789])
    rollout = ServoRollOut(names, ("rad",) * 3, rms, rms / 2, 5 * rms, 4 * rms, "q = q_des", True, 5 * rms)
    return ServoIdentification(
        robot=model.robot,
        model=with_servos(model, servos),
        servos=servos,
        joints=joints,
        scale=ServoScale("inertials of the description", "The masses of the URDF are assumed.", ("if kp is 20, x",)),
        rollout=rollout,
        traces=(_trace(names),),
        inputs=(Input(PATH, "0" * 64, "recording, held out"),),
        flags=tuple(flags),
        notes=("a note",),
        seed=0,
    )


def _identified(joint: str) -> ServoJoint:
    numbers = {
        "kp": ServoNumber("kp", "N.m/rad", 1.1, 0.06),
        "damping": ServoNumber("damping", "N.m.s/rad", 0.055, 0.004),
        "delay": ServoNumber("delay", "s", 0.001, 0.003),
        "lag": ServoNumber("lag", "s", 0.051, 0.001),
        "armature": ServoNumber("armature", "kg.m2", 0.0019, 0.0001),
        "coulomb_friction": ServoNumber("coulomb_friction", "N.m", 0.02, 0.003),
        "viscous_friction": ServoNumber("viscous_friction", "N.m.s/rad", None, sentence="kd and friction are one."),
        "effort_limit": ServoNumber("effort_limit", "N.m", 0.81, 0.04),
    }
    return ServoJoint(joint, "duty", 0.991, {"duty": 0.991, "effort": 0.009}, numbers, 0.03, 0.62, ("kd apart",))


def _stated(joint: str) -> ServoJoint:
    numbers = {
        "kp": ServoNumber("kp", "N.m/rad", 20.0, stated=True),
        "damping": ServoNumber("damping", "N.m.s/rad", 1.5, 0.1),
        "delay": ServoNumber("delay", "s", 0.0, 0.01),
        "lag": ServoNumber("lag", "s", 0.075, 0.001),
        "effort_limit": ServoNumber("effort_limit", "N.m", None, sentence="joint_2: no limit", above=1.3),
    }
    return ServoJoint(joint, "effort", None, {}, numbers, 0.0, 0.9, ("kd apart", "no limit"))


def _unknown(joint: str) -> ServoJoint:
    why = "only 3 % of the torque is known load"
    units = {"kp": "N.m/rad", "damping": "N.m.s/rad", "delay": "s", "lag": "s"}
    numbers = {name: ServoNumber(name, unit, None, sentence=why) for name, unit in units.items()}
    return ServoJoint(joint, "effort", 0.5, {"effort": 0.5, "duty": 0.5}, numbers, 0.0, 0.03, (f"{joint}: {why}",))


def _trace(joints: tuple[str, ...]) -> ServoTrace:
    t = np.arange(500) * 0.01
    command = np.sin(t)[:, None] * np.ones(3)
    measured = np.sin(t - 0.05)[:, None] * np.ones(3)
    return ServoTrace(PATH, joints, t, command, measured, measured + 0.01, command, one_second=measured + 0.005)
