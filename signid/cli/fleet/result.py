"""Joint evaluation of a fleet's sessions."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import exp, log
from statistics import median
from typing import Any, NamedTuple

import numpy as np

from ...effects import EFFECTS
from ...output.report.quantities import Quantity
from ...output.report.results.fleet import FLAGGED_STATE as MARKED, UNDONE_STATE, change_sentence, outlier_sentence
from ...output.report.results.sentences import Named, finding_headline, subject
from ...types import Input, Result
from ...version import __version__
from ..terminal import FLAGGED
from .manifest import Entry

FLEET_SCHEMA = "signid.fleet/1"
CHANGE_PRIOR = 0.01  # prior probability that a parameter changed, or that a robot's parameter is an outlier; stated
FINDING_PROBABILITY = 0.95  # probability from which a change or an outlier is a finding
LISTED_PROBABILITY = 0.5  # probability from which it is listed
CHANGE_STD = 0.5  # standard deviation of a change, as a share of the parameter; stated
SESSION_SPREAD = 0.06  # spread of friction between sessions, as a share: median over five sessions of a UR10e, 19 days
ROBOT_SPREAD = 0.15  # spread between robots of a kind, as a share; stated
BASE_SPREAD = 0.02  # spread of base parameters, which neither wear nor warm, as a share; stated
MIN_SCATTER_PARAMETERS = 8  # minimum number of parameters whose scatter widens all standard deviations
STD_OVER_MAD = 1.4826  # standard deviation over median absolute deviation of a normal variable
MIN_KIND_ROBOTS = 3  # minimum number of robots of a kind, to say which of them is the outlier
DOCUMENT_OF_TASK = {"diagnose": "diagnosis.json", "identify": "identification.json"}
MAX_NOISE_FACTOR = 1e6  # maximum ratio of residual to noise floor


@dataclass(frozen=True, eq=False)
class Fleet(Result):
    """All sessions in the order of the manifest, and their joint evaluation."""

    outcomes: tuple[Outcome, ...]
    manifest: Input
    seed: int
    reused: int = 0  # number of sessions that an earlier run stored

    @property
    def robots(self) -> list[tuple[str, list[Outcome]]]:
        """Robots with their sessions in order of time; the largest latest mismatch first, then as in the manifest."""
        by_name: dict[str, list[Outcome]] = {outcome.entry.name: [] for outcome in self.outcomes}
        for outcome in sorted(self.outcomes, key=_moment):
            by_name[outcome.entry.name].append(outcome)
        return sorted(by_name.items(), key=lambda robot: -(_latest(robot[1]).summary.mismatch or -1.0))

    @property
    def flagged(self) -> bool:
        """Whether a session failed or is flagged."""
        return any(not outcome.done or outcome.code == FLAGGED for outcome in self.outcomes)

    def document(self) -> dict[str, Any]:
        """The content of fleet.json."""
        groups: dict[tuple[str, str, str], list[Outcome]] = {}
        for one in sorted(self.outcomes, key=_moment):
            if one.summary.numbers or one.summary.verdict:
                groups.setdefault((one.entry.name, one.entry.task, one.summary.kind), []).append(one)
        robots: list[dict[str, Any]] = []
        for name, sessions in self.robots:
            latest = _latest(sessions)
            robots.append(
                {
                    "name": name,
                    "kind": latest.summary.kind,
                    "sessions": [one.entry.session for one in sessions],
                    "latest": latest.entry.session,
                    **_fields_of(latest.entry, "time task"),
                    **_fields_of(latest.summary, "mismatch joint left explained verdict"),
                    "causes": [cause.name for cause in latest.summary.causes],
                    "lacks": [finding_headline(cause.named) for cause in latest.summary.causes],
                    "undone": sum(not one.done for one in sessions),
                }
            )
        return {
            "schema": FLEET_SCHEMA,
            "robots": robots,
            **change_document(list(groups.values())),
            "sessions": [
                {
                    **_fields_of(outcome.entry, "session name robot task time"),
                    "recordings": list(outcome.entry.recordings),
                    "state": UNDONE_STATE if not outcome.done else MARKED if outcome.code == FLAGGED else "done",
                    "said": list(outcome.said),
                    "folder": f"sessions/{outcome.entry.session}" if outcome.done else None,
                    "files": list(outcome.files),
                    **_fields_of(outcome.summary, "mismatch joint left verdict"),
                    "causes": [cause.name for cause in outcome.summary.causes],
                }
                for outcome in self.outcomes
            ],
            "inputs": [self.manifest._asdict()],
            "seed": self.seed,
            "version": __version__,
        }


def _moment(outcome: Outcome) -> tuple[float, int]:
    day = outcome.entry.day
    return float("-inf") if day is None else day, outcome.entry.line


def _latest(sessions: Sequence[Outcome]) -> Outcome:
    """The last session with a known mismatch, or else the last session."""
    return ([session for session in sessions if session.summary.mismatch is not None] or sessions)[-1]


def _fields_of(source: object, keys: str) -> Mapping[str, Any]:
    """Some fields of a session, or of its summary."""
    return {key: getattr(source, key) for key in keys.split()}


class Difference(NamedTuple):
    """A parameter of a session beside those of sessions before, or of a robot beside those of the others."""

    number: Number
    at: Outcome
    others: tuple[Outcome, ...]
    centre: float  # of the others, as all below [unit of the number]
    centre_std: float  # of noise alone
    least: float
    most: float
    spread: float  # standard deviation of the difference if nothing changed
    width: float  # standard deviation of a change

    @property
    def odds(self) -> float:
        """Log Bayes factor of a change [1]."""
        null, free = self.spread**2, self.spread**2 + self.width**2
        square = (self.number.value - self.centre) ** 2
        return float(0.5 * log(null / free) + 0.5 * square * (1 / null - 1 / free))

    @property
    def probability(self) -> float:
        """Posterior probability of a change [1]."""
        return 1 / (1 + exp(min(700.0, -self.odds - log(CHANGE_PRIOR / (1 - CHANGE_PRIOR)))))

    @property
    def found(self) -> bool:
        """Whether it is a finding."""
        return self.probability >= FINDING_PROBABILITY


def find_changes(robots: Iterable[Sequence[Outcome]]) -> list[Difference]:
    """Parameters of each robot's sessions in order of time beside those before, the most probable change first.

    A session is compared with those since the last change of a parameter.
    """
    differences = list[Difference]()
    for sessions in robots:
        since: dict[tuple[str, str], int] = {}
        for k in range(1, len(sessions)):
            compared = _compared(sessions[k], sessions[:k], SESSION_SPREAD, since)
            since |= {difference.number[:2]: k for difference in compared if difference.found}
            differences += compared
    return sorted(differences, key=_rank)


def find_outliers(kinds: Iterable[Sequence[Outcome]]) -> list[Difference]:
    """Parameters of each robot beside those of the others of its kind, the most probable outlier first."""
    pairs = ((robots, k) for robots in kinds for k in range(len(robots)))
    compared = (_compared(robots[k], [*robots[:k], *robots[k + 1 :]], ROBOT_SPREAD, {}) for robots, k in pairs)
    differences = (difference for group in compared for difference in group)
    return sorted((x for x in differences if len(x.others) >= MIN_KIND_ROBOTS - 1), key=_rank)


def _rank(difference: Difference) -> tuple[float, str, str, str]:
    return -difference.odds, difference.at.entry.name, difference.at.entry.session, difference.number.what


def change_document(sessions: Sequence[Sequence[Outcome]]) -> dict[str, Any]:
    """Changes and outliers among the sessions of each robot and task, with the stated priors and spreads of both."""
    kinds: dict[tuple[str, str], list[Outcome]] = {}
    for group in sessions:
        kinds.setdefault((group[-1].summary.kind, group[-1].entry.task), []).append(group[-1])
    moved, apart = find_changes(sessions), find_outliers(kinds.values())
    changes, outliers = ([one for one in group if one.probability >= LISTED_PROBABILITY] for group in (moved, apart))
    return {
        "changes": [row | {"sentence": change_sentence(row)} for row in map(_change, changes)],
        "outliers": [row | {"sentence": outlier_sentence(row)} for row in map(_outlier, outliers)],
        "comparison": {
            "prior": CHANGE_PRIOR,
            "threshold": FINDING_PROBABILITY,
            "change_spread": CHANGE_STD,
            "session_spread": SESSION_SPREAD,
            "robot_spread": ROBOT_SPREAD,
            "base_spread": BASE_SPREAD,
            "changes_tested": len(moved),
            "outliers_tested": len(apart),
        },
    }


def _row(difference: Difference) -> dict[str, Any]:
    number = difference.number
    if number.effect not in EFFECTS.names:
        title = number.what if number.effect else f"base parameter {number.what}"
    else:
        effect = EFFECTS[number.effect]
        words = subject(Named(effect, number.joint, number.partner, {number.key: number.shown}))
        title = f"{words} ({number.key.replace('_', ' ')})" if len(effect.parameters) > 1 else words
    return {
        "name": difference.at.entry.name,
        "kind": difference.at.summary.kind,
        "number": number.what,
        "title": title,
        "effect": number.effect or None,
        **{key: getattr(number, key) for key in ("joint", "partner", "unit")},
        "finding": difference.found,
        "probability": difference.probability,
        "log_bayes_factor": difference.odds,
        "spread": difference.spread,
        "change": number.value - difference.centre,
    }


def _change(change: Difference) -> dict[str, Any]:
    at, last = change.at.entry, change.others[-1].entry
    before = {"sessions": [other.entry.session for other in change.others], "time": last.time}
    after = {"session": at.session, "time": at.time, "value": change.number.value, "std": change.number.std}
    return {**_row(change), "before": {**before, "value": change.centre, "std": change.centre_std}, "after": after}


def _outlier(outlier: Difference) -> dict[str, Any]:
    number = {"session": outlier.at.entry.session, "value": outlier.number.value, "std": outlier.number.std}
    others = {"robots": [other.entry.name for other in outlier.others], "least": outlier.least}
    return {**_row(outlier), **number, "others": {**others, "median": outlier.centre, "most": outlier.most}}


def _compared(
    session: Outcome, others: Sequence[Outcome], share: float, since: Mapping[tuple[str, str], int]
) -> list[Difference]:
    """Compare each parameter of a session with other sessions; those before index `since` do not count."""
    series: dict[tuple[str, str], list[tuple[Outcome, Number, Number]]] = {}
    for k, other in enumerate(others):
        mine = {number[:2]: number for number in _completed(session.summary, other.summary)}
        theirs = {number[:2]: number for number in _completed(other.summary, session.summary)}
        for key in mine.keys() & theirs.keys():
            if k >= since.get(key, 0):
                series.setdefault(key, []).append((other, mine[key], theirs[key]))
    largest: dict[tuple[str, str], float] = {}  # of all parameters of a joint in the same unit
    for number in (number for pairs in series.values() for _, *pair in pairs for number in pair):
        largest[number.place] = max(largest.get(number.place, 0.0), abs(number.value))
    differences = [_difference(session, series[key], share, largest) for key in sorted(series)]
    ratios = [abs(difference.number.value - difference.centre) / difference.spread for difference in differences]
    wider = max(1.0, STD_OVER_MAD * median(ratios)) if len(ratios) >= MIN_SCATTER_PARAMETERS else 1.0
    return [difference._replace(spread=wider * difference.spread) for difference in differences]


def _completed(summary: Summary, other: Summary) -> Iterator[Number]:
    """Parameters of a session; a law that only the other diagnosis names has the stated value, or zero.

    Its standard deviation is then that of the largest law that a diagnosis would not name. The law is left out if this
    diagnosis names another law at its joint, which may be the same physics in other words.
    """
    yield from summary.numbers
    known, places = {cause.name for cause in summary.found}, {cause.joint for cause in summary.causes}
    for cause in other.causes if summary.verdict not in ("", "unknown") else ():
        if cause.name not in known and cause.joint not in places and cause.numbers:
            number = cause.numbers[0]
            unseen = min(1.0, summary.tolerance / max(cause.share, 1e-9)) * abs(number.value - cause.stated)
            yield number._replace(value=cause.stated, std=max(number.std, unseen))


def _difference(
    session: Outcome,
    series: Sequence[tuple[Outcome, Number, Number]],
    share: float,
    largest: Mapping[tuple[str, str], float],
) -> Difference:
    """A parameter beside those of other sessions: their centre, and the spread of differences if nothing changed."""
    others, (*_, number), theirs = zip(*series, strict=True)
    value, std = np.array([[estimate.value, estimate.std] for estimate in theirs]).T
    few, middle = len(value) <= 2, float(np.median(value))

    def size(centre: float) -> float:  # that spreads are shares of: of an offset, that of the joint's friction
        scale: float = (abs(number.value) + abs(centre)) / 2
        return max(scale, largest[number.place] / 2) if number.effect == "torque_offset" else scale

    scatter = np.ptp(value) / np.sqrt(2) if few else STD_OVER_MAD * np.median(np.abs(value - middle))
    beyond_noise = float(np.sqrt(max(0.0, scatter**2 - np.mean(std**2))))
    spread = max((share if number.effect else BASE_SPREAD) * size(middle), beyond_noise)
    weight = 1 / (std**2 + spread**2)
    centre = float(weight @ value / weight.sum()) if few else middle
    variance = (1.0 if few else np.pi / 2) / weight.sum()
    return Difference(
        number=number,
        at=session,
        others=others,
        centre=centre,
        centre_std=float(np.sum(std**-2.0) ** -0.5),
        least=float(value.min()),
        most=float(value.max()),
        spread=float(np.sqrt(number.std**2 + spread**2 + variance)),
        width=CHANGE_STD * size(centre),
    )


class Number(NamedTuple):
    """A parameter estimated in one session."""

    what: str  # "coulomb_friction of joint_2: level"
    unit: str
    value: float
    std: float
    effect: str = ""  # of a law; "": a base parameter
    joint: str | None = None
    partner: str | None = None

    @property
    def key(self) -> str:
        """Name of the parameter in its law."""
        return self.what.rpartition(": ")[2]

    @property
    def place(self) -> tuple[str, str]:
        """Group of parameters of one size: of laws, all of the joint in the same unit."""
        return (self.joint or self.what) if self.effect else self.what, self.unit

    @property
    def shown(self) -> Quantity:
        """For its wording."""
        return Quantity(self.key, self.value, self.std, self.unit)


class Cause(NamedTuple):
    """A law that a simulation lacks."""

    effect: str
    joint: str | None
    partner: str | None
    numbers: tuple[Number, ...]
    role: str  # "cause", or of a correction another
    share: float = 0.0  # largest torque over that of the joint [1]
    stated: float = 0.0  # value of its first number in the simulation [unit of the number]

    @property
    def name(self) -> str:
        """Name of the law and its joints."""
        return _law_name(self.effect, self.joint, self.partner)

    @property
    def named(self) -> Named:
        """For its wording."""
        numbers = {number.key: number.shown for number in self.numbers}
        return Named(EFFECTS[self.effect], self.joint, self.partner, numbers)


class Summary(NamedTuple):
    """Result of a session. Residuals are those of the held-out torque, relative to the noise floor."""

    kind: str = ""  # kind of robot: the name in its description
    mismatch: float | None = None  # residual of the simulation or the identified model at the joint where it is largest
    joint: str = ""  # that joint
    left: float | None = None  # residual of the extended simulation at that joint
    verdict: str = ""  # verdict of a diagnosis
    numbers: tuple[Number, ...] = ()  # parameters that are compared
    found: tuple[Cause, ...] = ()  # causes and corrections
    tolerance: float = 0.0  # largest residual that counts as no difference, as a share of torque [1]

    @property
    def causes(self) -> list[Cause]:
        """Without corrections."""
        return [cause for cause in self.found if cause.role == "cause"]

    @property
    def explained(self) -> float | None:
        """Share of the squared residual at that joint that a diagnosis explains."""
        return None if self.left is None or not self.mismatch else max(0.0, 1 - (self.left / self.mismatch) ** 2)


class Outcome(NamedTuple):
    """One session, completed or failed."""

    entry: Entry
    code: int | None  # exit code of its command; None: its processes died
    said: tuple[str, ...]  # flags, or the reason of the failure
    files: tuple[str, ...] = ()  # files in its folder
    summary: Summary = Summary()

    @property
    def done(self) -> bool:
        """Whether there is a result."""
        return bool(self.files)


def summarise(task: str, document: Mapping[str, Any]) -> Summary:
    """Summarise the diagnosis.json or identification.json of a session."""
    kind, fit = str(document["robot"]), document["fit"]
    before = fit if task == "identify" else fit["before"]
    sizes = [(size, -j) for j in range(len(before["joints"])) if (size := _over(before, j)) is not None]
    mismatch, j = max(sizes, default=(None, 0))
    joint = "" if mismatch is None else str(before["joints"][-j])
    if task == "identify":
        identified: list[Number] = []
        for law in document["effects"]:
            identified += _numbers(law["parameters"], law["effect"], law["joint"])
        law_alone = re.compile(rf"({'|'.join(map(re.escape, EFFECTS.names))})[\w.]*")
        for base in document["base_parameters"]:
            value, std = base["estimate"], base["std"]
            if not law_alone.fullmatch(base["expression"]) and value is not None and std:
                identified.append(Number(base["expression"], base["unit"], value, std))
        return Summary(kind, mismatch, joint, numbers=tuple(identified))
    left = None if mismatch is None else _over(fit["after"], -j)
    causes: list[Cause] = []
    for finding in document["findings"]:
        parameters = finding["parameters"]
        at = finding["effect"], finding["joint"], parameters.get("partner", {}).get("value")
        parts = tuple(_numbers(parameters, *at))
        stated = parameters[parts[0].key].get("stated") if parts else None
        share = max((finding.get("torque_share") or {}).values(), default=0.0)
        causes.append(Cause(*at, parts, finding["role"], float(share), float(stated or 0.0)))
    found = tuple(causes)
    numbers = tuple(number for cause in found for number in cause.numbers)
    tolerance = float(document.get("tolerance") or 0.0)
    return Summary(kind, mismatch, joint, left, str(document["verdict"]), numbers, found, tolerance)


def _over(fit: Mapping[str, Sequence[Any]], j: int) -> float | None:
    rms, floor = fit["held_out_rms"][j], fit["noise_floor"][j]
    return None if rms is None or floor is None else min(MAX_NOISE_FACTOR, rms / max(floor, 1e-300))


def _law_name(effect: str, joint: str | None, partner: str | None = None) -> str:
    return effect + (f" of {joint}{f' and {partner}' if partner else ''}" if joint else "")


def _numbers(
    parameters: Mapping[str, Mapping[str, Any]], effect: str, joint: str | None, partner: str | None = None
) -> Iterator[Number]:
    for key, parameter in parameters.items():
        if key != "partner" and parameter["value"] is not None and parameter["std"]:
            what, (value, std) = f"{_law_name(effect, joint, partner)}: {key}", (parameter[x] for x in ("value", "std"))
            yield Number(what, parameter["unit"], float(value), float(std), effect, joint, partner)
