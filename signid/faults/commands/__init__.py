"""Recordings of servos -> audit, joint by joint, without a model of the robot."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...errors import RecordingError
from ...recording.formats.base import About
from ...types import Array, Recording, Robot, Samples
from ..channels import quantum
from ..result import JointAudit, ServoAudit
from .logs import (
    MIN_ENCODER_STEPS,
    command_noise,
    command_period,
    held_share,
    judge_joint,
    judge_stamps,
    judge_still,
    jumps,
    saturated_share,
    speed_over,
    turn_of,
    unwrapped,
)
from .response import (
    BRIEFEST,
    UNKNOWN,
    Grid,
    Part,
    RowClock,
    at_rest,
    best_shift,
    content_rate,
    cut,
    driven,
    find_response,
    joined,
    on_grid,
    read_samples,
    read_stamps,
)

PLACES = ("q", "command")
SLOWEST_GRID = 1e-3  # [s] shortest period of the grid
MIN_EPISODES = 3  # episodes that move, of which one may differ
MOVES, SECONDS = 0.05, 1.0  # share of the largest range of motion [1] and duration [s], from which an episode counts
FOLLOWS, LOST_CORRELATION = 0.9, 0.5  # correlation of the other episodes, and of one that does not follow
OTHER, NEARER = 0.95, 0.25  # correlation with another joint's command, and 1 - it over that with the own one
SCALES, MAX_SCALE_RATIO = 1.5, 1.15  # ratio of the scale to that of the others, and largest one among the others
ZERO, ZERO_LEAST = 0.1, 0.15  # [range] and [rad or m] by which the mean error differs from that of the others
SHIFT_CHANGE, PERIODS = 0.4, 3.0  # [s], [periods] by which the shift differs; dry friction in slow motion: below 0.27 s
SATURATED = 0.4  # share of rows at the limit, from which on numbers are inexact
ZERO_ERROR_RATIO = 3.0  # difference of the error over the largest one among the others


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
    coarsest = max((quantum([part.q for part in each]) for each in parts.values() if each), default=0.0)
    known = tracks.period, coarsest, _odd_episodes(given, tracks, units)
    audits = [_audit(joint, units.get(joint, "rad"), each, *known) for joint, each in parts.items() if each]
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
    sentences: list[str] = []
    commanded = [recording for recording in recordings if _commanded(recording)]
    audits = [audit_servos(recording, units) for recording in commanded]
    for recording, audit in zip(commanded, audits, strict=True):
        name = recording.path if len(recordings) > 1 else ""
        sentences += [said if not name or said.startswith(name) else f"{name}: {said}" for said in audit.faults]
    faulty = [{joint.joint for joint in audit.joints if joint.flags} for audit in audits]
    odd = _odd_episodes(commanded, _read(commanded), units) if len(commanded) > 1 else ()
    sentences += [episode.said for episode in odd if episode.joint not in faulty[episode.episode.parts[0].recording]]
    return tuple(dict.fromkeys(sentences))


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
    rows = [np.any([driven(sample, j) for j in range(sample.q.shape[1])], axis=0) for sample in samples]
    clocks = [read_stamps(sample.t, moving) for sample, moving in zip(samples, rows, strict=True)]
    names = dict.fromkeys(joint for recording in recordings for joint in _commanded(recording))
    parts: dict[str, list[Part]] = {joint: [] for joint in names}
    for k, (recording, rows_of_it, clock) in enumerate(zip(recordings, samples, clocks, strict=True)):
        for joint in _commanded(recording) if np.isfinite(clock.period) else []:
            j = recording.joints.index(joint)
            parts[joint] += cut(rows_of_it, j, driven(rows_of_it, j), clock.period, k)
    return _Tracks(samples, clocks, parts)


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


def _without_turns(parts: Sequence[Part], unit: str) -> list[Part]:
    turn = turn_of(jumps(parts)[1], unit)
    return [unwrapped(part, turn) for part in parts] if turn else list(parts)


def _audit(
    joint: str, unit: str, parts: Sequence[Part], period: float, coarsest: float, of_all: Sequence[Odd]
) -> JointAudit:
    """Audit one joint without its odd episodes; period of the rows [s], coarsest: largest step of an encoder."""
    odd = [episode for episode in of_all if episode.joint == joint]
    left_out = {(part.recording, part.t[0]) for episode in odd for part in episode.episode.parts}
    parts_kept = [part for part in parts if (part.recording, part.t[0]) not in left_out]
    parts = _without_turns(parts_kept, unit)
    q, command = joined(parts, "q"), joined(parts, "command")
    step, span = quantum([part.q for part in parts]), float(np.ptp(command))
    grids = [on_grid(part, max(period, SLOWEST_GRID)) for part in parts]
    moved = span > 0 and float(np.ptp(q)) > 0
    response = find_response(grids) if moved else None
    answer = (response or UNKNOWN)._asdict()
    del answer["correlation"], answer["gain"]
    rest = at_rest(parts, answer["lag"], step, max(span, 1e-12))
    audit = JointAudit(
        joint=joint,
        unit=unit,
        samples=len(q),
        range=span,
        zero=float(np.mean(command - q)),
        error=float(np.sqrt(np.mean((command - q) ** 2))),
        speed=float(np.sqrt(np.mean(np.concatenate([speed_over(grid.q, grid.period) for grid in grids]) ** 2))),
        saturated=saturated_share(parts, grids),
        command_period=command_period(parts),
        command_noise=command_noise(grids),
        held=held_share(parts, step),
        quantum=step,
        **answer,
        **rest._asdict(),
    )
    if span <= MIN_ENCODER_STEPS * max(step, coarsest):
        return replace(audit, flags=(*(episode.said for episode in odd), *judge_still(audit, parts)))
    said = judge_joint(audit, response, parts_kept, grids)
    limit = (
        f"{joint} is at its limit in {audit.saturated:.0%} of the rows: stiffness hardly shows there; command smaller "
    )
    limits = (f"{limit}or slower motion",) if audit.saturated > SATURATED else ()
    return replace(audit, flags=(*(episode.said for episode in odd), *said), limits=limits)


class Episode(NamedTuple):
    """Parts of one joint that belong together: those of an episode, of a file, or one alone."""

    name: str  # "episode 7", a file, or "12.3 to 14.6 s"
    parts: tuple[Part, ...]


def group(recordings: Sequence[Recording], parts: Sequence[Part]) -> list[Episode]:
    """Parts of one joint by episode where recordings have some, else by recording, else one by one."""
    groups: dict[str, list[Part]] = {}
    for part in parts:
        starts = About.of(recordings[part.recording].table).episodes
        file = recordings[part.recording].path or f"recording {part.recording + 1}"
        names = [name for first, name in starts if first <= part.t[0]][-1:] if len(starts) > 1 else []
        if not names and len(recordings) == 1:
            names = [f"{part.t[0]:.6g} to {part.t[-1]:.6g} s"]
        groups.setdefault(" of ".join(names + [file] * (len(recordings) > 1)), []).append(part)
    return [Episode(name, tuple(each)) for name, each in groups.items()]


class Odd(NamedTuple):
    """An episode of one joint that differs from the others."""

    joint: str
    episode: Episode
    said: str


class _Answer(NamedTuple):
    episode: Episode
    grids: list[Grid]
    range: float  # [unit] largest one of the command
    moves: bool
    correlation: float  # [1] at the usual shift, with its sign
    scale: float  # [1] motion per command
    zero: float  # [unit] mean of the command at the usual shift less q
    shift: float  # [s] of the episode alone
    best: float  # [1] correlation there


def odd_episodes(episodes: Mapping[str, Sequence[Episode]], period: float, units: Mapping[str, str]) -> tuple[Odd, ...]:
    """Episodes of joints that differ from the others; period of the grid [s], units of joints ("" if unknown)."""
    grids = {joint: [[on_grid(part, period) for part in each.parts] for each in own] for joint, own in episodes.items()}
    places = {
        joint: {
            _place(part, grid): grid.command
            for each, some in zip(own, grids[joint], strict=True)
            for part, grid in zip(each.parts, some, strict=True)
        }
        for joint, own in episodes.items()
    }
    odd: list[Odd] = []
    for joint, own in episodes.items():
        answers = _answers(own, grids[joint])
        for k, one in enumerate(answers):
            others = [*answers[:k], *answers[k + 1 :]]
            commands = {name: _same(places[name], one) for name in episodes if name != joint}
            said = next(_differences(one, others, commands, period), "") or _moved(one, others, units.get(joint, "rad"))
            odd += [Odd(joint, one.episode, f"{joint} {said}")] if said else []
    return tuple(odd)


def _answers(episodes: Sequence[Episode], grids: Sequence[list[Grid]]) -> list[_Answer]:
    """Answers of the episodes that last."""
    lasting = [k for k, each in enumerate(grids) if sum(len(grid.q) * grid.period for grid in each) >= SECONDS]
    ranges = [max(float(np.ptp(grid.command)) for grid in grids[k]) for k in lasting]
    moves = [size > 0 and size >= MOVES * max(ranges) for size in ranges]
    shifts = [best_shift(grids[k]) for k in lasting]
    known = [x.seconds for x in shifts if np.isfinite(x.seconds) and x.correlation > FOLLOWS]
    usual = float(np.median(known)) if known else 0.0
    answers = []
    for k, shift, size, moving in zip(lasting, shifts, ranges, moves, strict=True):
        r, scale = _at(grids[k], [grid.command for grid in grids[k]], usual)
        error = np.concatenate([_late(grid.command, usual, grid.period) - grid.q for grid in grids[k]])
        zero = float(error.mean())
        answers.append(_Answer(episodes[k], grids[k], size, moving, r, scale, zero, shift.seconds, shift.correlation))
    return answers


def _late(command: Array, shift: float, period: float) -> Array:
    """A command (N,) that is late by a shift [s]."""
    rows = min(len(command), max(0, round(shift / period)))
    return np.concatenate([np.full(rows, command[0]), command[: len(command) - rows]])


def _at(grids: Sequence[Grid], commands: Sequence[Array], shift: float) -> tuple[float, float]:
    """Correlation of the position with commands at a shift [s], and motion per command; zeros without motion."""
    late = [_late(command, shift, grids[0].period) for command in commands]
    x = np.concatenate([command - command.mean() for command in late])
    y = np.concatenate([grid.q - grid.q.mean() for grid in grids])
    size = float(x @ x) * float(y @ y)
    return (float(x @ y) / size**0.5, float(x @ y) / float(x @ x)) if size > 0 else (0.0, 0.0)


_Place = tuple[int, float, int]  # recording, first time and rows of a part


def _place(part: Part, grid: Grid) -> _Place:
    return part.recording, float(part.t[0]), len(grid.q)


def _same(places: Mapping[_Place, Array], answer: _Answer) -> list[Array] | None:
    """Commands of another joint in the rows of an episode; None if it lacks some of them."""
    commands = [places.get(_place(part, grid)) for part, grid in zip(answer.episode.parts, answer.grids, strict=True)]
    known = [command for command in commands if command is not None]
    return known if len(known) == len(commands) else None


def _differences(
    answer: _Answer, answers: Sequence[_Answer], commands: Mapping[str, list[Array] | None], period: float
) -> Iterator[str]:
    """Sentences on the motion of one episode that differs from that of the others, the likeliest first."""
    others = [other for other in answers if other.moves]
    if not answer.moves or len(others) < MIN_EPISODES - 1 or np.median([x.correlation for x in others]) < FOLLOWS:
        return
    where = f"in {answer.episode.name}, unlike in the others"
    shift = _middle([other.shift for other in others])
    near = {name: _at(answer.grids, command, shift)[0] for name, command in commands.items() if command is not None}
    name = max(near, key=lambda other: near[other], default="")
    against = f"moves against its command {where}: q or q_des has the wrong sign there; negate it, or leave it out"
    if answer.correlation < -FOLLOWS:
        yield against
    if name and near[name] > OTHER and 1 - near[name] < NEARER * (1 - answer.correlation):
        yield f"follows q_des of {name} {where}: joints are swapped there; swap their columns back, or leave it out"
    if answer.correlation < -LOST_CORRELATION:
        yield against
    late, nearer = answer.shift - shift, 1 - answer.best < NEARER * (1 - answer.correlation)
    follow = answer.best > OTHER and all(other.correlation > FOLLOWS for other in others)
    if abs(late) > max(SHIFT_CHANGE, PERIODS * period) and nearer and follow:
        way = "later" if late > 0 else "earlier"
        yield f"answers {1e3 * abs(late):.0f} ms {way} {where}: q and q_des are of different rows there; leave it out"
    if max(answer.correlation, answer.best) < LOST_CORRELATION:
        yield f"does not follow its command {where}: the drive is off or rows are damaged there; leave it out"
    scales = [other.scale for other in others]
    ratio = answer.scale / _middle(scales) if _middle(scales) > 0 else 1.0
    alike = min(scales) > 0 and max(scales) < MAX_SCALE_RATIO * min(scales)
    if answer.correlation > FOLLOWS and alike and not 1 / SCALES <= ratio <= SCALES:
        fact = f"moves by {ratio:.3g} of what it does in the others in {answer.episode.name}"
        yield f"{fact}: check units and scale there"


def _moved(answer: _Answer, others: Sequence[_Answer], unit: str) -> str:
    """Describe another zero of an episode than that of the others, which agree; "" if it is the same."""
    if len(others) < MIN_EPISODES - 1 or (answer.moves and answer.correlation < FOLLOWS):
        return ""
    usual = _middle([other.zero for other in others])
    apart = max(abs(other.zero - usual) for other in others)
    span = max(other.range for other in (answer, *others))
    if not abs(answer.zero - usual) > max(ZERO_LEAST if unit else 0.0, ZERO * span, ZERO_ERROR_RATIO * apart):
        return ""
    size, way = f"{abs(answer.zero - usual):.3g} {unit}".rstrip(), "below" if answer.zero > usual else "above"
    where = f"in {answer.episode.name}, unlike in the others"
    return f"is {size} {way} its usual place {where}: the zero has changed; calibrate it, or leave it out"


def _middle(values: Sequence[float]) -> float:
    known = [value for value in values if np.isfinite(value)]
    return float(np.median(known)) if known else 0.0
