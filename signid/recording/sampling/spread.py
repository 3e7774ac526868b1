"""A long recording -> a few stretches of it, evenly spread, that are enough."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .stretch import SHORTEST, Sampling, Stretch, restrict

COUNT = 6  # stretches that are taken


def spread(sampling: Sampling, seconds: float) -> Sampling:
    """The recording as it is, or stretches that last so long together: its beginning, its end, and some between.

    Args:
        sampling: of the recording.
        seconds: that are enough.
    """
    total = sum(stretch.count for stretch in sampling.stretches)
    size = max(SHORTEST, round(seconds / sampling.period / COUNT))
    if total <= COUNT * size:
        return sampling
    starts = np.linspace(0, total - size, COUNT).round().astype(int).tolist()
    return restrict(sampling, [part for start in starts for part in _parts(sampling, start, start + size)])


def _parts(sampling: Sampling, low: int, high: int) -> Iterator[Stretch]:
    """Samples low..high of all stretches in a row; ends of stretches that are too short to be used are left out."""
    for stretch in sampling.stretches:
        start, stop = max(0, low), min(stretch.count, high)
        if stop - start >= SHORTEST:
            yield stretch.part(start, stop)
        low, high = low - stretch.count, high - stretch.count
