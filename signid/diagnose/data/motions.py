"""Motions of recordings, with the torque that the simulation predicts for them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any, NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
import pinocchio as pin

from ...deadline import seconds_left
from ...effects.law import law_torque
from ...faults.evidence import PER_UNKNOWN, judge_amount
from ...model import Model
from ...recording.sampling import samples, select_stretches, time_origin
from ...regression.bandwidth import Decimator, lowpass, moving_minimum, smooth
from ...regression.motion import Motion, build_motion, margin
from ...regression.rows import Task
from ...regression.session import Part, Session
from ...types import Array, Law, Robot
from ..thresholds import REST_SPEED, REST_TIME, REVERSAL_TIME_STD

KEPT_SAMPLES = 2**15  # samples of motions that are kept for the next simulation on them: limits memory
PIECE_SAMPLES = 2**14  # samples of a piece at the rate of the rows, at most: limits memory

# Amount of recordings that is used. The work of columns grows with the square of the number of joints.
JOINT_SECONDS = 30_000.0  # [s] duration for one joint, at most. Heuristic
MIN_SECONDS = 120.0  # [s] duration for any robot that the limit above never goes below. Heuristic

# [1] seconds of recordings for one joint per second that is left, so that columns take a third of the time limit.
# Measured: columns of 750 s of recordings for one joint a second (panda, 500 Hz, one core at 3 GHz).
SECONDS_PER_SECOND = 250.0

CHECK_ROWS_FACTOR = 2.0  # [1] rows that recording checks get, over the number that they need. Heuristic
STRETCH_GROWTH = 1.5  # [1] factor by which the stretches grow until there are enough rows
_KNOWN = WeakKeyDictionary[Task, dict[Any, tuple[Motion, Array]]]()  # filtered motions of each task


class Piece(NamedTuple):
    """Consecutive samples of a recording, decimated to a rate that suits the band."""

    recording: int
    motion: Motion  # with predicted torque; recorded torque is low-passed for the laws that use it
    residual: Array  # (N, n) [N.m or N] y: recorded - predicted, not filtered; NaN where no torque is recorded
    origin: float = 0.0  # [s] time stamp from which reports count


def pieces(task: Task, model: Model, recordings: Sequence[Part]) -> Iterator[Piece]:
    """Split recordings into pieces; spans that are too short for the filter of the rows are left out."""
    robot = replace(model.robot, model=bodies_without_rotors(model))
    parts, known = task.parts, _KNOWN.setdefault(task, {})
    edge, half = margin(task.band, task.recorded_derivatives), len(task.band.taps) // 2
    for k, (recording, sampling) in enumerate(recordings):
        origin = time_origin(recording)
        for span in sampling.spans:
            total = sampling.length(span) - 2 * edge
            count = -(-total // (PIECE_SAMPLES * parts))
            cuts = np.linspace(0, total, count + 1).astype(int).tolist() if total > 0 else []
            for start, stop in ((a, b) for a, b in pairwise(cuts) if b - a > 2 * half):
                key = model.robot, (recording, sampling), span, start, stop
                motion, calm = known.get(key) or _filtered(task, *key)
                if len(motion) + sum(len(one) for one, _ in known.values()) <= KEPT_SAMPLES:
                    known[key] = motion, calm
                predicted = model.inverse(motion)
                shown = replace(model.acted(motion), robot=robot, recorded=calm, predicted=predicted)
                yield Piece(k, shown, np.asarray(motion.recorded) - predicted, origin)


def bodies_without_rotors(model: Model) -> pin.Model:
    """Bodies of a simulation with zero rotor inertia: rotors are no load of the transmission."""
    bodies = model.bodies()
    bodies.armature = np.zeros(bodies.nv)
    return bodies


def row_filter(task: Task) -> Decimator:
    """Low-pass filter and decimation from the samples of pieces to rows."""
    return task.band.decimator(task.parts)


def torque_of(law: Law, motion: Motion) -> dict[int, Array]:
    """Torque of a law with all its parameters: per joint (N,) [N.m or N]."""
    rows, torque = law_torque(law, motion)
    return {j: torque[:, k] for k, j in enumerate(rows)}


def standstill(motion: Motion, thin: Decimator, seconds: float = REST_TIME) -> Array:
    """(N, n) [1] 1 where a joint rests for some seconds, or does so within the reach of the filter, else 0."""
    assert motion.slow is not None, "a diagnosed motion has the width of a reversal"
    slow = (np.abs(motion.v) < REST_SPEED * motion.slow).astype(np.float64)
    half = max(1, round(seconds / 2 / motion.dt))
    opened = moving_minimum(slow, half)
    return -moving_minimum(-opened, half + thin.half // 2)


def stated_friction(model: Model) -> Array:
    """(n,) dry friction of each joint in the simulation [N.m or N]."""
    found = np.zeros(len(model.robot.joints))
    for law in (law for law in model.laws if law.effect.reverses and law.effect.scope == "joint"):
        keys = [key for key, kind in law.effect.linear().items() if kind.unit == "N.m"]
        found[law.joints[0]] += max((abs(law.parameters[key]) for key in keys), default=0.0)
    return found


def reversal_uncertainty(thin: Decimator, pieces: Sequence[Piece], dry: Array) -> Array:
    """(M, n) [N.m or N] standard deviation of torque near velocity reversals; dry friction `dry` (n,) [N.m or N].

    The time at which friction changes sign is not observed between samples, nor while dry friction holds the joint.
    """
    turns = (np.gradient(piece.motion.direction, piece.motion.dt, axis=0) for piece in pieces)
    return np.asarray(np.abs(np.concatenate([thin(REVERSAL_TIME_STD * dry * turn) for turn in turns])))


def _filtered(
    task: Task, robot: Robot, part: Part, span: tuple[int, int], start: int, stop: int
) -> tuple[Motion, Array]:
    """Motion from sample `start` to `stop` of a span, and its low-passed torque (N, n) [N.m or N]; 0 where absent."""
    window = samples(*part, span, start, stop + 2 * margin(task.band, task.recorded_derivatives))
    motion = build_motion(robot, window, task.band, part[1].period, task.recorded_derivatives, task.slow)
    if task.parts > 1:  # every `parts`-th sample: positions are in the band already, torque is low-passed first
        low = lowpass(task.band.rate, 0.4 * task.band.rate / task.parts)
        motion = replace(motion, recorded=smooth(np.asarray(motion.recorded), low, whole=True))[:: task.parts]
    calm = lowpass(task.band.rate / task.parts, 2 * task.band.cutoff)
    return motion, np.nan_to_num(smooth(np.asarray(motion.recorded), calm, whole=True))


def subsample(session: Session) -> Session:
    """Cut recordings longer than needed, or than the time limit allows, to evenly spread stretches, with a note."""
    joints = len(session.robot.joints)
    seconds = max(MIN_SECONDS, JOINT_SECONDS / joints**2)
    soon = SECONDS_PER_SECOND * seconds_left() / joints**2
    while soon < seconds:
        amount = judge_amount(session, _cut(session.train, soon))
        if amount.rows >= CHECK_ROWS_FACTOR * PER_UNKNOWN * amount.unknowns:
            break
        soon = STRETCH_GROWTH * max(soon, 1.0)
    seconds = min(seconds, soon)
    train, held_out = (_cut(parts, seconds) for parts in (session.train, session.held_out))
    whole, used = _duration((*session.train, *session.held_out)), _duration(train + held_out)
    if used >= whole:
        return session
    note = f"{used:.0f} s of the {whole:.0f} s of recordings were used, in evenly spread stretches"
    return replace(session, train=train, held_out=held_out, notes=(*session.notes, note))


def _duration(parts: tuple[Part, ...]) -> float:
    return sum(sampling.duration for _, sampling in parts)


def _cut(parts: tuple[Part, ...], seconds: float) -> tuple[Part, ...]:
    """Cut all recordings by the same factor to a total duration [s]."""
    whole = _duration(parts)
    if whole <= seconds:
        return parts
    return tuple((recording, select_stretches(s, seconds * s.duration / whole)) for recording, s in parts)
