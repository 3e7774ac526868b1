"""Whether a name is the right one: effects at joints, pairs of joints, and twins that no motion separates."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from .cases import FAMILIES

MUTUAL = ("joint_coupling", "channel_swap")  # told from either joint
ALONE = (  # one and the same on a single joint
    {"counterbalance", "base_tilt", "encoder_offset", "payload", "link_inertia"},
    {"quadratic_friction", "fluid_drag"},
)
WHOLE = {"asymmetric_friction": ("viscous_friction", "coulomb_friction", "torque_offset")}  # laws that it contains
ANYWHERE = ({"torque_offset", "asymmetric_friction"}, {"time_delay", "torque_lag"})
FIRST = {"armature", "link_inertia"}
LAST = {"payload", "link_inertia", "encoder_offset"}


class Truth(NamedTuple):
    """What is concealed."""

    effects: tuple[str, ...]  # any of which is right
    joints: tuple[str | None, ...]
    partner: str | None
    parameters: Mapping[str, Any]


def truths(answer: Mapping[str, Any]) -> list[Truth]:
    """What an answer conceals; of a foreign law, the family that it is of."""
    found = []
    for fault in answer["faults"]:
        effect, joint, partner = fault["effect"], fault["joint"], fault["parameters"].get("partner")
        joints = (joint, partner) if effect in MUTUAL else (joint,)
        if len(answer["joints"]) == 1:
            joints = (None, answer["joints"][0])
        found.append(
            Truth(FAMILIES.get(effect, (effect,)), joints, partner if effect in MUTUAL else None, fault["parameters"])
        )
    return found


def is_right(name: Mapping[str, Any], truth: Truth) -> bool:
    """Whether a finding or an alternative is what is concealed; a pair may be told from either joint."""
    if name["effect"] not in truth.effects or name["joint"] not in truth.joints:
        return False
    given = name.get("parameters", {}).get("partner")
    partner = given.get("value") if isinstance(given, Mapping) else given
    return truth.partner is None or partner is None or partner in truth.joints


def contains(name: Mapping[str, Any], truth: Truth) -> bool:
    """Whether a law is a part of the one that is named at its joint."""
    return truth.effects[0] in WHOLE.get(name["effect"], ()) and name["joint"] in truth.joints


def is_twin(name: Mapping[str, Any], truth: Truth, joints: Sequence[str]) -> bool:
    """Whether no motion tells a name from what is concealed."""
    (effect, *_), (joint, *_) = truth.effects, truth.joints
    both, same = {name["effect"], effect}, name["joint"] in truth.joints
    if len(joints) == 1 and any(both <= group for group in ALONE):
        return True
    if any(both <= group for group in ANYWHERE):
        return same
    return same and (both <= FIRST and joint == joints[0] or both <= LAST and joint == joints[-1])


def is_lead(document: Mapping[str, Any], truth: Truth) -> bool:
    """Whether what is left unexplained points at the joint: most of it, or any where the whole robot is meant."""
    left = sorted(document["unexplained"], key=lambda x: -float(x["share"]))
    return bool(left) and (None in truth.joints or left[0]["joint"] in truth.joints)
