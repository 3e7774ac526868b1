"""Content of a recording: columns that were interpolated or held from a lower rate, and samples at that rate."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import ceil, floor

import numpy as np

from ...errors import shorten
from ...types import Array, Frozen, Samples
from .knots import BLOCK, HELD, Knots, find_knots, same_knots, spline_values

WINDOW = 8192  # [rows] part in which knots are searched
BLOCKS, SHORT, STEPS = 12, 160, 16  # blocks of the recording that must agree; their least length [rows], [steps]
AGREE = 0.8  # smallest share of blocks that agree
SIGNALS = ("q", "tau", "dq", "ddq", "q_des")
BOUND = ("q", "tau")  # signals that bound the rate
POINTS = 6  # neighbours of an interpolated value (Lagrange)
LENGTH, PAD = 256, 12  # [knots] of one fit; beyond its ends
EXACT = 1e-6  # [rows] distance at which instants coincide

Read = Callable[[int, int], Samples]  # kept rows low..high of a stretch


@dataclass(frozen=True, eq=False)
class Content(Frozen):
    """Knots of the columns of a recording; rows count from the first one of its first stretch."""

    knots: Mapping[str, tuple[Knots | None, ...]]  # by signal, one for each joint; None: content up to the rate
    row: float  # [s] between rows
    grid: Knots  # the widest among positions and torques

    @property
    def period(self) -> float:
        """Time between samples [s]."""
        return self.grid.step * self.row


def find_content(read: Read, kept: int) -> Mapping[str, tuple[Knots | None, ...]] | None:
    """Knots by signal of the columns of a stretch of kept rows; None if no position and no torque has any."""
    size = min(WINDOW, kept)
    if size < BLOCK:
        return None
    start = (kept - size) // 2
    piece = read(start, start + size)
    found: dict[str, tuple[Knots | None, ...]] = {}
    for name in SIGNALS:
        x = getattr(piece, name)
        if x is None or (name not in BOUND and not any(any(found[key]) for key in BOUND)):
            continue
        complete = np.isfinite(x).all(axis=0)
        own: list[Knots | None] = [None] * x.shape[1]
        for j, knots in zip(np.flatnonzero(complete).tolist(), find_knots(x[:, complete]), strict=True):
            own[j] = None if knots is None else _confirmed(knots.moved(start), name, j, read, kept)
        found[name] = _shared(own)
    return found if any(any(found[key]) for key in BOUND) else None


def _confirmed(knots: Knots, name: str, joint: int, read: Read, kept: int) -> Knots | None:
    """Knots that hold in most blocks of a column of a stretch, with step and phase from all of them; None otherwise."""
    length = ceil(max(SHORT, STEPS * knots.step))
    starts = np.unique(np.linspace(0, kept - length, min(BLOCKS, kept // length)).astype(int)).tolist()
    starts.sort(key=lambda k: abs(k - (kept - length) // 2))  # from the middle outwards
    return same_knots(knots, [(k, getattr(read(k, k + length), name)[:, joint]) for k in starts], AGREE)


def _shared(columns: Sequence[Knots | None]) -> tuple[Knots | None, ...]:
    """Knots of columns of one signal; nearly equal ones become those of the first."""
    found: list[Knots | None] = []
    for knots in columns:
        alike = (other for other in found if other and knots and other.near(knots))
        found.append(next(alike, knots))
    return tuple(found)


def widest(knots: Mapping[str, tuple[Knots | None, ...]]) -> Knots:
    """The widest knots among positions and torques."""
    return max((each for key in BOUND for each in knots.get(key, ()) if each), key=lambda each: each.step)


def content_notes(columns: Mapping[str, Sequence[str]], content: Content) -> Iterator[str]:
    """A sentence for each kind of interpolation and rate."""
    groups: dict[tuple[str, str], list[str]] = {}
    for name, plural in (("q", "positions"), ("tau", "torques")):
        own = [(column, knots) for column, knots in zip(columns[name], content.knots[name], strict=True) if column]
        ways = [
            (column, ("held" if knots.kind == HELD else "interpolated", f"{1 / (knots.step * content.row):.4g}"))
            for column, knots in own
            if knots is not None
        ]
        if len(ways) == len(own) > 1 and len({way for _, way in ways}) == 1:
            ways = [(plural, ways[0][1])]
        for column, way in ways:
            groups.setdefault(way, []).append(column)
    rates = f"rows come at {1 / content.row:.4g} Hz, samples are used at {1 / content.period:.4g} Hz"
    for (how, rate), names in groups.items():
        single = len(names) == 1 and names[0] not in ("positions", "torques")
        listed = " and ".join(names) if len(names) < 3 else shorten(names)
        yield f"{listed} {'is' if single else 'are'} {how} from about {rate} Hz: {rates}"


def first_sample(content: Content, row: float, kept: int) -> tuple[float, int]:
    """First sample [rows of the stretch], and number of samples of a stretch of kept rows that begins at `row`."""
    ends = 0.0
    for columns in content.knots.values():
        for knots in columns:
            if knots is not None and not (knots.on_rows or knots.kind == HELD):
                ends = max(ends, 3 * knots.step + 6)
    grid, first = content.grid, ends - EXACT
    offset = (grid.phase - row) % grid.step
    offset = 0.0 if grid.step - offset < EXACT else offset
    offset += max(0, ceil((first - offset) / grid.step)) * grid.step
    return offset, max(0, floor((kept - 1 - ends - offset + EXACT) / grid.step) + 1)


def content_samples(content: Content, read: Read, row: float, kept: int, u: Array) -> dict[str, Array | None]:
    """Signals (M, n) at the instants u (M,) [rows of a stretch of kept rows that begins at `row`]."""
    low, high = max(0, floor(u[0]) - POINTS), min(kept, ceil(u[-1]) + POINTS + 1)
    rows = {(low, high): read(low, high)}

    def column(name: str, j: int) -> Callable[[int, int], Array]:
        def part(begin: int, end: int) -> Array:
            key = (max(0, begin), min(kept, end))
            if key not in rows:
                rows[key] = read(*key)
            return np.asarray(getattr(rows[key], name)[:, j])

        return part

    result: dict[str, Array | None] = {}
    for name in SIGNALS:
        values = getattr(rows[low, high], name)
        own = () if values is None else content.knots.get(name, (None,) * values.shape[1])
        columns = [
            _at_rows(values[:, j], low, u) if knots is None else _at_knots(knots.moved(-row), column(name, j), kept, u)
            for j, knots in enumerate(own)
        ]
        result[name] = np.column_stack(columns) if columns else None
    return result


def _at_rows(y: Array, low: int, u: Array) -> Array:
    """Values (M,) of a signal y (N,), the first of which is row `low`, at the instants u (M,) [rows]."""
    near = np.rint(u)
    if np.abs(u - near).max(initial=0.0) < EXACT:
        return np.asarray(y[near.astype(int) - low])
    return _lagrange(y, u - low)


def _lagrange(y: Array, u: Array) -> Array:
    """Values (M,) between equidistant ones y (N,) at the places u (M,)."""
    points = min(POINTS, len(y))
    first = np.clip(np.floor(u).astype(int) - points // 2 + 1, 0, len(y) - points)
    offset = u - first
    total = np.zeros(len(u))
    for i in range(points):
        others = [k for k in range(points) if k != i]
        weight = np.prod([(offset - k) / (i - k) for k in others], axis=0)
        total += weight * y[first + i]
    return total


def _at_knots(knots: Knots, read: Callable[[int, int], Array], kept: int, u: Array) -> Array:
    """Values (M,) at the instants u (M,) [rows] from the values of a column at its knots."""
    place = (u - knots.phase) / knots.step
    near = np.rint(place)
    if np.abs(place - near).max(initial=0.0) * knots.step < 10 * EXACT:
        values = _knot_values(knots, read, kept, int(near[0]), int(near[-1]))
        return np.asarray(values[(near - near[0]).astype(int)])
    most = floor((kept - 1 - knots.phase) / knots.step)
    low, high = max(0, floor(place[0]) - POINTS), min(most, ceil(place[-1]) + POINTS)
    return _lagrange(_knot_values(knots, read, kept, low, high), np.asarray(place - low))


def _knot_values(knots: Knots, read: Callable[[int, int], Array], kept: int, low: int, high: int) -> Array:
    """Values at the knots low..high of a column."""
    at = knots.phase + knots.step * np.arange(low, high + 1)
    if knots.kind == HELD or knots.on_rows:
        inside = floor((knots.step - 1) / 2) if knots.kind == HELD else 0  # ticks may come a row too late
        rows = np.clip(np.ceil(at - EXACT).astype(int) + inside, 0, kept - 1)
        return np.asarray(read(int(rows[0]), int(rows[-1]) + 1)[rows - rows[0]])
    return np.concatenate(list(_fitted(knots, read, kept, low, high)))


def _fitted(knots: Knots, read: Callable[[int, int], Array], kept: int, low: int, high: int) -> Iterator[Array]:
    """Values at the knots low..high from least-squares splines on fixed blocks of knots."""
    for block in range(low // LENGTH, high // LENGTH + 1):
        first, last = max(low, block * LENGTH), min(high, (block + 1) * LENGTH - 1)
        begin = max(0, floor(knots.phase + knots.step * (block * LENGTH - PAD)))
        end = min(kept, ceil(knots.phase + knots.step * ((block + 1) * LENGTH + PAD)))
        y = read(begin, end)
        u = np.arange(begin, begin + len(y), dtype=float)
        yield spline_values(u, y, knots, np.asarray(knots.phase + knots.step * np.arange(first, last + 1)))
