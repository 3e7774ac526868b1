"""Errors of windows simulated as a whole, or one joint at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin
from numba import njit

from ..effects.base import ActuatorLaw, BodyLaw, RecordingLaw, TransmissionLaw
from ..errors import OptionError, shorten
from ..model import Model, ModelSource, as_model, torque_model
from ..recording import Recordings, as_recordings, need_torque
from ..recording.sampling import samples, survey
from ..regression.session import Part
from ..robot import configuration
from ..robot.dynamics import joint_inertia
from ..types import Array, Indices, Recording, Result
from .plant.plant import apply_actuators
from .rollout import MAX_ROLLOUT_STEP, Windows, restrict_joints, simulate_windows

(
    INERTIA,
    CONSTANT,
    SINE,
    COSINE,
    FORWARD,
    BACKWARD,
    DRY_FORWARD,
    DRY_BACKWARD,
    QUADRATIC,
    STRIBECK,
    SPEED,
    STIFFNESS,
    WAVE_SINE,
    WAVE_COSINE,
    WAVE,
    RIPPLE_SINE,
    RIPPLE_COSINE,
    RIPPLE,
    COUNT,
) = range(19)  # numbers of a joint, in SI units
# where the coefficients of a law are added, each to one number or several, and its shape parameters
SLOTS: Mapping[str, tuple[tuple[tuple[int, ...], ...], Mapping[str, int]]] = {
    "viscous_friction": (((FORWARD, BACKWARD),), {}),
    "coulomb_friction": (((DRY_FORWARD, DRY_BACKWARD),), {}),
    "asymmetric_friction": (((FORWARD,), (BACKWARD,), (DRY_FORWARD,), (DRY_BACKWARD,)), {}),
    "torque_offset": (((CONSTANT,),), {}),
    "quadratic_friction": (((QUADRATIC,),), {}),
    "spring": (((STIFFNESS,), (CONSTANT,)), {}),
    "stribeck_friction": (((STRIBECK,),), {"velocity": SPEED}),
    "position_friction": (((WAVE_SINE,), (WAVE_COSINE,)), {"frequency": WAVE}),
    "torque_ripple": (((RIPPLE_SINE,), (RIPPLE_COSINE,)), {"frequency": RIPPLE}),
}
START_SAMPLES = 20  # samples whose line gives the start state; they do not count (EMPS, nonlinearbenchmark.org)


def one_joint_numbers(model: Model) -> Array | None:
    """Numbers (COUNT,) of a model with one plain joint whose laws are all known here; else None."""
    robot = model.robot
    if len(robot.joints) != 1 or np.count_nonzero(robot.drive) != 1:
        return None
    laws = [law for law in model.laws if not isinstance(law.effect, BodyLaw | ActuatorLaw)]
    shaped = [law.effect.name for law in laws if law.effect.name in SLOTS and SLOTS[law.effect.name][1]]
    if any(law.effect.name not in SLOTS for law in laws) or len(set(shaped)) < len(shaped):
        return None
    bodies, out = model.bodies(), np.zeros(COUNT)
    data, drive = bodies.createData(), robot.drive[:, 0]
    at = configuration(robot, np.array([[0.0], [np.pi / 2], [np.pi], [-np.pi / 2]]))
    out[INERTIA] = joint_inertia(replace(robot, model=bodies), pin.crba(bodies, data, at[0]))[0, 0]
    weight = [float(pin.computeGeneralizedGravity(bodies, data, q) @ drive) for q in at]
    if robot.prismatic[0]:
        out[CONSTANT] = weight[0]
    else:  # a wave of the angle
        out[SINE], out[COSINE] = (weight[1] - weight[3]) / 2, (weight[0] - weight[2]) / 2
    out[SPEED] = 1.0
    for law in laws:
        places, shapes = SLOTS[law.effect.name]
        for slots, value in zip(places, law.effect.coefficients(law.parameters), strict=True):
            out[list(slots)] += value
        for key, slot in shapes.items():
            out[slot] = law.parameters[key]
    return out


def one_joint_errors(numbers: Array, windows: Windows) -> Array:
    """Simulated minus measured positions (W, S, 1) [rad or m] after each sample.

    Args:
        numbers: (COUNT,) [SI] of `one_joint_numbers`.
        windows: of the joint.
    """
    out = np.empty((len(windows.t), windows.torque.shape[1]))
    _simulate(
        numbers,
        windows.step,
        np.ascontiguousarray(windows.q[:, 0, 0]),
        np.ascontiguousarray(windows.v[:, 0, 0]),
        np.ascontiguousarray(windows.torque[:, :, 0]),
        out,
    )
    return np.asarray(out[:, windows.parts - 1 :: windows.parts] - windows.q[:, 1:, 0])[..., None]


@njit(cache=True, error_model="numpy")
def _simulate(p, h, q0, v0, torque, out):  # type: ignore[no-untyped-def]
    """Positions out (W, S) after each step of h [s]; q0, v0 (W,), torque (W, S); numbers p (COUNT,)."""
    for w in range(len(q0)):
        q, v = q0[w], v0[w]
        for k in range(torque.shape[1]):
            half = q + 0.5 * h * v
            force = torque[w, k] - p[CONSTANT] - p[STIFFNESS] * half
            if p[SINE] != 0.0 or p[COSINE] != 0.0:
                force -= p[SINE] * np.sin(half) + p[COSINE] * np.cos(half)
            if p[RIPPLE_SINE] != 0.0 or p[RIPPLE_COSINE] != 0.0:
                force -= p[RIPPLE_SINE] * np.sin(p[RIPPLE] * half) + p[RIPPLE_COSINE] * np.cos(p[RIPPLE] * half)
            dry = 0.0
            if p[STRIBECK] != 0.0:
                dry += p[STRIBECK] * np.exp(-((v / p[SPEED]) ** 2))
            if p[WAVE_SINE] != 0.0 or p[WAVE_COSINE] != 0.0:
                dry += p[WAVE_SINE] * np.sin(p[WAVE] * half) + p[WAVE_COSINE] * np.cos(p[WAVE] * half)
            damping = p[FORWARD] if v > 0.0 or (v == 0.0 and force > 0.0) else p[BACKWARD]
            share = 0.5 * h * (damping + p[QUADRATIC] * abs(v)) / p[INERTIA]
            free = v * (1.0 - share) + h * force / p[INERTIA]
            high, low = h * (p[DRY_FORWARD] + dry) / p[INERTIA], -h * (p[DRY_BACKWARD] + dry) / p[INERTIA]
            if free > high:
                after = (free - high) / (1.0 + share)
            elif free < low:
                after = (free - low) / (1.0 + share)
            else:
                after = 0.0
            q, v = half + 0.5 * h * after, after
            out[w, k] = q


@dataclass(frozen=True, eq=False)
class WholeRollOut(Result):
    """Simulations of whole stretches without gaps, under recorded torque held from each sample to the next.

    `error` is simulated minus measured position. It is infinite if the simulation diverged.
    """

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # rad or m, one per joint
    recording: Indices  # (R,) number of the recording of each stretch
    t: tuple[Array, ...]  # R times (N,) [s]
    error: tuple[Array, ...]  # R errors (N, n) [rad or m], without the first samples
    motion: Array  # (n,) [rad or m] standard deviation of the recorded positions
    notes: tuple[str, ...] = ()

    @property
    def rms(self) -> Array:
        """Root mean square (n,) [rad or m] of the error over all samples."""
        return np.asarray(np.sqrt(np.mean(np.concatenate(self.error) ** 2, axis=0)))

    @property
    def seconds(self) -> float:
        """Length of the longest simulation [s]."""
        return float(max(t[-1] - t[0] for t in self.t))


def roll_out_whole(model: ModelSource, recordings: Recordings) -> WholeRollOut:
    """Errors of a model that is simulated over whole recordings, open loop under recorded torque.

    Each stretch without a gap starts at the state that a line through its first samples gives.

    Args:
        model: any model without elastic joints and without laws of the recording, such as a delay.
        recordings: one or several with signed torque of all joints.

    Raises:
        OptionError: the model has such a law, or torque is missing or without its sign.
        RecordingError: a recording cannot be used.
    """
    model = torque_model(as_model(model, "roll_out_whole"))
    read = as_recordings(recordings, model.robot, "roll_out_whole")
    need_torque(read)
    model, notes = restrict_joints(model, read)
    check_whole(model, read)
    found = [
        (k, windows, position_errors(model, windows)[0])
        for k, recording in enumerate(read)
        for windows in whole_windows(model, (recording, survey(recording, model.robot)))
    ]
    if not found:
        raise OptionError(f"every stretch of the recordings has less than {2 * START_SAMPLES} samples; record longer")
    return WholeRollOut(
        joints=model.robot.joints,
        unit=tuple("m" if prismatic else "rad" for prismatic in model.robot.prismatic),
        recording=np.array([k for k, _, _ in found]),
        t=tuple(w.t[0] + w.period * np.arange(START_SAMPLES, w.q.shape[1]) for _, w, _ in found),
        error=tuple(error[START_SAMPLES - 1 :] for _, _, error in found),
        motion=np.concatenate([w.q[0] for _, w, _ in found]).std(axis=0),
        notes=notes,
    )


def whole_windows(model: Model, part: Part) -> list[Windows]:
    """One window for each stretch of a recording, from its first sample to its last, as they are measured."""
    recording, sampling = part
    out = []
    for span in sampling.spans:
        if (count := sampling.length(span)) < 2 * START_SAMPLES:
            continue
        rows, period = samples(recording, sampling, span, 0, count), sampling.period
        (v, q), tail = np.polyfit(period * np.arange(START_SAMPLES), rows.q[:START_SAMPLES], 1), rows.q[1:]
        parts = max(1, int(np.ceil(period / MAX_ROLLOUT_STEP * (1 - 1e-9))))
        torque = apply_actuators(model.of(ActuatorLaw), rows.tau[:-1])
        out.append(
            Windows(
                t=rows.t[:1],
                period=period,
                step=period / parts,
                parts=parts,
                q=np.concatenate([q[None], tail])[None],
                v=np.repeat(v[None], count, axis=0)[None],
                torque=np.repeat(torque, parts, axis=0)[None],
                flex=np.empty((2, 1, 0)),
                before=np.repeat(v[None], 1, axis=0)[None],
                measured=np.ones(len(v), dtype=bool),
                origin=sampling.origin,
            )
        )
    return out


def position_errors(model: Model, windows: Windows) -> Array:
    """Simulated minus measured positions (W, S, n) [rad or m]: compiled for one joint with laws known there."""
    numbers = one_joint_numbers(model) if windows.measured.all() else None
    return simulate_windows(model, windows) if numbers is None else one_joint_errors(numbers, windows)


def check_whole(model: Model, recordings: Sequence[Recording]) -> None:
    """Refuse what a simulation of measured samples alone cannot start or drive.

    Raises:
        OptionError: the model has laws of the recording or elastic joints, or torque lacks a column or its sign.
    """
    laws = [law.effect.name for law in model.laws if isinstance(law.effect, RecordingLaw | TransmissionLaw)]
    if laws:
        raise OptionError(
            f"a roll-out of a whole recording cannot undo {shorten(laws)}; give a horizon in seconds instead"
        )
    for recording in recordings:
        name = recording.path or "the recording"
        columns = zip(recording.joints, recording.columns["tau"], recording.signed, strict=True)
        if lacking := [joint for joint, column, signed in columns if not (column and signed)]:
            raise OptionError(
                f"{name} has no signed torque of {shorten(lacking)}; a roll-out of the whole recording needs it"
            )
