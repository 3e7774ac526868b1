"""Methods that give a signid model: the description, least squares, `identify`, and `diagnose`'s extended model."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace

import signid
from signid.model import Model
from signid.types import Recording, Robot

from ..concealed_real.run import ONCE, attempt
from .rows import table
from .task import Answer, Fitted, Task, UnavailableError, identified, together

LIMIT = 60.0  # [s] of one diagnosis


def least_squares(robot: Robot, recordings: Sequence[Recording]) -> Fitted:
    """Weighted least squares of base parameters, viscous and Coulomb friction, offsets and rotors.

    signid's own regressor and filter, one weight a joint, no instruments, no physical constraints.

    Args:
        robot: as described.
        recordings: to learn from.
    """
    start = time.process_time()
    found = identified(robot, recordings, method="wls", options=signid.Options(instruments=False, whiten=False))
    seconds, period = time.process_time() - start, found.session.train[0][1].period
    return Fitted(found.model, found.cutoff, found.position_cutoff, period, seconds)


def description(task: Task) -> Answer:
    """The description and the friction that it states, nothing fitted.

    Args:
        task: the data.
    """
    return _judged(task, task.described, 0.0)


def least_squares_answer(task: Task) -> Answer:
    """The least squares that the set was built with.

    Args:
        task: the data.
    """
    return Answer(task.judged.rest, task.fitted.seconds)


def identify(task: Task) -> Answer:
    """`signid identify` with its defaults, on A and B.

    Args:
        task: the data.
    """
    start = time.process_time()
    model = identified(task.robot, together(task)).model
    return _judged(task, model, time.process_time() - start)


def identify_first(task: Task) -> Answer:
    """`signid identify` with its defaults, on A alone: the model that is diagnosed.

    Args:
        task: the data.
    """
    start = time.process_time()
    model = identified(task.robot, list(task.a)).model
    return _judged(task, model, time.process_time() - start)


def diagnose(task: Task, limit: float = LIMIT) -> Answer:
    """The extended model of `signid diagnose`: A is identified, B diagnosed.

    Laws of a single event are left out, as they say nothing about another recording.

    Args:
        task: the data.
        limit: of the diagnosis [s].

    Raises:
        UnavailableError: the diagnosis refused, crashed, or was stopped.
    """
    return _diagnosed(task, list(task.a), [task.b], limit)


def diagnose_all(task: Task, limit: float = LIMIT) -> Answer:
    """The extended model of `signid diagnose`: A and B are identified, and diagnosed again, as others learn from both.

    Args:
        task: the data.
        limit: of the diagnosis [s].

    Raises:
        UnavailableError: the diagnosis refused, crashed, or was stopped.
    """
    both = together(task)
    return _diagnosed(task, both, both, limit)


def _diagnosed(task: Task, known: Sequence[Recording], asked: Sequence[Recording], limit: float) -> Answer:
    """The model that some recordings give, extended by what others ask for."""
    start = time.process_time()
    model = identified(task.robot, known).model
    found = attempt(model, asked, limit)
    seconds = time.process_time() - start
    if found.diagnosis is None:
        raise UnavailableError(f"{found.answer.verdict}: {' '.join(found.answer.sentences)}")
    extended = found.diagnosis.model
    kept = tuple(law for law in extended.laws if not set(law.parameters) >= ONCE)
    names = dict.fromkeys(x.law.effect.name for x in found.diagnosis.causes)
    return _judged(task, replace(extended, laws=kept), seconds, ", ".join(names) or found.answer.verdict)


def _judged(task: Task, model: Model, seconds: float, note: str = "") -> Answer:
    return Answer(table(model, task.c, task.cutoff).rest, seconds, note)
