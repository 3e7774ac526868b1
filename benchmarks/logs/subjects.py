"""Robots whose logs are changed: simulated arms with known parameters, a servo arm, and real recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import signid
from signid.regression.session import prepare
from signid.types import Robot

from ..arms import ARMS, Arm, load, truth
from ..concealed_real.sets import TABLE, data
from ..plants.bodies import Drives
from ..plants.mujoco_ import Body, draw_motion, log, simulate
from ..servo.drive import Truth
from ..servo.plant import record
from ..servo.robots import benches, motion

Array = NDArray[np.float64]

SECONDS, NOISE, BITS = 20.0, 0.02, 17
UR5 = Arm(
    "ur5",
    6,
    125.0,
    (0.0, -1.2, 1.2, -0.5, 0.5, 0.0),
    Drives((1.0, 1.0, 0.8, 0.2, 0.2, 0.2), (5.0, 5.0, 3.0, 1.0, 0.8, 0.8), (6, 6, 4, 1.2, 1.0, 0.8), (0.1,) * 6),
)
REAL = ("ur10e", "emps", "tx40")


@dataclass(frozen=True)
class Numbers:
    """Numbers of a result by name, with standard deviations; flags and notes."""

    value: Mapping[str, float]
    std: Mapping[str, float]
    flags: tuple[str, ...] = ()


@dataclass(frozen=True)
class Subject:
    """A robot with its original log."""

    name: str
    document: Path  # URDF
    columns: Mapping[str, Array]
    truth: Mapping[str, float]  # by name; empty if unknown
    identify: Callable[[Robot, list[signid.Recording]], Numbers]
    drives: bool = False  # whether the log has commands and no torque
    joints: tuple[str, ...] | None = None
    actuators: Path | None = None


def of_torque(robot: Robot, recordings: list[signid.Recording]) -> Numbers:
    """Base parameters by least squares."""
    found = signid.identify(robot, recordings, method="wls")
    names = found.base.expressions
    value, std = (dict(zip(names, x.tolist(), strict=True)) for x in (found.estimate.value, found.estimate.std))
    return Numbers(value, std, found.flags)


def of_drives(robot: Robot, recordings: list[signid.Recording]) -> Numbers:
    """Numbers of the drives."""
    from signid.servo.identify import identify_servos

    found = identify_servos(robot, recordings)
    each = {(one.joint, name): x for one in found.joints for name, x in one.numbers.items() if x.value is not None}
    known = {f"{name} of {joint}": x for (joint, name), x in each.items() if x.std}
    return Numbers(
        {name: float(x.value or 0.0) for name, x in known.items()},
        {name: float(x.std or 0.0) for name, x in known.items()},
        found.flags,
    )


def simulated(arm: Arm, folder: Path, seed: int) -> Subject:
    """An arm in MuJoCo along a random motion, with noise and encoders."""
    robot = load(arm)
    track = simulate(Body(robot.document, robot.joints), arm.drives, draw_motion(arm.centre, seed), SECONDS, arm.rate)
    columns = log(track, seed, BITS, NOISE)
    session = prepare(robot, [signid.read_recording(columns, robot)])
    known = dict(zip(session.task.base.expressions, truth(arm, session).tolist(), strict=True))
    path = folder / f"{arm.robot}.urdf"
    path.write_text(robot.document, encoding="utf-8")
    return Subject(arm.robot, path, columns, known, of_torque, joints=robot.joints)


def servo_arm(folder: Path, seed: int) -> Subject:
    """A pendulum with a position drive in MuJoCo."""
    [bench] = benches(folder, ("pendulum",))
    command = motion(bench, seed, SECONDS, 100.0)
    columns = record(bench.urdf, Truth(bench.drives), command, 100.0, seed)
    known = {
        f"{name} of {joint}": float(getattr(drive, name))
        for joint, drive in bench.drives.items()
        for name in ("kp", "coulomb_friction", "armature", "delay")
    }
    return Subject("servo", bench.urdf, columns, known, of_drives, drives=True)


def real(name: str) -> Subject:
    """The first recording of a real set; its true parameters are unknown."""
    found = next(one for one in TABLE if one.name == name)
    robot = found.robot()
    recording = signid.read_recording(data() / found.folder / f"{found.a[0].file}.csv.gz", robot)
    samples = recording.read()
    inside = (samples.t >= found.a[0].start) & (samples.t <= found.a[0].end)
    columns = {"t": samples.t[inside]}
    for j, joint in enumerate(recording.joints):
        columns |= {f"q_{joint}": samples.q[inside, j], f"tau_{joint}": samples.tau[inside, j]}
    path = data() / found.folder / found.urdf
    return Subject(name, path, columns, {}, of_torque, actuators=found.actuators)


def subjects(folder: Path, names: tuple[str, ...], seed: int) -> dict[str, Callable[[], Subject]]:
    """Ways to make the robots of some names."""
    arms = {arm.robot: arm for arm in (*ARMS[:2], UR5)}
    made: dict[str, Callable[[], Subject]] = {name: partial(simulated, arm, folder, seed) for name, arm in arms.items()}
    made["servo"] = partial(servo_arm, folder, seed)
    made |= {name: partial(real, name) for name in REAL}
    return {name: made[name] for name in names if name in made}
