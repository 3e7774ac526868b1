"""Methods with a signid model: the description, least squares, `identify` and the extended model of `diagnose`."""

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

LIMIT = 60.0  # time limit of one diagnosis [s]


def least_squares(robot: Robot, recordings: Sequence[Recording]) -> Fitted:
    """Estimate base parameters, viscous and Coulomb friction, offsets and rotors by weighted least squares.

    Uses signid's regressor and filter, one weight per joint, no instruments and no physical constraints.

    Args:
        robot: robot of the description.
        recordings: training recordings.
    """
    start = time.process_time()
    found = identified(robot, recordings, method="wls", options=signid.Options(instruments=False, whiten=False))
    seconds, period = time.process_time() - start, found.session.train[0][1].period
    return Fitted(found.model, found.cutoff, found.position_cutoff, period, seconds)


def description(task: Task) -> Answer:
    """Predict with the description and its friction, without fit.

    Args:
        task: data of the set.
    """
    return _answer(task, task.described, 0.0)


def least_squares_answer(task: Task) -> Answer:
    """Return the least-squares fit of the task.

    Args:
        task: data of the set.
    """
    return Answer(task.held_out.rest, task.fitted.seconds)


def identify(task: Task) -> Answer:
    """Run `signid identify` with its defaults on A and B.

    Args:
        task: data of the set.
    """
    start = time.process_time()
    model = identified(task.robot, together(task)).model
    return _answer(task, model, time.process_time() - start)


def identify_first(task: Task) -> Answer:
    """Run `signid identify` with its defaults on A alone, the model of `diagnose`.

    Args:
        task: data of the set.
    """
    start = time.process_time()
    model = identified(task.robot, list(task.a)).model
    return _answer(task, model, time.process_time() - start)


def diagnose(task: Task, limit: float = LIMIT) -> Answer:
    """Predict with the extended model of `signid diagnose`: A identified, B diagnosed.

    Laws of a single event are omitted, because they do not apply to another recording.

    Args:
        task: data of the set.
        limit: time limit of the diagnosis [s].

    Raises:
        UnavailableError: the diagnosis refused, crashed or was stopped.
    """
    return _diagnosed(task, list(task.a), [task.b], limit)


def diagnose_all(task: Task, limit: float = LIMIT) -> Answer:
    """Predict with the extended model of `signid diagnose`: A and B identified and diagnosed.

    Args:
        task: data of the set.
        limit: time limit of the diagnosis [s].

    Raises:
        UnavailableError: the diagnosis refused, crashed or was stopped.
    """
    both = together(task)
    return _diagnosed(task, both, both, limit)


def _diagnosed(task: Task, known: Sequence[Recording], diagnosed: Sequence[Recording], limit: float) -> Answer:
    """Identify a model from `known` and extend it by the diagnosis of `diagnosed`."""
    start = time.process_time()
    model = identified(task.robot, known).model
    found = attempt(model, diagnosed, limit)
    seconds = time.process_time() - start
    if found.diagnosis is None:
        raise UnavailableError(f"{found.answer.verdict}: {' '.join(found.answer.sentences)}")
    extended = found.diagnosis.model
    kept = tuple(law for law in extended.laws if not set(law.parameters) >= ONCE)
    names = dict.fromkeys(x.law.effect.name for x in found.diagnosis.causes)
    return _answer(task, replace(extended, laws=kept), seconds, ", ".join(names) or found.answer.verdict)


def _answer(task: Task, model: Model, seconds: float, note: str = "") -> Answer:
    return Answer(table(model, task.c, task.cutoff).rest, seconds, note)
