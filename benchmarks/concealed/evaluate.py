"""Comparison of a diagnosis with the concealed faults: names, twins that no motion distinguishes, parameters."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

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


EACH: Mapping[str, tuple[str, ...]] = {  # parameters whose relative errors are averaged
    "viscous_friction": ("coefficient",),
    "coulomb_friction": ("level",),
    "asymmetric_friction": ("viscous_positive", "viscous_negative", "coulomb_positive", "coulomb_negative"),
    "stribeck_friction": ("level", "velocity"),
    "quadratic_friction": ("coefficient",),
    "load_friction": ("coefficient",),
    "presliding_friction": ("level", "distance"),
    "position_friction": ("amplitude", "frequency"),
    "friction_drift": ("change",),
    "armature": ("inertia",),
    "torque_offset": ("offset",),
    "spring": ("stiffness",),
    "cable_torque": ("cubic",),
    "torque_gain": ("error",),
    "torque_ripple": ("amplitude", "frequency"),
    "backlash": ("gap",),
    "joint_elasticity": ("stiffness",),
    "encoder_offset": ("offset",),
    "time_delay": ("delay",),
    "torque_lag": ("time_constant",),
    "joint_coupling": ("viscous", "coulomb"),
    "torque_saturation": ("limit",),
    "fluid_drag": ("coefficient",),
}
TOGETHER: Mapping[
    str, Mapping[str, float]
] = {  # vectors: length of the difference over that of the truth, in these units
    "payload": {"mass": 0.1, "first_moment_x": 1.0, "first_moment_y": 1.0, "first_moment_z": 1.0},
    "base_tilt": {"x": 1.0, "y": 1.0},
    "external_contact": {"force_x": 1.0, "force_y": 1.0, "force_z": 1.0},
}
UNSIGNED = ("position_friction", "torque_ripple")  # a negative amplitude is a phase shift
ROUGH = (  # laws with less accurate parameters
    *("load_friction", "stribeck_friction", "position_friction", "external_contact", "friction_drift"),
    *("joint_elasticity", "backlash", "presliding_friction"),
)
SEEN = 3  # joints needed to identify all parameters of a body or a push


def error(effect: str, found: Mapping[str, Any], true: Mapping[str, Any], joints: int) -> float:
    """Relative error of a law's parameters; NaN if some are unidentifiable or missing.

    Args:
        effect: name of the effect.
        found: parameters of a finding, `{"value": ...}` by key.
        true: true parameters by key.
        joints: number of joints.
    """
    if effect == "counterbalance":
        pairs = [(_value(found, "amplitude"), _value(found, "phase")), (float(true["amplitude"]), float(true["phase"]))]
        (one, other) = (np.array([a * math.cos(phase), a * math.sin(phase)]) for a, phase in pairs)
        return float(np.linalg.norm(one - other) / np.linalg.norm(other))
    if effect in TOGETHER and joints >= SEEN:
        units = TOGETHER[effect]
        off = [unit * (_value(found, key) - float(true[key])) for key, unit in units.items()]
        return float(np.linalg.norm(off) / np.linalg.norm([unit * float(true[key]) for key, unit in units.items()]))
    errors = []
    for key in EACH.get(effect, ()):
        value, truth = _value(found, key), float(true[key])
        value = abs(value) if effect in UNSIGNED else value
        errors.append(abs(value / truth - 1))
    return float(np.mean(errors)) if errors else math.nan


def _value(found: Mapping[str, Any], key: str) -> float:
    given = found.get(key)
    value = given.get("value") if isinstance(given, Mapping) else given
    return math.nan if value is None else float(value)


SURE = 0.95  # probability above which a wrong first cause counts as sure [1]


@dataclass(frozen=True)
class Evaluation:
    """Evaluation of one session."""

    suite: str
    robot: str
    joints: int
    effect: str  # all concealed effects
    size: float
    key: str
    name: str  # name of its folder
    outcome: str  # right stated twin lead unknown missed wrong; healthy robots: right alarm; pairs: both one none
    first: str  # the first named cause, "unknown" or "nothing"
    sure: bool  # the first cause is wrong with P > .95
    spurious: int  # number of spurious causes
    names: tuple[tuple[float, bool], ...]  # probability of each cause, and whether it is right
    errors: tuple[tuple[str, float], ...]  # effects and parameter errors of right causes
    after: float  # residual over the noise floor, rms over joints
    cpu: float  # processor time [s]
    hard: bool


def evaluate(answer: Mapping[str, Any], result: Mapping[str, Any]) -> Evaluation:
    """Evaluate a session from its answer and its diagnosis.json."""
    document, hidden = result["document"], truths(answer)
    causes = [x for x in document["findings"] if x["role"] == "cause"] if document["verdict"] == "named" else []
    right = [any(is_right(cause, truth) for truth in hidden) for cause in causes]
    outcome = _outcome(answer, document, causes, hidden)
    sure = bool(causes) and not right[0] and float(causes[0]["probability"]) > SURE
    first = causes[0]["effect"] if causes else "unknown" if document["verdict"] == "unknown" else "nothing"
    return Evaluation(
        suite=answer["suite"],
        robot=answer["robot"],
        joints=len(answer["joints"]),
        effect="+".join(answer["effects"]),
        size=answer["size"],
        key=answer["key"],
        name=answer["name"],
        outcome=outcome,
        first=first,
        sure=sure,
        spurious=max(right.count(False) - (outcome in ("stated", "twin", "wrong")), 0),
        names=tuple((float(c["probability"]), ok) for c, ok in zip(causes, right, strict=True)),
        errors=tuple(_errors(causes, hidden, answer)),
        after=_after(document["fit"]["after"]),
        cpu=float(result["cpu"]),
        hard=bool(answer["hard"]),
    )


def _outcome(
    answer: Mapping[str, Any], document: Mapping[str, Any], causes: Sequence[Mapping[str, Any]], hidden: Sequence[Truth]
) -> str:
    suite, verdict = answer["suite"], document["verdict"]
    if suite == "none":
        return "right" if verdict == "nothing_missing" else "alarm"
    if suite == "pairs":
        wholes = [cause for cause in causes if any(is_right(cause, truth) for truth in hidden)]
        named = sum(
            any(is_right(c, truth) for c in causes) or any(contains(c, truth) for c in wholes) for truth in hidden
        )
        return ("none", "one", "both")[named]
    (truth,) = hidden
    if suite in ("absent", "removed") and verdict == "unknown":
        return "right" if is_lead(document, truth) else "unknown"
    if verdict == "unknown":
        stated = any(is_right(name, truth) for name in listed(document["findings"]))
        return "lead" if stated or is_lead(document, truth) else "unknown"
    if not causes:
        return "missed"
    if suite == "removed":
        near = is_twin(causes[0], truth, answer["joints"]) or contains(causes[0], truth)
        return "twin" if near else "wrong"
    if is_right(causes[0], truth):
        return "right"
    if any(is_right(name, truth) for name in listed(causes)):
        return "stated"
    return "twin" if is_twin(causes[0], truth, answer["joints"]) else "wrong"


def listed(findings: Sequence[Mapping[str, Any]]) -> Iterator[Mapping[str, Any]]:
    """Findings and their alternatives."""
    for finding in findings:
        yield finding
        yield from finding["alternatives"]


def _errors(
    causes: Sequence[Mapping[str, Any]], hidden: Sequence[Truth], answer: Mapping[str, Any]
) -> Iterator[tuple[str, float]]:
    """Parameter errors of each right cause; none for foreign and absent laws."""
    if answer["suite"] in ("foreign", "absent"):
        return
    for truth in hidden:
        for cause in causes:
            if is_right(cause, truth):
                found = error(truth.effects[0], cause["parameters"], truth.parameters, len(answer["joints"]))
                if math.isfinite(found):
                    yield truth.effects[0], found


def _after(fit: Mapping[str, Any]) -> float:
    """Rms over joints of held-out residual over irreducible residual; NaN where the latter is zero."""
    pairs = zip(fit["held_out_rms"], fit["irreducible_rms"], strict=True)
    ratios = [float(x) / float(floor) for x, floor in pairs if x is not None and floor]
    return float(np.sqrt(np.mean(np.square(ratios)))) if ratios else math.nan
