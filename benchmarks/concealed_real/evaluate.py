"""Compare the answer of a diagnosis with the truth: names and twins, flags, parameters and confident wrong causes."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from signid.diagnose import Diagnosis
from signid.types import TWO_SIDED

from .changes import Joints, Truth

EXACT, TWIN, PART = "exact", "twin", "part"
ALONE = (  # equivalent on a single joint
    {"counterbalance", "base_tilt", "encoder_offset", "payload", "link_inertia"},
    {"quadratic_friction", "fluid_drag"},
)
ALIKE = ({"torque_offset", "asymmetric_friction"}, {"time_delay", "torque_lag"})  # at the same joints
FIRST = {"armature", "link_inertia"}
LAST = {"payload", "link_inertia", "encoder_offset"}
SLIDES = ({"base_tilt", "torque_offset"}, {"armature", "payload"})  # equivalent on a single prismatic joint
WHOLE = {"asymmetric_friction": ("viscous_friction", "coulomb_friction", "torque_offset")}  # contained laws


@dataclass(frozen=True)
class Candidate:
    """A finding or an alternative."""

    effect: str
    joints: Joints
    probability: float
    cause: bool = True
    value: Mapping[str, float] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    stated: Mapping[str, float] = field(default_factory=dict)  # values that the simulation states
    rivals: tuple[Candidate, ...] = ()


@dataclass(frozen=True)
class Arm:
    """Properties of the joints that decide which laws are twins."""

    joints: tuple[str, ...]
    slides: bool = False  # a single prismatic joint


def relation(name: Candidate, truth: Truth, arm: Arm) -> str:
    """Relation: exact, twin, part (of the truth, or a containing law) or empty (unrelated)."""
    anywhere = truth.joints is None or name.effect in ("base_tilt", "payload") or len(arm.joints) == 1
    same = anywhere or set(name.joints) == set(truth.joints or ())
    if name.effect in truth.effects and same:
        return EXACT
    if any(_twins({name.effect, x}, name, truth, same, arm) for x in truth.effects):
        return TWIN
    inside = truth.joints is None or set(name.joints) <= set(truth.joints)
    return PART if contains(name, truth, arm) or inside and name.effect in truth.effects else ""


def contains(name: Candidate, truth: Truth, arm: Arm) -> bool:
    """Whether a law contains the truth or its twin at the same joint."""
    inner = {x for effect in truth.effects for x in (effect, *_slides(effect, arm))}
    place = truth.joints is None or len(arm.joints) == 1 or set(name.joints) == set(truth.joints)
    return place and not inner.isdisjoint(WHOLE.get(name.effect, ()))


def _slides(effect: str, arm: Arm) -> set[str]:
    return {x for group in SLIDES if arm.slides and effect in group for x in group}


def _twins(both: set[str], name: Candidate, truth: Truth, same: bool, arm: Arm) -> bool:
    """Whether no motion distinguishes two effects."""
    if len(arm.joints) == 1 and (
        any(both <= group for group in ALONE) or arm.slides and any(both <= group for group in SLIDES)
    ):
        return True
    if any(both <= group for group in ALIKE) and same:
        return True
    n, place = len(arm.joints), (truth.joints or name.joints)
    here = set(place) == set(name.joints) or "payload" in both
    first, last = 0 in place and 0 in name.joints, n - 1 in place and n - 1 in name.joints
    return here and (both <= FIRST and first or both <= LAST and last)


def label(name: Candidate, arm: Arm) -> str:
    """Short text with effect, joints and probability of a finding."""
    everywhere = len(name.joints) > 2
    place = "all" if everywhere else " ".join(arm.joints[j] for j in name.joints)
    return f"{name.effect} {place} P {name.probability:.3f}"


SURE = 0.99  # probability above which a wrong cause counts as sure [1]
BODIES = {"payload", "link_inertia"}
FAULTS = {  # patterns of flags and refusals of a recording fault, up to the first colon
    "sign": r"\btorque of\b.*\b(wrong sign|negated)",
    "swap": r"\btorques of\b.*\b(exchanged|swapped)",
    "late": r"\btorque of\b.*\blate\b",
    "early": r"\btorque of\b.*\b(early|leads)\b",
    "gain": r"\btorques?\b.*\btimes the\b",
}


@dataclass(frozen=True)
class Answer:
    """Findings and flags of one diagnosis, or the message of its error."""

    verdict: str  # verdict of the diagnosis, "refused" or "crash"
    candidates: tuple[Candidate, ...] = ()  # the findings
    sentences: tuple[str, ...] = ()  # flags, or the message of an error


@dataclass(frozen=True)
class Number:
    """A true parameter and its estimate."""

    key: str
    truth: float
    truth_std: float  # 0 for an exact truth
    value: float
    std: float

    @property
    def within(self) -> bool:
        """Whether both agree within 1.96 standard deviations of their difference."""
        return abs(self.value - self.truth) <= TWO_SIDED * float(np.hypot(self.std, self.truth_std))


@dataclass(frozen=True)
class Evaluation:
    """Evaluation of a case. New causes are absent in the control."""

    outcome: str  # first, flag, list, missed, silent, refused or crash
    relation: str  # exact, twin or part; empty: the truth is not listed
    probability: float  # probability of the first new cause; 0 without one
    right: bool  # whether the first new cause is the truth or its twin
    first_new: bool  # the same, or the outcome is first or flag
    sure: tuple[str, ...]  # wrong new causes with a probability above SURE
    numbers: tuple[Number, ...]


def answer_of(diagnosis: Diagnosis) -> Answer:
    """Convert a diagnosis to plain types."""
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
    """Whether a flag or a refusal names exactly this recording fault and its joints."""
    for head in (sentence.split(": ")[0].split(";")[0] for sentence in sentences if truth.fault):
        found = {j for j, joint in enumerate(arm.joints) if re.search(rf"(?<!\w){re.escape(joint)}(?!\w)", head)}
        whole = set(range(len(arm.joints)))
        found = whole if "all joints" in head or "all torques" in head else found
        if re.search(FAULTS[truth.fault], head) and found == set(truth.joints or whole):
            return True
    return False


def already_named(control: Answer, truth: Truth, arm: Arm) -> bool:
    """Whether the control already names the truth, its twin or a containing law, or flags the fault."""
    causes = [x for x in control.candidates if x.cause]
    named = any(relation(x, truth, arm) in (EXACT, TWIN) or contains(x, truth, arm) for x in causes)
    return named or flagged(control.sentences, truth, arm)


def evaluate(answer: Answer, truth: Truth, control: Answer, arm: Arm) -> Evaluation:
    """Evaluate one case."""
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
    return Evaluation(
        outcome,
        best,
        new[0].probability if new else 0.0,
        right,
        right or outcome in ("first", "flag"),
        tuple(label(x, arm) for x in new if x.probability > SURE and not relation(x, truth, arm)),
        tuple(_numbers(answer, truth, arm)),
    )


def _numbers(answer: Answer, truth: Truth, arm: Arm) -> Iterator[Number]:
    """Parameters of the first true finding; payload and link_inertia of the last joint are comparable."""
    for x in answer.candidates:
        kind = relation(x, truth, arm)
        if kind == EXACT or kind == TWIN and truth.last and x.effect in BODIES:
            for key in sorted(truth.numbers.keys() & x.value.keys()):
                wanted = truth.totals.get(key, truth.numbers[key]) if key in x.stated else truth.numbers[key]
                yield Number(key, wanted, truth.std, x.value[key], x.std.get(key, 0.0))
            return
