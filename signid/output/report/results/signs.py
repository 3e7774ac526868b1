"""Signs that were recovered: their part of identification.json, the terminal, and torque with its signs as a table."""

from __future__ import annotations

from collections.abc import Iterator
from math import floor, isfinite
from typing import Any

import numpy as np
import polars as pl
from rich.console import RenderableType

from ....signs import Signs, SignSegment
from ....types import Array, Recording
from ..layout import heading, new_table, paragraph, plural
from ..numbers import figure, share, with_interval

CHUNK = 65_536  # rows
CERTAIN = 0.999  # from this confidence on a sign is not in doubt


def signs_document(signs: Signs | None) -> dict[str, Any] | None:
    """The signs block of identification.json; None where every torque was recorded with its sign."""
    if signs is None:
        return None
    hidden = list(signs.hidden)
    return {
        "proof": {
            "optimal": bool(signs.proof.optimal),
            "gap": float(signs.proof.gap),
            "nodes": int(signs.proof.nodes),
            "certified": bool(signs.proof.certified),
        },
        "flags": list(signs.flags),
        "segments": [_segment(signs, told) for told in signs.segments],
        "method": signs.method,
        "joints": [signs.joints[j] for j in hidden],
        "threshold": signs.threshold[hidden].tolist(),
        "noise": signs.noise[hidden].tolist(),
        "inflation": signs.inflation[hidden].tolist(),
        "gains": [
            {"joint": gain.joint, "torque_constant": float(gain.value), "std": float(gain.std), "unit": gain.unit}
            for gain in signs.gains
        ],
        "notes": list(signs.notes),
        "seed": int(signs.seed),
    }


def signs_tables(signs: Signs) -> list[RenderableType]:
    """Per joint how many segments there are and how sure their signs, and what is proved of them."""
    table = new_table("joint", "segments>", "+>", "->", "in doubt>", "lowest confidence>", "samples>", "in segments>")
    for j in signs.hidden:
        told = signs.of(j)
        counts = [sum(t.sign == sign for t in told) for sign in (1, -1)]
        doubt = sum(not t.confidence >= CERTAIN for t in told)
        lowest = confidence(min((t.confidence for t in told), default=float("nan")))
        total, inside = _samples(signs, told)
        cells = (len(told), *counts, doubt, lowest, total, share(inside / total) if total else "-")
        table.add_row(signs.joints[j], *map(str, cells))
    return [heading("Signs of torque"), table, paragraph(proof_sentence(signs)), *_gains(signs)]


def signed_csv(recording: Recording, signs: Signs, part: int) -> Iterator[str]:
    """The text of signed.csv, piece by piece: the recording's own rows, t [s], and tau [N.m or N], sure [1] of joints.

    `sure_J` is the confidence of the segment that a row lies in, 0 outside of segments, where the sign follows the
    model or is a guess, and 1 where torque had its sign. Numbers read back as they are; a missing one is an empty cell.

    Args:
        recording: with the signs that were found.
        signs: what is known about them.
        part: which of its traces is the recording's.
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
    """What is known about choices of signs that were not taken."""
    proof, nodes = signs.proof, plural(signs.proof.nodes, "node")
    best = "No other signs of these segments explain the torque better"
    if proof.optimal:
        return f"{best}: proved by {'eigenvalues alone' if proof.certified else f'a search of {nodes}'}."
    if proof.has_bound:
        told = f"Other signs of these segments could lower what is left unexplained by {share(proof.gap)} at most"
        return f"{told}; the search looked at {nodes}."
    return f"Whether other signs of these segments explain the torque better is not proved: {nodes} were looked at."


def confidence(value: float) -> str:
    """A probability, never rounded up.

    >>> confidence(0.99949), confidence(0.99899), confidence(1.0), confidence(float("nan"))
    ('>0.999', '0.998', '>0.999', '-')
    """
    if not isfinite(value):
        return "-"
    return f">{CERTAIN}" if value >= CERTAIN else f"{floor(1000 * value) / 1000:.3f}"


def part_name(signs: Signs, part: int) -> str:
    """The path of a recording, or its number where it has none."""
    return signs.traces[part].path or f"recording {part + 1}"


def _sure(signs: Signs, part: int, joint: int, t: Array, torque: Array) -> Array:
    """(N,) confidence of the segment that each row lies in, if it has its sign [1]."""
    if joint not in signs.hidden:
        return np.ones(len(t))
    own = sorted((told.start, told.end, told.sign, told.confidence) for told in signs.of(joint) if told.part == part)
    start, end, sign, sure = np.array([(-np.inf, -np.inf, 0.0, 0.0), *own]).T
    at = np.searchsorted(start, t, side="right") - 1
    return np.where((t <= end[at]) & (torque * sign[at] >= 0), sure[at], 0.0)


def _segment(signs: Signs, told: SignSegment) -> dict[str, Any]:
    segment = {
        "joint": signs.joints[told.joint],
        "start": float(told.start),
        "end": float(told.end),
        "sign": int(told.sign),
        "confidence": float(told.confidence),
    }
    return segment | ({"recording": part_name(signs, told.part)} if len(signs.traces) > 1 else {})


def _samples(signs: Signs, told: tuple[SignSegment, ...]) -> tuple[int, int]:
    """Samples of the recordings that were searched, and how many of them lie in some segments."""
    searched = {t.part for t in signs.segments}
    ends = ((signs.traces[t.part].t, t) for t in told)
    inside = sum(int(np.sum((time >= t.start) & (time <= t.end))) for time, t in ends)
    return sum(len(signs.traces[part].t) for part in searched), inside


def _gains(signs: Signs) -> list[RenderableType]:
    if not signs.gains:
        return []
    table = new_table("joint", "torque constant>", "± (95 %)>", "unit")
    for joint, value, std, unit in signs.gains:
        told = with_interval(value, std)
        table.add_row(joint, *told if isfinite(std) else (figure(value), "-"), unit)
    return [heading("Torque constants that were not known"), table]
