"""Animation of a recorded robot and its simulation, in Meshcat.

The simulation restarts from the measured state at regular intervals and is driven by the recorded torque. The colour of
a link shows the residual torque of its joint. Findings of a diagnosis are marked.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ...errors import OptionError
from ...model import ModelSource, as_model
from ...recording import as_recording, need_torque
from ...recording.sampling import time_origin
from ...recording.source import Source
from ...simulation.rollout import restrict_joints
from ...typed import typed
from ...types import Array, Recording, Robot, Table
from .live import Live
from .marks import headline, marks, read_found
from .page import Replay
from .shapes import look, reach
from .track import commands_only, follow_commands, movers, poses, track_of, with_drives

if TYPE_CHECKING:
    from ...diagnose import Diagnosis
    from ...servo.diagnose import ServoDiagnosis

__all__ = ["DEFAULT_MAX_DURATION", "Live", "Replay", "part", "replay"]
HORIZON = 0.5  # default length of a roll-out from recorded torque [s]
DEFAULT_MAX_DURATION = 60.0  # default maximum duration [s]
MAX_POSES = 150_000  # maximum number of poses (bodies x frames x robots), about 6 MB


@typed
def replay(
    model: ModelSource,
    recording: Recording | Source,
    diagnosis: Diagnosis | ServoDiagnosis | str | Path | None = None,
    *,
    start: float = 0.0,
    duration: float | None = None,
    horizon: float | None = None,
    fps: float = 30.0,
    package_dirs: Sequence[str | Path] = (),
) -> Replay:
    """Animate the recorded robot and its simulation, which restarts from the measured state after each horizon.

    Args:
        model: original simulation.
        recording: recording with signed torque, or of commanded positions that drive the simulation.
        diagnosis: diagnosis, or its diagnosis.json with model.json in the same folder.
        start: start time after the first row [s].
        duration: duration to show [s]; None: all, at most a minute.
        horizon: length of a roll-out [s]; None: 0.5, or the whole recording with position drives.
        fps: frames a second [Hz].
        package_dirs: folders that hold packages with meshes.

    Raises:
        OptionError: an option is invalid, torque has no sign, or the diagnosis belongs to another robot.
        RecordingError: the recording cannot be used, or is shorter than a horizon.
    """
    model = as_model(model, "replay")
    recording = as_recording(recording, model.robot, "replay")
    drives = commands_only(recording)
    horizon = HORIZON if horizon is None and not drives else horizon
    _check(recording, drives, horizon, fps)
    shown = part(recording, start, DEFAULT_MAX_DURATION if duration is None else duration)
    cut = duration is None and len(shown) < len(recording)
    notes = [f"{len(shown)} of {len(recording)} rows are shown"] if cut else []
    findings = None if diagnosis is None else read_found(diagnosis)
    simulations = [model] if findings is None else [model, findings.after]
    if findings is not None:
        diagnosed = findings.after.robot
        lacking = [joint for joint in diagnosed.joints if joint not in model.robot.joints]
        if diagnosed.model.njoints != model.robot.model.njoints or lacking:
            raise OptionError(
                f"the diagnosis is of {diagnosed.name} with {', '.join(diagnosed.joints)}, not of {model.robot.name}; "
                f"give the simulation that was diagnosed"
            )
    models, more = zip(
        *(with_drives(x, shown) if drives else restrict_joints(x, [shown]) for x in simulations), strict=True
    )
    robot: Robot = models[0].robot
    seen, far = look(robot, package_dirs), reach(robot)
    marked = [] if findings is None else marks(findings, far, time_origin(recording))
    bodies = sorted({*seen.bodies, *(mark.body for mark in marked)})
    span = shown.read(len(shown) - 1).t[0] - shown.read(0, 1).t[0]
    slow = MAX_POSES / (len(bodies) * (1 + drives + len(models)) * max(float(span), 1e-9))
    if slow < fps:
        notes.append(f"{slow:.3g} frames per second instead of {fps:g}, to limit the size of the page")
        fps = slow
    track = follow_commands(models, shown, horizon, fps) if drives else track_of(models, shown, horizon or HORIZON, fps)
    wanted = track.command
    return Replay(
        robot=robot,
        title=f"{robot.name}: {Path(recording.path).name or 'recording'}",
        look=seen,
        bodies=tuple(bodies),
        movers=tuple(movers(robot, bodies)),
        track=track,
        recorded=poses(robot, track.recorded, bodies),
        commanded=None if wanted is None else poses(robot, np.where(np.isnan(wanted), track.recorded, wanted), bodies),
        simulated=np.stack([poses(robot, q, bodies) for q in track.simulated]),
        marks=tuple(marked),
        verdict="" if findings is None else findings.verdict,
        headline="" if findings is None else headline(findings),
        horizon=horizon,
        reach=far,
        origin=time_origin(recording),
        notes=tuple(dict.fromkeys((*notes, *seen.notes, *(note for further in more for note in further)))),
    )


def _check(recording: Recording, drives: bool, horizon: float | None, fps: float) -> None:
    if not drives:
        need_torque([recording])
    if not 0 < fps <= 240:
        raise OptionError(f"{fps:g} frames a second cannot be shown; give a rate above 0 and up to 240 Hz")
    if horizon is not None and not 0 < horizon < float("inf"):
        raise OptionError(f"a horizon of {horizon:g} s is invalid; give one above 0 s, such as 0.5")
    unsigned = [joint for joint, signed in zip(recording.joints, recording.signed, strict=True) if not signed]
    if unsigned:
        raise OptionError(
            f"the torque of {', '.join(unsigned)} has no sign and cannot drive a simulation; "
            f"give the signed.csv that `signid identify` or `signid diagnose` writes"
        )


@dataclass(frozen=True)
class _Rows:
    """Consecutive rows of a table."""

    table: Table
    first: int
    rows: int

    @property
    def columns(self) -> tuple[str, ...]:
        return self.table.columns

    def read(self, names: Sequence[str], start: int, stop: int) -> Array:
        """Rows start..stop, (stop - start, len(names)) [units of the columns]."""
        return self.table.read(names, self.first + start, min(self.first + stop, self.first + self.rows))


def part(recording: Recording, start: float, duration: float) -> Recording:
    """Select the rows of a time window [s] after the first row; only time stamps are read.

    Raises:
        OptionError: the recording ends before the window, or the duration is invalid.
    """
    name, rows = recording.path or "the recording", len(recording)
    column = recording.columns["t"][0]

    def time(row: int) -> float:
        return float(recording.table.read([column], row, row + 1)[0, 0])

    if not (start >= 0 and duration > 0 and duration < float("inf")):
        advice = "give a start from 0 s on and a duration above 0 s"
        raise OptionError(f"{duration:g} s from {start:g} s on cannot be shown; {advice}")
    first, last = time(0), time(rows - 1)
    if start > 0 and not first + start < last:
        raise OptionError(f"{name} lasts {last - first:.4g} s, and has no rows from {start:g} s on; start earlier")
    low = bisect_left(range(rows), first + start, key=time) if start > 0 else 0
    high = bisect_right(range(rows), first + start + duration, key=time)
    return recording if high - low >= rows else replace(recording, table=_Rows(recording.table, low, high - low))
