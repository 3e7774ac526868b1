"""Logs for viewers: Rerun (.rrd), and MCAP for Foxglove, RViz and PlotJuggler.

A recording with its simulation and diagnosis (`viewer_log`), and a watch, send the same messages to a file of either
kind.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import RecordingError, shorten
from ...model import Model, ModelSource, as_model
from ...recording import Recordings, as_recordings, need_torque
from ...recording.sampling import time_origin
from ...regression.bandwidth import lowpass
from ...simulation.rollout import restrict_joints
from ...typed import typed
from ...types import Array, Frozen, Recording, Robot
from ..replay.marks import headline, marks, read_found
from ..replay.shapes import reach
from ..replay.track import Track, commands_only, follow_commands, predictions, surveyed, with_drives
from .files import FILE_OF_KIND, Head, Links, Remark, Signal, WatchLogs, check_library

if TYPE_CHECKING:
    from ...diagnose import Diagnosis
    from ...servo.diagnose import ServoDiagnosis

__all__ = ["ViewerLog", "WatchLogs", "check_library", "viewer_log"]
MAX_LOG_RATE = 250.0  # [Hz] rate of a log; faster recordings are low-passed and thinned
LOG_CUTOFF_SHARE = 0.4  # [1] cut-off over the rate of a log
PREDICTED_SIGNALS = ("predicted", "extended")  # signals of the given simulation, and of the extended one
RESIDUAL_SIGNALS = ("residual", "residual_extended")  # measured minus these
ROLLOUT_SIGNALS = ("simulated", "simulated_extended")  # positions of roll-outs


@dataclass(frozen=True, eq=False)
class ViewerLog(Frozen):
    """Signals and findings, as `rrd` or `mcap` write them."""

    head: Head
    signals: tuple[Signal, ...]
    remarks: tuple[Remark, ...] = ()  # verdict and findings of the diagnosis, and notes
    drawn: Robot | None = None  # URDF over the joints of the only recording

    def rrd(self) -> bytes:
        """Write a recording of Rerun, which reads the same messages. Its bytes differ from call to call.

        Raises:
            OptionError: rerun-sdk, mcap or rosbags is not installed.
        """
        return self._written("rrd")

    def mcap(self) -> bytes:
        """Write an MCAP file with messages of ROS 2 (JointState, Log, TFMessage).

        Raises:
            OptionError: mcap or rosbags is not installed.
        """
        return self._written("mcap")

    def _written(self, kind: str) -> bytes:
        check_library(kind)
        file = FILE_OF_KIND[kind](out := BytesIO(), self.head)
        for remark in self.remarks:
            file.remark("/findings", remark)
        if self.drawn is not None:
            file.robot(min(float(signal.t[0]) for signal in self.signals), Links(self.drawn))
        file.signals(self.signals)
        file.close()
        return out.getvalue()


@typed
def viewer_log(
    model: ModelSource,
    recordings: Recordings,
    diagnosis: Diagnosis | ServoDiagnosis | str | Path | None = None,
    *,
    rolled: Track | None = None,
) -> ViewerLog:
    """Compute measured, predicted and extended torque, residuals and positions for a viewer.

    Torque is as recorded, at up to 250 Hz; predictions follow the filtered motion. Recordings of commanded positions
    without torque give commanded, measured and simulated positions instead.

    Args:
        model: original simulation.
        recordings: recordings with signed torque, or of commanded positions.
        diagnosis: diagnosis, or its diagnosis.json with model.json in the same folder.
        rolled: motion of a replay of the only recording, whose simulated positions are logged too.

    Raises:
        OptionError: the diagnosis cannot be read.
        RecordingError: a recording cannot be used.
    """
    model = as_model(model, "viewer_log")
    read = as_recordings(recordings, model.robot, "viewer_log")
    findings = None if diagnosis is None else read_found(diagnosis)
    models = [model] if findings is None else [model, findings.after]
    notes, signals = list[str](), list[Signal]()
    for k, recording in enumerate(read, 1):
        folder = "" if len(read) == 1 else f"/{Path(recording.path).name.partition('.')[0] or 'recording'}_{k}"
        signals += _signals(folder, recording, models, rolled, notes)
    origins, name, notes = [time_origin(recording) for recording in read], model.robot.name, list(dict.fromkeys(notes))
    start, remarks = min(float(signal.t[0]) for signal in signals), list[Remark]()
    if findings is not None:  # causes are warnings
        placed = marks(findings, reach(findings.after.robot), origins[0])
        remarks = [Remark(start, headline(findings), bool(placed))]
        for mark in placed:
            at = start if mark.time is None else mark.time[0]
            remarks.append(Remark(at, f"{mark.title}: {'; '.join(mark.lines)}", mark.cause))
    return ViewerLog(
        head=Head(name, name, all(origins), notes),
        signals=tuple(signals),
        remarks=(*remarks, *(Remark(start, f"note: {note}", False) for note in notes)),
        drawn=restrict_joints(model, read)[0].robot if len(read) == 1 and model.robot.kind == "urdf" else None,
    )


def _signals(
    folder: str, recording: Recording, models: Sequence[Model], rolled: Track | None, notes: list[str]
) -> list[Signal]:
    """Signals of a recording; of commands, the closed loops run from these alone."""
    drives = commands_only(recording)
    pairs = [with_drives(x, recording) if drives else restrict_joints(x, [recording]) for x in models]
    restricted = [model for model, _ in pairs]
    notes += [note for _, further in pairs for note in further]
    joints = restricted[0].robot.joints

    def make(name: str, t: Array, **values: Array) -> Signal:
        return Signal(f"{folder}/{name}", joints, t, drawn=name == "measured", **values)

    if drives:
        column, rows = recording.columns["t"][0], len(recording)
        first, last = (float(recording.table.read([column], k, k + 1)[0, 0]) for k in (0, rows - 1))
        track = follow_commands(restricted, recording, None, min(MAX_LOG_RATE, (rows - 1) / max(last - first, 1e-9)))
        assert track.command is not None, "the recording has commands"
        names = ("commanded", "measured", *PREDICTED_SIGNALS[: len(models)], *RESIDUAL_SIGNALS[: len(models)])
        paths = (track.command, track.recorded, *track.simulated, *track.residual)
        return [make(name, track.t, position=path) for name, path in zip(names, paths, strict=True)]
    need_torque([recording])
    signals = _torques(restricted, recording, make, notes)
    for name, path in zip(ROLLOUT_SIGNALS, () if rolled is None else rolled.simulated, strict=False):
        there = np.isfinite(path).all(axis=1)
        if rolled is not None and there.any():
            signals.append(make(name, rolled.t[there], position=path[there]))
    return signals


def _torques(
    models: Sequence[Model], recording: Recording, make: Callable[..., Signal], notes: list[str]
) -> list[Signal]:
    """Signals of a recording of torque."""
    from scipy.ndimage import convolve1d

    read = surveyed(recording, models[0].robot)
    rate = 1 / read.sampling.period
    every = max(1, int(np.ceil(rate / MAX_LOG_RATE - 1e-6)))
    taps = lowpass(rate, LOG_CUTOFF_SHARE * rate / every) if every > 1 else np.ones(1)

    def thinned(x: Array) -> Array:
        return np.asarray((convolve1d(x, taps, axis=0, mode="mirror") if len(taps) > 1 else x)[::every])

    parts = []
    for motion, predicted in predictions(read, models):
        assert motion.recorded is not None, "a recording has torque"
        torque = [motion.recorded, *predicted]
        parts.append((motion.t[::every], *map(thinned, (motion.q, motion.v, *torque))))
    if not parts:
        raise RecordingError(
            f"{recording.path or 'the recording'} has no stretch long enough to log; give a longer one"
        )
    if every > 1:
        notes.append(f"signals are low-passed and thinned to {rate / every:.4g} Hz")
    if silent := [joint for joint, there in zip(recording.joints, read.measured, strict=True) if not there]:
        notes.append(f"no torque of {shorten(silent)} is recorded")
    t, q, v, measured, *predicted = (np.concatenate(x) for x in zip(*parts, strict=True))
    made = [make("measured", t, position=q, velocity=v, effort=measured)]
    made += [make(name, t, effort=x) for name, x in zip(PREDICTED_SIGNALS, predicted, strict=False)]
    return made + [make(name, t, effort=measured - x) for name, x in zip(RESIDUAL_SIGNALS, predicted, strict=False)]
