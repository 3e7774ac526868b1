"""Join the topics of a log in time to one table."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain
from typing import NamedTuple

import numpy as np

from ....errors import RecordingError, shorten
from ....types import Array
from ..base import About, MemoryTable, Topic
from .messages import Gather, Layout, Stamps

NAMES = {
    **{"q": "position", "dq": "velocity", "ddq": "acceleration", "tau": "effort"},
    **{"q_des": "desired position", "dq_des": "desired velocity", "volt": "voltage", "temp": "temperature"},
}
BACK = 0.01  # accepted share of header stamps that decrease or repeat
APART = 0.5e9  # accepted difference between the clocks of header stamps [ns]
SLOWER = 1.1  # maximum period of interpolated topics [periods of the base topic]
GAP, GAP_NS = 3.5, 0.01e9  # a gap exceeds both [periods], [ns] and is not interpolated
WRAP = 5.0  # [rad] larger jumps of position are wraps of the encoder


class _Stream(NamedTuple):
    """Joints with common time stamps."""

    topic: str
    t: Stamps  # (N,) [ns] increasing
    columns: Mapping[str, Array]  # (N,) each, by name: "q_elbow"

    @property
    def period(self) -> float:
        """Median period [ns]."""
        return float(np.median(np.diff(self.t))) if len(self.t) > 1 else np.inf

    @property
    def weight(self) -> tuple[bool, int]:
        """Sort key: streams with torque first, then those with most values."""
        return any(name.startswith("tau_") for name in self.columns), len(self.columns) * len(self.t)


def join(gathered: Sequence[Gather], topics: Sequence[Topic], source: str) -> MemoryTable:
    """Join topics of a log that all have messages.

    The slowest topic with positions or torques defines the rows. Topics of similar or higher rate are interpolated at
    these rows, but not across gaps; slower topics are omitted. Header stamps are used if they are set, increase, and
    come from one clock; otherwise the times of receipt.
    """
    by_header, clock = _clock(gathered)
    notes: list[str] = []
    only_plans = all(gather.plans for gather in gathered)
    streams = [stream for gather in gathered for stream in _streams(gather, by_header, only_plans, notes)]
    base = _base(streams, source)
    columns, t = _joined(base, [stream for stream in streams if stream is not base], notes)
    if only_plans:
        notes.append("the values are those of a commanded trajectory, unless measured values were published as one")
    if not any(name.startswith("tau_") for name in columns):
        servo = any(name.startswith("q_des_") for name in columns)
        consequence = ": it is a recording of servos" if servo else ", so identification is not possible"
        notes.append(f"no torque was recorded (effort is empty){consequence}")
    origin = f"{clock}, counted from {_date(int(t[0]))}"
    about = About(tuple(dict.fromkeys(notes)), topics=tuple(topics), clock=origin)
    return MemoryTable({"t": (t - t[0]) / 1e9, **columns}, {}, source, about)


def _clock(gathered: Sequence[Gather]) -> tuple[bool, str]:
    """Whether header stamps are used, and the description of the clock."""
    offsets = []
    for gather in gathered:
        for layout in gather.layouts.values():
            stamps, received = np.frombuffer(layout.stamps, np.int64), np.frombuffer(layout.received, np.int64)
            if not (stamps[1:] if len(stamps) > 1 else stamps).all():  # the first stamp of a simulation may be zero
                return False, f"time of receipt (header stamps of {gather.topic} are not set)"
            if not gather.plans and np.sum(np.diff(stamps) <= 0) > BACK * len(stamps):
                return False, f"time of receipt (header stamps of {gather.topic} do not increase)"
            offsets += [] if gather.plans else [float(np.median(received - stamps))]
    if offsets and np.ptp(offsets) > APART:
        return False, f"time of receipt (clocks of the header stamps are {np.ptp(offsets) / 1e9:.3g} s apart)"
    return True, "header stamps"


def _streams(gather: Gather, by_header: bool, only_plans: bool, notes: list[str]) -> Iterator[_Stream]:
    """Group joints that occur in the same messages, in any order."""
    if gather.misfits:
        notes.append(f"{gather.topic}: omitted lists with another length than the names: {gather.misfits}")
    places: dict[tuple[int, ...], list[str]] = {}
    for joint in gather.joints:
        places.setdefault(tuple(k for k, names in enumerate(gather.layouts) if joint in names), []).append(joint)
    lacking: dict[str, list[str]] = {}
    for place, joints in places.items():
        parts = [(names, layout) for k, (names, layout) in enumerate(gather.layouts.items()) if k in place]
        t, rows = _in_order(gather, [layout for _, layout in parts], by_header, notes)
        columns = {}
        for kind in dict.fromkeys(chain.from_iterable(layout.signals for _, layout in parts)):
            for joint in joints:
                values = np.concatenate([_values(names, layout, kind, joint) for names, layout in parts])[rows]
                name = f"{kind}_{joint}" if only_plans or not gather.plans else f"q_des_{joint}" if kind == "q" else ""
                if name and (np.isnan(values).all() or (kind != "q" and not np.nan_to_num(values).any())):
                    lacking.setdefault(kind, []).append(joint)
                elif name:
                    columns[name] = values
        yield _Stream(gather.topic, t, columns)
    for kind, joints in lacking.items():
        if kind == "dq_des":
            continue
        notes.append(f"{gather.topic}: {NAMES.get(kind, kind)} of {shorten(joints)} is NaN or zero throughout: omitted")


def _values(names: Sequence[str], layout: Layout, kind: str, joint: str) -> Array:
    if kind not in layout.signals:
        return np.full(len(layout.order), np.nan)
    return np.frombuffer(layout.signals[kind]).reshape(-1, len(names))[:, names.index(joint)]


def _in_order(
    gather: Gather, layouts: Sequence[Layout], by_header: bool, notes: list[str]
) -> tuple[Stamps, np.ndarray]:
    """Increasing times of the readings of several layouts, and the indices of these readings."""
    t = np.concatenate([np.frombuffer(x.stamps if by_header else x.received, np.int64) for x in layouts])
    rows = np.argsort(np.concatenate([np.frombuffer(x.order, np.int64) for x in layouts]))
    t = t[rows]
    if gather.plans:
        later = np.minimum.accumulate(np.append(t[1:], np.iinfo(np.int64).max)[::-1])[::-1]
        if replaced := int(np.sum(t >= later)):
            notes.append(f"{gather.topic}: {replaced} points are replaced by those of a later trajectory")
        return t[t < later], rows[t < later]
    if back := int(np.sum(np.diff(t) < 0)):
        notes.append(f"{gather.topic}: {_messages(back)} out of order: sorted by time")
        order = np.argsort(t, kind="stable")
        t, rows = t[order], rows[order]
    fresh = np.diff(t, prepend=t[0] - 1) > 0
    if repeated := int(np.sum(~fresh)):
        notes.append(f"{gather.topic}: {_messages(repeated)} with the time of the previous one: omitted")
    return t[fresh], rows[fresh]


def _messages(number: int) -> str:
    return f"{number} message{'' if number == 1 else 's'}"


def _base(streams: Sequence[_Stream], source: str) -> _Stream:
    """Slowest of the main streams of topics with positions or torques."""
    mains: dict[str, _Stream] = {}
    for stream in streams:
        if any(name.startswith(("q_", "tau_")) and not name.startswith("q_des_") for name in stream.columns):
            mains[stream.topic] = max(mains.get(stream.topic, stream), stream, key=lambda each: each.weight)
    if not mains:
        raise RecordingError(f"{source}: the topics have no position and no torque; name other topics")
    if len(mains) > 1 and (single := [topic for topic, stream in mains.items() if len(stream.t) < 2]):
        raise RecordingError(f"{source}: topic {single[0]} has a single reading and cannot be joined to another")
    return max(mains.values(), key=lambda each: each.period)


def _joined(base: _Stream, others: Sequence[_Stream], notes: list[str]) -> tuple[dict[str, Array], Stamps]:
    """Columns at the times of one stream, and these times; cut to the time in which all streams were recorded."""
    columns, used = dict(base.columns), []
    for stream in others:
        fresh = {name: values for name, values in stream.columns.items() if name not in columns}
        if both := [name for name in stream.columns if name in columns]:
            notes.append(f"{stream.topic}: {shorten(both)} omitted, an earlier topic has the same")
        if fresh and (len(stream.t) < 2 or stream.period > SLOWER * base.period):
            slow = f"{1e9 / stream.period:.3g} Hz is slower than the {1e9 / base.period:.3g} Hz of {base.topic}"
            notes.append(f"{stream.topic}: {shorten(list(fresh))} omitted: {slow}")
        elif fresh:
            columns |= {name: _onto(base.t, stream, name) for name in fresh}
            used += [] if all(name.startswith(("q_des_", "dq_des_")) for name in fresh) else [stream]
            if stream.topic != base.topic:
                notes.append(f"{stream.topic}: interpolated at the times of {base.topic}, not across gaps")
    first, last = max(x.t[0] for x in (base, *used)), min(x.t[-1] for x in (base, *used))
    inside = slice(*np.searchsorted(base.t, [first, last + 1]))
    if not len(base.t[inside]):
        raise RecordingError(f"topics {base.topic} and {used[0].topic} do not overlap in time; convert them separately")
    if cut := len(base.t) - len(base.t[inside]):
        notes.append(f"{base.topic}: {_messages(cut)} at the ends omitted, where another topic has none")
    return {name: values[inside] for name, values in columns.items()}, base.t[inside]


def _onto(t: Stamps, stream: _Stream, name: str) -> Array:
    """Column (M,) interpolated at other times, NaN in gaps, before and after; t: (M,) [ns]."""
    y, own = stream.columns[name], stream.t
    i = np.clip(np.searchsorted(own, t, side="right") - 1, 0, len(own) - 2)
    step, after = own[i + 1] - own[i], t - own[i]
    share = after / step
    chord = y[i + 1] - y[i]
    value = y[i] + share * chord
    if name.startswith("q_"):
        value = np.where(np.abs(chord) > WRAP, np.where(share < 0.5, y[i], y[i + 1]), value)
    reached = (after >= 0) & (after <= step) & (step <= max(GAP * stream.period, GAP_NS))
    value = np.where(reached, value, np.nan)
    return np.where(after == 0, y[i], np.where(after == step, y[i + 1], value))


def _date(stamp: int) -> str:
    """Stamp [ns] as a date in UTC, or in seconds if it is no date."""
    if 3e17 < stamp < 9e18:
        return datetime.fromtimestamp(stamp / 1e9, UTC).isoformat(timespec="milliseconds").replace("+00:00", "Z")
    return f"{stamp / 1e9:.9g} s"
