"""Terminal text and JSON document of a demonstration."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from shlex import join
from typing import Any

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ...diagnose import Diagnosis
from ...diagnose.findings.thresholds import UNSURE
from ...effects.naming import law_name, law_place
from ...errors import readable
from ...output.report import figure, with_interval
from ...output.report.documents import fit_with_errors, provenance
from ...output.report.layout import confidence, heading, new_table, note_lines, paragraph, plural
from ...output.report.results.diagnosis import change
from ...output.report.results.laws import law_numbers
from ...output.report.results.sentences import alternative_words, unexplained_words, verdict_words
from ...types import TWO_SIDED, Input
from .run import BITS, DURATION, FOUND, MINOR, MISSED, NOISE, RATE, RECORDINGS, RIVAL, LawOutcome, Story, misses

OUTCOMES = {
    FOUND: ("found", "green"),
    MINOR: ("found, as a correction", "green"),
    RIVAL: ("only an alternative", "yellow"),
    MISSED: ("missed", "bold red"),
}


def story_tables(story: Story) -> list[RenderableType]:
    """Tables of a demonstration: steps, validation, and the comparison of concealed and found laws."""
    name = story.simulation.robot.name
    return [
        heading(f"{name} with physics that its simulation lacks, seed {story.seed}", below=False),
        _steps(story),
        Padding(_validation(story.result), (1, 0, 0, 0)),
        heading("Comparison of concealed and found laws, ± 95 %"),
        _comparison(story),
        *map(paragraph, [*_alternatives(story), *_sum(story)]),
        *(paragraph(f"unexplained: {words}") for words in unexplained_words(story.result)),
        *note_lines(story.result.notes),
    ]


def story_end(story: Story, name: str, written: Sequence[Path]) -> str:
    """List the files and further commands; `name` is the robot as given on the command line."""
    pages = [path for path in written if path.suffix == ".html"]
    others = [path.name for path in written if path not in pages]
    another = join(["signid", "demo", "--robot", name, "--seed", str(story.seed + 1)])
    said = ["open:", *(f"  {path}" for path in pages), f"other files: {', '.join(others)}"]
    return "\n".join(["", *said, f"again: {by_hand(story, name)} -o again", f"other laws: {another}", ""])


def by_hand(story: Story, name: str) -> str:
    """Return the command that repeats the diagnosis; `name` is the robot as given on the command line."""
    train, held_out = map(str, story.recordings)
    seed = ["--seed", str(story.seed)] if story.seed else []
    return join(["signid", "diagnose", name, train, "--held-out", held_out, *seed])


def _steps(story: Story) -> Table:
    name, folder = story.simulation.robot.name, story.recordings[0].parent
    laws, rolled = plural(len(story.concealed), "law"), story.result.rollout_after
    position = "" if rolled is None else f" and position error after {max(rolled.horizons):g} s of simulation"
    setting = f"{DURATION:g} s at {RATE:g} Hz, {BITS}-bit encoders, {100 * NOISE:g} % torque noise"
    table = Table.grid(padding=(0, 2, 0, 0))
    for step, sentence in (
        ("conceal", f"MuJoCo simulates a {name} with {laws} that the description lacks."),
        ("record", f"Two motions of {setting}: {' and '.join(RECORDINGS)}."),
        ("diagnose", f"Only from the description and {RECORDINGS[0]}: {verdict_words(story.result)}."),
        ("extend", f"{folder / 'model.json'} is the extended simulation."),
        ("validate", f"On {RECORDINGS[1]}: rms of the residual torque{position}:"),
    ):
        table.add_row(step, sentence)
    return table


def _validation(result: Diagnosis) -> Table:
    """Residual torque and position error, before and after the extension."""
    before, after, first, last = result.before, result.after, result.rollout_before, result.rollout_after
    rolled = [] if first is None else ["position: before>", "after>", "unit"]
    table = new_table("joint", "torque: before>", "after>", "irreducible>", "unit", *rolled)
    for j, joint in enumerate(before.joints):
        rms = change(float(before.held_out_rms[j]), float(after.held_out_rms[j]))
        cells: list[RenderableType] = [joint, *rms, figure(float(before.irreducible_rms[j]), 2), before.unit[j]]
        if first is not None and last is not None:
            errors = (float(one.rms(max(one.horizons))[j]) for one in (first, last))
            cells += [*change(*errors), first.unit[j]]
        table.add_row(*cells)
    return table


def _comparison(story: Story) -> Table:
    table = new_table("concealed", "true>", "found>", "±>", "unit", "probability>", "")
    for outcome in story.outcomes:
        law, kind, _, probability = outcome
        shown = confidence(probability) if probability else "-"
        table.add_row(law_name(law, story.simulation.robot), "", "", "", "", shown, Text(*OUTCOMES[kind]))
        for key, value, found, half, unit in _numbers(story, outcome):
            table.add_row(f"  {key}", value, found, half, unit, "", "")
    return table


def _numbers(story: Story, outcome: LawOutcome) -> Iterator[tuple[str, str, str, str, str]]:
    """Yield key, true value, estimate, half-width of its interval and unit of each parameter."""
    named = outcome.found
    for key, true in law_numbers(story.simulation.robot, outcome.law, {}).items():
        value, std = (named.law.parameters[key], named.std.get(key)) if named else (None, None)
        bare = ("-" if value is None else figure(value), "-")
        found = bare if value is None or std is None else with_interval(value, std)
        yield key, figure(true["value"]), *found, true["unit"]


def _alternatives(story: Story) -> Iterator[str]:
    """Yield the alternatives of uncertain laws."""
    robot = story.simulation.robot
    for finding in story.result.causes:
        if finding.probability < UNSURE:
            yield from (f"{law_name(finding.law, robot)} {words}" for words in alternative_words(robot, finding))


def _sum(story: Story) -> Iterator[str]:
    """Yield the number of laws and parameters found, and the wrong findings."""
    found = sum(outcome.found is not None for outcome in story.outcomes)
    inside = [near for outcome in story.outcomes for near in _near(outcome)]
    laws = f"{found} of {plural(len(story.outcomes), 'concealed law')} found"
    yield f"{laws}; {sum(inside)} of their {plural(len(inside), 'parameter')} within the intervals."
    yield from (f"{flag}." for flag in misses(story.outcomes, story.result))


def _near(outcome: LawOutcome) -> Iterator[bool]:
    """Yield for each parameter whether the interval contains the true value."""
    law, named = outcome.law, outcome.found
    for key, std in named.std.items() if named else ():
        if key in law.parameters and named:
            yield abs(named.law.parameters[key] - law.parameters[key]) <= TWO_SIDED * std


def story_document(story: Story, name: str) -> dict[str, Any]:
    """Build demo.json: concealed laws, findings and validation."""
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
