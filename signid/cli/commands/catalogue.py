"""The commands `effects`, `data` and `demo`: laws, public recordings and a demonstration."""

from __future__ import annotations

import os
import shlex
import sys
from dataclasses import dataclass
from os.path import expanduser
from pathlib import Path
from shlex import join
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import (
    Json,
    RobotOptions,
    RunOptions,
    Text,
    Xacro,
    command,
    complete_data,
    complete_law,
    complete_robot,
    option,
    output_option,
)
from ..arguments import given_inputs, given_robot
from ..terminal import BAD, DONE, bars, check_folder, show, write_error

if TYPE_CHECKING:
    pass

DEMO_FILES = "demo.json recording.csv held_out.csv diagnosis.json model.json robot.urdf report.html replay.html".split()
BROWSER_VARIABLES = ("DISPLAY", "WAYLAND_DISPLAY", "BROWSER")  # environment variables that indicate a browser on Linux


@command("signid effects stribeck_friction")
def effects(
    name: Annotated[
        Text, typer.Argument(metavar="NAME", help="A law; without it, all are listed.", autocompletion=complete_law)
    ] = None,
    json: Json = False,
) -> int:
    """List the laws that signid knows, and how to inject them.

    Each law comes with its equation, parameters, units, usual values and source.
    """
    from ...effects import DRIVE_EFFECTS, EFFECTS
    from ...output.report import to_json
    from ...output.report.quantities import effects_document, effects_tables

    chosen = [*EFFECTS, *DRIVE_EFFECTS] if name is None else [EFFECTS[name]]
    return show(to_json(effects_document(chosen)) if json else effects_tables(chosen))


@dataclass(frozen=True, kw_only=True)
class DataOptions:
    """Source and target of a download."""

    output: Text = output_option("Target folder. Default: SIGNID_DATA, or the folder data.")
    yes: bool = option(False, "Download without confirmation.", "--yes", "-y")
    source: Text = option(None, "Mirror: https, or a local folder. Default: the original source.", metavar="URL")


@command("signid data panda")
def data(
    name: Annotated[
        Text,
        typer.Argument(metavar="NAME", help="A data set; without it, all are listed.", autocompletion=complete_data),
    ] = None,
    *,
    options: DataOptions,
    json: Json = False,
) -> int:
    """List or download public recordings of real robots.

    Recordings have torques, motor currents, or the commands and positions of position drives. The examples in robots/
    need them. Source, commit and licence are shown, and the download must be confirmed. The converted files are
    verified by their sha256 and written completely or not at all.

    Raises:
        OptionError: no folder, or no data set, was named.
    """
    from ...output.report import to_json
    from ...output.report.results.recordings import data_document, data_tables
    from ...recording.gallery import DATA, data_folder

    if options.output == "":
        raise OptionError("-o '' is not a folder; name the folder for the recordings")
    if name is None and options != DataOptions():
        raise OptionError("no data set was named; write signid data NAME, or signid data to list them")
    folder = data_folder() if options.output is None else Path(expanduser(options.output))
    if name is not None:
        return _get(name, folder, options, json)
    return show(to_json(data_document(DATA, folder)) if json else data_tables(DATA, folder))


def _get(name: str, folder: Path, options: DataOptions, json: bool) -> int:
    """Download a data set unless it is complete, and list the commands that use it."""
    from ...output.report import Screen, probe_folder, to_json, write_files
    from ...output.report.results.recordings import data_card, data_document
    from ...recording.gallery import DATA, check_source, data_folder, fetch, is_complete
    from ...robot.locate import robots_folder

    wanted, screen, source = DATA[name], Screen(), options.source
    place, base = folder / wanted.folder, wanted.base if source is None else check_source(source)
    if not json:
        screen.print(*data_card(wanted, folder, base), sep="\n")
    written: list[Path] = []
    if not is_complete(wanted, place):
        probe_folder(place)
        if not options.yes and (json or not (sys.stdin.isatty() and sys.stdout.isatty())):
            origin = f"github.com/{wanted.repository}, licence {wanted.licence}"
            raise OptionError(f"{name} comes from {origin}, and needs confirmation; add --yes to download it")
        if not (options.yes or typer.confirm("Download it?")):
            write_error(f"{name} was not downloaded")
            return BAD
        with bars(json) as progress:
            files = fetch(wanted, source, progress=progress)
        written = write_files(place, files, named=True)
    if json:
        screen.write(to_json(data_document([wanted], folder, written)))
    else:
        listed = ["written:", *(f"  {path}" for path in written)] if written else [f"{place} is already complete"]
        listed.append("")
        if not os.environ.get("SIGNID_DATA") or data_folder().resolve() != folder.resolve():
            listed.append(f"export SIGNID_DATA={shlex.quote(str(folder.resolve()))}")
        robots = robots_folder()
        here = robots.relative_to(Path.cwd()) if robots.is_relative_to(Path.cwd()) else robots
        places = {"folder": shlex.quote(str(place)), "robots": shlex.quote(str(here))}
        script = f"python {shlex.quote(str(here / wanted.name / 'identify.py'))}"
        example = wanted.example.format(**places) if wanted.example else script
        screen.write("\n".join(["", *listed, example, ""]))
    return DONE


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
    from ..demo import RECORDINGS, comparison, demo as play, story_document
    from ..terminal import diagnosis_files

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
