"""Comparison of named effects and joints with the truth, including twins that no motion distinguishes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from .cases import FAMILIES

MUTUAL = ("joint_coupling", "channel_swap")  # named at either of two joints
ALONE = (  # equivalent on a single joint
    {"counterbalance", "base_tilt", "encoder_offset", "payload", "link_inertia"},
    {"quadratic_friction", "fluid_drag"},
)
WHOLE = {"asymmetric_friction": ("viscous_friction", "coulomb_friction", "torque_offset")}  # laws that it contains
ANYWHERE = ({"torque_offset", "asymmetric_friction"}, {"time_delay", "torque_lag"})
FIRST = {"armature", "link_inertia"}
LAST = {"payload", "link_inertia", "encoder_offset"}


class Truth(NamedTuple):
    """A concealed fault."""

    effects: tuple[str, ...]  # effects that count as right
    joints: tuple[str | None, ...]
    partner: str | None
    parameters: Mapping[str, Any]


def truths(answer: Mapping[str, Any]) -> list[Truth]:
    """Concealed faults of an answer; a foreign law is represented by its family."""
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
    """Whether a finding or alternative matches the truth; a pair may be named at either joint."""
    if name["effect"] not in truth.effects or name["joint"] not in truth.joints:
        return False
    given = name.get("parameters", {}).get("partner")
    partner = given.get("value") if isinstance(given, Mapping) else given
    return truth.partner is None or partner is None or partner in truth.joints


def contains(name: Mapping[str, Any], truth: Truth) -> bool:
    """Whether the true law is part of the named one at the same joint."""
    return truth.effects[0] in WHOLE.get(name["effect"], ()) and name["joint"] in truth.joints


def is_twin(name: Mapping[str, Any], truth: Truth, joints: Sequence[str]) -> bool:
    """Whether no motion distinguishes the named effect from the truth."""
    (effect, *_), (joint, *_) = truth.effects, truth.joints
    both, same = {name["effect"], effect}, name["joint"] in truth.joints
    if len(joints) == 1 and any(both <= group for group in ALONE):
        return True
    if any(both <= group for group in ANYWHERE):
        return same
    return same and (both <= FIRST and joint == joints[0] or both <= LAST and joint == joints[-1])


def is_lead(document: Mapping[str, Any], truth: Truth) -> bool:
    """Whether the largest unexplained residual is at a true joint, or any residual for a fault of the whole robot."""
    unexplained = sorted(document["unexplained"], key=lambda x: -float(x["share"]))
    return bool(unexplained) and (None in truth.joints or unexplained[0]["joint"] in truth.joints)
