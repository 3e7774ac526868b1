"""Coverage of 95 % intervals on two plants, by number, encoder, kind of command and rate."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import polars as pl

from signid.robot import load_robot
from signid.servo.identify import identify_servos

from .arm import positions, write_arm
from .drive import Array, Drive, Truth
from .identified import KNOWN_LOAD, NUMBERS, SECONDS, drawn, truth_of
from .plant import record
from .robots import Bench, benches, motion

STEP, ARM_STEP = 5e-5, 1e-5  # [s] of MuJoCo and of the arm
RATES, BITS, KINDS = (50.0, 100.0, 200.0), (12, 14), ("sines", "steps", "teleoperation")
PLANTS = ("pendulum", "arm", "go2_leg")
FACTORS, DELAYS = (0.6, 1.5), (0.004, 0.04)  # of the numbers of healthy drives; [s]
LEADER = 0.02  # [s] between commands of a teleoperation


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
