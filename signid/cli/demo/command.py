"""The command `demo`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..app import command
from ..arguments import given_inputs, given_robot
from ..completion import complete_robot
from ..options import RobotOptions, RunOptions, Xacro
from ..terminal import bars, check_folder, show

if TYPE_CHECKING:
    from ...output.report import Content
    from .run import Story

FILES = "demo.json recording.csv held_out.csv diagnosis.json model.json robot.urdf report.html replay.html".split()
SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # environment variables that indicate a browser on Linux


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

    The robot moves in MuJoCo with laws that its description lacks; --seed selects others. The diagnosis sees only the
    description and the recordings. DIR gets the recordings, diagnosis.json, the extended simulation as model.json and
    robot.urdf, report.html, replay.html, and demo.json, which compares the concealed laws with the findings.
    """
    from ...output.report import Screen, to_json, write_files
    from .run import demo as play
    from .words import story_document, story_end, story_tables

    check_folder(output, False, FILES)
    described = given_robot(robot, RobotOptions(xacro=xacro))
    with bars(run.json, one=True) as progress:
        story = play(described, output, seed=run.seed, progress=progress)
        files = _files(story, robot)
        document = to_json(story_document(story, robot))
        written = write_files(
            output, {**files, "demo.json": document}
        )  # the last, which marks the folder, appears first
    code = show(document if run.json else story_tables(story), story.flags)
    if not run.json:
        Screen().write(story_end(story, robot, written))
        if browser:
            _open([path for path in written if path.suffix == ".html"])
    return code


def _files(story: Story, name: str) -> dict[str, Content]:
    """Files besides the recordings and demo.json."""
    from ...output.report import document, to_json
    from ..files import diagnosis_files
    from .words import by_hand

    inputs = given_inputs(name, story.result.robot, None)
    result, files = diagnosis_files(story.result, inputs, f"{by_hand(story, name)} -o DIR")
    text = to_json(document(result, inputs))
    return {**story.files, "diagnosis.json": text, **files, "replay.html": story.replay.page()}


def _open(pages: Sequence[Path]) -> None:
    """Open pages in the browser if the session is interactive."""
    import webbrowser

    screen = sys.platform != "linux" or any(os.environ.get(name) for name in SCREENS)
    for page in pages if screen and sys.stdout.isatty() else ():
        webbrowser.open(page.resolve().as_uri())
