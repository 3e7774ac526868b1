"""Compare the answer of a diagnosis with the truth: names, flags, numbers, and wrong causes that it is sure of."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from signid.diagnose import Diagnosis
from signid.parameters import TWO_SIDED

from .case import Truth
from .names import EXACT, PART, TWIN, Arm, Candidate, contains, label, relation

SURE = 0.99  # probability above which a wrong cause counts as wrong and sure
BODIES = {"payload", "link_inertia"}
FAULTS = {  # what a flag or a refusal says of a recording fault, before its first colon
    "sign": r"\btorque of\b.*\b(wrong sign|negated)",
    "swap": r"\btorques of\b.*\b(exchanged|swapped)",
    "late": r"\btorque of\b.*\blate\b",
    "early": r"\btorque of\b.*\b(early|leads)\b",
    "gain": r"\btorques?\b.*\btimes what\b",
}


@dataclass(frozen=True)
class Answer:
    """Findings and flags of one diagnosis, or the sentence of the error that ended it."""

    verdict: str  # that of the diagnosis, or "refused" or "crash"
    candidates: tuple[Candidate, ...] = ()  # the findings
    sentences: tuple[str, ...] = ()  # flags, or the sentence of an error


@dataclass(frozen=True)
class Number:
    """A number of the truth and its estimate."""

    key: str
    truth: float
    truth_std: float  # 0 where the truth is exact
    value: float
    std: float

    @property
    def within(self) -> bool:
        """Whether both agree within 1.96 standard deviations of their difference."""
        return abs(self.value - self.truth) <= TWO_SIDED * float(np.hypot(self.std, self.truth_std))


@dataclass(frozen=True)
class Verdict:
    """A judged case. New causes are those that the control does not have."""

    outcome: str  # first, flag, list, missed, silent, refused or crash
    relation: str  # exact, twin or part; empty: the truth is not in the list
    probability: float  # of the first new cause; 0 without one
    right: bool  # whether the first new cause is the truth or its twin
    first_new: bool  # the same, or the outcome is first or flag
    sure: tuple[str, ...]  # new causes that are wrong and sure
    numbers: tuple[Number, ...]


def answer_of(diagnosis: Diagnosis) -> Answer:
    """The answer of a diagnosis in plain types.

    Args:
        diagnosis: of one case.
    """
    candidates = tuple(
        Candidate(
            f.law.effect.name,
            tuple(f.law.joints),
            f.probability,
            f.role == "cause",
            dict(f.law.parameters),
            dict(f.std),
            dict(getattr(f, "stated", None) or {}),
            tuple(Candidate(a.law.effect.name, tuple(a.law.joints), a.probability) for a in f.alternatives),
        )
        for f in diagnosis.findings
    )
    return Answer(diagnosis.verdict, candidates, tuple(diagnosis.flags))


def flagged(sentences: Sequence[str], truth: Truth, arm: Arm) -> bool:
    """Whether a flag or a refusal names exactly this recording fault and its joints.

    Args:
        sentences: flags, or the sentence of an error.
        truth: the change.
        arm: the joints.
    """
    for head in (sentence.split(": ")[0].split(";")[0] for sentence in sentences if truth.fault):
        found = {j for j, joint in enumerate(arm.joints) if re.search(rf"(?<!\w){re.escape(joint)}(?!\w)", head)}
        whole = set(range(len(arm.joints)))
        found = whole if "all joints" in head or "all torques" in head else found
        if re.search(FAULTS[truth.fault], head) and found == set(truth.joints or whole):
            return True
    return False


def already_named(control: Answer, truth: Truth, arm: Arm) -> bool:
    """Whether the control has the truth, its twin or a law that contains it as a cause, or flags the fault.

    Args:
        control: the answer with nothing changed.
        truth: the change.
        arm: the joints.
    """
    causes = [x for x in control.candidates if x.cause]
    named = any(relation(x, truth, arm) in (EXACT, TWIN) or contains(x, truth, arm) for x in causes)
    return named or flagged(control.sentences, truth, arm)


def judge(answer: Answer, truth: Truth, control: Answer, arm: Arm) -> Verdict:
    """The verdict on one case.

    Args:
        answer: of its diagnosis.
        truth: the change.
        control: the answer with nothing changed.
        arm: the joints.
    """
    old = {(x.effect, frozenset(x.joints)) for x in control.candidates}
    causes = [x for x in answer.candidates if x.cause]
    new = [x for x in causes if (x.effect, frozenset(x.joints)) not in old]
    first, first_new = (relation(some[0], truth, arm) if some else "" for some in (causes, new))
    listed = [relation(x, truth, arm) for finding in answer.candidates for x in (finding, *finding.rivals)]
    best = next((kind for kind in (EXACT, TWIN, PART) if kind in listed), "")
    if first in (EXACT, TWIN):
        outcome, best = "first", first
    elif flagged(answer.sentences, truth, arm):
        outcome, best = "flag", EXACT
    elif answer.verdict in ("refused", "crash"):
        outcome = answer.verdict
    else:
        outcome = "list" if best else "missed" if answer.candidates else "silent"
    right = first_new in (EXACT, TWIN)
    return Verdict(
        outcome,
        best,
        new[0].probability if new else 0.0,
        right,
        right or outcome in ("first", "flag"),
        tuple(label(x, arm) for x in new if x.probability > SURE and not relation(x, truth, arm)),
        tuple(_numbers(answer, truth, arm)),
    )


def _numbers(answer: Answer, truth: Truth, arm: Arm) -> Iterator[Number]:
    """Numbers of the first finding that is the truth; payload and link_inertia of the last joint are comparable."""
    for x in answer.candidates:
        kind = relation(x, truth, arm)
        if kind == EXACT or kind == TWIN and truth.last and x.effect in BODIES:
            for key in sorted(truth.numbers.keys() & x.value.keys()):
                wanted = truth.totals.get(key, truth.numbers[key]) if key in x.stated else truth.numbers[key]
                yield Number(key, wanted, truth.std, x.value[key], x.std.get(key, 0.0))
            return
