"""Recordings of servos -> audit, joint by joint, without a model of the robot."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...types import Recording, Robot, Samples
from ..result import JointAudit, ServoAudit
from .episodes import Odd, group, odd_episodes
from .logs import (
    COARSE,
    command_noise,
    command_period,
    held_share,
    judge_joint,
    judge_limits,
    judge_stamps,
    judge_still,
    jumps,
    quantum,
    rms_speed,
    saturated_share,
    turn_of,
    unwrapped,
)
from .response import UNKNOWN, at_rest, find_response
from .rows import BRIEFEST, Part, RowClock, content_rate, cut, driven, joined, on_grid, read_samples, read_stamps

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
    units = units or {}
    tracks = _read(given)
    if not tracks.parts:
        source = given[0].path or "the recording"
        raise RecordingError(f"{source} has no commanded position of a joint that it records; add columns q_des_J")
    read, clocks, parts = tracks
    coarsest = max((quantum(each) for each in parts.values() if each), default=0.0)
    odd = _odd_episodes(given, tracks, units)
    audits = [
        _audit(joint, units.get(joint, "rad"), each, tracks.period, coarsest, odd)
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
        tuple(content_rate(samples.t, samples.q) for samples in read),
        tuple(stamps),
        tuple(dict.fromkeys(notes)),
        tuple(clock.stretches for clock in clocks),
        tuple(clock.rows for clock in clocks),
    )


def audit_flags(robot: Robot, recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Faults of recordings of a robot, each audited alone and then beside the others; one sentence each.

    Sentences begin with the file's name if there is more than one. Recordings without a commanded position have none.
    """
    units = {joint: "m" if slides else "rad" for joint, slides in zip(robot.joints, robot.prismatic, strict=True)}
    found: list[str] = []
    commanded = [recording for recording in recordings if _commanded(recording)]
    audits = [audit_servos(recording, units) for recording in commanded]
    for recording, audit in zip(commanded, audits, strict=True):
        name = recording.path if len(recordings) > 1 else ""
        found += [said if not name or said.startswith(name) else f"{name}: {said}" for said in audit.faults]
    faulty = [{joint.joint for joint in audit.joints if joint.flags} for audit in audits]
    odd = _odd_episodes(commanded, _read(commanded), units) if len(commanded) > 1 else ()
    found += [one.said for one in odd if one.joint not in faulty[one.episode.parts[0].recording]]
    return tuple(dict.fromkeys(found))


class _Tracks(NamedTuple):
    samples: list[Samples]  # of each recording
    clocks: list[RowClock]
    parts: dict[str, list[Part]]  # by joint

    @property
    def period(self) -> float:
        """Median period of the rows [s]."""
        return float(np.median([clock.period for clock in self.clocks if np.isfinite(clock.period)] or [np.nan]))


def _read(recordings: Sequence[Recording]) -> _Tracks:
    samples = [read_samples(recording) for recording in recordings]
    clocks = [_clock(each) for each in samples]
    names = dict.fromkeys(joint for recording in recordings for joint in _commanded(recording))
    read = list(zip(recordings, samples, strict=True))
    return _Tracks(samples, clocks, {joint: _parts(joint, read, clocks) for joint in names})


def _odd_episodes(recordings: Sequence[Recording], tracks: _Tracks, units: Mapping[str, str]) -> tuple[Odd, ...]:
    episodes = {
        joint: group(recordings, _without_turns(parts, units.get(joint, "rad")))
        for joint, parts in tracks.parts.items()
        if parts
    }
    return odd_episodes(episodes, max(tracks.period, SLOWEST_GRID), units)


def _commanded(recording: Recording) -> list[str]:
    columns = recording.columns.get("q_des", ())
    return [joint for joint, column in zip(recording.joints, columns, strict=True) if column] if any(columns) else []


def _clock(samples: Samples) -> RowClock:
    rows = np.any([driven(samples, j) for j in range(samples.q.shape[1])], axis=0)
    return read_stamps(samples.t, rows)


def _parts(joint: str, read: Sequence[tuple[Recording, Samples]], clocks: Sequence[RowClock]) -> list[Part]:
    parts = []
    for k, ((recording, samples), clock) in enumerate(zip(read, clocks, strict=True)):
        if joint in _commanded(recording) and np.isfinite(clock.period):
            j = recording.joints.index(joint)
            parts += cut(samples, j, driven(samples, j), clock.period, k)
    return parts


def _without_turns(parts: Sequence[Part], unit: str) -> list[Part]:
    turn = turn_of(jumps(parts)[1], unit)
    return [unwrapped(part, turn) for part in parts] if turn else list(parts)


def _audit(
    joint: str, unit: str, parts: Sequence[Part], period: float, coarsest: float, of_all: Sequence[Odd]
) -> JointAudit:
    """Audit one joint without its odd episodes; period of the rows [s], coarsest: largest step of an encoder."""
    odd = [one for one in of_all if one.joint == joint]
    left_out = {(part.recording, part.t[0]) for one in odd for part in one.episode.parts}
    given = [part for part in parts if (part.recording, part.t[0]) not in left_out]
    parts = _without_turns(given, unit)
    q, command = joined(parts, "q"), joined(parts, "command")
    step, span = quantum(parts), float(np.ptp(command))
    grids = [on_grid(part, max(period, SLOWEST_GRID)) for part in parts]
    moved = span > 0 and float(np.ptp(q)) > 0
    found = find_response(grids) if moved else None
    answer = (found or UNKNOWN)._asdict()
    del answer["correlation"], answer["gain"]
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
        said = judge_joint(audit, found, given, grids)
    else:
        said = judge_still(audit, parts)
    return replace(audit, flags=(*(one.said for one in odd), *said), limits=limits)
