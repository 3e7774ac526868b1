"""Summaries of identification.json and diagnosis.json, and drift of parameters over the sessions of a robot."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import ndtr, ndtri, stdtr, stdtrit

from ...effects import EFFECTS
from ...types import Array, Frozen

FILES = {"diagnose": "diagnosis.json", "identify": "identification.json"}
CEILING = 1e6  # maximum ratio of residual to noise floor
FEWEST = 3  # minimum number of sessions at different times
LEVEL = 0.05  # family-wise error rate over all parameters of a fleet


class Number(NamedTuple):
    """A parameter estimated in one session."""

    what: str  # "coulomb_friction of joint_2: level"
    unit: str
    value: float
    std: float
    effect: str = ""  # of a law; "": a base parameter
    joint: str | None = None
    partner: str | None = None


class Cause(NamedTuple):
    """A law that a simulation lacks."""

    effect: str
    joint: str | None
    partner: str | None
    probability: float
    numbers: tuple[Number, ...]
    share: float = 0.0  # largest torque over that of the joint [1]
    stated: float = 0.0  # value of its first number in the simulation [unit of the number]

    @property
    def name(self) -> str:
        """Name of the law and its joints."""
        beside = f" and {self.partner}" if self.partner else ""
        return self.effect + (f" of {self.joint}{beside}" if self.joint else "")


@dataclass(frozen=True)
class Summary:
    """Result of a session. Residuals are those of the held-out torque, relative to the noise floor."""

    kind: str = ""  # kind of robot: the name in its description
    joints: tuple[str, ...] = ()
    mismatch: float | None = None  # residual of the simulation or the identified model at the joint where it is largest
    joint: str = ""  # that joint
    left: float | None = None  # residual of the extended simulation at that joint
    verdict: str = ""  # verdict of a diagnosis
    causes: tuple[Cause, ...] = ()
    numbers: tuple[Number, ...] = ()  # parameters checked for drift
    found: tuple[Cause, ...] = ()  # causes and corrections
    tolerance: float = 0.0  # largest residual that counts as no difference, as a share of torque [1]

    @property
    def explained(self) -> float | None:
        """Share of the squared residual at that joint that a diagnosis explains."""
        if self.left is None or not self.mismatch:
            return None
        return max(0.0, 1 - (self.left / self.mismatch) ** 2)


def summarise(task: str, document: Mapping[str, Any]) -> Summary:
    """Summarise the diagnosis.json or identification.json of a session."""
    if not document:
        return Summary()
    kind, joints = str(document["robot"]), tuple(document["joints"])
    if task == "identify":
        mismatch, joint, _ = _mismatch(document["fit"])
        return Summary(kind, joints, mismatch, joint, numbers=tuple(_identified(document)))
    mismatch, joint, j = _mismatch(document["fit"]["before"])
    left = None if j is None else _over(document["fit"]["after"], j)
    found = tuple(_cause(one) for one in document["findings"])
    causes = tuple(cause for cause, one in zip(found, document["findings"], strict=True) if one["role"] == "cause")
    every = tuple(number for cause in found for number in cause.numbers)
    tolerance = float(document.get("tolerance") or 0.0)
    return Summary(kind, joints, mismatch, joint, left, str(document["verdict"]), causes, every, found, tolerance)


def _mismatch(fit: Mapping[str, Sequence[Any]]) -> tuple[float | None, str, int | None]:
    """The largest ratio of residual to noise floor, with its joint's name and index."""
    found = [(size, j) for j in range(len(fit["joints"])) if (size := _over(fit, j)) is not None]
    if not found:
        return None, "", None
    size, j = max(found, key=lambda each: (each[0], -each[1]))
    return size, str(fit["joints"][j]), j


def _over(fit: Mapping[str, Sequence[Any]], j: int) -> float | None:
    rms, floor = fit["held_out_rms"][j], fit["noise_floor"][j]
    return None if rms is None or floor is None else min(CEILING, rms / max(floor, 1e-300))


def _cause(finding: Mapping[str, Any]) -> Cause:
    effect, joint, parameters = finding["effect"], finding["joint"], finding["parameters"]
    partner = parameters["partner"]["value"] if "partner" in parameters else None
    share = max((finding.get("torque_share") or {}).values(), default=0.0)
    bare = Cause(effect, joint, partner, float(finding["probability"]), (), float(share))
    numbers = tuple(_numbers(bare.name, parameters, effect, joint, partner))
    first = parameters[numbers[0].what.rpartition(": ")[2]] if numbers else {}
    return bare._replace(numbers=numbers, stated=float(first.get("stated") or 0.0))


