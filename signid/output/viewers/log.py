"""Signals of recordings and models over time, and findings, for viewers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import RecordingError, shorten
from ...model import Model, ModelSource, as_model
from ...recording import Recordings, as_recordings, need_torque
from ...recording.sampling import time_origin
from ...regression.bandwidth import lowpass
from ...simulation.rollout.windows import restrict_joints
from ...typed import typed
from ...types import Array, Recording
from ..replay.drives import commands_only, follow_commands, with_drives
from ..replay.marks import Mark, ReplayFindings, drive_marks, headline, marks, read_found
from ..replay.shapes import reach
from ..replay.track import Track, predictions, surveyed
from .needed import check_library
from .signals import MODELS, RESIDUALS, ROLLED, LogContent, LoggedRecording, LoggedSignal

if TYPE_CHECKING:
    from ...diagnose import Diagnosis
    from ...servo.diagnose import ServoDiagnosis

FASTEST = 250.0  # [Hz] rate of a log; faster recordings are low-passed and thinned
SHARE = 0.4  # [1] cut-off over the rate of a log


@dataclass(frozen=True, eq=False)
class ViewerLog(LogContent):
    """Signals and findings, as `rrd` or `mcap` write them."""

    def rrd(self) -> bytes:
        """Write a recording of Rerun. Its bytes differ from call to call, since Rerun numbers its chunks by the clock.

        Raises:
            OptionError: rerun-sdk is not installed.
        """
        check_library("rrd")
        from .rerun_ import write_rrd

        return write_rrd(self)

    def mcap(self) -> bytes:
        """Write an MCAP file with messages of ROS 2 (JointState, DiagnosticArray, TFMessage).

        Raises:
            OptionError: mcap or rosbags is not installed.
        """
        check_library("mcap")
        from .mcap_ import write_mcap

        return write_mcap(self)


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
    found = None if diagnosis is None else read_found(diagnosis)
    models = [model] if found is None else [model, found.after]
    notes: list[str] = []
    names = _names(read)
    logged = tuple(_logged(name, each, models, rolled, notes) for name, each in zip(names, read, strict=True))
    origins = [time_origin(each) for each in read]
    return ViewerLog(
        robot=model.robot.name,
        recordings=logged,
        marks=() if found is None else _marks(found, origins[0]),
        headline="" if found is None else headline(found.after.robot, found),
        dated=all(origins),
        notes=tuple(dict.fromkeys(notes)),
        drawn=restrict_joints(model, read)[0].robot if len(read) == 1 else None,
    )


def _marks(found: ReplayFindings, origin: float) -> tuple[Mark, ...]:
    robot = found.after.robot
    placed = marks(robot, found.findings, reach(robot), origin)
    return (*placed, *drive_marks(robot, found.drives))


def _names(recordings: Sequence[Recording]) -> list[str]:
    """Name of each recording by its file; empty for a single one."""
    if len(recordings) == 1:
        return [""]
    stems = [Path(each.path).name.partition(".")[0] or "recording" for each in recordings]
    return [stem if stems.count(stem) == 1 else f"{stem}_{k + 1}" for k, stem in enumerate(stems)]


def _logged(
    name: str, recording: Recording, models: Sequence[Model], rolled: Track | None, notes: list[str]
) -> LoggedRecording:
    drives = commands_only(recording)
    prepare = with_drives if drives else lambda model, each: restrict_joints(model, [each])
    restricted, more = zip(*(prepare(model, recording) for model in models), strict=True)
    notes += [note for each in more for note in each]
    if drives:
        signals = _driven(restricted, recording)
    else:
        need_torque([recording])
        signals = [*_torques(restricted, recording, notes), *_rolled(rolled)]
    return LoggedRecording(name, restricted[0].robot.joints, tuple(signals))


def _torques(models: Sequence[Model], recording: Recording, notes: list[str]) -> list[LoggedSignal]:
    """Signals of a recording of torque."""
    from scipy.ndimage import convolve1d

    read = surveyed(recording, models[0].robot)
    rate = 1 / read.sampling.period
    every = max(1, int(np.ceil(rate / FASTEST - 1e-6)))
    taps = lowpass(rate, SHARE * rate / every) if every > 1 else np.ones(1)

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
    made = [LoggedSignal("measured", t, q, v, measured)]
    made += [LoggedSignal(name, t, effort=x) for name, x in zip(MODELS, predicted, strict=False)]
    return made + [LoggedSignal(name, t, effort=measured - x) for name, x in zip(RESIDUALS, predicted, strict=False)]


def _rolled(track: Track | None) -> list[LoggedSignal]:
    """Simulated positions of a replay, in the frames that have one."""
    found = []
    for name, path in zip(ROLLED, () if track is None else track.simulated, strict=False):
        assert track is not None, "there is a path"
        there = np.isfinite(path).all(axis=1)
        if there.any():
            found.append(LoggedSignal(name, track.t[there], path[there]))
    return found


def _driven(models: Sequence[Model], recording: Recording) -> list[LoggedSignal]:
    """Signals of a recording of commands: the closed loops run from the commands alone."""
    column = recording.columns["t"][0]
    first, last = (float(recording.table.read([column], k, k + 1)[0, 0]) for k in (0, len(recording) - 1))
    rate = min(FASTEST, (len(recording) - 1) / max(last - first, 1e-9))
    track = follow_commands(models, recording, None, rate)
    made = [LoggedSignal("commanded", track.t, track.command), LoggedSignal("measured", track.t, track.recorded)]
    made += [LoggedSignal(name, track.t, path) for name, path in zip(MODELS, track.simulated, strict=False)]
    return made + [LoggedSignal(name, track.t, x) for name, x in zip(RESIDUALS, track.residual, strict=False)]
