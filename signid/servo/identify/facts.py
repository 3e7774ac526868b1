"""Content of the recordings for each joint: known load, torque and speed of the drive, saturation, periods."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...model import Model
from ...robot.joints import similar_joints
from ...servos import Servo, ServoGrid
from ...types import Array, Recording, Robot
from ..plant import servo_grids
from ..plant.course import bodies_of, recorded_course
from ..search.data import ServoData
from .identifiable import RARE, JointFacts
from .scale import Stated, moves_while_off

FULL = 0.95  # duty from which a sample is left out of the slope
LINEAR = 0.98  # share of the variance of the duty that the error explains
ROWS = 50  # least number of samples
SLIDING = 0.05  # [rad/s or m/s] over which friction turns
PARTS = 9  # of the damping of a drive
POWER = 0.95  # share of the power of the commands below the frequency of the shortest period


def joint_facts(
    model: Model,
    data: ServoData,
    servos: Mapping[str, Servo],
    saturated: Mapping[str, float],
    stated: Stated,
    scale_known: bool,
) -> dict[str, JointFacts]:
    """Facts of each servo joint. saturated: share of saturated samples by joint [1]."""
    robot, courses = bodies_of(model, data.joints), [recorded_course(model, grid) for grid in data.train]
    loads = np.vstack([one.torque for one in courses])
    v, a = (np.vstack([getattr(one.motion, key) for one in courses]) for key in "va")
    facts = {}
    for joint, servo in servos.items():
        j = data.joints.index(joint)
        reached, damping = reached_torque(servo, data.train, [one.motion.v[:, j] for one in courses], j)
        share, unique = known_load_share(loads[:, j], v[:, j], a[:, j], servo)
        facts[joint] = JointFacts(
            joint,
            prismatic=bool(robot.prismatic[j]),
            scale_known=scale_known,
            known_load_share=share,
            unique_load_share=unique,
            masses_set_scale="kp" not in stated.get(joint, {}),
            saturated_share=float(np.nan_to_num(saturated.get(joint, 0.0))),
            largest_torque=reached,
            drive_damping=damping,
            torque_off=moves_while_off(data, joint),
            command_speed=servo.kd_on == "error",
            stated=stated.get(joint, {}),
        )
    for members in similar_joints(tuple(facts)):  # a kp that is far too small makes the load of its joint look large
        for name in ("known_load_share", "unique_load_share"):
            usual = float(np.median([getattr(facts[joint], name) for joint in members]))
            facts |= {j: replace(facts[j], **{name: min(getattr(facts[j], name), usual)}) for j in members}
    return facts


def known_load_share(load: Array, v: Array, a: Array, servo: Servo) -> tuple[float, float]:
    """Share of a joint's rms torque [1] that its known masses give, and the share that only they can give.

    load: (N,) torque of the masses [N.m or N]; v: (N,) [rad/s or m/s]; a: (N,) [rad/s2 or m/s2]. Armature,
    friction and offset of the joint could produce
    the rest of the load as well, so it does not set the scale.
    """
    friction = np.tanh(v / SLIDING)
    own = np.column_stack([a, v, friction, np.ones_like(v)])
    unique = load - own @ np.linalg.lstsq(own, load, rcond=None)[0]
    total = load + servo.armature * a + servo.coulomb_friction * friction + servo.damping * v
    size = max(_rms(total), 1e-150)
    return float(min(_rms(load) / size, 1.0)), float(min(_rms(unique) / size, 1.0))


def _rms(x: Array) -> float:
    return float(np.sqrt(np.mean(x**2)))


def demand(servo: Servo, grid: ServoGrid, v: Array, joint: int, damping: float) -> Array:
    """Torque (N,) [N.m or N] that a recorded motion asks of a drive with some damping.

    v: (N,) measured speed [rad/s or m/s]; damping [N.m.s/rad or N.s/m].
    """
    held = np.floor(np.arange(len(grid)) - servo.delay * grid.rate + 1e-9).astype(int)
    error = grid.command[np.maximum(held, 0), joint] - grid.q[:, joint]
    error = np.sign(error) * np.maximum(np.abs(error) - servo.dead_band, 0)
    return np.asarray((grid.gain[joint] * servo.kp * error - damping * v) * grid.on[:, joint])


def reached_torque(
    servo: Servo, grids: Sequence[ServoGrid], speeds: Sequence[Array], joint: int
) -> tuple[float, float]:
    """Torque [N.m or N] that a drive gives at least in a share RARE of the samples, and the damping for which it holds.

    speeds: (N,) each, measured [rad/s or m/s]. The least torque of all parts of the damping: the part that acts inside
    the limit is unknown, and none does by the law `duty`. A limit that cuts fewer samples may remain unnoticed.
    """
    tried = list[tuple[float, float]]()
    for damping in np.linspace(0.0, servo.damping, PARTS).tolist():
        torque = np.concatenate([demand(servo, g, v, joint, damping) for g, v in zip(grids, speeds, strict=True)])
        tried.append((float(np.quantile(np.abs(torque), 1 - RARE)), damping))
    least, part = min(tried)
    return min(least, servo.effort_limit), part


def shortest_period(grids: Sequence[ServoGrid], joint: str) -> float:
    """Period [s] below which 5 % of the power of a joint's commands lie; inf where it does not move."""
    power, frequency = np.zeros(0), np.zeros(0)
    for grid in grids:
        x = grid.command[:, grid.joints.index(joint)]
        own = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(len(x)))) ** 2
        power, frequency = np.append(power, own), np.append(frequency, np.fft.rfftfreq(len(x), grid.step))
    order = np.argsort(frequency, kind="stable")
    total = np.cumsum(power[order])
    if total[-1] < 1e-12:
        return np.inf
    return float(1.0 / max(frequency[order][np.searchsorted(total, POWER * total[-1])], 1e-6))


