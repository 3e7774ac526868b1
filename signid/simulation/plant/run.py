"""Simulation loop: drives, plant and recorded signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...effects.base import ActuatorLaw, RecordingLaw, of_kind
from ...effects.drive import DriveLaw
from ...effects.trial import Trial
from ...errors import OptionError
from ...model import Model, ModelSource, as_model
from ...typed import typed
from ...types import Array, Law, Progress, Result
from .control import Drive, Torques
from .drives import JointDrives, commanded
from .plant import Plant

MOST_STEPS = 5e6  # largest number of steps
MOST_SPEED = 1e4  # [rad/s or m/s] speed from which on a simulation has diverged


@dataclass(frozen=True, eq=False)
class Simulation(Result):
    """Ideal recorded signals of n joints at K instants, and the true motion."""

    joints: tuple[str, ...]
    t: Array  # (K,) [s]
    q: Array  # (K, n) recorded position [rad or m]
    tau: Array  # (K, n) recorded torque [N.m or N]
    desired: Array  # (K, n) desired position [rad or m]
    true_q: Array  # (K, n) of the motors [rad or m]
    true_v: Array  # (K, n) of the motors [rad/s or m/s]
    true_a: Array  # (K, n) of the motors [rad/s2 or m/s2]
    link_q: Array  # (K, n) of the links, behind elastic joints [rad or m]
    applied: Array  # (K, n) torque of the motors [N.m or N]


@typed
def simulate(
    model: ModelSource,
    drive: Drive,
    duration: float,
    *,
    step: float = 1e-3,
    integrator: str = "semi-implicit",
    substeps: int = 0,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a model with all its laws, moved by a drive; signals are recorded without error at each step.

    Recorded torque and acceleration belong to the same instant.

    Args:
        model: rigid bodies and laws of any kind; laws of drives replace gains of a controller at their joint.
        drive: controller, or given torque.
        duration: duration [s].
        step: step of the controller and of the recorded signals [s].
        integrator: `semi-implicit` or `rk4`.
        substeps: sub-steps per step; 0: as many as the stiffest law needs.
        progress: function that is called with the current step and the share of it that is done.

    Raises:
        OptionError: the duration, the step or a law cannot be simulated, or the simulation diverges.
    """
    model = as_model(model, "simulate")
    return simulate_many(
        model, [drive], duration, step=step, integrator=integrator, substeps=substeps, progress=progress
    )[0]


def simulate_many(
    model: Model,
    drives: Sequence[Drive],
    duration: float,
    *,
    step: float = 1e-3,
    integrator: str = "semi-implicit",
    substeps: int = 0,
    progress: Progress | None = None,
) -> list[Simulation]:
    """Simulate copies of a model at the same time, one for each drive; otherwise like `simulate`."""
    t = instants(duration, step)
    plant = Plant(model, step, len(drives), integrator, substeps)
    joints, reading = range(len(model.robot.joints)), model.of(RecordingLaw)
    acting, laws = model.of(ActuatorLaw), model.of(DriveLaw)
    plans = [drive.plan(t) for drive in drives]
    if laws and any(isinstance(drive, Torques) for drive in drives):
        raise OptionError(f"{laws[0].effect.name} acts on commanded positions; give a motion in place of torques")
    asked = np.stack([plan.desired for plan in plans], 1)
    plans = [commanded(laws, t, plan) for plan in plans] if laws else plans
    torque, desired, speed = (np.stack([getattr(p, key) for p in plans], 1) for key in ("torque", "desired", "speed"))
    stiffness, damping = (np.stack([getattr(p, key) for p in plans]) for key in ("stiffness", "damping"))
    motors = JointDrives(laws, stiffness, damping)
    plant.start(*(np.stack(x) for x in zip(*(drive.start() for drive in drives), strict=True)))
    log = np.empty((7, len(t), len(drives), len(joints)))  # seen, q, v, a, link, command, applied
    for k, now in enumerate(t):
        q, v = plant.q, plant.v
        seen = _seen(reading, q)
        command = torque[k] + stiffness * (desired[k] - seen) + damping * (speed[k] - v)
        command = motors.torque(command, seen, v, desired[k], speed[k], torque[k])
        applied = apply_actuators(acting, command)
        log[:3, k], log[4:, k] = (seen, q, v), (plant.link, command, applied)
        plant.advance(float(now), applied)
        log[3, k] = plant.a
        if k % 1000 == 0:
            _check(plant, float(now))
            if progress is not None:
                progress("simulating", k / len(t))
    _check(plant, float(t[-1]))
    late = 0.5 if integrator == "rk4" else (plant.substeps - 1) / (2 * plant.substeps)  # steps
    for row in (3, 5, 6):  # signals that are constant in a step belong to this later instant
        log[row, 1:] += late * (log[row, :-1] - log[row, 1:])
    return [_recorded(model, t, step, log[:, :, b], asked[:, b], reading) for b in range(len(drives))]


def instants(duration: float, step: float) -> Array:
    """Instants (K,) [s] at which steps begin.

    Raises:
        OptionError: there is none, or there are too many.
    """
    if not (np.isfinite(duration) and 0 < step <= duration):
        raise OptionError(f"{duration:g} s in steps of {step:g} s cannot be simulated; give at least one step")
    if duration / step > MOST_STEPS:
        raise OptionError(
            f"the simulation has {duration / step:.3g} steps, more than {MOST_STEPS:.0e}; give a shorter duration or "
            f"longer steps"
        )
    return np.asarray(np.arange(round(duration / step)) * step, dtype=np.float64)


def _seen(reading: Sequence[Law], q: Array) -> Array:
    """Positions (B, n) that the encoders measure."""
    for law in reading:
        j = list(law.joints)
        q = q.copy()
        q[:, j] = of_kind(law.effect, RecordingLaw).recorded_q(Trial(q[:, j]), **law.parameters)
    return q


def apply_actuators(acting: Sequence[Law], command: Array) -> Array:
    """Torque (..., n) that motors with actuator laws apply [N.m or N] at a command (..., n) [N.m or N]."""
    for law in acting:
        j = list(law.joints)
        command = command.copy()
        x = Trial(torque=command[..., j])
        command[..., j] = of_kind(law.effect, ActuatorLaw).applied_torque(x, **law.parameters)
    return command


def _check(plant: Plant, t: float) -> None:
    if not np.all(np.abs(plant.v) < MOST_SPEED):
        raise OptionError(
            f"the simulation diverged within {t:.3g} s; use shorter steps, lower gains, or torque that fits the robot"
        )


def _recorded(model: Model, t: Array, step: float, log: Array, desired: Array, reading: Sequence[Law]) -> Simulation:
    recorded = log[5].copy()
    for law in reading:
        j = list(law.joints)
        x = Trial(log[0][:, j], log[2][:, j], t=t[:, None], dt=step, torque=recorded[:, j], joints=law.joints)
        recorded[:, j] = of_kind(law.effect, RecordingLaw).recorded_torque(x, **law.parameters)
    return Simulation(model.robot.joints, t, log[0], recorded, desired, log[1], log[2], log[3], log[4], log[6])