def _identified(document: Mapping[str, Any]) -> Iterator[Number]:
    """Parameters of laws, and base parameters other than the coefficient of a single law."""
    for law in document["effects"]:
        where = f" of {law['joint']}" if law["joint"] else ""
        yield from _numbers(law["effect"] + where, law["parameters"], law["effect"], law["joint"])
    law_alone = re.compile(rf"({'|'.join(map(re.escape, EFFECTS.names))})[\w.]*")
    for base in document["base_parameters"]:
        value, std = base["estimate"], base["std"]
        if not law_alone.fullmatch(base["expression"]) and value is not None and std:
            yield Number(base["expression"], base["unit"], value, std)


def _numbers(
    name: str, parameters: Mapping[str, Mapping[str, Any]], effect: str, joint: str | None, partner: str | None = None
) -> Iterator[Number]:
    for key, entry in parameters.items():
        if key != "partner" and entry["value"] is not None and entry["std"]:
            value, std = float(entry["value"]), float(entry["std"])
            yield Number(f"{name}: {key}", entry["unit"], value, std, effect, joint, partner)


@dataclass(frozen=True, eq=False)
class Drift(Frozen):
    """A parameter at k times, and its regression line."""

    robot: str
    what: str
    unit: str
    day: Array  # (k,) [d] since 1970
    value: Array  # (k,) [unit]
    std: Array  # (k,) [unit]
    slope: float  # [unit/d]
    half: float  # [unit/d] half-width of its 95 % interval
    middle: float  # [unit] value of the line at the weighted mean day
    mean_day: float  # [d]
    chance: float  # p-value of the slope under no drift
    beyond: bool = False  # significant after the Holm correction over all parameters

    @property
    def change(self) -> float:
        """Change along the line from the first session to the last [unit]."""
        return self.slope * float(np.ptp(self.day))


def find_drifts(robots: Iterable[tuple[str, Sequence[tuple[float, Sequence[Number]]]]]) -> tuple[Drift, ...]:
    """Fit a line to every parameter that at least three sessions of a robot report; significant drifts first.

    Weights are inverse variances. If the values scatter about the line more than their standard deviations predict, the
    interval is widened by the Birge ratio and Student's t distribution is used. Significance is tested at 5 % with the
    Holm correction for multiple comparisons. Sessions of each robot are given as day [d] and parameters.

    Source: Birge, Physical Review 40, 1932 (scatter); Holm, Scandinavian J. Statistics 6, 1979 (multiple tests).
    """
    lines = [line for name, sessions in robots for line in _lines(name, sessions)]
    lines.sort(key=lambda line: (line.chance, line.robot, line.what))
    found, still = [], True
    for k, line in enumerate(lines):
        still = still and line.chance * (len(lines) - k) < LEVEL
        found.append(replace(line, beyond=still))
    return tuple(found)


def _lines(robot: str, sessions: Sequence[tuple[float, Sequence[Number]]]) -> list[Drift]:
    points: dict[tuple[str, str], list[tuple[float, Number]]] = {}
    for day, numbers in sorted(sessions, key=lambda session: session[0]):
        for number in numbers:
            points.setdefault((number.what, number.unit), []).append((day, number))
    lines = []
    for (what, unit), series in points.items():
        if len({day for day, _ in series}) >= FEWEST:
            table = np.array([[day, number.value, number.std] for day, number in series])
            lines.append(_line(robot, what, unit, *table.T))
    return lines


def _line(robot: str, what: str, unit: str, day: Array, value: Array, std: Array) -> Drift:
    """Weighted least squares through k > 2 points."""
    weight = (std.min() / std) ** 2
    mean_day, middle = (float(weight @ x / weight.sum()) for x in (day, value))
    lever = weight @ (day - mean_day) ** 2
    slope = float(weight @ ((day - mean_day) * (value - middle)) / lever)
    own = float(std.min() / np.sqrt(lever))
    rest, left = value - middle - slope * (day - mean_day), len(day) - 2
    scatter = own * float(np.sqrt(weight @ rest**2 / left)) / float(std.min())
    half = max(float(ndtri(0.975)) * own, float(stdtrit(left, 0.975)) * scatter)
    chance = max(2 * ndtr(-abs(slope) / own), 2 * stdtr(left, -abs(slope) / scatter) if scatter else 0.0)
    return Drift(robot, what, unit, day, value, std, slope, half, middle, mean_day, float(chance))
