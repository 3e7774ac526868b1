"""Identification of simulated robots with known drives: errors and coverage of every number."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import polars as pl

from signid.robot import load_robot
from signid.servo.identify import ServoIdentification, identify_servos

from .drive import Drive, Truth
from .plant import record
from .robots import Bench, motion

NUMBERS = ("kp", "damping", "coulomb_friction", "armature", "delay", "effort_limit")
SECONDS, RATE, STEP = 20.0, 100.0, 1e-4
KNOWN_LOAD = 0.15  # [1] share of known load from which the scale of a joint counts


@dataclass(frozen=True)
class Row:
    """One number of one joint of one trial."""

    robot: str
    seed: int
    joint: str
    number: str
    truth: float
    value: float | None
    std: float | None
    load: float  # share of known load [1]
    clipped: bool  # whether the drive has a limit

    @property
    def error(self) -> float:
        """Relative error; absolute in seconds of a delay."""
        if self.value is None:
            return float("nan")
        return abs(self.value - self.truth) / (1.0 if self.number == "delay" else abs(self.truth))

    @property
    def covered(self) -> bool | None:
        """Whether the 95 % interval holds the truth."""
        if self.value is None or not self.std:
            return None
        return bool(abs(self.value - self.truth) <= 1.96 * self.std)


@dataclass(frozen=True)
class Trial:
    """Numbers of one trial, laws that were named, processor time [s]."""

    rows: tuple[Row, ...]
    laws: tuple[tuple[str, str], ...]  # true, named; of saturated joints
    seconds: float


def run(bench: Bench, seed: int, folder: Path, law: str | None = None) -> Trial:
    """Record a robot with random drives and identify it; `law`: all drives saturate by that law."""
    rng = np.random.default_rng([seed, 3])
    drives = {joint: drawn(drive, rng) for joint, drive in bench.drives.items()}
    command = motion(bench, seed, SECONDS, RATE, fast=3.0)
    if law:
        drives = saturated(bench, drives, command, seed, law, rng)
    path = folder / "recording.csv"
    pl.DataFrame(record(bench.urdf, Truth(drives), command, RATE, seed, step=STEP)).write_csv(path)
    robot = load_robot(bench.urdf)
    start = time.process_time()
    found = identify_servos(robot, str(path))
    seconds = time.process_time() - start
    named = tuple((law, one.law) for one in found.joints) if law else ()
    return Trial(tuple(_rows(bench, seed, drives, found, law is not None)), named, seconds)


def drawn(
    drive: Drive,
    rng: np.random.Generator,
    factors: tuple[float, float] = (0.7, 1.4),
    delays: tuple[float, float] = (0.01, 0.03),
) -> Drive:
    """Drive with other numbers: gains, frictions and armature times a factor, and a delay [s], each within a range."""
    kp, kd, dry, viscous, rotor = rng.uniform(*factors, 5)
    return replace(
        drive,
        kp=drive.kp * kp,
        kd=drive.kd * kd,
        coulomb_friction=drive.coulomb_friction * dry,
        viscous_friction=drive.viscous_friction * viscous,
        armature=drive.armature * rotor,
        delay=round(float(rng.uniform(*delays)), 4),  # whole steps of the simulator
    )


def saturated(
    bench: Bench,
    drives: dict[str, Drive],
    command: np.ndarray,
    seed: int,
    law: str,
    rng: np.random.Generator,  # type: ignore[type-arg]
) -> dict[str, Drive]:
    """Drives with a limit that 15 to 40 % of the samples would exceed."""
    columns, out = record(bench.urdf, Truth(drives), command, RATE, seed), {}
    for joint, drive in drives.items():
        torque = drive.kp * np.abs(columns[f"q_des_{joint}"] - columns[f"q_{joint}"])
        limit = float(np.quantile(torque, 1 - rng.uniform(0.15, 0.4)))
        speed = {"speed_limit": 2.0 * float(np.quantile(np.abs(np.gradient(columns[f"q_{joint}"], 1 / RATE)), 0.99))}
        out[joint] = replace(drive, law=law, effort_limit=limit, **(speed if law == "torque_speed" else {}))
    return out


def truth_of(drive: Drive, name: str, step: float = STEP) -> float:
    """Number of a drive; a step [s] of the plant lets a command that begins with it act half a step early."""
    if name == "damping":
        return drive.kd + drive.viscous_friction
    return float(getattr(drive, name)) - (step / 2 if name == "delay" else 0.0)


def _rows(
    bench: Bench, seed: int, drives: dict[str, Drive], found: ServoIdentification, clipped: bool
) -> Iterator[Row]:
    for one in found.joints:
        drive = drives[one.joint]
        for name in NUMBERS:
            truth = truth_of(drive, name)
            number = one.numbers.get(name)
            if np.isfinite(truth) and number is not None:
                yield Row(
                    bench.name, seed, one.joint, name, truth, number.value, number.std, one.known_load_share, clipped
                )
