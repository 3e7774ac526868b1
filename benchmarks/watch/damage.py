"""Streams as networks deliver them: rows that are lost, without numbers or held, and stamps that jitter."""

from __future__ import annotations

import numpy as np

from ..plants.control import Array

LOST, MISSING = 0.02, 0.005  # [1] share of rows that are lost, and that lack a number
EVERY, SHORTEST, LONGEST = 1.7, 0.01, 0.2  # [s] between gaps, and their durations
JITTER = 2e-4  # [s] standard deviation of the stamps, at most twice of it


def damaged(columns: dict[str, Array], seed: int) -> dict[str, Array]:
    """Columns with 2 % of the rows lost, gaps up to 0.2 s (every second one holds the last row), NaN and jitter."""
    rng, t = np.random.default_rng(seed), columns["t"]
    keep, from_row = rng.random(len(t)) > LOST, np.arange(len(t))
    for k, begin in enumerate(np.arange(EVERY, t[-1], EVERY)):
        gap = (t > begin) & (t < begin + rng.uniform(SHORTEST, LONGEST))
        if k % 2:
            from_row[gap] = np.flatnonzero(gap)[0]
        else:
            keep &= ~gap
    out = {key: x[from_row][keep].copy() for key, x in columns.items() if key != "t"}
    names = list(out)
    for row in np.flatnonzero(rng.random(int(keep.sum())) < MISSING).tolist():
        out[names[int(rng.integers(len(names)))]][row] = np.nan
    jitter = np.clip(JITTER * rng.standard_normal(len(t)), -2 * JITTER, 2 * JITTER)
    return {"t": (t + jitter)[keep], **out}
