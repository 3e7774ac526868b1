"""The command `fleet`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import typer

from ...errors import ManifestError, OptionError, shorten
from ..app import RunOptions, Text, command, option, output_option
from ..arguments import given_command
from ..terminal import BAD, DONE, FLAGGED, bars, show, write_error


@dataclass(frozen=True, kw_only=True)
class FleetOptions:
    """Workers and output of a fleet."""

    output: Text = output_option("Output folder. Needed.")
    scheduler: Text = option(None, "Dask scheduler: tcp://HOST:8786. Default: this machine.", metavar="ADDRESS")
    workers: int | None = option(None, "Processes on this machine. Default: one per core.", metavar="N", min=1)
    keep_going: bool = option(True, "Continue if a session fails, or stop.", "--keep-going/--stop")


@command("signid fleet manifest.csv -o fleet")
def fleet(
    context: typer.Context,
    manifest: Annotated[str, typer.Argument(metavar="MANIFEST", help="CSV with one row per session.")],
    options: FleetOptions,
    run: RunOptions,
) -> int:
    """Diagnose or identify many robots, and compare the results.

    MANIFEST has the columns robot and recording (several files: a;b), and optionally held_out, reference, columns,
    actuators, xacro (name:=a;model:=b), task (diagnose, identify), name (of the individual robot), time
    (2026-03-31), session (its folder); paths are relative to the manifest. DIR gets index.html and fleet.json
    with changes, outliers and robots ranked by mismatch, and sessions/NAME with the files of the single command.
    An interrupted run can be repeated: sessions whose files are unchanged are not run again.

    Raises:
        OptionError: no folder was named.
    """
    from ...output.report import check_foreign, probe_folder, to_json, write_files
    from ...output.report.results.fleet import fleet_page, fleet_tables
    from .run import fleet as work

    place = options.output
    if not place:
        raise OptionError("no folder for the sessions was named; add -o DIR")
    probe_folder(place)
    check_foreign(place, ("fleet.json", "index.html"))
    try:
        with bars(run.json, one=True) as progress:
            result = work(
                manifest,
                place,
                scheduler=options.scheduler,
                workers=options.workers,
                seed=run.seed,
                keep_going=options.keep_going,
                progress=progress,
                failed=write_error,
            )
    except ManifestError as error:
        for sentence in error.sentences:
            write_error(sentence)
        return BAD
    except KeyboardInterrupt:
        write_error(f"interrupted; completed sessions are kept in {place}; repeat the command to continue")
        raise
    document = result.document()
    text = to_json(document)
    page = fleet_page(document, given_command(context), result.reused)
    written = write_files(place, {"fleet.json": text, "index.html": page})
    show(text if run.json else fleet_tables(document, result.reused), (), written)
    if flagged := [outcome.entry.session for outcome in result.outcomes if outcome.done and outcome.code == FLAGGED]:
        names = shorten(flagged, 3)
        write_error(f"the results of {names} are flagged; index.html marks them, their reports give the reasons")
    return FLAGGED if result.flagged else DONE
