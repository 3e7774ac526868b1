"""Factors of recordings: JSON document and terminal text."""

from __future__ import annotations

from rich.console import RenderableType

from ....regression.reduced import Reduced
from ....version import __version__
from ..layout import note_lines, paragraph, plural
from .documents import Document


def factors_document(found: Reduced, size: int) -> Document:
    """Build the output of `signid reduce --json`.

    Args:
        found: factors.
        size: size of their file [bytes].
    """
    band = found.task.band
    train, held_out = (sum(node.factors.rows for node in nodes) for nodes in (found.train, found.held_out))
    return {
        "schema": "signid.reduction/1",
        "robot": found.robot.name,
        "joints": list(found.robot.joints),
        "effects": list(dict.fromkeys(law.effect.name for law in found.task.laws)),
        "base_parameters": found.task.base.rank,
        "rows": {"learned_from": train, "held_out": held_out},
        "cutoff": {"torque": band.cutoff, "position": band.position_cutoff, "unit": "Hz"},
        "part": list(found.share),
        "bytes": size,
        "notes": list(found.notes),
        "inputs": [file._asdict() for file in found.inputs],
        "version": __version__,
    }


def factors_tables(document: Document) -> list[RenderableType]:
    """Summarise a reduction for the terminal.

    Args:
        document: result of `factors_document`.
    """
    rows, (which, of) = document["rows"], document["part"]
    part = "" if of == 1 else f", part {which} of {of}"
    count = plural(document["base_parameters"], "base parameter")
    title = f"{document['robot']}: factors of {plural(len(document['inputs']), 'recording')}{part}, for {count}"
    size = f"{document['bytes'] / 1e3:.0f} kB"
    kept = f"{rows['learned_from']} training rows and {rows['held_out']} held-out rows, in {size}"
    cutoff = f"Cut-off {document['cutoff']['torque']:.4g} Hz for torque (set with --cutoff)."
    return [paragraph(title), paragraph(kept), paragraph(cutoff), *note_lines(document["notes"])]
