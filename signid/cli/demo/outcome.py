"""What was concealed, held against what was found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ...diagnose import Diagnosis, Finding
from ...effects.naming import law_name
from ...types import Law

FOUND, MINOR, RIVAL, MISSED = "found", "minor", "alternative", "missed"


class Outcome(NamedTuple):
    """What became of a concealed law."""

    law: Law
    kind: str  # found as a cause, minor (a correction), alternative (beside another law), or missed
    finding: Finding | None  # that is it, or beside which it stands
    probability: float  # that was given to it

    @property
    def found(self) -> Finding | None:
        """The finding with its numbers, if it was named itself."""
        return self.finding if self.kind in (FOUND, MINOR) else None


def judge(concealed: Sequence[Law], result: Diagnosis) -> tuple[Outcome, ...]:
    """What became of each concealed law."""
    return tuple(_outcome(law, result) for law in concealed)


def misses(outcomes: Sequence[Outcome], result: Diagnosis) -> Iterator[str]:
    """A sentence on each law that was concealed and not named, or named and not concealed."""
    for law, kind, finding, probability in outcomes:
        concealed = f"{law_name(law, result.robot)} was concealed"
        if kind == MISSED:
            yield f"{concealed} and is missed"
        if kind == RIVAL and finding is not None:
            beside = law_name(finding.law, result.robot)
            yield f"{concealed} and is named only as an alternative to {beside}, with probability {probability:.3f}"
    for cause in result.causes:
        if not any(cause is outcome.finding for outcome in outcomes):
            yield f"{law_name(cause.law, result.robot)} is named and was not concealed"


def _outcome(law: Law, result: Diagnosis) -> Outcome:
    for finding in result.findings:
        if _same(finding.law, law):
            return Outcome(law, FOUND if finding.role == "cause" else MINOR, finding, finding.probability)
    for finding in result.findings:
        for rival in finding.alternatives:
            if _same(rival.law, law):
                return Outcome(law, RIVAL, finding, rival.probability)
    return Outcome(law, MISSED, None, 0.0)


def _same(one: Law, other: Law) -> bool:
    return (one.effect.name, one.joints) == (other.effect.name, other.joints)
