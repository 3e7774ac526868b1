"""Recordings of servos -> audit, joint by joint, without a model of the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...errors import RecordingError
from ...types import Recording, Robot, Samples
from ..plant.content import content_rate
from .faults import (
    command_noise,
    command_period,
    driven_by_error,
    held_share,
    jumps,
    quantum,
    rms_speed,
    saturated_share,
    turn_of,
    unwrapped,
)
from .response import UNKNOWN, find_response
from .rest import at_rest
from .result import JointAudit, ServoAudit
from .sentences import COARSE, judge_joint, judge_limits, judge_stamps, judge_still
from .tracks import BRIEFEST, Part, RowClock, cut, driven, joined, on_grid, read_samples, read_stamps

PLACES = ("q", "command")
SLOWEST_GRID = 1e-3  # [s] shortest period of the grid


def audit_servos(recordings: Recording | Sequence[Recording], units: Mapping[str, str] | None = None) -> ServoAudit:
    """Audit how joints follow their commanded positions; a description of the robot is not needed.

    Args:
        recordings: one or several recordings with q_J and q_des_J of the same robot.
        units: unit of the positions of each joint, "" if unknown; rad where not given.

    Raises:
        RecordingError: no joint has a commanded position, or there are too few rows.
    """
    given = [recordings] if isinstance(recordings, Recording) else list(recordings)
    read = [(recording, read_samples(recording)) for recording in given]
    clocks = [_clock(samples) for _, samples in read]
    names = dict.fromkeys(joint for recording in given for joint in _commanded(recording))
    if not names:
        source = given[0].path or "the recording"
        raise RecordingError(f"{source} has no commanded position of a joint that it records; add columns q_des_J")
    parts = {joint: _parts(joint, read, clocks) for joint in names}
    coarsest = max((quantum(each) for each in parts.values() if each), default=0.0)
    periods = [clock.period for clock in clocks if np.isfinite(clock.period)]
    audits = [
        _audit(joint, (units or {}).get(joint, "rad"), each, float(np.median(periods)), coarsest)
        for joint, each in parts.items()
        if each
    ]
    silent = [joint for joint, each in parts.items() if not each]
    notes = [note for recording in given for note in recording.notes]
    stamps = list(judge_stamps(given, clocks))
    if not audits:
        advice = "check the stamps, on_J and empty cells"
        stamps.append(f"no joint has a position and a command for {BRIEFEST:g} s without a gap; {advice}")
    elif all(not len(np.unique(joined(each, key))) > 1 for each in parts.values() if each for key in PLACES):
        stamps.append("no command changes and no joint moves; record a motion that q_des_J commands")
    if audits and silent:
        notes.append(f"commanded nowhere long enough, and not audited: {', '.join(silent)}")
    return ServoAudit(
        tuple(audits),
        tuple(given),
        tuple(1 / clock.period for clock in clocks),
        tuple(clock.duration for clock in clocks),
        tuple(clock.uneven for clock in clocks),
        tuple(content_rate(samples.t, samples.q) for _, samples in read),
        tuple(stamps),
        tuple(dict.fromkeys(notes)),
        tuple(clock.stretches for clock in clocks),
        tuple(clock.rows for clock in clocks),
    )


def audit_flags(robot: Robot, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Faults of recordings of a robot, each audited alone; one sentence each, with the file's name if there are more.

    Recordings without a commanded position have none.
    """
    units = {joint: "m" if slides else "rad" for joint, slides in zip(robot.joints, robot.prismatic, strict=True)}
    found: list[str] = []
    for recording in recordings:
        faults = audit_servos(recording, units).faults if _commanded(recording) else ()
        name = recording.path if len(recordings) > 1 else ""
        found += [said if not name or said.startswith(name) else f"{name}: {said}" for said in faults]
    return tuple(dict.fromkeys(found))


def _commanded(recording: Recording) -> list[str]:
    columns = recording.columns.get("q_des", ())
    return [joint for joint, column in zip(recording.joints, columns, strict=True) if column] if any(columns) else []


def _clock(samples: Samples) -> RowClock:
    rows = np.any([driven(samples, j) for j in range(samples.q.shape[1])], axis=0)
    return read_stamps(samples.t, rows)


def _parts(joint: str, read: Sequence[tuple[Recording, Samples]], clocks: Sequence[RowClock]) -> list[Part]:
    parts = []
    for (recording, samples), clock in zip(read, clocks, strict=True):
        if joint in _commanded(recording) and np.isfinite(clock.period):
            j = recording.joints.index(joint)
            parts += cut(samples, j, driven(samples, j), clock.period)
    return parts


def _audit(joint: str, unit: str, parts: Sequence[Part], period: float, coarsest: float) -> JointAudit:
    """Audit one joint; period of the rows [s], coarsest: largest step of an encoder [rad or m]."""
    given, turn = parts, turn_of(jumps(parts)[1], unit)
    parts = [unwrapped(part, turn) for part in given] if turn else given
    q, command = joined(parts, "q"), joined(parts, "command")
    step, span = quantum(parts), float(np.ptp(command))
    grids = [on_grid(part, max(period, SLOWEST_GRID)) for part in parts]
    moved = span > 0 and float(np.ptp(q)) > 0
    found = find_response(grids) if moved else None
    answer = (found or UNKNOWN)._asdict()
    del answer["correlation"]
    rest = at_rest(parts, answer["lag"], step, max(span, 1e-12))
    audit = JointAudit(
        joint=joint,
        unit=unit,
        samples=len(q),
        range=span,
        zero=float(np.mean(command - q)),
        error=float(np.sqrt(np.mean((command - q) ** 2))),
        speed=rms_speed(grids),
        saturated=saturated_share(parts, grids),
        command_period=command_period(parts),
        command_noise=command_noise(grids),
        held=held_share(parts, step),
        quantum=step,
        **answer,
        **rest._asdict(),
    )
    limits: tuple[str, ...] = ()
    if span > COARSE * max(step, coarsest):
        limits = tuple(judge_limits(audit))
        said = judge_joint(audit, found, given, period, driven_by_error(grids) if moved else 0.0)
    else:
        said = judge_still(audit, parts)
    return replace(audit, flags=tuple(said), limits=limits)
