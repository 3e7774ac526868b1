"""Joint evaluation of a fleet's sessions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Any

from ...effects import EFFECTS
from ...output.report.results.fleet import change_sentence, outlier_sentence
from ...output.report.results.sentences import Named, Value, finding_headline, subject
from ...types import Input, Result
from ...version import __version__
from ..terminal import FLAGGED
from . import changes as stated
from .changes import ComparedSession, ParameterChange, find_changes, find_outliers
from .manifest import Entry
from .summary import Cause, Drift, Number, Summary, find_drifts

SCHEMA = "signid.fleet/1"
UNDONE = "not done"


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
    drifts: tuple[Drift, ...]
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
            "drifts": [_drift(drift) for drift in self.drifts],
            **change_document(self.changes, self.outliers, self.tested),
            "sessions": [_session(outcome) for outcome in self.outcomes],
            "inputs": [self.manifest._asdict()],
            "seed": self.seed,
            "version": __version__,
        }


def gather(outcomes: Sequence[Outcome], manifest: Input, seed: int, reused: int = 0) -> Fleet:
    """Evaluate sessions jointly; they stand in the order of the manifest."""
    (moved, pairs), (apart, robots) = find_changes(_sessions(outcomes)), find_outliers(_kinds(outcomes))
    series: dict[tuple[str, str], list[tuple[float, Any]]] = {}
    for one in outcomes:
        if one.entry.day is not None and one.summary.numbers:
            series.setdefault((one.entry.name, one.entry.task), []).append((one.entry.day, one.summary.numbers))
    drifts = find_drifts((name, found) for (name, _), found in series.items())
    return Fleet(tuple(outcomes), drifts, tuple(moved), tuple(apart), (pairs, robots), manifest, seed, reused)


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


def _drift(drift: Drift) -> dict[str, Any]:
    return {
        "name": drift.robot,
        "number": drift.what,
        "unit": drift.unit,
        "day": drift.day.tolist(),
        "value": drift.value.tolist(),
        "std": drift.std.tolist(),
        "slope": {"value": drift.slope, "half": drift.half, "unit": f"{drift.unit}/d"},
        "line": {"day": drift.mean_day, "value": drift.middle},
        "change": drift.change,
        "chance": drift.chance,
        "beyond_noise": drift.beyond,
    }


def change_document(
    changes: Sequence[ParameterChange], outliers: Sequence[ParameterChange], tested: tuple[int, int]
) -> dict[str, Any]:
    """Changes between sessions, outliers between robots, and the stated priors and spreads of both."""
    return {
        "changes": [one | {"sentence": change_sentence(one)} for one in map(_change, changes)],
        "outliers": [one | {"sentence": outlier_sentence(one)} for one in map(_outlier, outliers)],
        "comparison": {
            "prior": stated.PRIOR,
            "threshold": stated.SURE,
            "change_spread": stated.WIDTH,
            "session_spread": stated.DAYS,
            "robot_spread": stated.ROBOTS,
            "base_spread": stated.RIGID,
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
