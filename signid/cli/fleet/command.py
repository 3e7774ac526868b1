"""The command `fleet`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

import typer

from ...errors import ManifestError, OptionError, shorten
from ..app import app
from ..arguments import Json, Seed, again
from ..terminal import BAD, DONE, FLAGGED, bars, complain

if TYPE_CHECKING:
    from . import Outcome

MOST = 20  # sentences on standard error


@app.command(epilog="Example: signid fleet manifest.csv -o fleet")
def fleet(
    context: typer.Context,
    manifest: Annotated[str, typer.Argument(metavar="MANIFEST", help="CSV: a row a session.")],
    output: Annotated[
        str | None, typer.Option("--output", "-o", metavar="DIR", help="Folder of the results. Needed.")
    ] = None,
    scheduler: Annotated[
        str | None, typer.Option(metavar="ADDRESS", help="Of Dask: tcp://HOST:8786. Default: this machine.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(metavar="N", min=1, help="Processes of this machine. Default: one a core.")
    ] = None,
    keep_going: Annotated[bool, typer.Option("--keep-going/--stop", help="When a session cannot be done.")] = True,
    seed: Seed = 0,
    json: Json = False,
) -> int:
    """Many robots: each diagnosed or identified, all told.

    MANIFEST has the columns robot and recording (several files: a;b), and if wanted held_out, reference, columns,
    actuators, task (diagnose, identify, reduce), like, name (of the single robot), time (2026-03-31), session (its
    folder); paths are relative to it. DIR gets index.html and fleet.json: robots by mismatch, equal causes, parameters
    that drift from session to session; and sessions/NAME with what the single command writes. The same command goes on
    where it was interrupted: sessions made from the same files are not done again.
    """
    from ...output.report import Screen, fleet_page, fleet_tables, to_json, write_files
    from . import fleet as work

    place = _folder(output)
    try:
        with bars(json, one=True) as progress:
            found = work(
                manifest,
                place,
                scheduler=scheduler,
                workers=workers,
                seed=seed,
                keep_going=keep_going,
                progress=progress,
            )
    except ManifestError as error:
        for sentence in error.sentences:
            complain(sentence)
        return BAD
    except KeyboardInterrupt:
        complain(f"interrupted; the sessions that are done are kept in {place}, and the same command goes on from them")
        raise
    document = found.document()
    text = to_json(document)
    written = write_files(place, {"fleet.json": text, "index.html": fleet_page(document, again(context))})
    if json:
        Screen().write(text)
    else:
        Screen().print(*fleet_tables(document), sep="\n")
        Screen().write("\n".join(["", "written:", *(f"  {path}" for path in written), ""]))
    _tell(found.outcomes)
    return FLAGGED if found.flagged else DONE


def _folder(output: str | None) -> str:
    from ...output.report import probe_folder

    if not output:
        raise OptionError("no folder for the sessions was named; add -o DIR")
    probe_folder(output)
    return output


def _tell(sessions: Sequence[Outcome]) -> None:
    """Sessions that could not be done, and why; how many are flagged."""
    undone = [one for one in sessions if not one.done]
    for one in undone[:MOST]:
        complain(f"session {one.entry.session} was not done: {'; '.join(one.said)}")
    if len(undone) > MOST:
        complain(f"and {len(undone) - MOST} more sessions were not done; index.html lists them")
    if flagged := [one.entry.session for one in sessions if one.done and one.code == FLAGGED]:
        complain(
            f"what {shorten(flagged, 3)} found is not all to be trusted; index.html marks it, their reports say why"
        )
