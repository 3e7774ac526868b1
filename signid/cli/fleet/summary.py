"""Summaries of identification.json and diagnosis.json."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from ...effects import EFFECTS

FILES = {"diagnose": "diagnosis.json", "identify": "identification.json"}
CEILING = 1e6  # maximum ratio of residual to noise floor


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
    numbers: tuple[Number, ...] = ()  # parameters that are compared
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
