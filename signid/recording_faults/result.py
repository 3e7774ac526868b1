"""What the gross checks found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ..types import Array, Frozen

REFUSE, WARN, NOTE = "refuse", "warn", "note"


@dataclass(frozen=True)
class Finding:
    """One thing that is grossly wrong, in a sentence that says what, how sure, and how to mend it."""

    kind: str  # "torque sign"
    joints: tuple[str, ...]  # that it is about; empty: the recordings as a whole
    severity: str  # "refuse": nothing that follows would mean anything; "warn"; "note"
    measures: Mapping[str, float]
    sentence: str
    alternatives: tuple[tuple[str, tuple[str, ...]], ...] = ()  # kinds and joints that explain it as well


@dataclass(frozen=True, eq=False)
class RecordingFaults(Frozen):
    """Findings, and per joint what they rest on. Verdicts are `right`, `wrong` or `cannot tell`."""

    joints: tuple[str, ...]  # n
    explained: Array  # (n,) [1] share of the torque's variance that model, friction and a rotor explain; NaN: no sign
    factor: Array  # (n,) [1] recorded torque over the model's; NaN where friction or a rotor may be all of it
    lag: Array  # (n,) [s] by which torque seems late; NaN where nothing tells
    signs: tuple[str, ...]  # (n,) verdicts on the sign of torque against the position's
    order: tuple[str, ...]  # (n,) verdicts on whose torque it is
    findings: tuple[Finding, ...]

    @property
    def refusal(self) -> str:
        """Why nothing that follows would mean anything; empty where it would."""
        return next((f.sentence for f in self.findings if f.severity == REFUSE), "")

    @property
    def flags(self) -> tuple[str, ...]:
        """The sentences of all that is wrong, the gravest first."""
        return tuple(f.sentence for severity in (REFUSE, WARN) for f in self.findings if f.severity == severity)

    @property
    def notes(self) -> tuple[str, ...]:
        """The sentences of what is worth knowing."""
        return tuple(f.sentence for f in self.findings if f.severity == NOTE)


def named(joints: Sequence[str]) -> str:
    """Joints as a sentence names them: "a", "joints a and b"."""
    if len(joints) == 1:
        return joints[0]
    return f"joints {', '.join(joints[:-1])} and {joints[-1]}"


def percent(share: float) -> str:
    """A share as a sentence tells it: "97 %"."""
    return f"{100 * share:.0f} %"
