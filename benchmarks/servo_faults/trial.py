"""One trial: record a robot with a fault in MuJoCo, diagnose the simulation without it."""

from __future__ import annotations

import time
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
import polars as pl

from signid.model import Model, load_model, with_servos
from signid.servo.diagnose import ServoDiagnosis, diagnose_servos
from signid.servos import Servo

from ..servo.drive import Drive, Truth
from ..servo.plant import record
from ..servo.robots import Bench, motion
from .faults import FAULTS, Fault, injected

SURE = 0.95  # probability from which a wrong name counts as sure
SECONDS, RATE = 20.0, 100.0
OWN = {item.name for item in fields(Servo)}


@dataclass(frozen=True)
class Outcome:
    """Outcome of one trial."""

    robot: str
    fault: str
    joint: str
    seed: int
    first: str
    first_joint: str
    probability: float
    verdict: str
    right: bool  # named first, or listed as a twin of the first with at least a third of its probability
    sure: bool  # wrong, with a probability of at least SURE
    before: float  # [rad] held-out rms of the worst joint
    after: float
    seconds: float  # of the diagnosis


def run_trial(bench: Bench, fault: Fault | None, seed: int, folder: Path) -> Outcome:
    """Record and diagnose; without a fault the robot is healthy."""
    rng = np.random.default_rng([seed, 5, FAULTS.index(fault) if fault else 0])  # another joint for each fault
    truth, joint = Truth(dict(bench.drives)), ""
    command = motion(bench, seed, SECONDS, RATE)
    if fault is not None:
        truth, joint = injected(bench, fault, _efforts(bench, command, seed), rng)
    path = folder / "recording.csv"
    pl.DataFrame(record(bench.urdf, truth, command, RATE, seed)).write_csv(path)
    start = time.process_time()
    result = diagnose_servos(simulation(bench), str(path))
    return _judged(bench, fault, joint, seed, result, time.process_time() - start)


def simulation(bench: Bench) -> Model:
    """The simulation without the fault."""
    return with_servos(load_model(bench.urdf), {joint: stated(drive) for joint, drive in bench.drives.items()})


def stated(drive: Drive) -> Servo:
    """Numbers of a drive as signid states them."""
    return Servo(**{item.name: getattr(drive, item.name) for item in fields(drive) if item.name in OWN})


def _efforts(bench: Bench, command: np.ndarray, seed: int) -> dict[str, float]:  # type: ignore[type-arg]
    """Largest torque of each healthy drive along the motion [N.m]."""
    columns = record(bench.urdf, Truth(dict(bench.drives)), command, RATE, seed)
    out = {}
    for joint, drive in bench.drives.items():
        q, u = columns[f"q_{joint}"], columns[f"q_des_{joint}"]
        v = np.gradient(q, 1 / RATE)
        out[joint] = float(np.quantile(np.abs(drive.kp * (u - q) - drive.kd * v), 0.995))
    return out


def _judged(
    bench: Bench, fault: Fault | None, joint: str, seed: int, result: ServoDiagnosis, seconds: float
) -> Outcome:
    causes = result.causes
    first = causes[0] if causes else None
    wanted = fault.found if fault else ()
    names = {(first.effect, first.joint)} if first else set()
    if first:
        names |= {(x.effect, x.joint) for x in first.alternatives if x.probability >= first.probability / 3}
    right = any((name, joint) in names for name in wanted) if fault else not causes
    probability = first.probability if first else 0.0
    return Outcome(
        bench.name, fault.name if fault else "healthy", joint, seed,
        first.effect if first else "", first.joint if first else "", probability, result.verdict, right,
        bool(first and not right and probability >= SURE),
        float(np.nanmax(result.before.held_out_rms)), float(np.nanmax(result.after.held_out_rms)), seconds,
    )  # fmt: skip
