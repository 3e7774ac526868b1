"""Events of a watch: contacts, changes of the robot and notes, and their JSON lines."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar

SCHEMA = "signid.watch/1"
DIGITS = 6  # significant digits of a number in a line
DECIMALS = 6  # of a time [s]


@dataclass(frozen=True)
class Event:
    """Something that the watch found at a time of the stream."""

    kind: ClassVar[str] = ""
    t: float  # [s] stamp of the last row that was needed

    def document(self) -> dict[str, Any]:
        """JSON object of the event, one line of the output."""
        own = {key: _plain(key, value) for key, value in vars(self).items()}
        return {"schema": SCHEMA, "event": self.kind, **own}


@dataclass(frozen=True)
class Note(Event):
    """A fact about the stream or the watch, as a sentence."""

    kind = "note"
    sentence: str


@dataclass(frozen=True)
class Contact(Event):
    """An external force: one event when it begins, with `end` None, and one when it ends."""

    kind = "contact"
    joints: tuple[str, ...]  # joints whose residual exceeds its threshold
    link: str  # furthest loaded link
    torque: Mapping[str, float]  # [N.m or N] external torque of each joint; at the end, of the largest moment
    direction: tuple[float, float, float] | None  # of the force, in the world [1]; None with fewer than 3 joints
    start: float  # [s]
    end: float | None = None  # [s]
    cause: str | None = None  # the change that explains it, if it was no contact
    corrects: float | None = None  # [s] t of the event that this one replaces


@dataclass(frozen=True)
class LastingChange(Event):
    """A lasting change of the robot: an additive law at a joint, or an unknown one."""

    kind = "change"
    law: str  # effect, or "unknown"
    joint: str
    parameters: Mapping[str, float]  # numbers by key of the effect, in its units
    std: Mapping[str, float]  # standard deviations of the numbers
    probability: float  # posterior probability of the law against the others
    sentence: str
    alternatives: Mapping[str, float] = field(default_factory=dict)  # "law of joint" -> probability
    corrects: float | None = None  # [s] t of the event that this one replaces, with the numbers of more motion


def _plain(key: str, value: Any) -> Any:
    """Numbers with few digits; containers as JSON has them."""
    if isinstance(value, Mapping):
        return {name: _plain("", x) for name, x in value.items()}
    if isinstance(value, tuple):
        return [_plain("", x) for x in value]
    if isinstance(value, float):
        return round(value, DECIMALS) if key in ("t", "start", "end", "corrects") else float(f"{value:.{DIGITS}g}")
    return value
