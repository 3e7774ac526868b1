"""A diagnosis as JSON."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ....effects.base import BodyLaw
from ....effects.naming import law_place
from ....robot.dynamics import own_body
from ....types import Coefficient, Input, Law, Robot
from ..results.documents import Document, description, fit_document, provenance
from ..results.signs import signs_document

if TYPE_CHECKING:
    from ....diagnose import Alternative, Diagnosis, Finding

INFORMED = "Bodies and laws of the simulation count as known as well as identification left them"
FURTHER = "yet they seem to be off by about {:g} times that, so which of several laws is behind a torque is less sure"


def diagnosis_document(result: Diagnosis, inputs: Sequence[Input] = ()) -> Document:
    """The content of diagnosis.json.

    Args:
        result: the diagnosis.
        inputs: path and sha256 of what was read besides the recordings; the robot's description if none is given.
    """
    robot, before, after = result.robot, result.rollout_before, result.rollout_after
    return {
        "schema": "signid.diagnosis/1",
        "robot": robot.name,
        "joints": list(robot.joints),
        "verdict": result.verdict,
        "tolerance": result.tolerance,
        "findings": [_finding(robot, finding) for finding in result.findings],
        "unexplained": [
            {
                "joint": robot.joints[left.joint],
                "depends_on": left.place.variable,
                "share": left.share,
                "region": left.place.region,
                "held_out_gain": left.held_out_gain,
                "empirical": left.modelled,
            }
            for left in result.unexplained
        ],
        "located": [
            {
                "joint": robot.joints[place.joint],
                "depends_on": place.variable,
                "region": place.region,
                "share": place.share,
                "explained": place.explained,
            }
            for place in result.located
        ],
        "fit": {"before": fit_document(result.before), "after": fit_document(result.after)},
        "rollout": None if before is None or after is None else after.document(before),
        "inertials": {"off": None if result.informed else result.trust, "covariance": result.informed},
        "signs": signs_document(result.signs),
        "cutoff": {"torque": result.cutoff, "unit": "Hz"},
        "flags": list(result.flags),
        "notes": diagnosis_notes(result),
        **provenance(result.inputs, inputs or [description(robot)], result.seed),
    }


def diagnosis_notes(result: Diagnosis) -> list[str]:
    """The notes of a diagnosis, and what the simulation's own covariance means for it."""
    if not result.informed:
        return list(result.notes)
    return [*result.notes, f"{INFORMED}, {FURTHER.format(result.trust)}" if result.trust > 1 else INFORMED]


def mended_link(robot: Robot, law: Law) -> str | None:
    """The link whose body a law changes; None for a law that changes more or something else."""
    if not isinstance(law.effect, BodyLaw) or law.effect.scope not in ("link", "tip"):
        return None
    return robot.links[own_body(robot, law.joints[0])]


def _finding(robot: Robot, finding: Finding) -> Document:
    joint, _ = law_place(finding.law, robot)
    where = finding.where
    return {
        "effect": finding.law.effect.name,
        "joint": joint,
        "link": mended_link(robot, finding.law),
        "role": finding.role,
        "in_model": finding.in_model,
        "probability": finding.probability,
        "parameters": finding_numbers(robot, finding),
        "meaning": finding.law.effect.meaning(finding.law.parameters),
        "torque_share": {
            name: float(share) for name, share in zip(robot.joints, finding.torque_share, strict=True) if share > 0
        },
        "where": {
            "joint": robot.joints[where.joint],
            "variable": where.variable,
            "region": where.region,
            "share": where.share,
        },
        "evidence": {
            "statistic": finding.statistic,
            "threshold": finding.threshold,
            "held_out_gain": finding.held_out_gain,
        },
        "alternatives": [_alternative(robot, rival) for rival in finding.alternatives],
    }


def finding_numbers(robot: Robot, finding: Finding) -> Document:
    """By key: value, standard deviation (None where it is not known), unit, and what the simulation states, if it does.

    The value of a partner is its name.
    """
    numbers = told_numbers(robot, finding.law, finding.std)
    for key in numbers.keys() & finding.stated.keys():
        numbers[key]["stated"] = finding.stated[key]
    return numbers


def told_numbers(robot: Robot, law: Law, std: Mapping[str, float]) -> Document:
    """The same of any law, with the standard deviations that are known."""
    _, values = law_place(law, robot)
    out: dict[str, Any] = {}
    for key, value in values.items():
        unit = "" if key == "partner" else _unit(robot, law, key)
        out[key] = {"value": value, "std": std.get(key), "unit": unit}
    return out


def _unit(robot: Robot, law: Law, key: str) -> str:
    kind, one = law.effect.parameters[key], len(law.joints) == 1
    prismatic = one and bool(robot.prismatic[law.joints[0]])
    return str(kind.unit_at(prismatic)) if isinstance(kind, Coefficient) or one else str(kind.unit)


def _alternative(robot: Robot, rival: Alternative) -> Document:
    joint, _ = law_place(rival.law, robot)
    return {
        "effect": rival.law.effect.name,
        "joint": joint,
        "probability": rival.probability,
        "separating_motion": rival.separating_motion,
    }
