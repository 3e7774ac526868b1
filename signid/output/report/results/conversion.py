"""Conversion: JSON document and terminal tables."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from rich.console import RenderableType
from rich.text import Text

from ....errors import shorten
from ....recording.convert import Conversion, Pace
from ....recording.mapping import split
from ....types import Input
from ..layout import heading, new_table, note_lines, paragraph, plural
from ..numbers import figure
from .documents import Document, provenance

SHOWN = 4  # number of joints listed per topic


def conversion_document(found: Conversion, inputs: Sequence[Input] = ()) -> Document:
    """Build the output of `signid convert --json`.

    Args:
        found: conversion.
        inputs: path and sha256 of the files read besides the source.
    """
    pace = found.pace
    return {
        "schema": "signid.conversion/1",
        "rows": _rows(found),
        "columns": list(found.columns),
        "joints": [{"name": joint, "columns": kinds} for joint, kinds in found.joints.items()],
        "units": dict(found.units),
        "time": None
        if pace is None
        else {
            "duration": pace.duration,
            "rate": pace.rate,
            "gaps": pace.gaps,
            "longest_gap": pace.longest,
            "clock": found.about.clock or None,
        },
        "topics": [
            {
                "name": topic.name,
                "type": topic.kind,
                "messages": topic.messages,
                "rate": topic.rate if np.isfinite(topic.rate) else None,
                "joints": list(topic.joints),
                "read": topic.read,
            }
            for topic in found.about.topics
        ],
        "suggested_columns": list(found.suggested),
        "flags": list(found.flags),
        "notes": list(found.notes),
        **provenance([found.source], inputs, 0),
    }


def conversion_tables(found: Conversion) -> list[RenderableType]:
    """Topics, joints and timing of a conversion."""
    joints = new_table("joint", "columns", *(["converted from"] if found.units else []))
    for joint, kinds in found.joints.items():
        units = dict.fromkeys(unit for kind in kinds if (unit := found.units.get(f"{kind}_{joint}")))
        joints.add_row(joint, " ".join(kinds), *([", ".join(units)] if found.units else []))
    others = [name for name in found.columns if name != "t" and not split(name)]
    suggested = [heading("Suggested column map; check it before use"), *map(_line, found.suggested)]
    return [
        heading(f"{found.source.path}: {plural(_rows(found), 'row')}{_pace(found.pace)}", below=False),
        *_topics(found),
        *([joints] if found.joints else []),
        *([paragraph(f"Other columns, unchanged: {shorten(others)}")] if others else []),
        *([paragraph(f"Clock: {found.about.clock}.")] if found.about.clock else []),
        *(suggested if found.suggested else []),
        *note_lines(found.notes),
    ]


def _line(text: str) -> RenderableType:
    """A line to copy, never wrapped."""
    return Text(text, no_wrap=True, overflow="ignore")


def _rows(found: Conversion) -> int:
    return len(next(iter(found.columns.values()), ()))


def _pace(pace: Pace | None) -> str:
    if pace is None:
        return ""
    gaps = f"{plural(pace.gaps, 'gap')} of up to {figure(pace.longest)} s" if pace.gaps else "no gap"
    return f", {figure(pace.duration)} s at {figure(pace.rate)} Hz, {gaps}"


def _topics(found: Conversion) -> list[RenderableType]:
    if not found.about.topics:
        return []
    table = new_table("topic", "type", "messages>", "Hz>", "joints")
    for topic in found.about.topics:
        rate = figure(topic.rate) if np.isfinite(topic.rate) else ""
        joints = shorten(topic.joints, SHOWN) if topic.read else "(not read)"
        table.add_row(topic.name, topic.kind.rpartition("/")[2], str(topic.messages), rate, joints)
    return [table]
