"""Recordings: JSON documents and terminal text of their conversion, download and audit."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import numpy as np
from rich.console import RenderableType

from ....errors import shorten
from ....recording.gallery import DataSet, is_complete
from ....recording.names.mapping import split
from ....types import Input
from ....version import __version__
from ..documents import Document, ending, picked
from ..layout import figure, heading, new_table, note_lines, paragraph, plural

if TYPE_CHECKING:
    from ....recording.convert import Conversion

MAX_TOPIC_JOINTS = 4  # number of joints listed per topic


def conversion_document(found: Conversion, inputs: Sequence[Input] = ()) -> Document:
    """Build the output of `signid convert --json`; `inputs` are files read besides the source."""
    pace, clock = found.pace, found.about.clock or None
    return {
        "schema": "signid.conversion/1",
        "rows": _rows(found),
        "columns": list(found.columns),
        "joints": [{"name": joint, "columns": kinds} for joint, kinds in found.joints.items()],
        "units": dict(found.units),
        "time": pace and {**picked(pace, "duration rate gaps"), "longest_gap": pace.longest, "clock": clock},
        "topics": [
            {"name": topic.name, "type": topic.kind, **picked(topic, "messages rate joints read")}
            for topic in found.about.topics
        ],
        "joined": [picked(file, "path offset estimate std") for file in found.joined],
        **ending(found, _sources(found), inputs, 0),
    }


def conversion_tables(found: Conversion) -> list[RenderableType]:
    """Topics, joints and timing of a conversion."""
    topics = new_table("topic", "type", "messages>", "Hz>", "joints")
    for topic in found.about.topics:
        rate = figure(topic.rate) if np.isfinite(topic.rate) else ""
        names = shorten(topic.joints, MAX_TOPIC_JOINTS) if topic.read else "(not read)"
        topics.add_row(topic.name, topic.kind.rpartition("/")[2], str(topic.messages), rate, names)
    joints = new_table("joint", "columns", *(["converted from"] if found.units else []))
    for joint, kinds in found.joints.items():
        units = dict.fromkeys(unit for kind in kinds if (unit := found.units.get(f"{kind}_{joint}")))
        joints.add_row(joint, " ".join(kinds), *([", ".join(units)] if found.units else []))
    others = [name for name in found.columns if name != "t" and not split(name)]
    title = f"{' + '.join(source.path for source in _sources(found))}: {plural(_rows(found), 'row')}"
    if (pace := found.pace) is not None:
        gaps = f"{plural(pace.gaps, 'gap')} of up to {figure(pace.longest)} s" if pace.gaps else "no gap"
        title += f", {figure(pace.duration)} s at {figure(pace.rate)} Hz, {gaps}"
    return [
        heading(title, below=False),
        *([topics] if found.about.topics else []),
        *([joints] if found.joints else []),
        *([paragraph(f"Other columns, unchanged: {shorten(others)}")] if others else []),
        *([paragraph(f"Clock: {found.about.clock}.")] if found.about.clock else []),
        *note_lines(found.notes),
    ]


def _sources(found: Conversion) -> list[Input]:
    return [found.source, *(Input(file.path, file.sha256, found.source.role) for file in found.joined)]


def _rows(found: Conversion) -> int:
    return len(next(iter(found.columns.values()), ()))


def data_document(sets: Iterable[DataSet], folder: Path, written: Sequence[Path] = ()) -> Document:
    """Build the output of `signid data --json`: data sets and written files."""
    described = [
        {
            "name": data.name,
            "title": data.title,
            "duration": data.seconds,
            **picked(data, "drives repository commit base licence cite megabytes"),
            "folder": str(folder / data.folder),
            "here": is_complete(data, folder / data.folder),
            "files": [{"name": x.name, "sha256": x.sha256, "sources": list(x.sources)} for x in data.products],
        }
        for data in sets
    ]
    known = {"schema": "signid.data/1", "folder": str(folder), "sets": described}
    return {**known, "written": [str(path) for path in written], "version": __version__}


def data_tables(sets: Iterable[DataSet], folder: Path) -> list[RenderableType]:
    """List the data sets by what they hold, and whether they are present."""
    listed, parts = list(sets), list[RenderableType]()
    for title, drives in (("Torques or motor currents", False), ("Position drives: commands and positions", True)):
        table = new_table("name", "content", "duration [s]>", "download [MB]>", "present")
        for data in (data for data in listed if data.drives is drives):
            here = "yes" if is_complete(data, folder / data.folder) else "no"
            table.add_row(data.name, data.title, f"{data.seconds:.0f}", f"{data.megabytes:g}", here)
        parts += [heading(title, below=bool(parts)), table] if table.rows else []
    sources = [paragraph(f"{data.name}: github.com/{data.repository}, licence {data.licence}") for data in listed]
    advice = f"\nsignid data NAME downloads one into {folder} after confirmation."
    return [*parts, paragraph(""), *sources, paragraph(advice)]


def data_card(wanted: DataSet, folder: Path, base: str) -> list[RenderableType]:
    """Source, licence and size of a data set."""
    rows = {
        "source": f"https://github.com/{wanted.repository}",
        "commit": wanted.commit,
        "from": urlsplit(base).netloc if base == wanted.base else base,
        "licence": wanted.licence,
        "cite": wanted.cite,
        "download": f"{plural(len(wanted.sources), 'file')}, about {wanted.megabytes:g} MB",
        "into": str(folder / wanted.folder),
    }
    table = new_table("", "", rows=rows.items())
    table.show_header = False
    return [paragraph(f"{wanted.name}: {wanted.title}, {wanted.seconds:.0f} s"), table]
