"""Summaries of identification.json and diagnosis.json."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from ...effects import EFFECTS
from ...output.report.quantities import Quantity
from ...output.report.results.sentences import Named
from .manifest import Entry

DOCUMENT_OF_TASK = {"diagnose": "diagnosis.json", "identify": "identification.json"}
MAX_NOISE_FACTOR = 1e6  # maximum ratio of residual to noise floor


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
        return [one for one in self.found if one.role == "cause"]

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
        return Summary(kind, mismatch, joint, numbers=tuple(_identified(document)))
    left = None if mismatch is None else _over(fit["after"], -j)
    found = tuple(_cause(one) for one in document["findings"])
    numbers = tuple(number for cause in found for number in cause.numbers)
    tolerance = float(document.get("tolerance") or 0.0)
    return Summary(kind, mismatch, joint, left, str(document["verdict"]), numbers, found, tolerance)


def _over(fit: Mapping[str, Sequence[Any]], j: int) -> float | None:
    rms, floor = fit["held_out_rms"][j], fit["noise_floor"][j]
    return None if rms is None or floor is None else min(MAX_NOISE_FACTOR, rms / max(floor, 1e-300))


def _law_name(effect: str, joint: str | None, partner: str | None = None) -> str:
    return effect + (f" of {joint}{f' and {partner}' if partner else ''}" if joint else "")


def _cause(finding: Mapping[str, Any]) -> Cause:
    parameters = finding["parameters"]
    at = finding["effect"], finding["joint"], parameters.get("partner", {}).get("value")
    numbers = tuple(_numbers(parameters, *at))
    stated = parameters[numbers[0].key].get("stated") if numbers else None
    share = max((finding.get("torque_share") or {}).values(), default=0.0)
    return Cause(*at, numbers, finding["role"], float(share), float(stated or 0.0))


def _identified(document: Mapping[str, Any]) -> Iterator[Number]:
    """Parameters of laws, and base parameters other than the coefficient of a single law."""
    for law in document["effects"]:
        yield from _numbers(law["parameters"], law["effect"], law["joint"])
    law_alone = re.compile(rf"({'|'.join(map(re.escape, EFFECTS.names))})[\w.]*")
    for base in document["base_parameters"]:
        value, std = base["estimate"], base["std"]
        if not law_alone.fullmatch(base["expression"]) and value is not None and std:
            yield Number(base["expression"], base["unit"], value, std)


def _numbers(
    parameters: Mapping[str, Mapping[str, Any]], effect: str, joint: str | None, partner: str | None = None
) -> Iterator[Number]:
    for key, one in parameters.items():
        if key != "partner" and one["value"] is not None and one["std"]:
            what, value, std = f"{_law_name(effect, joint, partner)}: {key}", float(one["value"]), float(one["std"])
            yield Number(what, one["unit"], value, std, effect, joint, partner)
