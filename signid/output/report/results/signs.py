"""Recovered signs: block of identification.json, terminal tables, and signed.csv."""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

import numpy as np
import polars as pl
from rich.console import RenderableType

from ....signs import Signs, SignSegment
from ....types import Array, Recording
from ..documents import Document, picked
from ..layout import CERTAIN, confidence, figure, heading, new_table, paragraph, plural, share, with_interval

CHUNK = 65_536  # rows written at once


def signs_document(signs: Signs | None) -> Document | None:
    """Build the signs block of identification.json; None if all torques were recorded with signs."""
    if signs is None:
        return None
    hidden = list(signs.hidden)
    return {
        "proof": picked(signs.proof, "optimal gap nodes certified"),
        "flags": list(signs.flags),
        "segments": [_segment(signs, segment) for segment in signs.segments],
        "method": signs.method,
        "joints": [signs.joints[j] for j in hidden],
        **{key: x[hidden].tolist() for key, x in picked(signs, "threshold noise inflation").items()},
        "gains": [
            {"joint": gain.joint, "torque_constant": float(gain.value), "std": float(gain.std), "unit": gain.unit}
            for gain in signs.gains
        ],
        "notes": list(signs.notes),
        "seed": int(signs.seed),
    }


def signs_tables(signs: Signs) -> list[RenderableType]:
    """Number of segments and confidence of their signs per joint, and the optimality proof."""
    table = new_table("joint", "segments>", "+>", "->", "uncertain>", "lowest confidence>", "samples>", "in segments>")
    for j in signs.hidden:
        segments = signs.of(j)
        counts = [sum(t.sign == sign for t in segments) for sign in (1, -1)]
        uncertain = sum(not t.confidence >= CERTAIN for t in segments)
        lowest = confidence(min((t.confidence for t in segments), default=float("nan")))
        total, inside = _samples(signs, segments)
        cells = (len(segments), *counts, uncertain, lowest, total, share(inside / total) if total else "-")
        table.add_row(signs.joints[j], *map(str, cells))
    return [heading("Torque signs"), table, paragraph(proof_sentence(signs)), *_gains(signs)]


def signed_csv(recording: Recording, signs: Signs, part: int) -> Iterator[str]:
    """Yield signed.csv in pieces: the recording's rows with t [s], and tau_J [N.m or N] and sure_J [1] of each joint.

    `sure_J` is the confidence of the segment of a row. It is 0 outside of segments, where the sign follows the model,
    and 1 for torques recorded with signs. Numbers are written exactly; missing numbers are empty cells. `part` is the
    index of the recording's trace.
    """
    columns = recording.columns["tau"]
    joints = [j for j, column in enumerate(columns) if column]
    names = [*recording.columns["t"], *(columns[j] for j in joints)]
    scale = np.array([1.0, *recording.torque_per_unit[joints]])
    for start in range(0, max(1, len(recording)), CHUNK):
        values = recording.table.read(names, start, start + CHUNK) * scale + 0.0  # no -0
        t, *torques = np.ascontiguousarray(values.T)
        cells = {"t": t}
        for j, tau in zip(joints, torques, strict=True):
            name = recording.joints[j]
            cells |= {f"tau_{name}": tau, f"sure_{name}": _sure(signs, part, j, t, tau)}
        yield pl.DataFrame(cells).fill_nan(None).write_csv(include_header=start == 0)


def proof_sentence(signs: Signs) -> str:
    """Optimality of the signs in a sentence."""
    proof, nodes = signs.proof, plural(signs.proof.nodes, "node")
    if proof.optimal:
        way = "eigenvalues alone" if proof.certified else f"a search of {nodes}"
        return f"The signs of these segments are optimal, proved by {way}."
    if proof.has_bound:
        bound = f"Other signs of these segments could reduce the residual by at most {share(proof.gap)}"
        return f"{bound}; the search visited {nodes}."
    return f"The signs of these segments are not proved optimal: the search visited {nodes}."


def part_name(signs: Signs, part: int) -> str:
    """The path of a recording, or its number if it has none."""
    return signs.traces[part].path or f"recording {part + 1}"


def _sure(signs: Signs, part: int, joint: int, t: Array, torque: Array) -> Array:
    """Confidence of the segment of each row with its sign, (N,) [1]."""
    if joint not in signs.hidden:
        return np.ones(len(t))
    own = sorted((s.start, s.end, s.sign, s.confidence) for s in signs.of(joint) if s.part == part)
    start, end, sign, sure = np.array([(-np.inf, -np.inf, 0.0, 0.0), *own]).T
    at = np.searchsorted(start, t, side="right") - 1
    return np.where((t <= end[at]) & (torque * sign[at] >= 0), sure[at], 0.0)


def _segment(signs: Signs, segment: SignSegment) -> Document:
    entry = {"joint": signs.joints[segment.joint], **picked(segment, "start end sign confidence")}
    return entry | ({"recording": part_name(signs, segment.part)} if len(signs.traces) > 1 else {})


def _samples(signs: Signs, segments: tuple[SignSegment, ...]) -> tuple[int, int]:
    """Number of samples of the recordings with segments, and number of samples inside some segments."""
    searched = {t.part for t in signs.segments}
    ends = ((signs.traces[t.part].t, t) for t in segments)
    inside = sum(int(np.sum((time >= t.start) & (time <= t.end))) for time, t in ends)
    return sum(len(signs.traces[part].t) for part in searched), inside


def _gains(signs: Signs) -> list[RenderableType]:
    if not signs.gains:
        return []
    table = new_table("joint", "torque constant>", "± (95 %)>", "unit")
    for joint, value, std, unit in signs.gains:
        interval = with_interval(value, std)
        table.add_row(joint, *interval if isfinite(std) else (figure(value), "-"), unit)
    return [heading("Unknown torque constants"), table]
