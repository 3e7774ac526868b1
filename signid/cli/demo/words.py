"""Comparison of concealed and found laws: a table for the terminal, and the JSON document of a demonstration."""

from __future__ import annotations

from typing import Any

from rich.console import RenderableType
from rich.text import Text

from ...effects.naming import law_name, law_place
from ...errors import readable
from ...output.report import figure, with_interval
from ...output.report.documents import fit_with_errors, provenance
from ...output.report.layout import confidence, heading, new_table
from ...output.report.results.laws import law_numbers
from ...types import Input
from .run import BITS, DURATION, FOUND, MINOR, MISSED, NOISE, RATE, RIVAL, LawOutcome, Story

OUTCOMES = {
    FOUND: ("found", "green"),
    MINOR: ("found, as a correction", "green"),
    RIVAL: ("only an alternative", "yellow"),
    MISSED: ("missed", "bold red"),
}


def comparison(story: Story) -> list[RenderableType]:
    """Table of the concealed laws: true and found parameters, and probabilities."""
    robot, table = story.simulation.robot, new_table("concealed", "true>", "found>", "±>", "unit", "probability>", "")
    for outcome in story.outcomes:
        shown = confidence(outcome.probability) if outcome.probability else "-"
        table.add_row(law_name(outcome.law, robot), "", "", "", "", shown, Text(*OUTCOMES[outcome.kind]))
        for key, number in _numbers(story, outcome).items():
            found, std = number["found"], number["std"]
            cells = ("-" if found is None else figure(found), "-") if std is None else with_interval(found, std)
            table.add_row(f"  {key}", figure(number["value"]), *cells, number["unit"], "", "")
    return [heading("Concealed and found laws, ± 95 %"), table]


def _numbers(story: Story, outcome: LawOutcome) -> dict[str, dict[str, Any]]:
    """True value, unit, and estimate with standard deviation of each parameter; None: not found."""
    robot, named = story.simulation.robot, outcome.found
    found = law_numbers(robot, named.law, named.std) if named else {}
    missing = {"value": None, "std": None}
    return {
        key: {
            "value": number["value"],
            "unit": number["unit"],
            "found": found.get(key, missing)["value"],
            "std": found.get(key, missing)["std"],
        }
        for key, number in law_numbers(robot, outcome.law, {}).items()
    }


def story_document(story: Story, name: str) -> dict[str, Any]:
    """Build demo.json: concealed laws, findings and validation; `name` is the robot as given on the command line."""
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
        **provenance(result.inputs, [Input(readable(name), robot.sha256, "description")], story.seed),
    }


def _concealed(story: Story, outcome: LawOutcome) -> dict[str, Any]:
    """A concealed law and its estimated parameters, if it was found."""
    robot, (law, kind, finding, probability) = story.simulation.robot, outcome
    return {
        "effect": law.effect.name,
        "joint": law_place(law, robot)[0],
        "outcome": kind,
        "probability": probability,
        "alternative_to": law_name(finding.law, robot) if finding and not outcome.found else None,
        "parameters": _numbers(story, outcome),
    }
