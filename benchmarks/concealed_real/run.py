"""Run the cases of a set: identify A, change the model or B, diagnose, evaluate, and compare both models on C."""

from __future__ import annotations

import signal
import time
import traceback
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, dataclass, replace
from types import FrameType
from typing import Any

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.effects import EFFECTS
from signid.errors import SignidError
from signid.model import Model, load_model
from signid.robot.dynamics import own_body
from signid.types import Law, Recording

from .changes import (
    Array,
    Case,
    Change,
    Setup,
    Truth,
    carrying,
    compare,
    identified_std,
    load_of,
    plus,
    ratios,
    ratios_apart,
    recorded,
    residual,
    rms,
    scaled_law,
    shifted,
    swapped,
    tilted,
    times,
    with_body,
    without,
)
from .evaluate import SURE, Answer, Arm, already_named, answer_of, evaluate, label
from .sets import RealSet, columns_of, data, read

CONTROL = "control"
BEYOND = 2.0  # processor time over the time limit at which a diagnosis is aborted [1]
ONCE = {"start", "end"}  # parameters of laws that describe a single event
Row = dict[str, Any]
KIND = "nature"
PAYLOAD = 2.805  # mass weighed by the authors [kg]
COUPLING = {"inertia": 0.00964, "viscous": 0.616, "coulomb": 1.95}  # published [kg.m2], [N.m.s/rad], [N.m]
DIRECTIONS = ("asymmetric_friction", "armature")
FRICTION = ("viscous_friction", "coulomb_friction", "asymmetric_friction", "stribeck_friction")


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


def concealed(one: RealSet, setup: Setup, a: list[Recording]) -> Iterator[Case]:
    """Yield the cases of a set; most sets have none."""
    if one.name in CASES:
        yield CASES[one.name](one, setup, a)


