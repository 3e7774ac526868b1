"""Bring columns with their own times to the times of another stream."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..errors import RecordingError, shorten
from ..types import Array

Stamps = NDArray[np.int64]  # [ns]
SLOWER = 1.1  # maximum period of interpolated topics [periods of the base topic]
GAP, GAP_NS = 3.5, 0.01e9  # a gap exceeds both [periods], [ns] and is not interpolated
WRAP = 5.0  # [rad] larger jumps of position are wraps of the encoder


class TimedColumns(NamedTuple):
    """Columns with common time stamps.

    columns: (N,) each, by name [any unit].
    """

    topic: str  # or file
    t: Stamps  # (N,) [ns] increasing
    columns: Mapping[str, Array]  # (N,) each, by name: "q_elbow"
    wraps: Mapping[str, float]  # by name of a position: a larger jump is a wrap of the encoder
    row: str = "message"

    @property
    def period(self) -> float:
        """Median period [ns]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @property
    def weight(self) -> tuple[bool, int]:
        """Sort key: streams with torque first, then those with most values."""
        return any(name.startswith("tau_") for name in self.columns), len(self.columns) * len(self.t)


def at_times(
    base: TimedColumns, others: Sequence[TimedColumns], notes: list[str], *, slower: bool
) -> tuple[dict[str, Array], slice]:
    """Columns of all streams at the times of one, and the rows of it in which all streams were recorded.

    Columns are interpolated, but not across gaps. Streams that are slower than the base are omitted unless `slower`.

    Raises:
        RecordingError: the streams do not overlap in time.
    """
    columns, used = dict(base.columns), []
    for stream in others:
        fresh = {name: values for name, values in stream.columns.items() if name not in columns}
        if both := [name for name in stream.columns if name in columns]:
            notes.append(f"{stream.topic}: {shorten(both)} omitted, an earlier topic has the same")
        slow = f"{1e9 / stream.period:.3g} Hz is slower than the {1e9 / base.period:.3g} Hz of {base.topic}"
        late = stream.period > SLOWER * base.period
        if fresh and (len(stream.t) < 2 or (late and not slower)):
            notes.append(f"{stream.topic}: {shorten(list(fresh))} omitted: {slow}")
        elif fresh:
            columns |= {name: _onto(base.t, stream, name) for name in fresh}
            used += [] if all(name.startswith(("q_des_", "dq_des_")) for name in fresh) else [stream]
            if stream.topic != base.topic:
                caveat = f"; {slow}" if late else ""
                notes.append(f"{stream.topic}: interpolated at the times of {base.topic}, not across gaps{caveat}")
    first, last = max(x.t[0] for x in (base, *used)), min(x.t[-1] for x in (base, *used))
    inside = slice(*np.searchsorted(base.t, [first, last + 1]))
    if not len(base.t[inside]):
        raise RecordingError(f"topics {base.topic} and {used[0].topic} do not overlap in time; convert them separately")
    if cut := len(base.t) - len(base.t[inside]):
        other = "topic" if base.row == "message" else "file"
        notes.append(f"{base.topic}: {plural(cut, base.row)} at the ends omitted, where another {other} has none")
    return {name: values[inside] for name, values in columns.items()}, inside


def plural(number: int, thing: str) -> str:
    """A number of things: "1 message", "2 messages"."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _onto(t: Stamps, stream: TimedColumns, name: str) -> Array:
    """Column (M,) interpolated at other times, NaN in gaps, before and after; t: (M,) [ns]."""
    y, own = stream.columns[name], stream.t
    i = np.clip(np.searchsorted(own, t, side="right") - 1, 0, len(own) - 2)
    step, after = own[i + 1] - own[i], t - own[i]
    share = after / step
    chord = y[i + 1] - y[i]
    wrapped = np.abs(chord) > stream.wraps.get(name, np.inf)
    value = np.where(wrapped, np.where(share < 0.5, y[i], y[i + 1]), y[i] + share * chord)
    reached = (after >= 0) & (after <= step) & (step <= max(GAP * stream.period, GAP_NS))
    value = np.where(reached, value, np.nan)
    return np.where(after == 0, y[i], np.where(after == step, y[i + 1], value))
