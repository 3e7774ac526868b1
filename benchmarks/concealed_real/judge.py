"""Whether what was said is what was changed: names, flags, numbers, and causes that are wrong and sure."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from signid.diagnose import Diagnosis
from signid.parameters import TWO_SIDED

from .case import Joints, Truth

SURE = 0.99
EXACT, TWIN, PART = "exact", "twin", "part"
ALONE = (  # one and the same on a single joint
    {"counterbalance", "base_tilt", "encoder_offset", "payload", "link_inertia"},
    {"quadratic_friction", "fluid_drag"},
)
ALIKE = ({"torque_offset", "asymmetric_friction"}, {"time_delay", "torque_lag"})  # at the same joints
FIRST = {"armature", "link_inertia"}
LAST = {"payload", "link_inertia", "encoder_offset"}
SLIDES = ({"base_tilt", "torque_offset"}, {"armature", "payload"})  # of a single prismatic joint: a force, a mass
BODIES = {"payload", "link_inertia"}
WHOLE = {"asymmetric_friction": ("viscous_friction", "coulomb_friction", "torque_offset")}  # laws that it contains
FAULTS = {
    "sign": r"\btorque of\b.*\b(wrong sign|negated)",
    "swap": r"\btorques of\b.*\b(exchanged|swapped)",
    "late": r"\btorque of\b.*\blate\b",
    "early": r"\btorque of\b.*\b(early|leads)\b",
    "gain": r"\btorques?\b.*\btimes what\b",
}


@dataclass(frozen=True)
class Named:
    """A finding, or an alternative of one."""

    effect: str
    joints: Joints
    probability: float
    cause: bool = True
    value: Mapping[str, float] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    stated: Mapping[str, float] = field(default_factory=dict)  # what the simulation states already, where it does
    rivals: tuple[Named, ...] = ()


@dataclass(frozen=True)
class Said:
    """All that one diagnosis says, or why it says nothing."""

    verdict: str  # as it stands there, "refused" or "crash"
    named: tuple[Named, ...] = ()
    sentences: tuple[str, ...] = ()  # flags, or the sentence of an error


@dataclass(frozen=True)
class Arm:
    """What decides which laws are twins."""

    joints: tuple[str, ...]
    slides: bool = False  # a single prismatic joint


@dataclass(frozen=True)
class Number:
    """One number of the truth, and what was found."""

    key: str
    truth: float
    value: float
    std: float

    @property
    def within(self) -> bool:
        """Whether the truth is in its 95 % interval."""
        return abs(self.value - self.truth) <= TWO_SIDED * self.std


@dataclass(frozen=True)
class Verdict:
    """A case, judged."""

    outcome: str  # first, flag, list, missed, silent, refused or crash
    relation: str  # of what was right: exact, twin or part
    probability: float  # of the first cause that the control lacks; 0 without one
    right: bool  # whether that one is the truth or its twin
    leads: bool  # whether it is, the control's causes left aside
    sure: tuple[str, ...]  # causes that are wrong and sure
    numbers: tuple[Number, ...]


def said_of(diagnosis: Diagnosis) -> Said:
    """What a diagnosis says, in plain types.

    Args:
        diagnosis: of one case.
    """
    named = tuple(
        Named(
            f.law.effect.name,
            tuple(f.law.joints),
            f.probability,
            f.role == "cause",
            dict(f.law.parameters),
            dict(f.std),
            dict(getattr(f, "stated", None) or {}),
            tuple(Named(a.law.effect.name, tuple(a.law.joints), a.probability) for a in f.alternatives),
        )
        for f in diagnosis.findings
    )
    return Said(diagnosis.verdict, named, tuple(diagnosis.flags))


def relation(name: Named, truth: Truth, arm: Arm) -> str:
    """Exact, a structural twin, a part of the truth or all of it and more; empty: none of these.

    Args:
        name: a finding or an alternative.
        truth: what was changed.
        arm: whose joints.
    """
    anywhere = truth.joints is None or name.effect in ("base_tilt", "payload") or len(arm.joints) == 1
    same = anywhere or set(name.joints) == set(truth.joints or ())
    if name.effect in truth.effects and same:
        return EXACT
    if any(_twins({name.effect, x}, name, truth, same, arm) for x in truth.effects):
        return TWIN
    inside = truth.joints is None or set(name.joints) <= set(truth.joints)
    return PART if contains(name, truth, arm) or inside and name.effect in truth.effects else ""


def contains(name: Named, truth: Truth, arm: Arm) -> bool:
    """Whether a law at the joint has the truth, or its twin, in it and more.

    Args:
        name: a finding.
        truth: what was changed.
        arm: whose joints.
    """
    inner = {x for effect in truth.effects for x in (effect, *_slides(effect, arm))}
    place = truth.joints is None or len(arm.joints) == 1 or set(name.joints) == set(truth.joints)
    return place and not inner.isdisjoint(WHOLE.get(name.effect, ()))


def _slides(effect: str, arm: Arm) -> set[str]:
    return {x for group in SLIDES if arm.slides and effect in group for x in group}


def _twins(both: set[str], name: Named, truth: Truth, same: bool, arm: Arm) -> bool:
    """Whether no motion separates two effects."""
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


def flagged(sentences: Sequence[str], truth: Truth, arm: Arm) -> bool:
    """Whether a flag or a refusal names exactly the gross fault that was made.

    Args:
        sentences: flags, or the sentence of an error.
        truth: what was changed.
        arm: whose joints.
    """
    for head in (sentence.split(": ")[0].split(";")[0] for sentence in sentences if truth.fault):
        found = {j for j, joint in enumerate(arm.joints) if re.search(rf"(?<![\w]){re.escape(joint)}(?![\w])", head)}
        whole = set(range(len(arm.joints)))
        found = whole if "all joints" in head or "all torques" in head else found
        if re.search(FAULTS[truth.fault], head) and found == set(truth.joints or whole):
            return True
    return False


def knows(control: Said, truth: Truth, arm: Arm) -> bool:
    """Whether the control names the truth already, or a law that contains it, as a cause or a flag.

    Args:
        control: what is said with nothing changed.
        truth: what will be changed.
        arm: whose joints.
    """
    causes = [name for name in control.named if name.cause]
    named = any(relation(name, truth, arm) in (EXACT, TWIN) or contains(name, truth, arm) for name in causes)
    return named or flagged(control.sentences, truth, arm)


def judge(said: Said, truth: Truth, control: Said, arm: Arm) -> Verdict:
    """What a diagnosis is worth.

    Args:
        said: by the diagnosis of the case.
        truth: what was changed.
        control: what is said with nothing changed.
        arm: whose joints.
    """
    usual = {(name.effect, frozenset(name.joints)) for name in control.named}
    causes = [name for name in said.named if name.cause]
    fresh = [name for name in causes if (name.effect, frozenset(name.joints)) not in usual]
    related = [relation(name, truth, arm) for name in causes[:1]]
    leading = relation(fresh[0], truth, arm) if fresh else ""
    listed = [relation(x, truth, arm) for name in said.named for x in (name, *name.rivals)]
    best = next((kind for kind in (EXACT, TWIN, PART) if kind in listed), "")
    if related and related[0] in (EXACT, TWIN):
        outcome, best = "first", related[0]
    elif flagged(said.sentences, truth, arm):
        outcome, best = "flag", EXACT
    elif said.verdict in ("refused", "crash"):
        outcome = said.verdict
    else:
        outcome = "list" if best else "missed" if said.named else "silent"
    wrong = [name for name in fresh if name.probability > SURE and not relation(name, truth, arm)]
    return Verdict(
        outcome,
        best,
        fresh[0].probability if fresh else 0.0,
        leading in (EXACT, TWIN),
        leading in (EXACT, TWIN) or outcome in ("first", "flag"),
        tuple(spoken(name, arm) for name in wrong),
        tuple(_numbers(said, truth, arm)),
    )


def _numbers(said: Said, truth: Truth, arm: Arm) -> Iterator[Number]:
    """The numbers of the first finding that is the truth, or that is a body at the last link as it is."""
    for name in said.named:
        kind = relation(name, truth, arm)
        if kind == EXACT or kind == TWIN and truth.last and name.effect in BODIES:
            for key in truth.numbers.keys() & name.value.keys():
                wanted = truth.wholes.get(key, truth.numbers[key]) if key in name.stated else truth.numbers[key]
                yield Number(key, wanted, name.value[key], name.std.get(key, 0.0))
            return


def spoken(name: Named, arm: Arm) -> str:
    """A finding in short.

    Args:
        name: the finding.
        arm: whose joints.
    """
    everywhere = len(name.joints) > 2
    place = "all" if everywhere else " ".join(arm.joints[j] for j in name.joints)
    return f"{name.effect} {place} P {name.probability:.3f}"
