"""Changes between sessions of a robot, and outliers between robots of a kind, with their probability.

Two hypotheses per parameter: it differs from the sessions (or robots) before by noise and a usual spread alone, or by a
change of unknown size besides. Both predict the difference as a normal variable of zero mean.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import exp, log
from statistics import median
from typing import NamedTuple

import numpy as np

from ...types import Array
from .summary import Number, Summary

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
            compared = list(_compared(sessions[k], sessions[:k], DAYS, since))
            tested += len(compared)
            since |= {(one.number.what, one.number.unit): k for one in compared if one.found}
            found += compared
    return _ordered(found), tested


def find_outliers(kinds: Iterable[Sequence[ComparedSession]]) -> tuple[list[ParameterChange], int]:
    """Robots that differ from the others of their kind, the most probable first; and how many numbers were tested."""
    found, tested = list[ParameterChange](), 0
    for robots in kinds:
        for k in range(len(robots) if len(robots) >= ROBOTS_LEAST else 0):
            compared = list(_compared(robots[k], [*robots[:k], *robots[k + 1 :]], ROBOTS, {}))
            compared = [one for one in compared if len(one.others) >= ROBOTS_LEAST - 1]
            tested += len(compared)
            found += compared
    return _ordered(found), tested


def _ordered(found: Sequence[ParameterChange]) -> list[ParameterChange]:
    shown = [one for one in found if one.probability >= SHOWN]
    return sorted(shown, key=lambda one: (-one.odds, one.at.robot, one.at.session, one.number.what))


def _compared(
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
