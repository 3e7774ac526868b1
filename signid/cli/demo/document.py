"""JSON document of a demonstration."""

from __future__ import annotations

from typing import Any

from ...effects.naming import law_name, law_place
from ...output.report.results.documents import fit_with_errors, provenance
from ...output.report.results.laws import law_numbers
from ...types import Input
from .outcome import LawOutcome
from .run import BITS, DURATION, NOISE, RATE, Story


def story_document(story: Story, name: str) -> dict[str, Any]:
    """Build demo.json: concealed laws, findings and validation.

    Args:
        story: demonstration.
        name: robot as given on the command line.
    """
    result, robot = story.result, story.simulation.robot
    before, after = result.rollout_before, result.rollout_after
    return {
        "schema": "signid.demo/1",
        "robot": robot.name,
        "joints": list(robot.joints),
        "recordings": {"duration": DURATION, "rate": RATE, "encoder_bits": BITS, "torque_noise": NOISE},
        "verdict": result.verdict,
        "concealed": [_concealed(story, outcome) for outcome in story.outcomes],
        "fit": {"before": fit_with_errors(result.before), "after": fit_with_errors(result.after)},
        "rollout": None if before is None or after is None else after.document(before),
        "flags": list(story.flags),
        "notes": list(result.notes),
        **provenance(result.inputs, [Input(name, robot.sha256, "description")], story.seed),
    }


def _concealed(story: Story, outcome: LawOutcome) -> dict[str, Any]:
    """A concealed law and its estimated parameters, if it was found."""
    robot, (law, kind, finding, probability), named = story.simulation.robot, outcome, outcome.found
    found = law_numbers(robot, named.law, named.std) if named else {}
    beside = law_name(finding.law, robot) if finding and not named else None
    return {
        "effect": law.effect.name,
        "joint": law_place(law, robot)[0],
        "outcome": kind,
        "probability": probability,
        "alternative_to": beside,
        "parameters": {
            key: {
                "value": number["value"],
                "unit": number["unit"],
                "found": found[key]["value"] if key in found else None,
                "std": found[key]["std"] if key in found else None,
            }
            for key, number in law_numbers(robot, law, {}).items()
        },
    }