def _payload(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    b, c = (read(one, setup.model.robot, one.more[key]) for key in ("loaded", "loaded, held out"))
    truth = Truth(("payload",), (len(setup.model.robot.joints) - 1,), {"mass": PAYLOAD}, last=True)
    return Case(KIND, f"{PAYLOAD} kg payload", setup.model, b, c, truth, other=True)


def _coupling(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    law = Law(EFFECTS["joint_coupling"], (4, 5), COUPLING)
    complete = replace(setup.model, laws=(*setup.model.laws, law))
    return _same(setup, "wrist coupling", Truth(("joint_coupling",), (4, 5)), complete)


def _directions(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    complete = signid.identify(setup.model.robot, a, options=signid.Options(effects=DIRECTIONS)).model
    return _same(setup, "asymmetric friction", Truth(("asymmetric_friction",), (0,)), complete)


def _friction(one: RealSet, setup: Setup, a: list[Recording]) -> Case:
    published = load_model(data() / one.folder / one.urdf)
    case = _same(setup, "published inertials, no friction", Truth(FRICTION, None), setup.model)
    return replace(case, model=published)


def _same(setup: Setup, what: str, truth: Truth, complete: Model) -> Case:
    return Case(KIND, what, setup.model, setup.b, setup.c, truth, complete)


CASES: dict[str, Callable[[RealSet, Setup, list[Recording]], Case]] = {
    "ur10e": _payload,
    "tx40": _coupling,
    "emps": _directions,
    "panda": _friction,
}
LAWS = ("coulomb_friction", "viscous_friction", "armature", "torque_offset")
SMALLER, HEAVIER = 3.0, 1.2  # divisor of a friction level, factor on a link's inertials [1]
TILT = float(np.radians(3.0))  # base tilt [rad]
LATE, GAIN, OFFSET = 3, 1.15, 0.05  # delay [samples], torque gain [1], encoder offset [rad or m]


def all_cases(setup: Setup) -> Iterator[Case]:
    """Yield all cases: laws, bodies, recordings."""
    yield from laws(setup)
    yield from bodies(setup)
    yield from recordings(setup)


def laws(setup: Setup) -> Iterator[Case]:
    """Remove each kind of law at the joint with its largest share of torque; reduce one Coulomb level."""
    size = _torque(setup)
    for effect in LAWS:
        own = {law.joints[0]: law for law in setup.model.laws if law.effect.name == effect}
        if not own:
            continue
        changed = setup.ratios(without(setup.model, effect)) * rms(setup.residual) / size
        joint = max(own, key=lambda j: changed[j])
        numbers = dict(own[joint].parameters)
        truth = Truth((effect,), (joint,), numbers, numbers, setup.std.get((effect, joint), 0.0))
        yield _case(setup, "law removed", f"no {effect}", joint, without(setup.model, effect, joint), truth)
        if effect == "coulomb_friction":
            smaller = scaled_law(setup.model, effect, joint, 1 / SMALLER)
            lacking = {key: (1 - 1 / SMALLER) * x for key, x in numbers.items()}
            truth = replace(truth, numbers=lacking)
            yield _case(setup, "law of wrong size", f"{effect} / {SMALLER:g}", joint, smaller, truth)


def bodies(setup: Setup) -> Iterator[Case]:
    """Remove and add a payload, make a link of the model too heavy, tilt the base."""
    model, last = setup.model, len(setup.model.robot.joints) - 1
    load, body = load_of(model), own_body(model.robot, last)
    truth = Truth(("payload",), (last,), {"mass": -float(load[0])}, last=True)
    yield _case(setup, "payload gone", f"{-load[0]:.3g} kg", last, with_body(model, body, load), truth)
    truth = Truth(("payload",), (last,), {"mass": float(load[0])}, last=True)
    before, b, c = (carrying(x, model, y, setup.band) for x, y in ((setup.b, None), (setup.b, load), (setup.c, load)))
    yield Case("payload carried", _at(setup, f"{load[0]:.3g} kg", last), model, b, c, truth, before=before)
    middle = range(last + 1) if last < 2 else range(1, last)
    own = {j: model.inertials[own_body(model.robot, j)] for j in middle}
    heavier = {j: with_body(model, own_body(model.robot, j), (HEAVIER - 1) * x) for j, x in own.items()}
    joint = _largest(setup, heavier)
    truth = Truth(("link_inertia",), (joint,), {"mass": (1 - HEAVIER) * float(own[joint][0])}, last=joint == last)
    yield _case(setup, "link +20 %", "its link", joint, heavier[joint], truth)
    leaning = {axis: tilted(model, *(TILT * (k == axis) for k in (0, 1))) for axis in (0, 1)}
    axis = _largest(setup, leaning)
    truth = Truth(("base_tilt",), None, {key: -TILT * (k == axis) for k, key in enumerate("xy")})
    yield _case(setup, "base tilted", f"3 degrees about {'xy'[axis]}", None, leaning[axis], truth)


def recordings(setup: Setup) -> Iterator[Case]:
    """Apply delay, lead, gain, encoder offset, sign and channel swap to B and C."""
    n, step = len(setup.model.robot.joints), float(np.median(np.diff(columns_of(setup.b)["t"])))
    for samples, word in ((LATE, "late"), (-LATE, "early")):
        truth = Truth(("time_delay",), tuple(range(n)), {"delay": samples * step}, fault=word)
        what = f"{LATE} samples, {1e3 * LATE * step:.3g} ms"
        yield _logged(setup, f"torque {word}", what, None, truth, lambda x, k=samples: shifted(x, k))  # type: ignore[misc]
    order = np.argsort(-_torque(setup) / rms(setup.residual)).tolist()  # joints by signal over residual
    first, middle = order[0], order[n // 2]
    truth = Truth(("torque_gain",), (first,), {"error": GAIN - 1}, fault="gain")
    yield _logged(setup, "torque gain", f"x {GAIN:g}", first, truth, lambda x: times(x, first, GAIN))
    trials = [recorded(setup.b, setup.model, lambda x, j=j: plus(x, j, OFFSET)) for j in range(n)]  # type: ignore[misc]
    zero = int(np.argmax([np.max(setup.ratios(setup.model, b)) for b in trials]))
    truth = Truth(("encoder_offset",), (zero,), {"offset": OFFSET})
    yield _logged(setup, "encoder offset", f"+{OFFSET:g}", zero, truth, lambda x: plus(x, zero, OFFSET))
    truth = Truth(("torque_sign",), (middle,), fault="sign")
    yield _logged(setup, "torque sign", "negated", middle, truth, lambda x: times(x, middle, -1.0))
    if n > 1:
        pair = (middle, middle + 1) if middle + 1 < n else (middle - 1, middle)
        truth = Truth(("channel_swap",), pair, fault="swap")
        yield _logged(setup, "channels swapped", "with the next", pair[0], truth, lambda x: swapped(x, pair))


def _case(setup: Setup, kind: str, what: str, joint: int | None, model: Model, truth: Truth) -> Case:
    return Case(kind, _at(setup, what, joint), model, setup.b, setup.c, truth)


def _logged(setup: Setup, kind: str, what: str, joint: int | None, truth: Truth, change: Change) -> Case:
    b, c = (recorded(one, setup.model, change) for one in (setup.b, setup.c))
    return Case(kind, _at(setup, what, joint), setup.model, b, c, truth)


def _at(setup: Setup, what: str, joint: int | None) -> str:
    return what if joint is None else f"{what} at {setup.model.robot.joints[joint]}"


def _largest(setup: Setup, changed: Mapping[int, Model]) -> int:
    """Key of the model with the largest change."""
    sizes = {key: float(np.max(setup.ratios(model))) for key, model in changed.items()}
    return max(sizes, key=lambda key: sizes[key])


def _torque(setup: Setup) -> Array:
    """Rms of the recorded torque (n,) [N.m or N]."""
    return rms(columns_of(setup.b)["tau"])
