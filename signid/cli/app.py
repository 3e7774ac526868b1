"""The Typer application: general help and version."""

from __future__ import annotations

from typing import Annotated

import typer

from ..version import __version__

app = typer.Typer(
    name="signid",
    help="Identify and diagnose robot dynamics models from a robot description and recordings.",
    epilog="Exit codes: 0 done; 2 bad input or usage; 3 done, but the result is flagged and says why.",
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    add_completion=False,
)


def _version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"signid {__version__}")
        raise typer.Exit


@app.callback()
def _signid(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version.")
    ] = False,
) -> None:
    pass
