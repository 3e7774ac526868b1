"""A set, case by case: identified, changed, diagnosed, judged, and held against a recording that took no part."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Collection, Iterator
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

from .band import Array, compare, ratios, ratios_apart, rest
from .case import Case
from .cases import every
from .changes import Scene
from .judge import SURE, Arm, Said, judge, knows, said_of, spoken
from .nature import KIND, concealed
from .sets import RealSet, read

CONTROL = "control"
BEYOND = 2.0  # times the limit, of processor time, after which a diagnosis is stopped from outside
ONCE = {"start", "end"}  # numbers of laws that happened once
Row = dict[str, Any]


class OutOfTimeError(Exception):
    """A diagnosis took far longer than its limit."""


@dataclass(frozen=True)
class Attempt:
    """A diagnosis, or why there is none."""

    said: Said
    seconds: float  # of processor time
    diagnosis: Diagnosis | None = None


def rows_of(one: RealSet, kinds: Collection[str], limit: float | None) -> Iterator[Row]:
    """The control first, then each case of a set.

    Args:
        one: the set.
        kinds: of cases; empty: all.
        limit: of a diagnosis [s]; None: none.
    """
    robot = one.robot()
    a = [read(one, robot, part) for part in one.a]
    b, c = read(one, robot, one.b), read(one, robot, one.c)
    model = signid.identify(robot, a).model
    arm = Arm(model.robot.joints, len(model.robot.joints) == 1 and bool(model.robot.prismatic[0]))
    control = attempt(model, b, limit)
    cutoff = control.diagnosis.cutoff if control.diagnosis else None
    scene = Scene(model, b, c, cutoff, rest(model, b, cutoff))
    yield _control(one, scene, control, arm)
    for case in (*concealed(one, scene, a), *every(scene)):
        if not kinds or case.kind in kinds:
            unchanged = case.model is model and case.b is b
            yield _row(one, scene, case, control if unchanged else attempt(case.model, case.b, limit), control, arm)


def attempt(model: Model, b: Recording, limit: float | None) -> Attempt:
    """A diagnosis, timed; a crash is a result.

    Args:
        model: the simulation.
        b: the recording.
        limit: [s]; None: none.
    """
    start = time.process_time()
    try:
        with signid.time_limit(limit) if limit else nullcontext(), _stopped(limit):
            diagnosis = signid.diagnose(model, [b])
    except SignidError as error:
        return Attempt(Said("refused", (), (str(error),)), time.process_time() - start)
    except Exception as error:  # whatever it is, it must not end the benchmark
        frame = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error} ({frame.name})"
        return Attempt(Said("crash", (), (told,)), time.process_time() - start)
    return Attempt(said_of(diagnosis), time.process_time() - start, diagnosis)


@contextmanager
def _stopped(limit: float | None) -> Iterator[None]:
    """Ended from outside after far more processor time than the limit."""

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


def _control(one: RealSet, scene: Scene, found: Attempt, arm: Arm) -> Row:
    causes = [name for name in found.said.named if name.cause]
    told: Row = {"outcome": found.said.verdict if found.said.verdict in ("refused", "crash") else CONTROL}
    sure = [spoken(name, arm) for name in causes if name.probability > SURE]
    return (
        _base(one, CONTROL, "nothing changed", found, arm) | told | {"sure": sure} | _worse(scene.model, scene.c, found)
    )


def _row(one: RealSet, scene: Scene, case: Case, found: Attempt, control: Attempt, arm: Arm) -> Row:
    reused = found is control
    usual = control.said if not reused else replace(control.said, named=())
    verdict = judge(found.said, case.truth, usual, arm)
    sizes = _bound(scene, case)
    largest = int(np.argmax(sizes)) if len(sizes) else 0
    known = case.kind != KIND and knows(control.said, case.truth, arm)
    bound = float(sizes[largest]) if len(sizes) else 0.0
    told = {
        "bound": bound,
        "bound_joint": arm.joints[largest],
        "known": known,
        "fair": bound >= 1 and not known,
        "numbers": [{**asdict(number), "within": number.within} for number in verdict.numbers],
        "numbers_asked": len(case.truth.numbers),
        **{key: value for key, value in asdict(verdict).items() if key != "numbers"},
    }
    if reused:
        told["sure"] = []  # of what else the model lacks, nothing is known
    return _base(one, case.kind, case.what, found, arm) | told | _worse(case.model, case.c, found)


def _bound(scene: Scene, case: Case) -> Array:
    try:
        if case.other:
            return ratios_apart(rest(case.model, case.b, scene.cutoff), scene.rest)
        if case.knowing is not None:
            own = rest(case.knowing, case.b, scene.cutoff)
            return ratios(rest(case.model, case.b, scene.cutoff), own)
        usual = scene.rest if case.before is None else rest(scene.model, case.before, scene.cutoff)
        return ratios(rest(case.model, case.b, scene.cutoff), usual)
    except SignidError:
        return np.zeros(0)


def _base(one: RealSet, kind: str, what: str, found: Attempt, arm: Arm) -> Row:
    said = found.said
    return {
        "set": one.name,
        "kind": kind,
        "what": what,
        "verdict": said.verdict,
        "causes": [spoken(name, arm) for name in said.named if name.cause],
        "secondary": [spoken(name, arm) for name in said.named if not name.cause],
        "sentences": list(said.sentences),
        "seconds": found.seconds,
        "cutoff": found.diagnosis.cutoff if found.diagnosis else None,
    }


def _worse(given: Model, c: Recording, found: Attempt) -> Row:
    """Both simulations on a recording that took no part, in the band of the diagnosis."""
    if found.diagnosis is None:
        return {"unseen": []}
    extended, cutoff = found.diagnosis.model, found.diagnosis.cutoff
    extended = replace(extended, laws=tuple(law for law in extended.laws if not set(law.parameters) >= ONCE))
    try:
        before, after = (rest(model, c, cutoff) for model in (given, extended))
    except SignidError as error:
        return {"unseen": [], "unseen_refused": str(error)}
    except Exception as error:  # an extended model that cannot be simulated is a result
        return {"unseen": [], "unseen_crash": f"{type(error).__name__}: {error}"}
    return {"unseen": [asdict(one) for one in compare(before, after, extended.robot.joints)]}


def run(one: RealSet, kinds: Collection[str], limit: float | None) -> Iterator[Row]:
    """A set's rows as they come; a set that cannot be begun, or cannot go on, is a row.

    Args:
        one: the set.
        kinds: of cases; empty: all.
        limit: of a diagnosis [s]; None: none.
    """
    try:
        yield from rows_of(one, kinds, limit)
    except Exception as error:
        frame = traceback.extract_tb(error.__traceback__)[-1]
        told = f"{type(error).__name__}: {error} ({frame.name})"
        outcome = "refused" if isinstance(error, SignidError) else "crash"
        failed = {"set": one.name, "kind": "set", "what": "cannot go on", "outcome": outcome}
        yield {**failed, "sentences": [told], "seconds": 0.0}
