"""Signs of samples: a Markov chain on the thinned grid, jumps and expected signs at full rate, a sign for each row."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..recording.sampling import Sampling
from ..recording.sampling.grid import Stretch, row_times
from ..regression.rows import Task
from ..regression.session import Part
from ..types import Array, Frozen, Indices, Mask, Recording
from .observations import JUMP_TORQUE, Observations, motion_windows, place_sign_change, place_sign_changes, predict
from .problem import orthonormalise, signed_rows
from .result import Trace

RESIDUAL_INFLATION = 10.0  # [samples per independent sample] kappa of the residual; logs: with 1, signs of small
# torques follow the model, and parameter errors are 3 to 7 times larger
MAX_EM_ROUNDS = 12  # [rounds] of EM, at most; logs: 5 to 12 suffice
SAME_SIGN_ODDS = 2.0  # [log-odds] that neighbours have the same sign, whatever their torques; logs
STEP_WINDOW_SAMPLES = 31  # [samples] over which the steps of |torque| are averaged; logs
MIN_STEP_RATIO = 0.25  # [median squared step of |torque|] smallest average; logs
MAX_SIGN_ODDS = 200.0  # [log-odds] of the sign of a sample, at most; no overflow of exp
MAX_TIE_ODDS = 60.0  # [log-odds] of equal signs of neighbours, at most; logs
MIN_RESIDUAL = 1e-9  # [rms torque] smallest residual and smallest step; rounding
EM_TOLERANCE = 1e-10  # [1] relative change of z at which EM ends; heuristic
EXPECTATION_ROWS = 65_536  # [rows] read at a time; bounds memory
FULL_RATE_INFLATION = 4.0  # [rows per independent row] kappa of the residual at full rate; heuristic
MIN_CONTRADICTION = 0.96  # [1] |expectation| of the opposite sign from which the sign found before stays; heuristic
Weights = NDArray[np.float32]
CHUNK_ROWS = 65_536  # [rows] read at a time; bounds memory
MAX_MINIMUM_TORQUE = 0.05  # [rms torque] beyond the samples, lower minima of |torque| may be changes of sign; heuristic
TIME_TOLERANCE = 0.01  # [periods] time tolerance of matching rows to instants; heuristic
EXTRA_ROWS = 64  # [rows] read beyond an interval, so that a row of another time is among them; heuristic
MIN_PARABOLA_ROWS = 3  # [rows] on either side of a minimum for the fit of a parabola, at least; heuristic
MAX_PARABOLA_ROWS = 10  # [rows] the same, at most; heuristic
MAX_KINK_RATIO = 0.5  # [1] of squared residuals with and without a change of sign, where there is one; heuristic
SignMarks = NDArray[np.int8]


@dataclass(frozen=True, eq=False)
class RefinedSigns(Frozen):
    """Signs of N samples of n joints, and the parameters fitted with them."""

    signs: Array  # (N, n) [1] most probable signs: -1 or 1; as recorded if torque has its sign, 0 if there is none
    expected: Array  # (N, n) E[s], expectations of the signs [1]
    value: Array  # (b,) theta, fitted to expected signs [units of base]
    sigma: Array  # (n,) standard deviation of the residual of steady samples [N.m or N], 0 without torque
    loss: float  # expected sum of the squared weighted residuals of steady samples
    rounds: int
    change: float  # relative change of z in the last round


def refine_signs(observed: Observations, value: Array, *, rounds: int = MAX_EM_ROUNDS) -> RefinedSigns:
    """Infer the signs of all samples by expectation maximisation, from approximate parameters.

    E step: with m the predicted and a the absolute torque of a sample, the log-odds of a positive sign are 2 m a /
    (kappa sigma^2); messages along the chain give E[s]. M step: z = U'(E[s] a w). Parameters are fitted to expected
    signs, since a fit to the most probable ones takes noise around zero for torque. Samples near reversals do not enter
    the fit; their log-odds use the variance of their own residual. Weights w are one over the rms torque of a joint;
    the start is value (b,) [units of base].

    Source: Dempster, Laird, Rubin, J. Royal Statistical Society B 39(1), 1977; Rabiner, Proc. IEEE 77(2), 1989.
    """
    hidden = list(observed.hidden)
    fit = _ParameterFit.of(observed)
    magnitude = np.abs(observed.torque[:, hidden])
    tied = coupling(magnitude, observed.first)
    z, done, change = np.zeros(fit.back.shape[1]), 0, np.inf
    expected = odds = np.zeros_like(magnitude)
    while done < rounds:
        done += 1
        predicted = observed.predict(value)[:, hidden]
        errors = (np.abs(predicted) - magnitude) ** 2
        calm = RESIDUAL_INFLATION * _masked_mean(errors, fit.fitted)
        near = np.maximum(calm, _masked_mean(errors, ~fit.fitted))  # of samples near reversals
        variance = np.maximum(np.where(fit.fitted, calm, near), _floor(magnitude))
        odds = np.clip(2 * predicted * magnitude / variance, -MAX_SIGN_ODDS, MAX_SIGN_ODDS)
        expected = expected_signs(odds, tied)
        before, z = z, fit.coordinates(expected * magnitude)
        value = fit.back @ z
        change = float(np.linalg.norm(z - before) / max(float(np.linalg.norm(z)), 1e-300))
        if change <= EM_TOLERANCE:
            break
    signs = np.sign(observed.torque) * (observed.known & observed.signed)
    mean = signs.copy()
    signs[:, hidden], mean[:, hidden] = likeliest_signs(odds, tied), expected
    predicted = observed.predict(value)
    signs = place_sign_changes(observed, signs, predicted)
    torque = np.abs(observed.torque)
    squares = np.maximum(torque**2 - 2 * mean * torque * predicted + predicted**2, 0)  # expected, of the residual
    sigma = np.where(observed.known, np.sqrt(_masked_mean(squares, _fitted_samples(observed))), 0.0)
    return RefinedSigns(signs, mean, value, sigma, max(fit.energy - float(z @ z), 0.0), done, change)


def coupling(magnitude: Array, first: Mask, same: float = SAME_SIGN_ODDS) -> Array:
    """Log-odds that a sample has the sign of the one before it: (N, h) [1], 0 where a span begins (`first`).

    Torque is modelled as a random walk with the local mean squared step d^2 of magnitude a (N, h) [N.m or N]: the
    log-odds of neighbours a, a' are 2 a a' / d^2 + same. Neighbours that are large compared with d have the same sign.
    """
    inside = np.broadcast_to(~first[:, None], magnitude.shape)
    step = np.diff(magnitude, axis=0, prepend=magnitude[:1]) ** 2 * inside
    from scipy.ndimage import uniform_filter1d  # imported here, since that takes longer than its use

    size = min(STEP_WINDOW_SAMPLES, len(magnitude))
    share = uniform_filter1d(inside.astype(np.float64), size, axis=0, mode="nearest")
    local = uniform_filter1d(step, size, axis=0, mode="nearest") / np.maximum(share, 1 / size)
    calm = np.median(step[~first], axis=0) if not first.all() else 0.0
    before = np.concatenate([magnitude[:1], magnitude[:-1]])
    odds = 2 * before * magnitude / np.maximum(local, np.maximum(MIN_STEP_RATIO * calm, _floor(magnitude))) + same
    return np.where(inside, np.minimum(odds, MAX_TIE_ODDS), 0.0)


def expected_signs(odds: Array, tied: Array) -> Array:
    """Expectations of the signs of h chains: (N, h) E[s] = tanh(log-odds / 2) [1].

    A sample alone has the log-odds odds (N, h) [1] of a positive sign, and tied (N, h) [1] of the sign before it.

    Source: forward and backward messages of Rabiner, Proc. IEEE 77(2), 1989, as odds.
    """
    evidence, same = np.exp(odds), np.exp(tied)
    after = np.concatenate([same[1:], np.ones_like(same[:1])])
    return np.tanh(0.5 * (_messages(evidence, same) + _messages(evidence[::-1], after[::-1])[::-1] - odds))


def likeliest_signs(odds: Array, tied: Array) -> Array:
    """Most probable signs of h whole chains: (N, h) [1], -1 or 1.

    Log-odds are those of `expected_signs`: odds (N, h) [1] and tied (N, h) [1], at least 0.

    Source: Viterbi, IEEE Trans. Information Theory 13(2), 1967.
    """
    paths = []
    for chain, ties in zip(odds.T.tolist(), tied.T.tolist(), strict=True):
        best, gain = [], 0.0
        for alone, tie in zip(chain, ties, strict=True):
            gain = alone + min(max(gain, -tie), tie)
            best.append(gain)
        sign, path = 1.0, []
        for gain, tie in zip(best[::-1], [0.0, *ties[:0:-1]], strict=True):
            sign = 1.0 if gain + tie * sign >= 0 else -1.0
            path.append(sign)
        paths.append(path[::-1])
    return np.array(paths).reshape(odds.T.shape).T


def _messages(evidence: Array, same: Array) -> Array:
    """(N, h) log-odds of a positive sign from each sample and all before it."""
    chains = []
    for chain, ties in zip(evidence.T.tolist(), same.T.tolist(), strict=True):
        messages, odds = [], 1.0
        for alone, tie in zip(chain, ties, strict=True):
            odds = alone * (odds * tie + 1.0) / (odds + tie)
            messages.append(odds)
        chains.append(messages)
    return np.asarray(np.log(np.array(chains).reshape(evidence.T.shape)).T)


def _masked_mean(squares: Array, which: Mask) -> Array:
    return np.asarray(np.sum(squares * which, axis=0) / np.maximum(which.sum(0), 1))


def _floor(torque: Array) -> Array:
    return np.asarray(MIN_RESIDUAL**2 * np.mean(torque**2, axis=0) + 1e-300)


def _fitted_samples(observed: Observations) -> Mask:
    """(N, n) samples that the parameters are fitted to: the steady ones, or all of a joint without any."""
    return observed.steady | ~observed.steady.any(0)


@dataclass(frozen=True, eq=False)
class _ParameterFit:
    """Least squares of the fitted samples, factorised once for any signs."""

    orthonormal: Array  # (M, r) U of the rows whose sign is hidden
    given: Array  # (r,) contribution to z of the rows with a known right-hand side
    back: Array  # (b, r)
    weights: Array  # (h,)
    fitted: Mask  # (N, h)
    energy: float  # sum of the squared right-hand sides

    @classmethod
    def of(cls, observed: Observations) -> _ParameterFit:
        hidden, weights, fitted = list(observed.hidden), 1 / observed.scale, _fitted_samples(observed)
        rows = [observed.rows(j, fitted[:, j]) * weights[j] for j in hidden]
        signed = signed_rows(observed, weights)
        unsigned = (observed.torque * weights)[:, hidden][fitted[:, hidden]]
        orthonormal, back = orthonormalise(np.concatenate([*rows, signed.matrix]))
        return cls(
            orthonormal[: len(unsigned)],
            orthonormal[len(unsigned) :].T @ signed.target,
            back,
            weights[hidden],
            fitted[:, hidden],
            float(unsigned @ unsigned + signed.target @ signed.target),
        )

    def coordinates(self, torque: Array) -> Array:
        """(r,) z that fits a torque (N, h) [N.m or N] best."""
        return np.asarray(self.orthonormal.T @ (torque * self.weights).T[self.fitted.T] + self.given)


def place_jumps(task: Task, part: Part, step: int, thinned: Trace, value: Array) -> tuple[Array, Indices, Array]:
    """Add the samples between two thinned ones where torque jumped past zero, with the signs that fit the model best.

    A torque that passes through zero has its smallest absolute value there. A torque that jumps, as at a reversal of
    friction, leaves no such trace, so the jump is placed where the residual of the model with base parameters
    value (b,) [units of base] is smallest. A thinned sample stands for `step` recorded ones. Returns times, beginnings
    of spans and signs as in a `Trace`.
    """
    size = np.nan_to_num(thinned.magnitude)
    large = size > JUMP_TORQUE * np.sqrt(np.mean(size**2, axis=0))
    changing = (thinned.signs[1:] != thinned.signs[:-1]) & large[1:] & large[:-1]
    changing[thinned.first[1:] - 1] = False
    signs, after, t, inner = thinned.signs.copy(), [], [], []
    for at, times, jump_signs in _jumps(task, part, step, changing.any(axis=1), thinned.signs, value):
        signs[[at, at + 1]] = jump_signs[[0, -1]]
        after += [at] * (len(jump_signs) - 2)
        t.append(times[1:-1])
        inner.append(jump_signs[1:-1])
    if not after:
        return thinned.t, thinned.first, signs
    place = np.array(after, dtype=np.intp) + 1
    first = thinned.first + np.searchsorted(place, thinned.first, side="right")
    return np.insert(thinned.t, place, np.concatenate(t)), first, np.insert(signs, place, np.concatenate(inner), axis=0)


def _jumps(
    task: Task, part: Part, step: int, changing: Mask, thinned: Array, value: Array
) -> Iterator[tuple[int, Array, Array]]:
    """Thinned samples before a jump; times (K,) and signs (K, n) of all samples from each to the next."""
    passed = 0
    for _, motion, torque, _ in motion_windows(task, part, step):
        count = -(-len(motion) // step)
        for k in np.flatnonzero(changing[passed : passed + count - 1]).tolist():
            here, (before, after) = slice(k * step, (k + 1) * step + 1), thinned[passed + k : passed + k + 2]
            between = replace(motion[here], slow=None)  # friction changes its sign at once
            size, model = np.abs(np.nan_to_num(torque[here])), predict(task, between, value)
            signs = np.repeat(before[None], len(between), axis=0)
            for j in np.flatnonzero(before != after):
                signs[place_sign_change(before[j], after[j], size[:, j], model[:, j]) :, j] = after[j]
            yield passed + k, between.t, signs
        passed += count


def expect_signs(task: Task, part: Part, value: Array, sigma: Array, signs: NDArray[np.int8]) -> Weights:
    """Expectation (rows, n) of the sign of each row, from the torque of a model and the rows around it.

    A torque below its noise that is given the sign of the model is biased towards the model; with the expectation of
    the sign it is not. Near reversals, and where the chain clearly contradicts a sign, the sign stays.

    The model has base parameters value (b,) [units of base], and a residual of standard deviation
    sigma (n,) [N.m or N]. The signs (rows, n) [1] are those found for the rows of the file, 0 where there is none.

    Source: E step of Dempster, Laird, Rubin, J. Royal Statistical Society B 39(1), 1977.
    """
    recording, sampling = part
    grid: list[Weights] = []  # expectations of the samples of the grid, window by window; NaN near reversals
    variance = np.where(sigma > 0, FULL_RATE_INFLATION * sigma**2, np.inf)
    for _, motion, torque, steady in motion_windows(task, part, 1):
        magnitude = np.abs(np.nan_to_num(torque))
        odds = np.clip(2 * predict(task, motion, value) * magnitude / variance, -MAX_SIGN_ODDS, MAX_SIGN_ODDS)
        expected = expected_signs(odds, coupling(magnitude, np.arange(len(odds)) == 0, 0.0))
        grid.append(np.where(steady, expected, np.nan).astype(np.float32))
    weights, ends = signs.astype(np.float32), np.cumsum([stretch.count for stretch in sampling.stretches])
    for stretch, stretch_signs in zip(sampling.stretches, np.split(np.concatenate(grid), ends[:-1]), strict=True):
        _assign_nearest(weights, part, stretch, stretch_signs)
    weights[:, recording.signed] = signs[:, recording.signed]
    return weights


def _assign_nearest(weights: Weights, part: Part, stretch: Stretch, expected: Weights) -> None:
    """Assign to each row of a stretch the expectation of the nearest sample of the grid."""
    recording, sampling = part
    for start in range(stretch.start, stretch.stop, EXPECTATION_ROWS):
        rows = slice(start, min(start + EXPECTATION_ROWS, stretch.stop))
        stamps = row_times(recording, sampling, rows.start, rows.stop)
        place = np.round((stamps - stretch.stamps[0]) / sampling.period).astype(np.intp) - stretch.first
        inside = (place >= 0) & (place < len(expected))
        soft, hard = expected[np.clip(place, 0, len(expected) - 1)], weights[rows]
        clash = (np.sign(soft) != hard) & (np.abs(soft) > MIN_CONTRADICTION)
        keep = ~inside[:, None] | np.isnan(soft) | (soft == 0) | (hard == 0) | clash
        weights[rows] = np.where(keep, hard, soft)


def signs_of_rows(recording: Recording, sampling: Sampling, t: Array, first: Indices, signs: SignMarks) -> SignMarks:
    """A sign (rows, n) for every row of a recording: -1 or 1, and 0 in rows of no span.

    Between two samples of different sign, the change is at the smallest |torque| recorded between them. Before the
    first and after the last sample of a span the nearest sign continues; it changes at minima near zero (below 5 % of
    the joint's rms torque, or within a step between rows) where the torque is smoother with a change of sign. Torques
    that have their sign get 1. The recording is read piece by piece.

    The M samples at times t (M,) [s] with signs (M, n) [1] lie on the grids of the spans that are long enough, and
    start a span at the indices first (k,).
    """
    marks = np.zeros((len(recording), len(recording.joints)), np.int8)
    pieces = [slice(*ends) for ends in pairwise([*first.tolist(), len(t)])]
    for stretch in sampling.stretches:
        low, high = _span_ends(stretch, sampling.period)
        if pieces and low < t[pieces[0].start] and t[pieces[0].stop - 1] < high:
            piece = pieces.pop(0)
            _fill_span(marks, _Span.of(recording, sampling, stretch, t[piece]), signs[piece])
    assert not pieces, "every span of the samples lies in one of the recording, in the same order"
    marks[:, recording.signed] = 1
    return marks


class _FileRows(NamedTuple):
    """K rows of distinct times, forwards or backwards."""

    number: Indices  # (K,)
    t: Array  # (K,) [s]
    size: Array  # (K, h) absolute torques of the joints without a sign [N.m or N]

    def backwards(self) -> _FileRows:
        return _FileRows(self.number[::-1], self.t[::-1], self.size[::-1])


class _Span(NamedTuple):
    """Rows begin..end of a recording, and the first row at or after each of M samples."""

    recording: Recording
    sampling: Sampling
    hidden: list[int]  # h joints without a sign
    small: Array  # (h,) [N.m or N]
    begin: int
    end: int
    at: Indices  # (M,)
    exact: bool  # whether samples coincide with rows

    @classmethod
    def of(cls, recording: Recording, sampling: Sampling, stretch: Stretch, t: Array) -> _Span:
        low, high = _span_ends(stretch, sampling.period)
        at = _row_at(recording, sampling, stretch, np.array([low, *t, high]))
        begin = stretch.start if stretch.first == 0 else int(at[0])
        end = stretch.stop if stretch.first + stretch.count == stretch.size else int(at[-1])
        hidden = np.flatnonzero(~recording.signed).tolist()
        small, at = MAX_MINIMUM_TORQUE * sampling.torque_rms[hidden], np.clip(at[1:-1], begin, end - 1)
        return cls(recording, sampling, hidden, small, begin, end, at, sampling.uniform)

    def read(self, start: int, stop: int) -> _FileRows:
        """Rows start..stop inside the span, without those that repeat a time."""
        start, stop = max(start, self.begin), min(stop, self.end)
        names = [self.recording.columns["tau"][j] for j in self.hidden]
        inside = slice(*np.searchsorted(self.sampling.dropped, [start, stop]))
        repeated = self.sampling.dropped[inside] - start
        t = np.delete(row_times(self.recording, self.sampling, start, stop), repeated)
        values = np.delete(self.recording.table.read(names, start, stop), repeated, axis=0)
        number = np.delete(np.arange(start, stop), repeated)
        return _FileRows(number, t, np.abs(values * self.recording.torque_per_unit[self.hidden]))


def _span_ends(stretch: Stretch, period: float) -> tuple[float, float]:
    """Times half a period before and after the grid of a span [s]."""
    first, last = stretch.first - 0.5, stretch.first + stretch.count - 0.5
    return float(stretch.stamps[0] + first * period), float(stretch.stamps[0] + last * period)


def _row_at(recording: Recording, sampling: Sampling, stretch: Stretch, t: Array) -> Indices:
    """First row at or after each instant t (k,): from the grid where rows lie on it, else from their stamps."""
    if sampling.uniform:
        kept = np.ceil((t - stretch.stamps[0]) / sampling.period - TIME_TOLERANCE).astype(np.intp)
        inside = slice(*np.searchsorted(sampling.dropped, [stretch.start, stretch.stop]))
        place = sampling.dropped[inside] - stretch.start
        place = place - np.arange(len(place))  # how many rows are kept before each dropped one
        return np.asarray(stretch.start + kept + np.searchsorted(place, kept, side="right"))
    rows = np.full(len(t), stretch.start, dtype=np.intp)
    for start in range(stretch.start, stretch.stop, CHUNK_ROWS):
        stop = min(start + CHUNK_ROWS, stretch.stop)
        stamps = row_times(recording, sampling, start, stop)
        rows += np.searchsorted(stamps, t - TIME_TOLERANCE * sampling.period)
    return rows


def _fill_span(marks: SignMarks, span: _Span, signs: SignMarks) -> None:
    """Set the signs of the rows of a span."""
    own = signs[:, span.hidden]
    changes = np.repeat(span.at[1:, None], len(span.hidden), axis=1)  # rows from which the next sample's sign holds
    turning = np.flatnonzero((own[1:] != own[:-1]).any(axis=1))  # intervals between samples in which a sign changes
    for intervals in np.split(turning, np.flatnonzero(np.diff(span.at[turning] // CHUNK_ROWS)) + 1):
        if not len(intervals):
            continue
        rows = span.read(int(span.at[intervals[0]]) - EXTRA_ROWS, int(span.at[intervals[-1] + 1]) + EXTRA_ROWS)
        for i in range(len(span.hidden)):
            which = intervals[own[intervals, i] != own[intervals + 1, i]]
            if len(which):
                places = (np.searchsorted(rows.number, span.at[which + k]) for k in (0, 1))
                low, high = (np.minimum(place, len(rows.number) - 1) for place in places)
                changes[which, i] = rows.number[_crossings(rows.t, rows.size[:, i], low, high, span.exact)]
    for i, j in enumerate(span.hidden):
        lengths = np.diff([span.begin, *changes[:, i], span.end])
        marks[span.begin : span.end, j] = np.repeat(own[:, i], lengths)
    step = min(max(MIN_PARABOLA_ROWS, int(span.at[-1] - span.at[0]) // max(1, len(span.at) - 1)), MAX_PARABOLA_ROWS)
    first, last = int(span.at[0]), int(span.at[-1]) + span.exact
    left, right = span.read(span.begin, first + step + 1).backwards(), span.read(last - step - 1, span.end)
    for i, j in enumerate(span.hidden):
        known = int(np.sum(left.number >= first)) + int(marks[first, j] != own[0, i])
        for turn in _kinks(left, i, known, float(span.small[i]), step):
            marks[span.begin : left.number[turn - 1], j] *= -1
        known = int(np.sum(right.number < last)) + int(marks[max(last - 1, span.begin), j] != own[-1, i])
        for turn in _kinks(right, i, known, float(span.small[i]), step):
            marks[right.number[turn] : span.end, j] *= -1


def _crossings(t: Array, size: Array, low: Indices, high: Indices, exact: bool) -> Indices:
    """First row of the new sign in each interval low..high (k,), given the absolute torques size (K,) at times t.

    The smallest value gets the sign with the smaller second difference between its neighbours of opposite signs.
    """
    lengths = high - low + 1
    begin = np.cumsum(lengths) - lengths
    rows = np.arange(lengths.sum()) + np.repeat(low - begin, lengths)
    hits = np.flatnonzero(size[rows] == np.repeat(np.minimum.reduceat(size[rows], begin), lengths))
    lowest = rows[hits[np.searchsorted(hits, begin)]]
    return np.asarray(np.clip(lowest + _keeps_sign(t, size, lowest), low + exact, high))


def _keeps_sign(t: Array, size: Array, lowest: Indices) -> Mask:
    """Whether the smallest value of each interval has the sign of the row before it, not of the row after."""
    before, after = np.maximum(lowest - 1, 0), np.minimum(lowest + 1, len(size) - 1)
    return np.asarray(size[before] * np.abs(t[after] - t[lowest]) > size[after] * np.abs(t[lowest] - t[before]))


def _kinks(rows: _FileRows, joint: int, known: int, small: float, step: int) -> list[int]:
    """First rows of a new sign beyond the `known` rows, at least `step` apart, the clearest kinks first."""
    size = rows.size[:, joint]
    steps = np.abs(np.diff(size, prepend=size[0], append=size[-1]))
    low = size < np.maximum(small, np.maximum(steps[1:], steps[:-1]))  # near zero, or within a step between rows
    lowest = np.flatnonzero((size[1:-1] <= size[:-2]) & (size[1:-1] < size[2:]) & low[1:-1]) + 1
    turns = lowest + _keeps_sign(rows.t, size, lowest)
    rows_of_kinks: list[int] = []
    for bend, turn in sorted((_kink_ratio(rows.t, size, turn, step), turn) for turn in turns[turns >= known].tolist()):
        if bend < MAX_KINK_RATIO and all(abs(turn - other) > step for other in rows_of_kinks):
            rows_of_kinks.append(turn)
    return rows_of_kinks


def _kink_ratio(t: Array, size: Array, turn: int, step: int) -> float:
    """Ratio of the squared residuals of a parabola with and without a change of sign at a row; 0: a perfect change."""
    around = slice(max(0, turn - step), turn + step)
    x, y = t[around] - t[turn], size[around]
    both = np.stack([y, np.where(x < 0 if t[-1] > t[0] else x > 0, y, -y)], axis=1)
    _, (kept, changed), *_ = np.polyfit(x / np.ptp(x), both, 2, full=True)
    return float(changed / max(kept, 1e-300))
