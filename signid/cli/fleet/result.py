"""Joint evaluation of a fleet's sessions."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from ...effects import EFFECTS
from ...output.report.results.fleet import change_sentence, outlier_sentence
from ...output.report.results.sentences import Named, Value, finding_headline, subject
from ...types import Array, Input, Result
from ...version import __version__
from ..terminal import FLAGGED
from .manifest import Entry
from .summary import Cause, Number, Summary

SCHEMA = "signid.fleet/1"
UNDONE = "not done"
PRIOR = 0.01  # prior probability that a parameter changed, or that a robot's parameter is an outlier; stated
SURE = 0.95  # probability from which a change or an outlier is a finding
SHOWN = 0.5  # probability from which it is listed
WIDTH = 0.5  # standard deviation of a change, as a share of the parameter; stated
DAYS = 0.06  # spread of friction between sessions, as a share: median over five sessions of a UR10e, 19 days
ROBOTS = 0.15  # spread between robots of a kind, as a share; stated
RIGID = 0.02  # spread of base parameters, which neither wear nor warm, as a share; stated
FEWEST = 8  # minimum number of parameters whose scatter widens all standard deviations
MAD = 1.4826  # standard deviation over median absolute deviation of a normal variable
ROBOTS_LEAST = 3  # minimum number of robots of a kind, to say which of them is the outlier


@dataclass(frozen=True)
class Outcome:
    """One session, completed or failed."""

    entry: Entry
    code: int | None  # exit code of its command; None: its processes died
    said: tuple[str, ...]  # flags, or the reason of the failure
    files: tuple[str, ...]  # files in its folder
    summary: Summary

    @property
    def done(self) -> bool:
        """Whether there is a result."""
        return bool(self.files)


@dataclass(frozen=True, eq=False)
class Fleet(Result):
    """All sessions in the order of the manifest, and their joint evaluation."""

    outcomes: tuple[Outcome, ...]
    changes: tuple[ParameterChange, ...]  # between sessions of a robot; the most probable first
    outliers: tuple[ParameterChange, ...]  # robots beside the others of their kind
    tested: tuple[int, int]  # number of comparisons of both
    manifest: Input
    seed: int
    reused: int = 0  # number of sessions that an earlier run stored

    @property
    def robots(self) -> list[tuple[str, list[Outcome]]]:
        """Robots with their sessions in order of time; the largest latest mismatch first, then as in the manifest."""
        found: dict[str, list[Outcome]] = {}
        for outcome in self.outcomes:
            found.setdefault(outcome.entry.name, []).append(outcome)
        ordered = {name: sorted(some, key=_moment) for name, some in found.items()}
        return sorted(ordered.items(), key=lambda robot: -(_latest(robot[1]).summary.mismatch or -1.0))

    @property
    def causes(self) -> list[dict[str, Any]]:
        """Causes shared by the latest diagnoses of robots of one kind; the most frequent first."""
        kinds: dict[str, list[tuple[str, Summary]]] = {}
        for name, sessions in self.robots:
            diagnosed = [one for one in sessions if one.summary.verdict]
            if diagnosed:
                kinds.setdefault(diagnosed[-1].summary.kind, []).append((name, diagnosed[-1].summary))
        found = [cause for kind, robots in kinds.items() for cause in _grouped(kind, robots)]
        return sorted(found, key=lambda cause: (-len(cause["robots"]), cause["kind"], cause["cause"]))

    @property
    def flagged(self) -> bool:
        """Whether a session failed or is flagged."""
        return any(not outcome.done or outcome.code == FLAGGED for outcome in self.outcomes)

    def document(self) -> dict[str, Any]:
        """The content of fleet.json."""
        return {
            "schema": SCHEMA,
            "robots": [_robot(name, sessions) for name, sessions in self.robots],
            "causes": self.causes,
            **change_document(self.changes, self.outliers, self.tested),
            "sessions": [_session(outcome) for outcome in self.outcomes],
            "inputs": [self.manifest._asdict()],
            "seed": self.seed,
            "version": __version__,
        }


def gather(outcomes: Sequence[Outcome], manifest: Input, seed: int, reused: int = 0) -> Fleet:
    """Evaluate sessions jointly; they stand in the order of the manifest."""
    (moved, pairs), (apart, robots) = find_changes(_sessions(outcomes)), find_outliers(_kinds(outcomes))
    return Fleet(tuple(outcomes), tuple(moved), tuple(apart), (pairs, robots), manifest, seed, reused)


def _sessions(outcomes: Sequence[Outcome]) -> list[list[ComparedSession]]:
    """Sessions with results of each robot and task in order of time."""
    groups: dict[tuple[str, str, str], list[ComparedSession]] = {}
    for one in sorted(outcomes, key=_moment):
        if one.summary.numbers or one.summary.verdict:
            key = (one.entry.name, one.entry.task, one.summary.kind)
            session = ComparedSession(one.entry.name, one.entry.session, one.entry.time, one.summary)
            groups.setdefault(key, []).append(session)
    return list(groups.values())


def _kinds(outcomes: Sequence[Outcome]) -> list[list[ComparedSession]]:
    """The last session of each robot, by kind of robot and task."""
    tasks = {one.entry.session: one.entry.task for one in outcomes}
    groups: dict[tuple[str, str], list[ComparedSession]] = {}
    for sessions in _sessions(outcomes):
        last = sessions[-1]
        groups.setdefault((last.summary.kind, tasks[last.session]), []).append(last)
    return list(groups.values())


def _moment(outcome: Outcome) -> tuple[float, int]:
    day = outcome.entry.day
    return float("-inf") if day is None else day, outcome.entry.line


def _latest(sessions: Sequence[Outcome]) -> Outcome:
    """The last session with a known mismatch, or else the last session."""
    return ([one for one in sessions if one.summary.mismatch is not None] or sessions)[-1]


def _grouped(kind: str, robots: Sequence[tuple[str, Summary]]) -> Iterator[dict[str, Any]]:
    groups: dict[str, list[tuple[str, Cause]]] = {}
    for name, summary in robots:
        for cause in summary.causes:
            groups.setdefault(cause.name, []).append((name, cause))
    for law, found in groups.items():
        joint = found[0][1].joint
        could = sum(joint is None or joint in summary.joints for _, summary in robots)
        yield {
            "cause": law,
            "title": subject(cause_named(found[0][1])),
            "kind": kind,
            "robots": [name for name, _ in found],
            "of": could,
            "probability": min(one.probability for _, one in found),
            "numbers": list(_spread([one for _, one in found])),
        }


def _spread(causes: Sequence[Cause]) -> Iterator[dict[str, Any]]:
    """Range, median and largest standard deviation of each number over the robots."""
    series: dict[tuple[str, str], list[Number]] = {}
    for number in (number for cause in causes for number in cause.numbers):
        series.setdefault((number.what.rpartition(": ")[2], number.unit), []).append(number)
    for (key, unit), found in series.items():
        values = [number.value for number in found]
        ends = {"least": min(values), "median": median(values), "most": max(values)}
        yield {"key": key, "unit": unit, **ends, "std": max(number.std for number in found)}


def _taken(source: Entry | Summary, *keys: str) -> dict[str, Any]:
    """Some fields of a session, or of its summary."""
    return {key: getattr(source, key) for key in keys}


def _robot(name: str, sessions: Sequence[Outcome]) -> dict[str, Any]:
    latest = _latest(sessions)
    return {
        "name": name,
        "kind": latest.summary.kind,
        "sessions": [one.entry.session for one in sessions],
        "latest": latest.entry.session,
        **_taken(latest.entry, "time", "task"),
        **_taken(latest.summary, "mismatch", "joint", "left", "explained", "verdict"),
        "causes": [cause.name for cause in latest.summary.causes],
        "lacks": [finding_headline(cause_named(cause)) for cause in latest.summary.causes],
        "undone": sum(not one.done for one in sessions),
    }


def _session(outcome: Outcome) -> dict[str, Any]:
    state = UNDONE if not outcome.done else "flagged" if outcome.code == FLAGGED else "done"
    return {
        **_taken(outcome.entry, "session", "name", "robot", "task", "time"),
        "recordings": list(outcome.entry.recordings),
        "state": state,
        "said": list(outcome.said),
        "folder": f"sessions/{outcome.entry.session}" if outcome.done else None,
        "files": list(outcome.files),
        **_taken(outcome.summary, "mismatch", "joint", "left", "verdict"),
        "causes": [cause.name for cause in outcome.summary.causes],
    }


def change_document(
    changes: Sequence[ParameterChange], outliers: Sequence[ParameterChange], tested: tuple[int, int]
) -> dict[str, Any]:
    """Changes between sessions, outliers between robots, and the stated priors and spreads of both."""
    return {
        "changes": [one | {"sentence": change_sentence(one)} for one in map(_change, changes)],
        "outliers": [one | {"sentence": outlier_sentence(one)} for one in map(_outlier, outliers)],
        "comparison": {
            "prior": PRIOR,
            "threshold": SURE,
            "change_spread": WIDTH,
            "session_spread": DAYS,
            "robot_spread": ROBOTS,
            "base_spread": RIGID,
            "changes_tested": tested[0],
            "outliers_tested": tested[1],
        },
    }


def cause_named(cause: Cause) -> Named:
    """A cause for its wording."""
    numbers = {number.what.rpartition(": ")[2]: Value(*number[2:4], number.unit) for number in cause.numbers}
    return Named(EFFECTS[cause.effect], cause.joint, cause.partner, numbers)


def number_title(number: Number) -> str:
    """A parameter in words: its law and joints, and the parameter if the law has several."""
    if number.effect not in EFFECTS.names:
        return f"base parameter {number.what}" if not number.effect else number.what
    effect, key = EFFECTS[number.effect], number.what.rpartition(": ")[2]
    words = subject(Named(effect, number.joint, number.partner, {key: Value(*number[2:4], number.unit)}))
    return f"{words} ({key.replace('_', ' ')})" if len(effect.parameters) > 1 else words


def _compared(one: ParameterChange) -> dict[str, Any]:
    number = one.number
    return {
        "name": one.at.robot,
        "kind": one.at.summary.kind,
        "number": number.what,
        "title": number_title(number),
        "effect": number.effect or None,
        **{key: getattr(number, key) for key in ("joint", "partner", "unit")},
        "finding": one.found,
        "probability": one.probability,
        "log_bayes_factor": one.odds,
        "spread": one.spread,
        "change": number.value - one.centre,
    }


def _change(one: ParameterChange) -> dict[str, Any]:
    last = one.others[-1]
    before = {"sessions": [other.session for other in one.others], "time": last.time}
    after = {"session": one.at.session, "time": one.at.time, "value": one.number.value, "std": one.number.std}
    return {**_compared(one), "before": {**before, "value": one.centre, "std": one.centre_std}, "after": after}


def _outlier(one: ParameterChange) -> dict[str, Any]:
    ends = {"least": one.least, "median": one.centre, "most": one.most}
    own = {"session": one.at.session, "value": one.number.value, "std": one.number.std}
    return {**_compared(one), **own, "others": {"robots": [other.robot for other in one.others], **ends}}


class ComparedSession(NamedTuple):
    """A session of a robot with its result."""

    robot: str
    session: str
    time: str
    summary: Summary


@dataclass(frozen=True)
class ParameterChange:
    """A parameter of a session beside those of sessions before, or of a robot beside those of the others."""

    number: Number
    at: ComparedSession
    others: tuple[ComparedSession, ...]
    centre: float  # of the others [unit of the number]
    centre_std: float  # of noise alone [unit of the number]
    least: float  # of the others [unit of the number]
    most: float
    spread: float  # standard deviation of the difference if nothing changed [unit of the number]
    odds: float  # log Bayes factor of a change [1]

    @property
    def probability(self) -> float:
        """Posterior probability of a change."""
        return 1 / (1 + exp(min(700.0, -self.odds - log(PRIOR / (1 - PRIOR)))))

    @property
    def found(self) -> bool:
        """Whether it is a finding."""
        return self.probability >= SURE


def find_changes(robots: Iterable[Sequence[ComparedSession]]) -> tuple[list[ParameterChange], int]:
    """Changes between the sessions of each robot in order of time, the most probable first; and how many were tested.

    A session is compared with those since the last change of a parameter.
    """
    found, tested = list[ParameterChange](), 0
    for sessions in robots:
        since: dict[tuple[str, str], int] = {}
        for k in range(1, len(sessions)):
            compared = list(_comparisons(sessions[k], sessions[:k], DAYS, since))
            tested += len(compared)
            since |= {(one.number.what, one.number.unit): k for one in compared if one.found}
            found += compared
    return _ordered(found), tested


def find_outliers(kinds: Iterable[Sequence[ComparedSession]]) -> tuple[list[ParameterChange], int]:
    """Robots that differ from the others of their kind, the most probable first; and how many numbers were tested."""
    found, tested = list[ParameterChange](), 0
    for robots in kinds:
        for k in range(len(robots) if len(robots) >= ROBOTS_LEAST else 0):
            compared = list(_comparisons(robots[k], [*robots[:k], *robots[k + 1 :]], ROBOTS, {}))
            compared = [one for one in compared if len(one.others) >= ROBOTS_LEAST - 1]
            tested += len(compared)
            found += compared
    return _ordered(found), tested


def _ordered(found: Sequence[ParameterChange]) -> list[ParameterChange]:
    shown = [one for one in found if one.probability >= SHOWN]
    return sorted(shown, key=lambda one: (-one.odds, one.at.robot, one.at.session, one.number.what))


def _comparisons(
    session: ComparedSession, before: Sequence[ComparedSession], share: float, since: Mapping[tuple[str, str], int]
) -> Iterator[ParameterChange]:
    """Compare each parameter of a session with other sessions; those before index `since` do not count."""
    series: dict[tuple[str, str], list[tuple[ComparedSession, Number, Number]]] = {}
    for k, other in enumerate(before):
        mine, theirs = ({(x.what, x.unit): x for x in some} for some in completed(session.summary, other.summary))
        for key in mine.keys() & theirs.keys():
            if k >= since.get(key, 0):
                series.setdefault(key, []).append((other, mine[key], theirs[key]))
    sizes = _sizes(number for some in series.values() for _, *pair in some for number in pair)
    found = [_difference(session, series[key], share, sizes) for key in sorted(series)]
    ratios = [abs(one.number.value - one.centre) / one.spread for one in found]
    wider = max(1.0, MAD * median(ratios)) if len(ratios) >= FEWEST else 1.0
    yield from (_weighed(one, wider, sizes) for one in found)


def completed(one: Summary, other: Summary) -> tuple[list[Number], list[Number]]:
    """Parameters of two sessions; a law that only one diagnosis names has the stated value, or zero, in the other.

    Its standard deviation there is that of the largest law that a diagnosis would not name. The law is left out if the
    other diagnosis names another law at its joint, which may be the same physics in other words.
    """
    return [*one.numbers, *_absent(other, one)], [*other.numbers, *_absent(one, other)]


def _absent(given: Summary, lacking: Summary) -> Iterator[Number]:
    if not lacking.verdict or lacking.verdict == "unknown":
        return
    known = {cause.name for cause in lacking.found}
    places = {cause.joint for cause in lacking.causes}
    for cause in given.causes:
        if cause.name not in known and cause.joint not in places and cause.numbers:
            number = cause.numbers[0]
            unseen = min(1.0, lacking.tolerance / max(cause.share, 1e-9)) * abs(number.value - cause.stated)
            yield number._replace(value=cause.stated, std=max(number.std, unseen))


def _sizes(numbers: Iterable[Number]) -> dict[tuple[str, str], float]:
    """Largest value of each parameter; of laws, of all parameters of the joint in the same unit [unit of them]."""
    sizes: dict[tuple[str, str], float] = {}
    for number in numbers:
        key = _place(number)
        sizes[key] = max(sizes.get(key, 0.0), abs(number.value))
    return sizes


def _place(number: Number) -> tuple[str, str]:
    return (number.joint or number.what, number.unit) if number.effect else (number.what, number.unit)


def _size(number: Number, centre: float, sizes: Mapping[tuple[str, str], float]) -> float:
    """Size that spreads are shares of [unit of the number]: of an offset, that of the joint's friction."""
    own = (abs(number.value) + abs(centre)) / 2
    return max(own, sizes[_place(number)] / 2) if number.effect == "torque_offset" else own


