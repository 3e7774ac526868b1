"""Coverage of 95 % intervals on two plants, by number, encoder, kind of command and rate."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numba
import numpy as np
import polars as pl

from signid.robot import load_robot
from signid.servo.identify import identify_servos

from .drive import Array, Drive, Truth
from .identified import KNOWN_LOAD, NUMBERS, SECONDS, drawn, truth_of
from .plant import record
from .robots import Bench, benches, motion

STEP, ARM_STEP = 5e-5, 1e-5  # [s] of MuJoCo and of the arm
RATES, BITS, KINDS = (50.0, 100.0, 200.0), (12, 14), ("sines", "steps", "teleoperation")
PLANTS = ("pendulum", "arm", "go2_leg")
FACTORS, DELAYS = (0.6, 1.5), (0.004, 0.04)  # of the numbers of healthy drives; [s]
LEADER = 0.02  # [s] between commands of a teleoperation
GRAVITY = 9.81
MASS, LENGTH, CENTRE, INERTIA = (0.9, 0.5), 0.3, (0.17, 0.14), (6e-3, 3e-3)  # [kg], [m], [m], [kg.m2]
URDF = """<robot name="arm"><link name="base"/>
<link name="upper"><inertial><origin xyz="{c[0]} 0 0"/><mass value="{m[0]}"/>
<inertia ixx="1e-4" iyy="{i[0]}" izz="{i[0]}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="lower"><inertial><origin xyz="{c[1]} 0 0"/><mass value="{m[1]}"/>
<inertia ixx="1e-4" iyy="{i[1]}" izz="{i[1]}" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" velocity="20" effort="40"/></joint>
<joint name="elbow" type="revolute"><origin xyz="{l} 0 0"/><parent link="upper"/><child link="lower"/>
<axis xyz="0 -1 0"/><limit lower="-3" upper="3" velocity="20" effort="40"/></joint></robot>"""
COLUMNS = ("kp", "kd", "viscous_friction", "coulomb_friction", "armature", "effort_limit")


@dataclass(frozen=True)
class Case:
    """A robot, its encoder and its commands."""

    plant: str
    seed: int
    kind: str
    rate: float  # [Hz]
    bits: int
    limited: bool  # whether drives saturate


@dataclass(frozen=True)
class Interval:
    """One number of one joint: its error over the standard deviation, and over the truth."""

    case: Case
    joint: str
    number: str
    truth: float
    value: float
    std: float

    @property
    def score(self) -> float:
        return (self.value - self.truth) / self.std


def cases(seeds: Sequence[int], plants: Sequence[str] = PLANTS) -> Iterator[Case]:
    """One case a plant and seed; kinds, rates and encoders take turns, every third one saturates."""
    kinds = list(product(KINDS, BITS, RATES))
    for plant, seed in product(plants, seeds):
        kind, bits, rate = kinds[(7 * seed + 5 * PLANTS.index(plant)) % len(kinds)]
        yield Case(plant, seed, kind, rate, bits, seed % 3 == 0)


def intervals(case: Case, folder: Path) -> tuple[list[Interval], float, float]:
    """Intervals of the joints whose scale is identifiable, processor time [s], and rms of held-out windows [rad]."""
    rng = np.random.default_rng([case.seed, 23, PLANTS.index(case.plant)])
    bench = _bench(case.plant, folder)
    command = _command(bench, case, rng)
    drives = {joint: drawn(drive, rng, FACTORS, DELAYS) for joint, drive in bench.drives.items()}
    if case.limited:
        drives = _limited(bench, drives, command, case, rng)
    columns = _recorded(bench, drives, command, case)
    path = folder / "recording.csv"
    pl.DataFrame(columns).write_csv(path)
    robot = load_robot(bench.urdf)
    start = time.process_time()
    found = identify_servos(robot, str(path), prior=["masses=1+-1e-6"])  # exact, as those of the plant are
    seconds = time.process_time() - start
    rows = [
        Interval(case, one.joint, name, truth, number.value, number.std)
        for one in found.joints
        if one.known_load_share > KNOWN_LOAD
        for name in NUMBERS
        if np.isfinite(truth := truth_of(drives[one.joint], name, ARM_STEP if case.plant == "arm" else STEP))
        and (number := one.numbers.get(name)) is not None
        and number.value is not None
        and number.std
    ]
    return rows, seconds, float(np.sqrt(np.nanmean(found.rollout.one_second_rms**2)))


def _bench(plant: str, folder: Path) -> Bench:
    if plant != "arm":
        return benches(folder, (plant,))[0]
    path = folder / "arm.urdf"
    write_arm(path)
    drives = {
        "shoulder": Drive(kp=40.0, kd=1.6, coulomb_friction=0.15, viscous_friction=0.1, armature=0.02),
        "elbow": Drive(kp=15.0, kd=0.5, coulomb_friction=0.06, viscous_friction=0.04, armature=0.008),
    }
    return Bench("arm", path, drives, np.array([-0.3, 0.5]), np.array([0.7, 0.7]))


def _command(bench: Bench, case: Case, rng: np.random.Generator) -> Array:
    """Held commands (N, n) [rad]."""
    if case.kind == "sines":
        return motion(bench, case.seed, SECONDS, case.rate, fast=3.0, steps=0.0)
    n, count = len(bench.centre), int(SECONDS * case.rate)
    t, u = np.arange(count) / case.rate, np.zeros((count, len(bench.centre)))
    for j in range(n):
        at, level = 0.3, 0.0
        while at < SECONDS:
            goal = float(rng.uniform(-1, 1))
            if case.kind == "steps":
                u[t >= at, j], at = goal, at + float(rng.uniform(0.3, 1.2))
                continue
            move = float(rng.uniform(0.25, 1.0))
            x = np.clip((t - at) / move, 0, 1)
            u[:, j] += (goal - level) * (10 * x**3 - 15 * x**4 + 6 * x**5)  # least jerk
            at, level = at + move + float(rng.uniform(0.0, 0.6)), goal
    command = bench.centre + bench.size * u
    if case.kind == "teleoperation":  # of a leader with an encoder of 12 bit, slower than the log
        held = np.floor(t / LEADER + 1e-9) * LEADER
        tick = 2 * np.pi / 4096
        command = np.column_stack([np.round(np.interp(held, t, x) / tick) * tick for x in command.T])
    return np.asarray(command)


def _limited(
    bench: Bench, drives: dict[str, Drive], command: Array, case: Case, rng: np.random.Generator
) -> dict[str, Drive]:
    """Drives with a limit that 5 to 30 % of the samples would exceed, by the law of one draw."""
    columns, law, out = _recorded(bench, drives, command, case), str(rng.choice(["effort", "duty"])), {}
    for joint, drive in drives.items():
        torque = drive.kp * np.abs(columns[f"q_des_{joint}"] - columns[f"q_{joint}"])
        limit = float(np.quantile(torque, 1 - rng.uniform(0.05, 0.3)))
        out[joint] = replace(drive, law=law, effort_limit=limit)
    return out


def _recorded(bench: Bench, drives: dict[str, Drive], command: Array, case: Case) -> dict[str, Array]:
    """Columns t, q_J, q_des_J; an encoder that only rounds."""
    tick = 2 * np.pi / 2**case.bits
    if case.plant != "arm":
        return record(bench.urdf, Truth(drives), command, case.rate, case.seed, step=STEP, tick=tick, noise=0.0)
    q = np.round(positions(list(drives.values()), command, case.rate, ARM_STEP) / tick) * tick
    columns = {"t": np.arange(len(q)) / case.rate}
    for j, name in enumerate(drives):
        columns |= {f"q_{name}": q[:, j], f"q_des_{name}": command[:, j]}
    return columns


def write_arm(path: Path) -> None:
    """Write the description of the arm."""
    path.write_text(URDF.format(c=CENTRE, m=MASS, i=INERTIA, l=LENGTH), encoding="utf-8")


def positions(drives: list[Drive], command: Array, rate: float, step: float) -> Array:
    """Positions (N, 2) [rad] at the instants of the commands (N, 2), each held and acting after the delay."""
    numbers = np.array([[getattr(drive, name) for name in COLUMNS] for drive in drives])
    late = np.array([int(round(drive.delay / step)) for drive in drives])
    duty = np.array([drive.law == "duty" for drive in drives])
    return np.asarray(_roll(numbers, late, duty, command, int(round(1 / rate / step)), step))


@numba.njit(cache=False)  # type: ignore[untyped-decorator]
def _roll(numbers, late, duty, command, substeps, step):  # type: ignore[no-untyped-def]
    """Semi-implicit steps; dry friction is the impulse within its bounds that stops a joint."""
    kp, kd, viscous, dry, rotor, limit = numbers.T
    out, q, v = np.empty_like(command), command[0].copy(), np.zeros(2)
    first = MASS[0] * CENTRE[0] ** 2 + INERTIA[0] + MASS[1] * LENGTH**2
    second, cross = MASS[1] * CENTRE[1] ** 2 + INERTIA[1], MASS[1] * LENGTH * CENTRE[1]
    force, impulse = np.empty(2), np.empty(2)
    for k in range(len(command)):
        out[k] = q
        for s in range(substeps):
            for j in range(2):
                row = max((k * substeps + s - late[j]) // substeps, 0)
                spring = kp[j] * (command[row, j] - q[j])
                if duty[j]:
                    force[j] = min(max(spring, -limit[j]), limit[j]) - kd[j] * v[j]
                else:
                    force[j] = min(max(spring - kd[j] * v[j], -limit[j]), limit[j])
                force[j] -= viscous[j] * v[j]
            c1, c12, sine = np.cos(q[0]), np.cos(q[0] + q[1]), cross * np.sin(q[1])
            low = MASS[1] * GRAVITY * CENTRE[1] * c12
            bias0 = low + (MASS[0] * CENTRE[0] + MASS[1] * LENGTH) * GRAVITY * c1 - sine * v[1] * (2 * v[0] + v[1])
            bias1 = low + sine * v[0] ** 2
            couple = second + cross * np.cos(q[1])
            m00, m11 = first + second + 2 * cross * np.cos(q[1]) + rotor[0], second + rotor[1]
            p0 = m00 * v[0] + couple * v[1] + step * (force[0] - bias0)
            p1 = couple * v[0] + m11 * v[1] + step * (force[1] - bias1)
            for _ in range(20):  # momentum less friction: each joint in turn, as Gauss and Seidel
                for j in range(2):
                    free = (p0 - couple * v[1]) if j == 0 else (p1 - couple * v[0])
                    impulse[j] = min(max(free, -step * dry[j]), step * dry[j])
                    v[j] = (free - impulse[j]) / (m00 if j == 0 else m11)
            q += step * v
    return out
