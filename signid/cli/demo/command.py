"""The command `demo`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from shlex import join
from typing import Annotated, Any

import typer
from rich.console import RenderableType
from rich.text import Text

from ...effects.naming import law_name, law_place
from ...errors import readable
from ...output.report import figure, with_interval
from ...output.report.documents import fit_with_errors, provenance
from ...output.report.layout import confidence, heading, new_table
from ...output.report.results.laws import law_numbers
from ...types import Input
from ..app import command, complete_robot
from ..arguments import given_inputs, given_robot
from ..options import RobotOptions, RunOptions, Xacro
from ..terminal import bars, check_folder, show
from .run import BITS, DURATION, FOUND, MINOR, MISSED, NOISE, RATE, RIVAL, LawOutcome, Story

FILES = "demo.json recording.csv held_out.csv diagnosis.json model.json robot.urdf report.html replay.html".split()
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # environment variables that indicate a browser on Linux
OUTCOMES = {
    FOUND: ("found", "green"),
    MINOR: ("found, as a correction", "green"),
    RIVAL: ("only an alternative", "yellow"),
    MISSED: ("missed", "bold red"),
}


@command("signid demo --robot panda")
def demo(
    run: RunOptions,
    robot: Annotated[
        str,
        typer.Option(
            metavar="ROBOT",
            help="A URDF, xacro or MJCF file, or a name such as panda.",
            autocompletion=complete_robot,
        ),
    ] = "3r",
    output: Annotated[str, typer.Option("--output", "-o", metavar="DIR", help="Output folder.")] = "signid-demo",
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the pages in the browser.")] = True,
    xacro: Xacro = None,
) -> int:
    """Demonstrate a diagnosis: conceal physics, and find it again.

    The robot is simulated with laws that its description lacks; --seed selects others. The diagnosis sees only the
    description and the recordings. DIR gets the recordings, diagnosis.json, the extended simulation as model.json and
    robot.urdf, report.html, replay.html, and demo.json, which compares the concealed laws with the findings.
    """
    from ...output.report import Screen, document, tables, to_json, write_files
    from ..files import diagnosis_files
    from .run import RECORDINGS, demo as play

    check_folder(output, False, FILES)
    described = given_robot(robot, RobotOptions(xacro=xacro))
    with bars(run.json, one=True) as progress:
        story = play(described, output, seed=run.seed, progress=progress)
        inputs = given_inputs(robot, story.simulation.robot, None)
        train, held_out = (str(Path(output, name)) for name in RECORDINGS)
        seed = ["--seed", str(run.seed)] if run.seed else []
        again = join(["signid", "diagnose", robot, train, "--held-out", held_out, *seed])
        result, files = diagnosis_files(story.result, inputs, f"{again} -o DIR")
        files = {"diagnosis.json": to_json(document(result, inputs)), **files, "replay.html": story.replay.page()}
        text = to_json(story_document(story, robot))
        written = write_files(output, {**story.files, **files, "demo.json": text})  # the last appears first
    if run.json:
        return show(text, story.flags)
    code = show([*tables(result), *comparison(story)], story.flags, written)
    Screen().write(f"again: {again} -o again\n")
    if browser:
        _open([path for path in written if path.suffix == ".html"])
    return code


def _open(pages: Sequence[Path]) -> None:
    """Open pages in the browser if the session is interactive."""
    import webbrowser

    screen = sys.platform != "linux" or any(os.environ.get(name) for name in SCREENS)
    for page in pages if screen and sys.stdout.isatty() else ():
        webbrowser.open(page.resolve().as_uri())


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
