"""Public data sets: list, licence and download."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

from rich.console import RenderableType

from ....recording.gallery import DataSet, is_complete
from ....version import __version__
from ..layout import new_table, paragraph, plural
from .documents import Document


def data_document(sets: Iterable[DataSet], folder: Path, written: Sequence[Path] = ()) -> Document:
    """Build the output of `signid data --json`: data sets and written files."""
    known = {"schema": "signid.data/1", "folder": str(folder), "sets": [_entry(one, folder) for one in sets]}
    return {**known, "written": [str(path) for path in written], "version": __version__}


def data_tables(sets: Iterable[DataSet], folder: Path) -> list[RenderableType]:
    """List the data sets and whether they are present."""
    table = new_table("name", "content", "duration [s]>", "download [MB]>", "present")
    lines: list[RenderableType] = []
    for one in sets:
        here = "yes" if is_complete(one, folder / one.folder) else "no"
        table.add_row(one.name, one.title, f"{one.seconds:.0f}", f"{one.megabytes:g}", here)
        lines.append(paragraph(f"{one.name}: github.com/{one.repository}, licence {one.licence}"))
    return [
        table,
        paragraph(""),
        *lines,
        paragraph(f"\nsignid data NAME downloads one into {folder} after confirmation."),
    ]


def data_card(wanted: DataSet, folder: Path, base: str) -> list[RenderableType]:
    """Source, licence and size of a data set."""
    table = new_table("", "")
    table.show_header = False
    for name, value in (
        ("source", f"https://github.com/{wanted.repository}"),
        ("commit", wanted.commit),
        ("from", urlsplit(base).netloc if base == wanted.base else base),
        ("licence", wanted.licence),
        ("cite", wanted.cite),
        ("download", f"{plural(len(wanted.sources), 'file')}, about {wanted.megabytes:g} MB"),
        ("into", str(folder / wanted.folder)),
    ):
        table.add_row(name, value)
    return [paragraph(f"{wanted.name}: {wanted.title}, {wanted.seconds:.0f} s"), table]


def _entry(one: DataSet, folder: Path) -> dict[str, Any]:
    return {
        "name": one.name,
        "title": one.title,
        "duration": one.seconds,
        "repository": one.repository,
        "commit": one.commit,
        "base": one.base,
        "licence": one.licence,
        "cite": one.cite,
        "megabytes": one.megabytes,
        "folder": str(folder / one.folder),
        "here": is_complete(one, folder / one.folder),
        "files": [
            {"name": product.name, "sha256": product.sha256, "sources": list(product.sources)}
            for product in one.products
        ],
    }
