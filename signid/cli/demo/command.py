"""The command `demo`."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from shlex import join
from typing import Annotated

import typer

from ..app import command, complete_robot
from ..arguments import given_inputs, given_robot
from ..options import RobotOptions, RunOptions, Xacro
from ..terminal import bars, check_folder, show

DEMO_FILES = "demo.json recording.csv held_out.csv diagnosis.json model.json robot.urdf report.html replay.html".split()
BROWSER_VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # environment variables that indicate a browser on Linux


@command("signid demo --robot panda")
def demo(
    run: RunOptions,
    robot: Annotated[
        str,
        typer.Option(
            metavar="ROBOT", help="A URDF, xacro or MJCF file, or a name such as panda.", autocompletion=complete_robot
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
    from .run import RECORDINGS, comparison, demo as play, story_document

    check_folder(output, False, DEMO_FILES)
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
    screen = sys.platform != "linux" or any(os.environ.get(name) for name in BROWSER_VARIABLES)
    if browser and screen and sys.stdout.isatty():
        import webbrowser

        for page in (path for path in written if path.suffix == ".html"):
            webbrowser.open(page.resolve().as_uri())
    return code
