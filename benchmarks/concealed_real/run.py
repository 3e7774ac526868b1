"""Run the cases of a set: identify A, change the model or B, diagnose, evaluate, and compare both models on C."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from types import FrameType
from typing import Any

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.errors import SignidError
from signid.model import Model
from signid.types import Recording

from .cases import KIND, all_cases, concealed
from .changes import Array, Case, Setup, compare, identified_std, ratios, ratios_apart, residual, rms
from .evaluate import SURE, Answer, Arm, already_named, answer_of, evaluate, label
from .sets import RealSet, columns_of, read

CONTROL = "control"
BEYOND = 2.0  # processor time over the time limit at which a diagnosis is aborted [1]
ONCE = {"start", "end"}  # parameters of laws that describe a single event
Row = dict[str, Any]


class OutOfTimeError(Exception):
    """A diagnosis far exceeded its time limit."""


@dataclass(frozen=True)
class Attempt:
    """A diagnosis, or the reason for its absence."""

    answer: Answer
    seconds: float  # processor time
    diagnosis: Diagnosis | None = None


def run(one: RealSet, kinds: Collection[str], limit: float | None) -> Iterator[Row]:
    """Yield the rows of a set as they finish; a failing set yields a row with the reason. No kinds: all."""
    try:
        yield from rows_of(one, kinds, limit)
    except Exception as error:  # one set must not end the others
        outcome = "refused" if isinstance(error, SignidError) else "crash"
        failed = {"set": one.name, "kind": "set", "what": "cannot go on", "outcome": outcome}
        yield {**failed, "sentences": [_message(error)], "seconds": 0.0}


def rows_of(one: RealSet, kinds: Collection[str], limit: float | None) -> Iterator[Row]:
    """Yield the control, then each case of a set, each diagnosed within a limit [s]."""
    begun = begin(one, limit)
    setup, control, arm = begun.setup, begun.control, begun.arm
    yield _control(one, setup, control, arm)
    for case in begun.cases():
        if not kinds or case.kind in kinds:
            found = control if begun.is_unchanged(case) else attempt(case.model, [case.b], limit)
            yield _row(one, setup, case, found, control, arm)


@dataclass(frozen=True)
class Begun:
    """A set with its identified model and the diagnosis of its control."""

    one: RealSet
    a: tuple[Recording, ...]  # identified recordings
    setup: Setup
    control: Attempt
    arm: Arm

    def cases(self) -> Iterator[Case]:
        """Yield all cases of the set."""
        yield from concealed(self.one, self.setup, list(self.a))
        yield from all_cases(self.setup)

    def is_unchanged(self, case: Case) -> bool:
        """Whether a case diagnoses what the control does."""
        return case.model is self.setup.model and case.b is self.setup.b


def begin(one: RealSet, limit: float | None = None) -> Begun:
    """Identify A of a set and diagnose its control within a limit [s]."""
    robot = one.robot()
    a = tuple(read(one, robot, part) for part in one.a)
    b, c = read(one, robot, one.b), read(one, robot, one.c)
    identified = signid.identify(robot, a)
    model = identified.model
    arm = Arm(model.robot.joints, len(model.robot.joints) == 1 and bool(model.robot.prismatic[0]))
    control = attempt(model, [b], limit)
    cutoff = control.diagnosis.cutoff if control.diagnosis else None
    setup = Setup(model, b, c, cutoff, residual(model, b, cutoff), identified_std(identified))
    return Begun(one, a, setup, control, arm)


def attempt(model: Model, recordings: Sequence[Recording], limit: float | None) -> Attempt:
    """Diagnose within a limit [s] and measure processor time; a refusal or a crash is a result."""
    start = time.process_time()
    try:
        with signid.time_limit(limit) if limit else nullcontext(), _stopped(limit):
            diagnosis = signid.diagnose(model, recordings)
    except SignidError as error:
        return Attempt(Answer("refused", (), (str(error),)), time.process_time() - start)
    except Exception as error:  # a crash of one case must not end the benchmark
        return Attempt(Answer("crash", (), (_message(error),)), time.process_time() - start)
    return Attempt(answer_of(diagnosis), time.process_time() - start, diagnosis)


@contextmanager
def _stopped(limit: float | None) -> Iterator[None]:
    """Raise inside the block when its processor time is far above the limit."""

    def stop(number: int, frame: FrameType | None) -> None:
        raise OutOfTimeError(f"stopped after {BEYOND * (limit or 0):g} s of processor time")

    if limit is None:
        yield
        return
    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, BEYOND * limit)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def _message(error: Exception) -> str:
    frame = traceback.extract_tb(error.__traceback__)[-1]
    return f"{type(error).__name__}: {error} ({frame.name})"


def _control(one: RealSet, setup: Setup, found: Attempt, arm: Arm) -> Row:
    answer = found.answer
    share = rms(setup.residual) / rms(columns_of(setup.b)["tau"])
    row: Row = {
        "outcome": answer.verdict if answer.verdict in ("refused", "crash") else CONTROL,
        "sure": [label(x, arm) for x in answer.candidates if x.cause and x.probability > SURE],
        "residual_share": dict(zip(arm.joints, share.tolist(), strict=True)),
    }
    return _common(one, CONTROL, "nothing changed", found, arm) | row | _held_out(setup.model, setup.c, found)


def _row(one: RealSet, setup: Setup, case: Case, found: Attempt, control: Attempt, arm: Arm) -> Row:
    row = judged(case, found, control, arm, bound(setup, case))
    if found is control:
        row["sure"] = []  # the truth about the rest of the model is not known
    held_out = _held_out(case.model, case.c, found)
    return _common(one, case.kind, case.what, found, arm) | row | held_out | {"undone": _undone(setup, case, found)}


def judged(case: Case, found: Attempt, control: Attempt, arm: Arm, sizes: Array) -> Row:
    """Evaluation of an attempt as a row; sizes: bound (n,) of the change [1].

    Where the attempt is the control itself, none of its causes counts as old.
    """
    old = replace(control.answer, candidates=()) if found is control else control.answer
    evaluation = evaluate(found.answer, case.truth, old, arm)
    largest = int(np.argmax(sizes))
    known = case.kind != KIND and already_named(control.answer, case.truth, arm)
    return {
        "bound": float(sizes[largest]),
        "bound_joint": arm.joints[largest],
        "known": known,
        "fair": float(sizes[largest]) >= 1 and not known,
        "numbers_asked": len(case.truth.numbers),
        **asdict(evaluation),
        "numbers": [{**asdict(number), "within": number.within} for number in evaluation.numbers],
    }


def _undone(setup: Setup, case: Case, found: Attempt) -> list[Row]:
    """Compare the given model with the truth on C: no diagnosis can improve joints that are worse here."""
    if found.diagnosis is None or case.kind == KIND:
        return []
    cutoff = found.diagnosis.cutoff
    try:
        given, truth = residual(case.model, case.c, cutoff), residual(setup.model, setup.c, cutoff)
    except (SignidError, ValueError, ArithmeticError):
        return []
    same = given.shape == truth.shape  # shorter recordings have other rows
    return [asdict(one) for one in compare(given, truth, setup.model.robot.joints)] if same else []


def bound(setup: Setup, case: Case) -> Array:
    """Rms torque of the change over the rms residual of the control (n,) [1]; 0 without rows."""
    try:
        changed = residual(case.model, case.b, setup.cutoff)
        if case.other:
            return ratios_apart(changed, setup.residual)
        if case.complete is not None:
            return ratios(changed, residual(case.complete, case.b, setup.cutoff))
        plain = setup.residual if case.before is None else residual(setup.model, case.before, setup.cutoff)
        return ratios(changed, plain)
    except (SignidError, ValueError, ArithmeticError):
        return np.zeros(len(setup.model.robot.joints))


def _common(one: RealSet, kind: str, what: str, found: Attempt, arm: Arm) -> Row:
    answer = found.answer
    return {
        "set": one.name,
        "kind": kind,
        "what": what,
        "verdict": answer.verdict,
        "causes": [label(x, arm) for x in answer.candidates if x.cause],
        "secondary": [label(x, arm) for x in answer.candidates if not x.cause],
        "sentences": list(answer.sentences),
        "seconds": found.seconds,
        "cutoff": found.diagnosis.cutoff if found.diagnosis else None,
    }


def _held_out(given: Model, c: Recording, found: Attempt) -> Row:
    """Compare both models on the held-out recording C in the band of the diagnosis."""
    if found.diagnosis is None:
        return {"unseen": []}
    extended, cutoff = found.diagnosis.model, found.diagnosis.cutoff
    extended = replace(extended, laws=tuple(law for law in extended.laws if not set(law.parameters) >= ONCE))
    try:
        before, after = (residual(model, c, cutoff) for model in (given, extended))
    except SignidError as error:
        return {"unseen": [], "unseen_refused": str(error)}
    except Exception as error:  # a failing evaluation of the extended model is a result
        return {"unseen": [], "unseen_crash": _message(error)}
    return {"unseen": [asdict(one) for one in compare(before, after, extended.robot.joints)]}
