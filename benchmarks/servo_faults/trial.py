"""One trial: record a robot with a fault in MuJoCo, diagnose the simulation without it."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import polars as pl

from signid.model import Model, load_model, with_servos
from signid.servo.diagnose import ServoDiagnosis, diagnose_servos
from signid.servos import Servo

from ..servo.drive import Drive, Truth
from ..servo.plant import record
from ..servo.robots import Bench, motion

SURE = 0.95  # probability from which a wrong name counts as sure
SECONDS, RATE = 20.0, 100.0
OWN = {item.name for item in fields(Servo)}
Change = Callable[[Drive, float, np.random.Generator], dict[str, object]]
PAYLOADS = {"pendulum": 0.1, "so101": 0.06, "go2_leg": 0.35}  # [kg]
CENTRES = {"pendulum": (0.2, 0.0, 0.0), "so101": (0.0, -0.05, 0.02), "go2_leg": (0.0, 0.0, -0.15)}  # [m]
JOINTS = {"pendulum": 1, "so101": 4, "go2_leg": 3}  # joints from the base that get faults


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


@dataclass(frozen=True)
class Fault:
    """One fault: names that count as found, and what changes; torques relative to the largest of the joint."""

    name: str
    found: tuple[str, ...]
    change: Change


def _more(drive: Drive, number: str, change: float) -> dict[str, object]:
    return {number: getattr(drive, number) + change}


FAULTS = (
    Fault("gain_up", ("servo_gain",), lambda d, e, r: {"kp": d.kp * r.uniform(1.2, 1.4)}),
    Fault("gain_down", ("servo_gain",), lambda d, e, r: {"kp": d.kp * r.uniform(0.56, 0.7)}),
    Fault("register", ("register_gain", "servo_gain"), lambda d, e, r: {"kp": d.kp * r.choice([0.5, 2.0])}),
    Fault("damping_up", ("servo_damping",), lambda d, e, r: {"kd": d.kd * r.uniform(1.4, 1.8)}),
    Fault("damping_down", ("servo_damping",), lambda d, e, r: {"kd": d.kd * r.uniform(0.3, 0.6)}),
    Fault("delay", ("command_delay",), lambda d, e, r: {"delay": d.delay + r.uniform(0.01, 0.02)}),
    Fault("delay_small", ("command_delay",), lambda d, e, r: {"delay": d.delay + r.uniform(0.004, 0.006)}),
    Fault("effort", ("effort_limit",), lambda d, e, r: {"effort_limit": e * r.uniform(0.35, 0.55)}),
    Fault("duty", ("duty_limit",), lambda d, e, r: {"law": "duty", "effort_limit": e * r.uniform(0.35, 0.55)}),
    Fault(
        "torque_speed",
        ("speed_limit",),
        lambda d, e, r: {
            "law": "torque_speed",
            "effort_limit": e * r.uniform(0.6, 0.9),
            "speed_limit": r.uniform(5, 8),
        },
    ),
    Fault("dead_band", ("dead_band",), lambda d, e, r: {"dead_band": r.uniform(0.01, 0.03)}),
    Fault("profile", ("profile_limit",), lambda d, e, r: {"profile_speed": r.uniform(1.2, 2.5)}),
    Fault("load_friction", ("load_friction",), lambda d, e, r: {"load_friction": r.uniform(0.15, 0.4)}),
    Fault("droop", ("voltage_droop",), lambda d, e, r: {"droop": r.uniform(0.25, 0.5) / e}),
    Fault("backlash", ("backlash",), lambda d, e, r: {"backlash": r.uniform(0.03, 0.06)}),
    Fault("coulomb", ("coulomb_friction",), lambda d, e, r: _more(d, "coulomb_friction", e * r.uniform(0.03, 0.08))),
    Fault("viscous", ("viscous_friction",), lambda d, e, r: _more(d, "viscous_friction", d.kd * r.uniform(0.4, 0.8))),
    Fault("armature", ("armature",), lambda d, e, r: {"armature": d.armature * r.uniform(1.6, 2.5)}),
    Fault(
        "offset",
        ("torque_offset",),
        lambda d, e, r: _more(d, "torque_offset", e * r.choice([-1, 1]) * r.uniform(0.05, 0.1)),
    ),
    Fault("payload", ("payload",), lambda d, e, r: {}),
)


def injected(bench: Bench, fault: Fault, effort: dict[str, float], rng: np.random.Generator) -> tuple[Truth, str]:
    """The robot with a fault, and the joint that has it; effort: largest torque by joint [N.m]."""
    joints = list(bench.drives)
    if fault.name == "payload":
        mass = PAYLOADS[bench.name] * float(rng.uniform(0.7, 1.4))
        return Truth(dict(bench.drives), mass, CENTRES[bench.name]), joints[-1]
    loaded = joints[: JOINTS[bench.name]]
    joint = str(rng.choice(loaded))
    drive = bench.drives[joint]
    changed = replace(drive, **fault.change(drive, effort[joint], rng))  # type: ignore[arg-type]
    return Truth({**bench.drives, joint: changed}), joint
