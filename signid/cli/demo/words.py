"""The story for the eye, on one screen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from shlex import join

from rich.console import RenderableType
from rich.padding import Padding
from rich.table import Table
from rich.text import Text

from ...diagnose import Diagnosis
from ...diagnose.findings.thresholds import UNSURE
from ...effects.naming import spoken
from ...output.report import figure, with_interval
from ...output.report.diagnosis.document import told_numbers
from ...output.report.diagnosis.tables import change
from ...output.report.diagnosis.words import alternative_words, unexplained_words, verdict_words
from ...output.report.layout import heading, new_table, note_lines, paragraph, plural
from ...output.report.results.signs import confidence
from ...types import TWO_SIDED
from .outcome import FOUND, MINOR, MISSED, RIVAL, Outcome, misses
from .run import BITS, DURATION, NOISE, RATE, RECORDINGS, Story

TOLD = {
    FOUND: ("found", "green"),
    MINOR: ("found, as a correction", "green"),
    RIVAL: ("only an alternative", "yellow"),
    MISSED: ("missed", "bold red"),
}


def story_tables(story: Story) -> list[RenderableType]:
    """What was concealed, recorded, diagnosed, extended and proved, and what the envelope says."""
    name = story.simulation.robot.name
    return [
        heading(f"{name} with physics that its simulation is not told, seed {story.seed}", below=False),
        _steps(story),
        Padding(_proof(story.result), (1, 0, 0, 0)),
        heading("The envelope is opened: what was concealed, and what was found, ± 95 %"),
        _envelope(story),
        *map(paragraph, [*_alternatives(story), *_sum(story)]),
        *(paragraph(f"left unexplained: {words}") for words in unexplained_words(story.result)),
        *note_lines(story.result.notes),
    ]


def story_end(story: Story, name: str, written: Sequence[Path]) -> str:
    """Where everything is, and how to go on.

    Args:
        story: what happened.
        name: of the robot, as it was asked for.
        written: files besides the recordings.
    """
    pages = [path for path in written if path.suffix == ".html"]
    others = [path.name for path in (*story.recordings, *written) if path not in pages]
    another = join(["signid", "demo", "--robot", name, "--seed", str(story.seed + 1)])
    said = ["look at:", *(f"  {path}" for path in pages), f"beside them: {', '.join(others)}"]
    return "\n".join(["", *said, f"by hand: {by_hand(story, name)} -o again", f"another: {another}", ""])


def by_hand(story: Story, name: str) -> str:
    """The command that diagnoses the recordings once more; name: of the robot, as it was asked for."""
    learned, judged = map(str, story.recordings)
    seed = ["--seed", str(story.seed)] if story.seed else []
    return join(["signid", "diagnose", name, learned, "--held-out", judged, *seed])


def _steps(story: Story) -> Table:
    name, folder = story.simulation.robot.name, story.recordings[0].parent
    laws, rolled = plural(len(story.concealed), "law"), story.result.rollout_after
    position = "" if rolled is None else f", and error of position after {max(rolled.horizons):g} s of simulation"
    setting = f"{DURATION:g} s at {RATE:g} Hz, {BITS}-bit encoders, {100 * NOISE:g} % of torque noise"
    table = Table.grid(padding=(0, 2, 0, 0))
    for step, told in (
        ("conceal", f"MuJoCo moves a {name} that obeys {laws} more than its description, the simulation."),
        ("record", f"Two motions of {setting}: {' and '.join(RECORDINGS)}."),
        ("diagnose", f"From the description and {RECORDINGS[0]} alone: {verdict_words(story.result)}."),
        ("extend", f"{folder / 'model.json'} is the simulation with what it lacked."),
        ("prove", f"On {RECORDINGS[1]}, not learned from: rms of the torque left unexplained{position}:"),
    ):
        table.add_row(step, told)
    return table


def _proof(result: Diagnosis) -> Table:
    """Torque and position, before and after."""
    before, after, first, last = result.before, result.after, result.rollout_before, result.rollout_after
    rolled = [] if first is None else ["position: before>", "after>", "unit"]
    table = new_table("joint", "torque: before>", "after>", "noise floor>", "unit", *rolled)
    for j, joint in enumerate(before.joints):
        rms = change(float(before.held_out_rms[j]), float(after.held_out_rms[j]))
        cells: list[RenderableType] = [joint, *rms, figure(float(before.irreducible_rms[j]), 2), before.unit[j]]
        if first is not None and last is not None:
            errors = (float(one.rms(max(one.horizons))[j]) for one in (first, last))
            cells += [*change(*errors), first.unit[j]]
        table.add_row(*cells)
    return table


def _envelope(story: Story) -> Table:
    table = new_table("concealed", "true>", "found>", "±>", "unit", "probability>", "")
    for outcome in story.outcomes:
        law, kind, _, probability = outcome
        told = confidence(probability) if probability else "-"
        table.add_row(spoken(law, story.simulation.robot), "", "", "", "", told, Text(*TOLD[kind]))
        for key, value, found, half, unit in _numbers(story, outcome):
            table.add_row(f"  {key}", value, found, half, unit, "", "")
    return table


def _numbers(story: Story, outcome: Outcome) -> Iterator[tuple[str, str, str, str, str]]:
    """Key, true value, value found, half its interval and unit of each number of a law."""
    named = outcome.found
    for key, true in told_numbers(story.simulation.robot, outcome.law, {}).items():
        value, std = (named.law.parameters[key], named.std.get(key)) if named else (None, None)
        bare = ("-" if value is None else figure(value), "-")
        found = bare if value is None or std is None else with_interval(value, std)
        yield key, figure(true["value"]), *found, true["unit"]


def _alternatives(story: Story) -> Iterator[str]:
    """What else could be behind a law that is not sure."""
    robot = story.simulation.robot
    for finding in story.result.causes:
        if finding.probability < UNSURE:
            yield from (f"{spoken(finding.law, robot)} {words}" for words in alternative_words(robot, finding))


def _sum(story: Story) -> Iterator[str]:
    """How many of the laws and numbers were found, and what was missed or named in vain."""
    found = sum(outcome.found is not None for outcome in story.outcomes)
    inside = [near for outcome in story.outcomes for near in _near(outcome)]
    laws = f"{found} of {plural(len(story.outcomes), 'concealed law')} found"
    yield f"{laws}; {sum(inside)} of their {plural(len(inside), 'number')} within the intervals."
    yield from (f"{flag}." for flag in misses(story.outcomes, story.result))


def _near(outcome: Outcome) -> Iterator[bool]:
    """Of each number, whether what is true lies within the interval of what was found."""
    law, named = outcome.law, outcome.found
    for key, std in named.std.items() if named else ():
        if key in law.parameters and named:
            yield abs(named.law.parameters[key] - law.parameters[key]) <= TWO_SIDED * std
