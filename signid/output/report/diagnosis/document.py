"""JSON document of a diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ....effects.base import BodyLaw
from ....effects.naming import law_place
from ....robot.dynamics import own_body
from ....types import Coefficient, Input, Law, Robot
from ..results.documents import Document, description, fit_with_errors, provenance
from ..results.signs import signs_document

if TYPE_CHECKING:
    from ....diagnose import Alternative, Diagnosis, Finding

INFORMED = "The covariance of the simulation is used as prior for its inertials and laws"
FURTHER = "their errors appear about {:g} times larger, which makes alternatives harder to distinguish"


def diagnosis_document(result: Diagnosis, inputs: Sequence[Input] = ()) -> Document:
    """Build the content of diagnosis.json.

    Args:
        result: diagnosis.
        inputs: path and sha256 of the files read besides the recordings; default: the robot description.
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
        "fit": {"before": fit_with_errors(result.before), "after": fit_with_errors(result.after)},
        "rollout": None if before is None or after is None else after.document(before),
        "inertials": {"off": None if result.informed else result.prior_scale, "covariance": result.informed},
        "signs": signs_document(result.signs),
        "cutoff": {"torque": result.cutoff, "unit": "Hz"},
        "flags": list(result.flags),
        "notes": diagnosis_notes(result),
        **provenance(result.inputs, inputs or [description(robot)], result.seed),
    }


def diagnosis_notes(result: Diagnosis) -> list[str]:
    """Notes of a diagnosis, including one on the use of the simulation's covariance."""
    if not result.informed:
        return list(result.notes)
    return [*result.notes, f"{INFORMED}, {FURTHER.format(result.prior_scale)}" if result.prior_scale > 1 else INFORMED]


def changed_link(robot: Robot, law: Law) -> str | None:
    """The link whose inertia a law changes; None for other laws."""
    if not isinstance(law.effect, BodyLaw) or law.effect.scope not in ("link", "tip"):
        return None
    return robot.links[own_body(robot, law.joints[0])]


def _finding(robot: Robot, finding: Finding) -> Document:
    joint, _ = law_place(finding.law, robot)
    where = finding.where
    return {
        "effect": finding.law.effect.name,
        "joint": joint,
        "link": changed_link(robot, finding.law),
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
    """Parameters of a finding by key: value, std (None if unknown), unit, and the value stated by the simulation.

    The value of a partner is its name.
    """
    numbers = law_numbers(robot, finding.law, finding.std)
    for key in numbers.keys() & finding.stated.keys():
        numbers[key]["stated"] = finding.stated[key]
    return numbers


def law_numbers(robot: Robot, law: Law, std: Mapping[str, float]) -> Document:
    """Parameters of a law by key: value, std (None if unknown) and unit."""
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
