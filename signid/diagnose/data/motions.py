"""Recordings -> motions with the torque that the simulation predicts for them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ...deadline import seconds_left
from ...effects.law import law_torque
from ...model import Model
from ...recording.sampling import samples, select_stretches
from ...recording_faults.limits import PER_UNKNOWN, judge_amount
from ...regression.bandwidth import Band
from ...regression.filters import Decimator, lowpass, smooth
from ...regression.motion import Motion, build_motion, margin
from ...regression.rows import Task
from ...regression.session import Part, Session
from ...types import Array, Law, Robot

LATE = 0.006  # [s] by which a reversal is sensed too early or too late
LONG = 2**14  # samples at a time


MOST, LEAST = 30_000.0, 120.0  # [s] of recordings for one joint (its columns grow as joints squared), and for any robot

# [1] seconds of recordings for one joint per second that is left: columns take a third of the time limit. Measured:
# columns of 750 s of recordings for one joint a second (panda, 500 Hz, one core at 3 GHz)
SHARE = 250.0

SPARE, MORE = 2.0, 1.5  # times the rows that gross checks need at least; factor by which the stretches grow to get them


class Piece(NamedTuple):
    """Consecutive samples of a recording, at a rate that is enough for its band."""

    recording: int
    motion: Motion  # as it was, with predicted torque; recorded torque is low-passed, for laws that look at it
    residual: Array  # (N, n) [N.m or N] measured - predicted, not filtered; NaN where no torque is recorded


def pieces(task: Task, model: Model, recordings: Sequence[Part]) -> Iterator[Piece]:
    """All spans of recordings that are long enough for the filter of the rows, long ones cut.

    Args:
        task: gives the band and the width of a reversal.
        model: the simulation.
        recordings: and their sampling.
    """
    robot = replace(model.robot, model=bodies_of(model))
    edge, half = margin(task.band, task.recorded_derivatives), len(task.band.taps) // 2
    parts = task.parts
    for k, (recording, sampling) in enumerate(recordings):
        for span in sampling.spans:
            total = sampling.length(span) - 2 * edge
            count = -(-total // (LONG * parts))
            cuts = np.linspace(0, total, count + 1).astype(int).tolist() if total > 0 else []
            for start, stop in ((a, b) for a, b in pairwise(cuts) if b - a > 2 * half):
                window = samples(recording, sampling, span, start, stop + 2 * edge)
                motion = build_motion(
                    model.robot, window, task.band, sampling.period, task.recorded_derivatives, task.slow
                )
                yield _piece(task, model, _thinned_motion(motion, task.band, parts), robot, k)


def bodies_of(model: Model) -> pin.Model:
    """The bodies of a simulation without rotors, which are no load."""
    bodies = model.bodies()
    bodies.armature = np.zeros(bodies.nv)
    return bodies


def row_filter(task: Task) -> Decimator:
    """The low-pass that makes rows of the samples of pieces."""
    return task.band.decimator(task.parts)


def _thinned_motion(motion: Motion, band: Band, parts: int) -> Motion:
    """Every so manieth sample: positions lie in the band already, torque passes a low-pass first."""
    if parts == 1:
        return motion
    assert motion.recorded is not None, "windows carry torque"
    calm = smooth(motion.recorded, lowpass(band.rate, 0.4 * band.rate / parts), whole=True)
    return replace(motion, recorded=calm)[::parts]


def thinned(thin: Decimator, columns: Sequence[Mapping[int, Array]]) -> dict[int, Array]:
    """Per joint, rows (M, k) [torque per coefficient] of columns that were made at full rate.

    Args:
        thin: the low-pass of columns and torque.
        columns: piece by piece, per joint (N, k) [torque per coefficient].
    """
    return {j: np.concatenate([thin(made[j]) for made in columns]) for j in columns[0]}


def torque_of(law: Law, motion: Motion) -> dict[int, Array]:
    """Per joint, (N,) [N.m or N] what a law with all its numbers adds."""
    rows, torque = law_torque(law, motion)
    return {j: torque[:, k] for k, j in enumerate(rows)}


def torque_rows(thin: Decimator, pieces: Sequence[Piece], law: Law) -> dict[int, Array]:
    """Per joint, (M,) [N.m or N] what a law with all its numbers adds to the rows of some pieces."""
    made = [{j: x[:, None] for j, x in torque_of(law, piece.motion).items()} for piece in pieces]
    return {j: x[:, 0] for j, x in thinned(thin, made).items()}


def unsure_rows(thin: Decimator, pieces: Sequence[Piece], dry: Array) -> Array:
    """(M, n) [N.m or N] how unsure torque is where a joint reverses, since the moment of its reversal is.

    Between samples, and while dry friction holds the joint still, nothing tells when friction turns.

    Args:
        thin: the low-pass of columns and torque.
        pieces: with the motion.
        dry: (n,) dry friction of each joint [N.m or N].
    """
    turns = (np.gradient(piece.motion.direction, piece.motion.dt, axis=0) for piece in pieces)
    return np.asarray(np.abs(np.concatenate([thin(LATE * dry * turn) for turn in turns])))


def _piece(task: Task, model: Model, motion: Motion, robot: Robot, k: int) -> Piece:
    predicted = model.inverse(motion)
    acted, recorded = model.acted(motion), motion.recorded
    assert recorded is not None, "windows carry torque"
    calm = smooth(recorded, lowpass(task.band.rate / task.parts, 2 * task.band.cutoff), whole=True)
    shown = replace(acted, robot=robot, recorded=np.nan_to_num(calm), predicted=predicted)
    return Piece(k, shown, recorded - predicted)


def enough(session: Session) -> Session:
    """The session with recordings cut to evenly spread stretches where they are longer than needed, and a note of it.

    Recordings that a time limit leaves no time for are longer than needed.
    """
    joints = len(session.robot.joints)
    seconds = max(LEAST, MOST / joints**2)
    soon = SHARE * seconds_left() / joints**2
    while soon < seconds and not _suffices(session, _cut(session.train, soon)):
        soon = MORE * max(soon, 1.0)
    seconds = min(seconds, soon)
    train, held_out = (_cut(parts, seconds) for parts in (session.train, session.held_out))
    whole, used = (
        sum(s.duration for _, s in parts) for parts in ((*session.train, *session.held_out), train + held_out)
    )
    if used >= whole:
        return session
    note = f"of {whole:.0f} s that were recorded {used:.0f} s were used, in stretches that are evenly spread"
    return replace(session, train=train, held_out=held_out, notes=(*session.notes, note))


def _suffices(session: Session, parts: tuple[Part, ...]) -> bool:
    amount = judge_amount(session, parts)
    return amount.rows >= SPARE * PER_UNKNOWN * amount.unknowns


def _cut(parts: tuple[Part, ...], seconds: float) -> tuple[Part, ...]:
    """Each recording by as much."""
    whole = sum(sampling.duration for _, sampling in parts)
    if whole <= seconds:
        return parts
    return tuple((recording, select_stretches(s, seconds * s.duration / whole)) for recording, s in parts)
