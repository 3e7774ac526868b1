"""Relation of a named law to the truth: exact, a twin that no motion distinguishes, or a part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from .case import Joints, Truth

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
    """Relation: exact, twin, part (of the truth, or a containing law) or empty (unrelated).

    Args:
        name: finding or alternative.
        truth: known change.
        arm: joints of the robot.
    """
    anywhere = truth.joints is None or name.effect in ("base_tilt", "payload") or len(arm.joints) == 1
    same = anywhere or set(name.joints) == set(truth.joints or ())
    if name.effect in truth.effects and same:
        return EXACT
    if any(_twins({name.effect, x}, name, truth, same, arm) for x in truth.effects):
        return TWIN
    inside = truth.joints is None or set(name.joints) <= set(truth.joints)
    return PART if contains(name, truth, arm) or inside and name.effect in truth.effects else ""


def contains(name: Candidate, truth: Truth, arm: Arm) -> bool:
    """Whether a law contains the truth or its twin at the same joint.

    Args:
        name: a finding.
        truth: known change.
        arm: joints of the robot.
    """
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
    """Short text with effect, joints and probability of a finding.

    Args:
        name: finding.
        arm: joints of the robot.
    """
    everywhere = len(name.joints) > 2
    place = "all" if everywhere else " ".join(arm.joints[j] for j in name.joints)
    return f"{name.effect} {place} P {name.probability:.3f}"
