"""Knots of interpolated and held signals: the instants at which the signals of a file have content of their own."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import ceil, floor
from typing import NamedTuple

import numpy as np

from ...types import Array

HELD, LINEAR, CUBIC, SMOOTH = "held", "linear", "cubic", "smooth"
SPACES = {LINEAR: (1, 1), CUBIC: (3, 1), SMOOTH: (3, 2)}  # degree of the spline, multiplicity of its knots
ORDERS = (1, 2, 4)  # differences that show knots of held signals, of lines, of smooth interpolation
SLOWEST, DENSEST = 64.0, 1.05  # [rows] largest and smallest distance between knots
FULL = 0.82  # [1/rows] most free numbers of a spline with multiple knots, which fits everything beyond
LOCAL = 65  # [rows] window of the local rms that scales differences
OUTLIER = 4.0  # [1] largest scaled difference
LINES, LINE = 3, 100.0  # strongest lines; [1] their power over the background (real logs: 133 at most, off low rates)
# Parts of a window; periods of a line in one that show it; [1] most gain of a line over the background by the longer
# window: 8 to 21 for knots, 90 and more for lines of a motion that is repeated, which are none in a part.
PARTS, PERIODS, REPEATED = 8, 8, 60.0
WIDTH, FAINT = 8, 1e-3  # half width of a line [1/4 of the resolution]; least power at a rate over that of its multiples
LOWEST = 0.01  # [1/rows] lowest frequency of a line
HARMONICS = 8  # of the main frequency of a signal, lines at which are those of a periodic motion
MOTION_FREQUENCY, MOTION_RATIO = 0.1, 10.0  # [1/rows] below which lines are motion, unless they are stronger [1]
SIMPLE_BLOCKS, OTHER_BLOCKS = 3, 5  # blocks in motion that must agree, for simple ratios of rates and for others
INTERPOLATED_RANGE, HELD_RANGE = 0.3, 1.01  # [rows] range of phases of interpolated and of held signals in all blocks
BLOCK = 480  # [rows] on which knots are tested
LIMITED = 2.5  # [rows] half a step beyond which fits may be limited by the motion itself
ROW_OFFSET = 0.02  # [rows] distance at which a knot lies on a row
MARGIN = 3  # [rows] between the ends of a fit and its first and last knot
FIRST, PHASES = 3, 8  # phases of knots that are tried first, and where these differ
FIT = 0.35  # [1] rms beside a spline with these knots, over that with the worst phase; white noise: above 0.8
LIKELY, HOPEFUL = 0.9, 0.8  # [1] shares from which more phases are tried, and from which one is refined
PRECISE, ROUGH, FIT_EXCESS = 0.0035, 0.2, 1.7  # [1] remaining shares of a phase's interval; misfit over FIT
GOLDEN = (5**0.5 - 1) / 2
MIN_KNOT_QUANTA = 0.5  # [quanta] least rms of displaced knots: counts at a steady speed are periodic (0.29)
NOTHING = 0.03  # [1] share below which a spline leaves nothing but the error of its phase
RMS_RATIO = 3.0  # [1] ratio of rms within which the fewer knots are preferred
NORMAL = 1e-6  # [1] rms over the size of a signal from which on normal equations are exact enough
ROUNDING = 1e-13  # [1] rounding errors of a fit, over the size of the signal
OFF_TICK, ON_TICK = 0.01, 0.3  # [1] share of the changes between the ticks of a held signal; share of ticks with one
STEP_DRIFT = 0.1  # [steps] drift over a block within which two steps are the same knots
SNAP, RATIO = 2e-3, 8  # [1] tolerance, and largest denominator of a simple ratio of rates that is tried


@dataclass(frozen=True)
class Knots:
    """Evenly spaced knots of a signal, in rows."""

    kind: str  # HELD, LINEAR, CUBIC (twice differentiable) or SMOOTH (once differentiable)
    step: float  # [rows] between knots
    phase: float  # [rows] of a knot, below the step

    @property
    def on_rows(self) -> bool:
        """Whether every knot lies on a row."""
        return self.step == round(self.step) and self.phase == round(self.phase)

    def moved(self, rows: float) -> Knots:
        """The same knots where row 0 becomes row `rows`."""
        return Knots(self.kind, self.step, (self.phase + rows) % self.step)

    def near(self, other: Knots) -> bool:
        """Whether two estimates are of the same knots."""
        distance = abs(self.phase - other.phase) % self.step
        apart = min(distance, self.step - distance)
        return self.kind == other.kind and abs(self.step - other.step) < 1e-4 * self.step and apart < 0.1


class _Trial(NamedTuple):
    """A kind of knots tried on c signals."""

    knots: Knots
    rest: Array  # (c,) rms that the splines leave
    share: Array  # (c,) [1] the same over that with the worst phase


def find_knots(x: Array) -> list[Knots | None]:
    """Knots of each signal in consecutive rows x (N, c) of one kind [any]; None: it has content up to the rate.

    Differences of interpolated signals vary periodically: those of order 1 of held ones, of order 2 of lines, of order
    4 of smoother ones. Lines in the spectrum of their size propose steps. A least-squares spline with these knots must
    then leave far less than one with displaced knots; for any other signal the phase makes no difference.

    Source: Gallagher, Detection of linear and cubic interpolation in JPEG compressed images, CRV 2005 (periodic
    variance of differences); de Boor, A Practical Guide to Splines, 1978, chapter XIV (least-squares splines).
    """
    columns: list[Knots | None] = [None] * x.shape[1]
    moving = np.flatnonzero(np.ptp(x, axis=0) > 0).tolist()
    if len(x) < BLOCK or not moving:
        return columns
    held = list(_steps(_lines(x[:, moving], 1)))
    for j in moving:
        columns[j] = _held(x[:, j], held)
    left = [j for j in moving if columns[j] is None]
    steps = list(_steps([line for order in ORDERS[1:] for line in _lines(x[:, left], order)])) if left else []
    if steps:
        for j, knots in zip(left, _splines(x[:, left], steps), strict=True):
            columns[j] = None if knots and _is_harmonic(x[:, j], knots) else knots
    return columns


def _is_harmonic(x: Array, knots: Knots) -> bool:
    """Whether a harmonic of the main frequency of a signal (N,) explains the rate of knots, as of a single sine."""
    n, rate = len(x), 1 / knots.step
    power = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(n), 4 * n)) ** 2
    main, line = int(np.argmax(power)) / (4 * n), min(rate, 1 - rate)
    order = round(line / main) if main > 0 else 0
    return 1 <= order <= HARMONICS and abs(line - order * main) < order / (2 * n)


class _Line(NamedTuple):
    """A line in a spectrum."""

    frequency: float  # [1/rows]
    power: Array  # (K,) [1] of the spectrum at 0 to 0.5 [1/rows]

    def beside(self, step: float) -> bool:
        """Whether the rate of knots a step [rows] apart, of which the line is a multiple, has power as well."""
        width, bins = WIDTH, 2 * (len(self.power) - 1)
        place = round(abs(1 / step - round(1 / step)) * bins)
        near = self.power[max(0, place - width) : place + width + 1].max(initial=0.0)
        return bool(near > FAINT * self.power[round(self.frequency * bins)])


def _lines(x: Array, order: int) -> list[_Line]:
    """Lines in the spectrum of the activity of signals (N, c) that are there in all parts, the strongest first."""
    if order == 1:
        y = np.asarray((np.diff(x, axis=0) != 0).mean(axis=1))
    else:  # differences over their local rms, summed over the signals [1]
        size = np.abs(np.diff(x, order, axis=0))
        total = np.cumsum(np.vstack([np.zeros(x.shape[1]), size**2]), axis=0)
        low = np.maximum(np.arange(len(size)) - LOCAL // 2, 0)
        high = np.minimum(low + LOCAL, len(size))
        local = np.sqrt(np.maximum(total[high] - total[low], 0.0) / (high - low)[:, None])
        y = np.asarray(np.minimum(size / np.where(local > 0, local, np.inf), OUTLIER).sum(axis=1))
    n = len(y)
    if np.ptp(y) == 0:
        return []
    power, background = _spectrum(y, n)
    whole = power.copy()
    power[: int(LOWEST * 4 * n)] = 0.0
    power[: int(MOTION_FREQUENCY * 4 * n)] /= MOTION_RATIO
    lines: list[_Line] = []
    for _ in range(LINES):
        k = int(np.argmax(power))
        if not power[k] > LINE * background:
            break
        offset = 0.0
        if k < len(power) - 1:
            left, middle, right = np.log(np.maximum(whole[k - 1 : k + 2], 1e-300))
            bend = left - 2 * middle + right
            offset = float(np.clip(0.5 * (left - right) / bend, -1, 1)) if bend < 0 else 0.0
        lines.append(_Line((k + offset) / (4 * n), whole))
        power[max(0, k - 12) : k + 13] = 0.0
    parts, level = _spectrum(y, n // PARTS) if lines else (whole, background)

    def is_lasting(line: _Line) -> bool:
        k, here = (round(4 * size * line.frequency) for size in (n, n // PARTS))
        least = min(LINE * background, whole[k] / REPEATED) * level
        return bool(k < 4 * PARTS * PERIODS or parts[max(0, here - 1) : here + 2].max() * background >= least)

    return list(filter(is_lasting, lines))


def _spectrum(y: Array, length: int) -> tuple[Array, float]:
    """Power of a signal (N,) in windows of a length that overlap by half, at 4 `length` frequencies; its background."""
    pieces = (y[k : k + length] for k in range(0, len(y) - length + 1, max(1, length // 2)))
    window = np.hanning(length)
    powers = (np.abs(np.fft.rfft((piece - piece.mean()) * window, 4 * length)) ** 2 for piece in pieces)
    power = np.asarray(sum(powers))
    return power, float(np.median(power)) / np.log(2)


def _steps(lines: Sequence[_Line]) -> Iterator[float]:
    """Steps [rows] between knots that explain a line, the widest first; simple ratios before those near them."""
    steps = {
        part / base
        for line in lines
        for base in (line.frequency, 1 - line.frequency)
        for part in (1, 2, 3)
        if part == 1 or line.beside(part / base)
    }
    inside = sorted((step for step in steps if DENSEST <= step <= SLOWEST), reverse=True)
    tried: list[float] = []
    for step in inside:
        ratio = float(Fraction(step).limit_denominator(RATIO))
        for candidate in [ratio, step] if abs(ratio - step) < SNAP * step else [step]:
            if all(abs(candidate - other) > 1e-6 * candidate for other in tried):
                tried.append(candidate)
                yield candidate


def _held(x: Array, steps: Sequence[float]) -> Knots | None:
    """Knots of a held signal (N,): changes lie in the rows at or after ticks."""
    jumps = np.diff(x)
    changes = np.flatnonzero(jumps) + 1.0
    size = np.abs(jumps[jumps != 0])
    if len(changes) < BLOCK / SLOWEST or np.median(size) <= 1.001 * size.min():
        return None  # at rest, or counts of a coarse encoder at a slow speed
    for step in steps:
        middle = float(np.angle(np.exp(2j * np.pi * changes / step).sum())) / (2 * np.pi) * step
        tick = np.round((changes - middle) / step)
        late = changes - tick * step
        near = np.abs(late - np.median(late)) < (0.5 if step < 4 else 1.0) + 1e-6
        if np.mean(~near) > OFF_TICK or len(np.unique(tick)) < (1 - OFF_TICK) * len(tick):
            continue
        if near.sum() >= ON_TICK * len(x) / step:
            return Knots(HELD, step, float(late[near].min() % step))
    return None


def _splines(x: Array, steps: Sequence[float]) -> list[Knots | None]:
    """Knots of piecewise polynomials (N, c): those of the splines that leave nothing, with the fewest free numbers."""
    starts = np.arange(0, len(x) - BLOCK + 1, BLOCK // 2)
    change = np.array([np.abs(np.diff(x[k : k + BLOCK], axis=0)).sum(axis=0) for k in starts])
    first = int(starts[np.argmax((change / np.maximum(change.max(axis=0), 1e-300)).sum(axis=1))])  # the busiest
    y = x[first : first + BLOCK] - x[first]
    trials: list[_Trial] = []
    for kind, (_, multiple) in SPACES.items():
        for step in steps:
            if multiple == 1 or 2 / step < FULL:
                failed = trials and trials[-1].knots.kind == kind and trials[-1].share.min() > FIT_EXCESS * FIT
                if not (failed and BLOCK * abs(step - trials[-1].knots.step) < STEP_DRIFT * step**2):
                    trials.append(_trial(y, kind, step, first))
    columns: list[Knots | None] = []
    dense = {trial.knots: SPACES[trial.knots.kind][1] / trial.knots.step for trial in trials}  # free numbers [1/rows]
    for j, size in enumerate(np.ptp(y, axis=0)):
        coarse = MIN_KNOT_QUANTA * _quantum(y[:, j])
        good = [trial for trial in trials if trial.share[j] < FIT and trial.rest[j] > coarse * trial.share[j]]
        least = RMS_RATIO * min((trial.rest[j] for trial in good), default=0.0) + ROUNDING * size
        fit = [trial for trial in good if trial.rest[j] <= least or trial.share[j] < NOTHING]
        columns.append(min(fit, key=lambda trial: (dense[trial.knots], trial.rest[j])).knots if fit else None)
    return columns


def _quantum(x: Array) -> float:
    """Quantum of a signal (N,); 0 if it has none."""
    bends = np.abs(np.diff(x, 2))
    bends = bends[bends > 1e-12 * float(np.ptp(x))]
    if not len(bends):
        return 0.0
    counts = bends / bends.min()
    return float(bends.min()) if np.abs(counts - np.rint(counts)).max() < 0.01 else 0.0


def _trial(y: Array, kind: str, step: float, first: int) -> _Trial:
    """A kind of splines at the best phase of their knots, on BLOCK rows (N, c) from the row `first`."""
    rest: dict[float, Array] = {}
    worst = np.full(y.shape[1], 1e-300)

    def share(phase: float) -> float:
        if phase not in rest:
            rest[phase] = _rest(y, kind, step, phase)
        return float(np.min(rest[phase] / worst))

    whole = np.arange(step) if step == round(step) else np.zeros(0)
    for phases in (step * np.arange(FIRST) / FIRST, np.unique([*(step * np.arange(PHASES) / PHASES), *whole])):
        rest |= {phase: _rest(y, kind, step, phase) for phase in phases.tolist() if phase not in rest}
        known = [rms for rms in rest.values() if np.isfinite(rms).all()]
        worst = np.maximum(np.max(known, axis=0, initial=0.0), 1e-300)
        best = min(rest, key=share)
        if share(best) >= (LIKELY if len(rest) == FIRST else HOPEFUL):
            break
    else:
        best = _least(share, best - step / PHASES, best + step / PHASES, best, FIT_EXCESS * FIT)
    return _Trial(Knots(kind, step, float((best + first) % step)), rest[best], rest[best] / worst)


def _least(value: Callable[[float], float], low: float, high: float, best: float, most: float) -> float:
    """Place of the least value found between low and high, from which it rises on both sides, or `best`.

    Golden sections (Kiefer, Proceedings of the AMS 4, 1953); they end early where the value stays above `most`.
    """
    end, rough = PRECISE * (high - low), ROUGH * (high - low)
    left, right = high - GOLDEN * (high - low), low + GOLDEN * (high - low)
    at = {place: value(place) for place in (left, right, best)}
    while high - low > end and (high - low > rough or min(at.values()) < most):
        if at[left] < at[right]:
            high, right = right, left
            left = high - GOLDEN * (high - low)
            at[left] = value(left)
        else:
            low, left = left, right
            right = low + GOLDEN * (high - low)
            at[right] = value(right)
    return min(at, key=lambda place: at[place])


def same_knots(knots: Knots, blocks: Sequence[tuple[int, Array]], agree: float) -> Knots | None:
    """Knots that fit all blocks of a signal, those next to the estimate first.

    Args:
        knots: the estimate.
        blocks: first row, and signal (N,) [any] of each block.
        agree: smallest share of the blocks in motion that fit; None if fewer do.
    """
    step, phase, moving = knots.step, knots.phase, 0
    places: list[tuple[float, float]] = []  # number of a knot, and its distance from the estimate [rows]
    for first, y in blocks:
        here = Knots(knots.kind, step, phase).moved(-first)
        fit = _held_shift(y, here) if knots.kind == HELD else _spline_shift(y, here)
        if fit is None:
            continue
        moving += 1
        if not np.isnan(fit):
            number = np.round((first + len(y) / 2 - knots.phase) / knots.step)
            places.append((float(number), phase + step * float(number) + fit))
            if len(places) > 1 and not _is_simple(knots.step):
                x, z = np.transpose(places)
                slope, intercept = np.polyfit(x - x[0], z, 1)
                step, phase = float(slope), float(intercept - slope * x[0])
        elif moving - len(places) > (1 - agree) * len(blocks):
            return None
    simple = _is_simple(knots.step)
    if moving < (SIMPLE_BLOCKS if simple else OTHER_BLOCKS) or len(places) < agree * moving:
        return None
    numbers, at = np.transpose(places)
    late = at - (knots.step * numbers if simple else step * numbers + phase)
    if np.ptp(late) > (HELD_RANGE if knots.kind == HELD else INTERPOLATED_RANGE):
        return None
    if not simple:
        return Knots(knots.kind, step, phase % step)
    phase = float(late.min() if knots.kind == HELD else np.median(late))
    parts = Fraction(knots.step).limit_denominator(RATIO).denominator
    if abs(phase - round(phase * parts) / parts) < ROW_OFFSET:  # where the first rows coincide, some knots lie on rows
        phase = round(phase * parts) / parts
    return Knots(knots.kind, knots.step, phase % knots.step)


def _is_simple(step: float) -> bool:
    return step == float(Fraction(step).limit_denominator(RATIO))


def _held_shift(y: Array, knots: Knots) -> float | None:
    """Distance of the ticks of a held signal (N,) from knots [rows]; NaN if it does not fit; None at rest."""
    changes = np.flatnonzero(np.diff(y)) + 1.0
    if len(changes) < len(y) / SLOWEST:
        return None
    late = changes - knots.phase
    late -= np.round((late - 0.5) / knots.step) * knots.step
    near = np.abs(late - np.median(late)) < (0.5 if knots.step < 4 else 1.0) + 1e-3
    return float(late[near].min()) if np.mean(near) > 1 - 3 * OFF_TICK else np.nan


def _spline_shift(y: Array, knots: Knots) -> float | None:
    """Distance of the knots of a piecewise polynomial (N,) from knots [rows]; NaN if none fits; None at rest."""
    y = (y - y[0])[:, None]
    kind, step = knots.kind, knots.step
    wrong = float(_rest(y, kind, step, (knots.phase + step / 2) % step)[0])
    if wrong <= ROUNDING * float(np.ptp(y)) or not np.diff(y[:, 0]).any():
        return None

    def rest(distance: float) -> float:
        return float(_rest(y, kind, step, (knots.phase + distance) % step)[0])

    best = 0.0 if rest(0.0) <= NOTHING / 3 * wrong else _least(rest, -step / 6, step / 6, 0.0, FIT_EXCESS * FIT * wrong)
    least = rest(best)
    if least > FIT * wrong:
        return np.nan
    half = float(_rest(y, kind, step / 2, (knots.phase + best) % (step / 2))[0]) if step / 2 > LIMITED else least
    return best if least <= RMS_RATIO * half + max(ROUNDING * float(np.ptp(y)), NOTHING * wrong) else np.nan


def _rest(y: Array, kind: str, step: float, phase: float) -> Array:
    """Rms (c,), without the ends, that splines with knots phase + k step [rows] leave of signals (N, c)."""
    u, knots = np.arange(len(y), dtype=float), Knots(kind, step, phase)
    inside = slice(edge := ceil(2 * step) + MARGIN, len(y) - edge)
    for normal in (True, False) if len(y) >= BLOCK else (False,):  # faster, as exact where none is nearly a spline
        try:
            error = (y - spline_values(u, y, knots, u, normal))[inside]
        except np.linalg.LinAlgError:  # of a knot without a row
            continue
        rest = np.sqrt(np.mean(error**2, axis=0))
        if normal and (rest > NORMAL * np.abs(y).max(axis=0)).all():
            break
    return np.asarray(np.nan_to_num(rest, nan=np.inf))


def spline_values(u: Array, y: Array, knots: Knots, at: Array, normal: bool = False) -> Array:
    """Values of the least-squares spline of a signal.

    Within two steps and `MARGIN` rows of the ends it may differ from the signal.

    Args:
        u: (N,) [rows] of the signal.
        y: (N,) or (N, c) [any] signal.
        knots: of the spline.
        at: (M,) [rows] of the values.
        normal: solve normal equations, which lose half of the digits.
    """
    from scipy.interpolate import make_lsq_spline  # slow import

    degree, multiple = SPACES[knots.kind]
    low, high = u[0] + MARGIN, u[-1] - MARGIN
    count = np.arange(ceil((low - knots.phase) / knots.step), floor((high - knots.phase) / knots.step) + 1)
    edges = [np.full(degree + 1, u[k]) for k in (0, -1)]
    places = np.concatenate([edges[0], np.repeat(knots.phase + knots.step * count, multiple), edges[1]])
    return np.asarray(
        make_lsq_spline(u, y, places, degree, method="norm-eq" if normal else "qr", check_finite=False)(at)
    )
