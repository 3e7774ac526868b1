"""The command `demo`."""

from __future__ import annotations

import os
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..app import app
from ..arguments import Json, Seed, given_inputs, given_robot
from ..output import check_folder
from ..terminal import bars, tell_flags

if TYPE_CHECKING:
    from ...output.report import Content
    from . import Story

SCREENS = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # one of these says that Linux has somewhere to open a page


@app.command(epilog="Example: signid demo --robot panda")
def demo(
    robot: Annotated[
        str, typer.Option(metavar="ROBOT", help="A URDF, xacro or MJCF file, or a name such as panda.")
    ] = "3r",
    output: Annotated[
        str, typer.Option("--output", "-o", metavar="DIR", help="Where recordings and results are written.")
    ] = "signid-demo",
    browser: Annotated[bool, typer.Option("--open/--no-open", help="Open the pages in the browser.")] = True,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """The whole story: a robot with concealed physics, found out.

    The robot moves in MuJoCo with laws that its description lacks; --seed draws others. The diagnosis sees the
    description and the recordings alone. DIR gets recordings, diagnosis.json, the simulation with what it lacked as
    model.json and robot.urdf, report.html, replay.html, and demo.json: what was concealed beside what was found.
    """
    from ...output.report import Screen, to_json, write_files
    from . import demo as play, story_document, story_end, story_tables

    check_folder(output, False)
    described = given_robot(robot, None, None, None, None)
    with bars(json, one=True) as progress:
        story = play(described, output, seed=seed, progress=progress)
        files = _files(story, robot)
        document = to_json(story_document(story, robot))
        written = write_files(output, {**files, "demo.json": document})
    if json:
        Screen().write(document)
        return tell_flags(story.flags)
    Screen().print(*story_tables(story), sep="\n")
    code = tell_flags(story.flags)
    Screen().write(story_end(story, robot, written))
    if browser:
        _open([path for path in written if path.suffix == ".html"])
    return code


def _files(story: Story, name: str) -> dict[str, Content]:
    """What is written besides the recordings and the story itself."""
    from ...output.report import diagnosis_document, to_json
    from ..files import diagnosis_files
    from . import by_hand

    inputs = given_inputs(name, story.result.robot, None)
    result, files = diagnosis_files(story.result, inputs, f"{by_hand(story, name)} -o DIR")
    document = to_json(diagnosis_document(result, inputs))
    return {"diagnosis.json": document, **files, "replay.html": story.replay.page()}


def _open(pages: Sequence[Path]) -> None:
    """Pages in the browser, if a person sits before one."""
    import webbrowser

    screen = sys.platform != "linux" or any(os.environ.get(name) for name in SCREENS)
    for page in pages if screen and sys.stdout.isatty() else ():
        webbrowser.open(page.resolve().as_uri())
