"""Statistics over all motions of the pendulum, as tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from rich.table import Table

from signid.types import TWO_SIDED

from ..summary import frame
from .signs import Signs
from .trial import Array, Trial

COEFFICIENTS = "m g d", "I + m d2"  # N.m, kg.m2
TARGET = 1.0  # upper bound on the rms error of a coefficient [%]


@dataclass(frozen=True)
class Row:
    """Statistics of one coefficient and one method over all motions."""

    way: str
    signed: bool
    coefficient: str
    true: float
    mean: float
    rms_error: float  # [%]
    interval: float  # median half width of the nominal 95 % interval [%]
    inside: float  # intervals that contain the true value [%]

    @property
    def holds(self) -> bool:
        """Whether the error is within the target."""
        return self.rms_error <= TARGET


def summarise(done: Sequence[Trial], truth: Array) -> Iterator[Row]:
    """Yield a row for each method, with and without signs, and each coefficient."""
    for way, known in dict.fromkeys((trial.way, trial.signed) for trial in done):
        some = [trial for trial in done if (trial.way, trial.signed) == (way, known)]
        value, std = np.array([trial.value for trial in some]), np.array([trial.std for trial in some])
        error = value - truth
        for k, name in enumerate(COEFFICIENTS):
            yield Row(
                way=way,
                signed=known,
                coefficient=name,
                true=float(truth[k]),
                mean=float(value[:, k].mean()),
                rms_error=float(100 * np.sqrt(np.mean(error[:, k] ** 2)) / truth[k]),
                interval=float(100 * TWO_SIDED * np.median(std[:, k]) / truth[k]),
                inside=float(100 * np.mean(np.abs(error[:, k]) < TWO_SIDED * std[:, k])),
            )


def show_rows(rows: Sequence[Row]) -> Table:
    """Table of identified and true coefficients."""
    names = ("filter", "signs", "coefficient", "true", "found", "error", "95 %", "inside")
    table = frame("error and half interval in % of true", names, left=5)
    for row in rows:
        shares = [f"{row.rms_error:.3f}", f"{row.interval:.3f}", f"{row.inside:.0f} %"]
        labels = [row.way, "logged" if row.signed else "found", row.coefficient]
        table.add_row(*labels, f"{row.true:.5g}", f"{row.mean:.5g}", *shares, style="" if row.holds else "red")
    return table


def show_signs(signs: Mapping[str, Sequence[Signs]]) -> Table:
    """Table of correct signs over one or many recordings."""
    names = ("recordings", "segments", "mixed", "right", "samples", "above 10 %", "second rms / rms")
    table = frame("signs from |torque| alone", names)
    for name, some in signs.items():
        counts = [str(sum(getattr(got, key) for got in some)) for key in ("segments", "mixed", "right")]
        shares = [f"{np.mean([getattr(got, key) for got in some]):.2f} %" for key in ("samples", "away")]
        rivals = [got.next_rms / max(got.rms, 1e-6) for got in some if np.isfinite(got.next_rms)]
        rival = f"{min(rivals):.3g}" if rivals else ""
        table.add_row(name, *counts, *shares, rival, style="" if all(got.holds for got in some) else "red")
    return table
