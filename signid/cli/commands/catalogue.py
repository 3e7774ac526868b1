"""The command `effects`."""

from __future__ import annotations

from typing import Annotated

import typer

from ..app import app
from ..options import Json
from ..terminal import DONE


@app.command(epilog="Example: signid effects stribeck_friction")
def effects(
    name: Annotated[str | None, typer.Argument(metavar="NAME", help="A law; without it, all are listed.")] = None,
    json: Json = False,
) -> int:
    """List the laws that signid knows, and how to inject them.

    Each law comes with its equation, parameters, units, usual values and source.
    """
    from ...effects import EFFECTS
    from ...output.report import Screen, effects_document, effects_tables, to_json

    chosen = list(EFFECTS) if name is None else [EFFECTS[name]]
    if json:
        Screen().write(to_json(effects_document(chosen)))
    else:
        Screen().print(*effects_tables(chosen), sep="\n")
    return DONE
