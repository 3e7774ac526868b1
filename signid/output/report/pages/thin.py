"""A line of many points as one of few, its peaks kept."""

from __future__ import annotations

import numpy as np

from ....types import Array, Indices


def thinned(t: Array, lines: Array, first: Indices, most: int) -> tuple[Array, Array]:
    """At most so many points of several lines over the same time, the extremes of each stretch of every line kept.

    Lines are broken (NaN) where a span begins.

    Args:
        t: (N,) [s].
        lines: (N, k) [any unit].
        first: where a span begins.
        most: points a line.
    """
    breaks = first[1:] if 6 * len(first) <= most else first[:0]
    if len(t) + len(breaks) > most:
        extremes = 2 * lines.shape[1]
        size = -(-extremes * len(t) // max(most - (extremes + 1) * (len(breaks) + 1), extremes))
        spans = np.split(np.arange(len(t)), breaks)
        parts = [part for span in spans for part in np.split(span, np.arange(size, len(span), size))]
        full = np.nan_to_num(lines)
        ends = [part[f(full[part], axis=0)] for part in parts if len(part) for f in (np.argmin, np.argmax)]
        kept = np.unique(np.concatenate(ends))
        breaks, t, lines = np.searchsorted(kept, breaks), t[kept], lines[kept]
    return np.insert(t, breaks, t[breaks]), np.insert(lines, breaks, np.nan, axis=0)
