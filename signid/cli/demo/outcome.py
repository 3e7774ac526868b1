"""Comparison of concealed laws with findings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ...diagnose import Diagnosis, Finding
from ...effects.naming import law_name
from ...types import Law

FOUND, MINOR, RIVAL, MISSED = "found", "minor", "alternative", "missed"


class LawOutcome(NamedTuple):
    """Result for a concealed law."""

    law: Law
    kind: str  # found (as a cause), minor (a correction), alternative (to another law), or missed
    finding: Finding | None  # the matching finding, or the one with the matching alternative
    probability: float  # probability of the law

    @property
    def found(self) -> Finding | None:
        """The finding of the law itself, if there is one."""
        return self.finding if self.kind in (FOUND, MINOR) else None


def judge(concealed: Sequence[Law], result: Diagnosis) -> tuple[LawOutcome, ...]:
    """Compare each concealed law with the findings."""
    return tuple(_outcome(law, result) for law in concealed)


def misses(outcomes: Sequence[LawOutcome], result: Diagnosis) -> Iterator[str]:
    """Yield a sentence for each law that was missed or named without being concealed."""
    for law, kind, finding, probability in outcomes:
        concealed = f"{law_name(law, result.robot)} was concealed"
        if kind == MISSED:
            yield f"{concealed} and missed"
        if kind == RIVAL and finding is not None:
            beside = law_name(finding.law, result.robot)
            yield f"{concealed} and named only as an alternative to {beside}, with probability {probability:.3f}"
    for cause in result.causes:
        if not any(cause is outcome.finding for outcome in outcomes):
            yield f"{law_name(cause.law, result.robot)} was named but not concealed"


def _outcome(law: Law, result: Diagnosis) -> LawOutcome:
    for finding in result.findings:
        if _same(finding.law, law):
            return LawOutcome(law, FOUND if finding.role == "cause" else MINOR, finding, finding.probability)
    for finding in result.findings:
        for rival in finding.alternatives:
            if _same(rival.law, law):
                return LawOutcome(law, RIVAL, finding, rival.probability)
    return LawOutcome(law, MISSED, None, 0.0)


def _same(one: Law, other: Law) -> bool:
    return (one.effect.name, one.joints) == (other.effect.name, other.joints)
