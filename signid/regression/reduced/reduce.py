"""Recordings -> factors, of all their rows or of one of so many equal parts."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from ...errors import OptionError, RecordingError
from ...types import Frozen, Input, Progress, Recording, Robot
from ..factors import LAGS, Factors, Node, cascade, window_factors
from ..prepare import prepare
from ..rows import Task, count_windows, cut_rows, read_rows
from ..session import SAME_RATE, Options, Part, Session, only_once, recordings_used

Share = tuple[int, int]  # which of how many equal parts, counted from 1
WHOLE: Share = (1, 1)


@dataclass(frozen=True, eq=False)
class Reduced(Frozen):
    """What recordings tell `signid.identify`, without their samples; those of one task can be added."""

    task: Task
    train: tuple[Node, ...]  # sums over windows of rows: a single one, unless it is a part
    held_out: tuple[Node, ...]
    inputs: tuple[Input, ...]  # the recordings
    notes: tuple[str, ...]
    share: Share = WHOLE  # of the rows of these recordings

    @property
    def robot(self) -> Robot:
        """With the joints held that the recordings do not move."""
        return self.task.robot

    @property
    def lags(self) -> int:
        """Highest order that a noise model can have."""
        return max((len(node.factors.joints[0].grams) - 1 for node in self.train), default=-1)


def reduce(
    robot: Robot,
    recordings: Sequence[Recording],
    *,
    held_out: Sequence[Recording] = (),
    options: Options | None = None,
    like: Reduced | None = None,
    share: Share = WHOLE,
    progress: Progress | None = None,
) -> Reduced:
    """The factors of recordings, in one pass: `signid.identify` answers from them as from the recordings.

    Args:
        robot: as `load_robot` gives it.
        recordings: to learn from, as `read_recording` gives them, with the signs of their torque.
        held_out: to judge by; without any, the last of several recordings or the last 30 % of the only one.
        options: effects, cut-off and the like.
        like: takes these factors' laws, band and filter, so that both can be added; cut-off, effects and the like in
            the options do not count then.
        share: which of how many equal parts of the rows, counted from 1; the parts add up to the whole.
        progress: told what is being done and how far it is.

    Raises:
        OptionError: there is no such part, or an option has no place here.
        RecordingError: a recording cannot be used, or not like those others; the sentence says why.
    """
    options = options or Options()
    _check(recordings, held_out, options, share)
    if like is None:
        session = prepare(robot, recordings, held_out, options)
    else:
        session = _alike(prepare(robot, recordings, held_out, _same(like.task, options)), like.task)
    lags = LAGS if options.whiten else 0
    train = _factors(session, session.train, share, lags, progress, "learning from")
    judge = _factors(session, session.held_out, share, 0, progress, "judging by")
    return Reduced(session.task, train, judge, recordings_used(recordings, held_out), session.notes, share)


def _check(recordings: Sequence[Recording], held_out: Sequence[Recording], options: Options, share: Share) -> None:
    which, of = share
    if not 1 <= which <= of:
        raise OptionError(f"there is no part {which} of {of}; parts count from 1")
    if options.robust:
        raise OptionError("weights against outliers need every sample again and again; identify the recordings instead")
    only_once((*recordings, *held_out))
    for recording in (*recordings, *held_out):
        if not recording.signed.all():
            raise RecordingError(
                f"{recording.path or 'a recording'} has torque without its sign, and factors are of signed torque; "
                f"identify it, and reduce the signed.csv that this writes"
            )


def _same(task: Task, options: Options) -> Options:
    """The options that lead to a task like another."""
    effects = tuple(dict.fromkeys(law.effect.name for law in task.laws))
    cutoff = task.band.cutoff if task.band.filtered else float("inf")
    derivatives = "recorded" if task.recorded_derivatives else "computed"
    return replace(options, effects=effects, cutoff=cutoff, derivatives=derivatives, instruments=task.instruments)


def _alike(session: Session, task: Task) -> Session:
    """The session with another's task, if its recordings have all that it takes."""
    own = session.task
    rates, joints = (own.band.rate, task.band.rate), (own.robot.joints, task.robot.joints)
    measured = [[law.joints for law in each.laws] for each in (own, task)]
    why = ""
    if joints[0] != joints[1]:
        why = f"move {', '.join(joints[0])}, those others {', '.join(joints[1])}"
    elif abs(rates[0] - rates[1]) > SAME_RATE * rates[1]:
        why = f"are sampled at {rates[0]:.6g} Hz, those others at {rates[1]:.6g} Hz"
    elif measured[0] != measured[1] or (own.base.sees.any(1) != task.base.sees.any(1)).any():
        why = "have torque of other joints than those others"
    elif own.instruments != task.instruments:
        why = "lack the desired positions that those others have"
    if why:
        raise RecordingError(f"the recordings {why}; only factors of like recordings can be added")
    return replace(session, task=replace(task, robot=own.robot))


def _factors(
    session: Session, parts: Sequence[Part], share: Share, lags: int, progress: Progress | None, purpose: str
) -> tuple[Node, ...]:
    """Sums over the windows of a share; a single one where it is the whole."""
    if share == WHOLE:
        return (Node(0, 0, session.reduce(parts, progress=progress, purpose=purpose, lags=lags)),)
    count = sum(count_windows(session.task, sampling) for _, sampling in parts)
    if not count:
        session.reduce(parts, lags=0)  # says why
    start, stop = (_edge(count, k, share[1]) for k in (share[0] - 1, share[0]))
    found = _pieces(session.task, parts, (start, stop), lags)
    nodes: list[Node] = []
    for k, factors in enumerate(found, start):
        nodes = cascade([*nodes, Node(k, 0, factors)])
        if progress is not None:
            progress(f"{purpose} part {share[0]} of {share[1]}", (k + 1 - start) / (stop - start))
    return tuple(nodes)


def _edge(count: int, k: int, of: int) -> int:
    """The window that the part after k parts begins with: a round number, so that a part leaves few sums."""
    step = 2 ** max(0, (count // (8 * of)).bit_length() - 1)
    return count if k == of else count * k // of // step * step


def _pieces(task: Task, parts: Sequence[Part], windows: tuple[int, int], lags: int) -> Iterator[Factors]:
    """Factors of windows start..stop, counted over all recordings."""
    before = 0
    for recording, sampling in parts:
        for piece, past in cut_rows(task, sampling, *(k - before for k in windows)):
            yield from window_factors(task, read_rows(task, recording, piece), lags, past=past)
        before += count_windows(task, sampling)
