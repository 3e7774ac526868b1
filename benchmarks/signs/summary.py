"""Statistics over rows: medians, flags and calibration of confidence."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from .row import Row

WRONG = 2.0  # distance of wrong parameters from the truth over that of the signed estimate [1]
EDGES = (0.0, 0.9, 0.99, 0.999, 1.0)  # of the confidence bins [1]
SURE = 0.999  # confidence above which a segment must be right [1]


@dataclass(frozen=True)
class Group:
    """Statistics of runs of one kind."""

    name: str
    runs: int
    perfect: float  # share of runs with all segments right
    optimal: float  # share of runs with proved optimum
    segments: int
    right: float  # share of right segments
    mixed: int
    samples: float  # share of right samples, mean over runs
    ratio: float  # median
    ratio_90: float  # 90th percentile
    seconds: float  # median
    wrong: int  # runs with a wrong segment or wrong parameters
    alarms: int  # wrong runs with a flag
    false_alarms: int  # other runs with a flag


@dataclass(frozen=True)
class Bin:
    """Segments of runs without flags with a confidence in a bin."""

    low: float
    high: float
    segments: int
    right: int
    said: float  # mean confidence; nan without segments


def is_wrong(row: Row) -> bool:
    """Whether a run has a wrong segment or wrong parameters."""
    return not row.perfect or bool(row.ratio > WRONG)


def summarise(rows: Sequence[Row]) -> list[Group]:
    """Statistics of each kind of run, in order of appearance."""
    names = dict.fromkeys(row.group for row in rows)
    return [gather(name, [row for row in rows if row.group == name]) for name in names]


def gather(name: str, rows: Sequence[Row]) -> Group:
    """Statistics of the runs of one kind."""
    wrong = [row for row in rows if is_wrong(row)]
    total = sum(row.segments for row in rows)
    ratios = [row.ratio for row in rows]
    return Group(
        name=name,
        runs=len(rows),
        perfect=float(np.mean([row.perfect for row in rows])),
        optimal=float(np.mean([row.optimal for row in rows])),
        segments=total,
        right=sum(row.right for row in rows) / max(total, 1),
        mixed=sum(row.mixed for row in rows),
        samples=float(np.mean([row.samples for row in rows])),
        ratio=float(np.median(ratios)),
        ratio_90=float(np.quantile(ratios, 0.9)),
        seconds=float(np.median([row.seconds for row in rows])),
        wrong=len(wrong),
        alarms=sum(bool(row.flags) for row in wrong),
        false_alarms=sum(bool(row.flags) for row in rows if not is_wrong(row)),
    )


def reliability(rows: Sequence[Row]) -> Iterator[Bin]:
    """Share of right segments by confidence over all exact runs without flag."""
    scores = [one for row in rows if not row.flags and row.method == "exact" for one in row.judged]
    for low, high in zip(EDGES[:-1], EDGES[1:], strict=True):
        inside = [one for one in scores if low <= one.confidence < high or (high == 1.0 and one.confidence >= 1.0)]
        said = float(np.mean([one.confidence for one in inside])) if inside else float("nan")
        yield Bin(low, high, len(inside), sum(one.right for one in inside), said)