def _difference(
    session: ComparedSession,
    series: Sequence[tuple[ComparedSession, Number, Number]],
    share: float,
    sizes: Mapping[tuple[str, str], float],
) -> ParameterChange:
    """A parameter beside those of other sessions: their centre, and the spread of differences if nothing changed."""
    number = series[-1][1]
    value, std = np.array([[theirs.value, theirs.std] for *_, theirs in series]).T
    usual = (share if number.effect else RIGID) * _size(number, float(np.median(value)), sizes)
    spread = max(usual, _scatter(value, std))
    weight = 1 / (std**2 + spread**2)
    centre = float(np.median(value)) if len(value) > 2 else float(weight @ value / weight.sum())
    variance = (np.pi / 2 if len(value) > 2 else 1.0) / weight.sum()
    return ParameterChange(
        number=number,
        at=session,
        others=tuple(other for other, *_ in series),
        centre=centre,
        centre_std=float(np.sum(std**-2.0) ** -0.5),
        least=float(value.min()),
        most=float(value.max()),
        spread=float(np.sqrt(number.std**2 + spread**2 + variance)),
        odds=0.0,
    )


def _scatter(value: Array, std: Array) -> float:
    """Robust spread of values (k,) beyond their standard deviations (k,) [unit of the number]; 0 for one value."""
    if len(value) < 2:
        return 0.0
    middle = np.median(value)
    size = np.ptp(value) / np.sqrt(2) if len(value) == 2 else MAD * np.median(np.abs(value - middle))
    return float(np.sqrt(max(0.0, size**2 - np.mean(std**2))))


def _weighed(one: ParameterChange, wider: float, sizes: Mapping[tuple[str, str], float]) -> ParameterChange:
    """With the log Bayes factor of a change; the spread is `wider` where most parameters of the pair scatter so."""
    null = (wider * one.spread) ** 2
    free = null + (WIDTH * _size(one.number, one.centre, sizes)) ** 2
    square = (one.number.value - one.centre) ** 2
    odds = 0.5 * log(null / free) + 0.5 * square * (1 / null - 1 / free)
    return replace(one, spread=null**0.5, odds=float(odds))
