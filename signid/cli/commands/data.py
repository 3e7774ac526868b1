"""The command `data`."""

from __future__ import annotations

import os
import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import OptionError
from ..app import app
from ..options import Json
from ..terminal import BAD, DONE, bars, write_error

if TYPE_CHECKING:
    from ...recording.gallery import DataSet


@app.command(epilog="Example: signid data panda")
def data(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="A data set; without it, all are listed.")] = None,
    output: Annotated[
        str | None,
        typer.Option("--output", "-o", metavar="DIR", help="Target folder. Default: SIGNID_DATA, or the folder data."),
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Download without confirmation.")] = False,
    source: Annotated[
        str | None,
        typer.Option(metavar="URL", help="Mirror: https, or a local folder. Default: the original source."),
    ] = None,
    json: Json = False,
) -> int:
    """List or download public recordings of real robots.

    The examples in robots/ need them. Source, commit and licence are shown, and the download must be confirmed. The
    converted files are verified by their sha256 and written completely or not at all.
    """
    from ...recording.gallery import data_folder

    folder = data_folder() if output is None else _folder(output)
    if name is not None:
        return _get(name, folder, yes, source, json)
    return _list(folder, json, alone=not yes and source is None and output is None)


def _list(folder: Path, json: bool, alone: bool) -> int:
    from ...output.report import Screen, data_document, data_tables, to_json
    from ...recording.gallery import DATA

    if not alone:
        raise OptionError("no data set was named; write signid data NAME, or signid data to list them")
    if json:
        Screen().write(to_json(data_document(DATA, folder)))
    else:
        Screen().print(*data_tables(DATA, folder), sep="\n")
    return DONE


def _get(name: str, folder: Path, yes: bool, source: str | None, json: bool) -> int:
    from ...output.report import Screen, data_card, data_document, probe_folder, to_json, write_files
    from ...recording.gallery import DATA, check_source, fetch, is_complete

    wanted, screen = DATA[name], Screen()
    place, base = folder / wanted.folder, wanted.base if source is None else check_source(source)
    if not json:
        screen.print(*data_card(wanted, folder, base), sep="\n")
    written: list[Path] = []
    if not is_complete(wanted, place):
        probe_folder(place)
        if not _agreed(wanted, yes, json):
            write_error(f"{name} was not downloaded")
            return BAD
        with bars(json) as progress:
            files = fetch(wanted, source, progress=progress)
        written = write_files(place, files)
    if json:
        screen.write(to_json(data_document([wanted], folder, written)))
    else:
        listed = ["written:", *(f"  {path}" for path in written)] if written else [f"{place} is already complete"]
        screen.write("\n".join(["", *listed, "", *_next(wanted, folder), ""]))
    return DONE


def _folder(output: str) -> Path:
    if not output:
        raise OptionError("-o '' is not a folder; name the folder for the recordings")
    return Path(output).expanduser()


def _agreed(wanted: DataSet, yes: bool, json: bool) -> bool:
    """Whether the user confirms the download."""
    if yes:
        return True
    if json or not (sys.stdin.isatty() and sys.stdout.isatty()):
        source = f"github.com/{wanted.repository}, licence {wanted.licence}"
        raise OptionError(f"{wanted.name} comes from {source}, and needs confirmation; add --yes to download it")
    return typer.confirm("Download it?")


def _next(wanted: DataSet, folder: Path) -> list[str]:
    """Commands that use the data set."""
    from ...recording.gallery import data_folder
    from ...robot.locate import robots_folder

    lines = []
    if not os.environ.get("SIGNID_DATA") or data_folder().resolve() != folder.resolve():
        lines.append(f"export SIGNID_DATA={shlex.quote(str(folder.resolve()))}")
    if wanted.example:
        return [*lines, wanted.example.format(folder=shlex.quote(str(folder / wanted.folder)))]
    example = robots_folder() / wanted.name / "identify.py"
    here = example.relative_to(Path.cwd()) if example.is_relative_to(Path.cwd()) else example
    return [*lines, f"python {shlex.quote(str(here))}"]
