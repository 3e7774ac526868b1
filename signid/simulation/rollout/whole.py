"""Roll-outs of whole recordings: started once, at the first samples, and driven by the recorded torque alone."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...effects.base import ActuatorLaw, RecordingLaw, TransmissionLaw
from ...errors import OptionError, shorten
from ...model import Model, ModelSource, as_model, torque_model
from ...recording import Recordings, as_recordings, need_torque
from ...recording.sampling import samples, survey
from ...regression.session import Part
from ...types import Array, Indices, Recording, Result
from ..plant.run import apply_actuators
from .joints import restrict_joints
from .one_joint import one_joint_errors, one_joint_numbers
from .run import STEP, simulate_windows
from .windows import Windows

START = 20  # samples whose line gives the start state; they do not count (EMPS, nonlinearbenchmark.org)


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
    each = as_recordings(recordings, model.robot, "roll_out_whole")
    need_torque(each)
    model, notes = restrict_joints(model, each)
    check_whole(model, each)
    found = [
        (k, windows, position_errors(model, windows)[0])
        for k, recording in enumerate(each)
        for windows in whole_windows(model, (recording, survey(recording, model.robot)))
    ]
    if not found:
        raise OptionError(f"every stretch of the recordings has less than {2 * START} samples; record longer")
    return WholeRollOut(
        joints=model.robot.joints,
        unit=tuple("m" if prismatic else "rad" for prismatic in model.robot.prismatic),
        recording=np.array([k for k, _, _ in found]),
        t=tuple(w.t[0] + w.period * np.arange(START, w.q.shape[1]) for _, w, _ in found),
        error=tuple(error[START - 1 :] for _, _, error in found),
        motion=np.concatenate([w.q[0] for _, w, _ in found]).std(axis=0),
        notes=notes,
    )


def whole_windows(model: Model, part: Part) -> list[Windows]:
    """One window for each stretch of a recording, from its first sample to its last, as they are measured."""
    recording, sampling = part
    out = []
    for span in sampling.spans:
        if (count := sampling.length(span)) < 2 * START:
            continue
        rows, period = samples(recording, sampling, span, 0, count), sampling.period
        (v, q), tail = np.polyfit(period * np.arange(START), rows.q[:START], 1), rows.q[1:]
        parts = max(1, int(np.ceil(period / STEP * (1 - 1e-9))))
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