def full_duty_errors(robot: Robot, recordings: Sequence[Recording]) -> dict[str, float]:
    """Error [rad or m] of full duty at the nominal gain, of each joint whose PWM is proportional to its error."""
    pairs: dict[str, list[tuple[Array, Array]]] = {}
    for recording in recordings:
        x = recording.read()
        pwm = None if x.servo is None else x.servo.pwm
        if pwm is None or x.q_des is None:
            continue
        gain = servo_grids(recording, robot)[0].gain
        for j, joint in enumerate(recording.joints):
            error = gain[j] * (x.q_des[:, j] - x.q[:, j])
            on = np.isfinite(error) & np.isfinite(pwm[:, j]) & (np.abs(pwm[:, j]) < FULL)
            if x.servo is not None and x.servo.on is not None:
                on &= x.servo.on[:, j] > 0.5
            pairs.setdefault(joint, []).append((error[on], pwm[on, j]))
    found = {joint: _error_of_one(*map(np.concatenate, zip(*some, strict=True))) for joint, some in pairs.items()}
    return {joint: error for joint, error in found.items() if error > 0}


def exceeded(grids: Sequence[ServoGrid], joint: str, error: float) -> float:
    """Share of rows with the drive on in which its error exceeds one [rad or m at the nominal gain]."""
    j = grids[0].joints.index(joint)
    beyond = np.concatenate([(g.gain[j] * np.abs(g.command - g.q)[:, j] > error)[g.on[:, j] > 0.5] for g in grids])
    return float(beyond.mean()) if len(beyond) else 0.0


def _error_of_one(error: Array, duty: Array) -> float:
    """Error of full duty; 0 unless the duty is proportional to the error."""
    if len(error) < ROWS or not np.any(error):
        return 0.0
    slope = float(error @ duty / (error @ error))
    left = np.median(np.abs(duty - slope * error)) / 0.675
    return 1.0 / slope if slope > 0 and left**2 < (1 - LINEAR) * np.mean(duty**2) else 0.0
