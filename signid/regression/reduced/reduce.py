"""Recordings -> factors of reduced size, and sums of those."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import reduce as fold
from itertools import chain
from operator import add
from pathlib import Path
from typing import Any

import numpy as np

from ...errors import OptionError, RecordingError, shorten
from ...recording import Recordings, as_recordings
from ...robot import as_robot
from ...typed import typed
from ...types import Input, Progress, Recording, Result, Robot
from ..factors import LAGS, Factors, Node, cascade, total, window_factors
from ..rows import Task, count_windows, cut_rows, read_rows
from ..session import SAME_RATE, Options, Part, Session, only_once, prepare, recordings_used

Share = tuple[int, int]  # (k, m): part k of m equal parts, k counted from 1
WHOLE: Share = (1, 1)
SAME = 1e-9  # [1] relative tolerance between tasks that two machines computed
FILTERS = "filters"
SUMS = ("train", "held_out")


@dataclass(frozen=True, eq=False)
class Reduced(Result):
    """Factors of recordings, from which `signid.identify` works without samples; factors of one task can be added."""

    task: Task
    train: tuple[Node, ...]  # sums over windows of rows: a single one unless this is a part
    held_out: tuple[Node, ...]
    inputs: tuple[Input, ...]  # the recordings
    notes: tuple[str, ...]
    share: Share = WHOLE  # part of the rows of these recordings

    @property
    def robot(self) -> Robot:
        """Robot whose unrecorded joints are held."""
        return self.task.robot

    @property
    def lags(self) -> int:
        """Highest order of a noise model."""
        return max((len(node.factors.joints[0].grams) - 1 for node in self.train), default=-1)


@typed
def reduce(
    robot: Robot | str | Path,
    recordings: Recordings,
    *,
    held_out: Recordings = (),
    options: Options | None = None,
    like: Reduced | None = None,
    share: Share = WHOLE,
    progress: Progress | None = None,
) -> Reduced:
    """Factors of recordings, in one pass; `signid.identify` gives the same result from them as from the recordings.

    Args:
        robot: robot by `load_robot`.
        recordings: training recordings by `read_recording`, with signed torque.
        held_out: held-out recordings; default: the last of several recordings, or the last 30 % of a single one.
        options: effects, cut-off and other options.
        like: factors whose laws, band and filter are used, so that both can be added; the corresponding options are
            ignored then.
        share: part k of m equal parts of the rows, k counted from 1; the parts add up to the whole.
        progress: function that is called with the current step and the share of it that is done.

    Raises:
        OptionError: there is no such part, or an option is not supported here.
        RecordingError: a recording cannot be used, or does not fit `like`; the sentence says why.
    """
    robot, options = as_robot(robot, "reduce"), options or Options()
    recordings, held_out = (as_recordings(some, robot, "reduce") for some in (recordings, held_out))
    _check(recordings, held_out, options, share)
    if like is None:
        session = prepare(robot, recordings, held_out, options)
    else:
        session = _with_task(prepare(robot, recordings, held_out, _same(like.task, options)), like.task)
    lags = LAGS if options.whiten else 0
    train = _factors(session, session.train, share, lags, progress, "learning from")
    learned_later = 0 if held_out else lags  # given held-out recordings are never learned from
    held = _factors(session, session.held_out, share, learned_later, progress, "evaluating on")
    return Reduced(session.task, train, held, recordings_used(recordings, held_out), session.notes, share)


def _check(recordings: Sequence[Recording], held_out: Sequence[Recording], options: Options, share: Share) -> None:
    which, of = share
    if not 1 <= which <= of:
        raise OptionError(f"there is no part {which} of {of}; parts are counted from 1")
    if options.robust:
        raise OptionError(
            "robust weights need all samples several times, and factors have none; identify the recordings"
        )
    only_once((*recordings, *held_out))
    for recording in (*recordings, *held_out):
        if not recording.signed.all():
            raise RecordingError(
                f"{recording.path or 'a recording'} has torque without its sign, and factors need signed torque; "
                f"run signid identify on it, and reduce the signed.csv that it writes"
            )


def _same(task: Task, options: Options) -> Options:
    """Options that give the same task."""
    effects = tuple(dict.fromkeys(law.effect.name for law in task.laws))
    cutoff = task.band.cutoff if task.band.filtered else float("inf")
    derivatives = "recorded" if task.recorded_derivatives else "computed"
    return replace(options, effects=effects, cutoff=cutoff, derivatives=derivatives, instruments=task.instruments)


def _with_task(session: Session, task: Task) -> Session:
    """Session with the given task, if its recordings fit it."""
    own = session.task
    rates, joints = (own.band.rate, task.band.rate), (own.robot.joints, task.robot.joints)
    measured = [[law.joints for law in each.laws] for each in (own, task)]
    why = ""
    if joints[0] != joints[1]:
        why = f"move {', '.join(joints[0])}, those of the given factors {', '.join(joints[1])}"
    elif abs(rates[0] - rates[1]) > SAME_RATE * rates[1]:
        why = f"are sampled at {rates[0]:.6g} Hz, those of the given factors at {rates[1]:.6g} Hz"
    elif measured[0] != measured[1] or (own.base.sees.any(1) != task.base.sees.any(1)).any():
        why = "have torque of other joints than those of the given factors"
    elif own.instruments != task.instruments:
        why = "lack the desired positions that those of the given factors have"
    if why:
        raise RecordingError(f"the recordings {why}; only factors of recordings of the same kind can be added")
    return replace(session, task=replace(task, robot=own.robot))


def _factors(
    session: Session, parts: Sequence[Part], share: Share, lags: int, progress: Progress | None, purpose: str
) -> tuple[Node, ...]:
    """Sums over the windows of a share; a single sum for the whole."""
    if share == WHOLE:
        return (Node(0, 0, session.reduce(parts, progress=progress, purpose=purpose, lags=lags)),)
    count = sum(count_windows(session.task, sampling) for _, sampling in parts)
    if not count:
        session.reduce(parts, lags=0)  # raises with the reason
    start, stop = (_edge(count, k, share[1]) for k in (share[0] - 1, share[0]))
    found = _pieces(session.task, parts, (start, stop), lags)
    nodes: list[Node] = []
    for k, factors in enumerate(found, start):
        nodes = cascade([*nodes, Node(k, 0, factors)])
        if progress is not None:
            progress(f"{purpose} part {share[0]} of {share[1]}", (k + 1 - start) / (stop - start))
    return tuple(nodes)


def _edge(count: int, k: int, of: int) -> int:
    """Number of the window at which the part after k parts begins: a multiple of a power of two, for few sums."""
    step = 2 ** max(0, (count // (8 * of)).bit_length() - 1)
    return count if k == of else count * k // of // step * step


def _pieces(task: Task, parts: Sequence[Part], windows: tuple[int, int], lags: int) -> Iterator[Factors]:
    """Factors of each of the windows start..stop, counted over all recordings."""
    before = 0
    for recording, sampling in parts:
        for piece, past in cut_rows(task, sampling, *(k - before for k in windows)):
            yield from window_factors(task, read_rows(task, recording, piece), lags, past=past)
        before += count_windows(task, sampling)


def add_up(parts: Sequence[Reduced]) -> Reduced:
    """Sum of factors: as if all recordings were reduced together; held-out factors add to held-out factors.

    The factors, at least one, must have the same task: robot, held joints, laws, base parameters, band, widths of
    reversals, lags. `reduce(..., like=...)` ensures this. Parts of the same recordings must be complete.

    Raises:
        OptionError: the tasks differ, or a part is missing or given twice.
    """
    if not parts:
        raise OptionError("no factors were given; give at least one file of factors")
    for other in parts[1:]:
        if differs := _difference(parts[0], other):
            raise OptionError(
                f"the factors of {_names(parts[0])} and of {_names(other)} cannot be added: {differs}; "
                f"reduce one of them like the other (--like)"
            )
    joined = [_joined(found) for found in _sets(parts)]
    train, held_out = (fold(add, [getattr(part, name)[0].factors for part in joined]) for name in SUMS)
    files = tuple(dict.fromkeys(file for part in parts for file in part.inputs))
    notes = tuple(dict.fromkeys(note for part in parts for note in part.notes))
    return replace(joined[0], train=_whole(train), held_out=_whole(held_out), inputs=files, notes=notes)


def _joined(parts: Sequence[Reduced]) -> Reduced:
    """Sum of the parts of the same recordings, equal to the last bit to the factors of the whole."""
    if len(parts) == 1:
        return parts[0]
    ordered = sorted(parts, key=lambda part: part.share)
    train, held_out = (total(cascade(chain(*(getattr(part, name) for part in ordered)))) for name in SUMS)
    assert train is not None and held_out is not None, "all parts together have windows"
    return replace(ordered[0], train=_whole(train), held_out=_whole(held_out), share=WHOLE)


def _whole(factors: Factors) -> tuple[Node]:
    return (Node(0, 0, factors),)


def _difference(one: Reduced, other: Reduced) -> str:
    """Sentence on the first difference of two tasks; "" if they are the same."""
    pairs = zip(_definition(one.task).items(), _definition(other.task).values(), strict=True)
    differs = next((name for (name, ours), theirs in pairs if not all(map(_alike, ours, theirs))), "")
    if differs and differs != FILTERS:
        return f"their {differs} differ"
    if -1 not in (one.lags, other.lags) and one.lags != other.lags:
        return "one was reduced for white noise"
    if differs:
        bands = " and ".join(f"{each.task.band.cutoff:.3g} Hz" for each in (one, other))
        return f"their filters differ (cut-offs {bands}, or the noise levels that set them)"
    return ""


def _definition(task: Task) -> dict[str, tuple[Any, ...]]:
    """Everything that the rows of a task depend on, under the names in messages."""
    robot, base, band = task.robot, task.base, task.band
    laws = tuple((law.effect.name, law.joints) for law in task.laws)
    return {
        "robot or its held joints": (robot.sha256, robot.joints, robot.rest, robot.drive),
        "gravity": (np.array(robot.model.gravity.linear),),
        "laws": (laws, task.recorded_derivatives, task.instruments),
        "base parameters": (base.independent.tolist(), base.combination, base.sees.tolist()),
        FILTERS: (band.rate, band.factor, band.filtered, band.beyond, band.torque_floor, task.slow, task.reach),
    }


def _alike(a: Any, b: Any) -> bool:
    if not isinstance(a, np.ndarray | float):
        return bool(a == b)
    size = float(np.max(np.abs(a), initial=0.0, where=np.isfinite(a)))
    return np.shape(a) == np.shape(b) and np.allclose(a, b, rtol=SAME, atol=SAME * size)


def _sets(parts: Sequence[Reduced]) -> list[list[Reduced]]:
    """Parts grouped by their recordings, after a check that each group is complete and no recording is in two."""
    sets: dict[tuple[Input, ...], list[Reduced]] = {}
    for part in parts:
        sets.setdefault(part.inputs, []).append(part)
    for found in sets.values():
        _check_complete(found)
    seen: dict[str, str] = {}
    for inputs in sets:
        for file in inputs:
            if file.sha256 in seen:
                again = f"{file.path or 'one recording'} holds the same samples as {seen[file.sha256] or 'another'}"
                raise OptionError(f"{again}; give each recording once")
        seen |= {file.sha256: file.path for file in inputs}
    return list(sets.values())


def _check_complete(parts: Sequence[Reduced]) -> None:
    of, name, given = parts[0].share[1], _names(parts[0]), sorted(part.share[0] for part in parts)
    if any(part.share[1] != of for part in parts):
        raise OptionError(f"{name} was cut in two different ways; give the parts of one of them")
    if twice := [k for k in given if given.count(k) > 1]:
        repeated = name if of == 1 else f"part {twice[0]} of {of} of {name}"
        raise OptionError(f"{repeated} was given twice; give each once")
    if missing := [str(k) for k in range(1, of + 1) if k not in given]:
        raise OptionError(f"part {shorten(missing)} of the {of} parts of {name} is missing; give all of them")


def _names(part: Reduced) -> str:
    return shorten([file.path or "a recording" for file in part.inputs], 2)
