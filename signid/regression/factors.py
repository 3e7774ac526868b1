"""Rows -> factors: additive sums and a sample of rows, of a size that does not grow with the recording.

What a fit leaves of held-out rows follows from them: its misfit, and the laws that it lacks. Laws are tried beside
bodies that stay near the description: a fit of any bodies hides a spring in tens of kg.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import reduce as fold
from typing import Any, NamedTuple, Protocol

import numpy as np

from ..effects import EFFECT_NAMES, EFFECTS
from ..effects.law import law_columns
from ..types import Array, Effect, Frozen, Indices, Law, Mask, Parameters
from .base_parameters import round_digits
from .motion import Motion
from .projection import least_squares
from .rows import Rows, Task

MAX_SAMPLE_ROWS = 512  # largest number of rows; with 256, intervals of real recordings contain the truth less often
MIN_ROW_LIMIT = 128  # smallest limit on the number of rows, for many columns
MAX_COLUMN_ENTRIES = 2**18  # largest number of entries of `columns` above that: 2 MB
SAMPLE_ARRAYS = ("number", "q", "v", "a", "torque", "slope", "kept", "columns")  # arrays of a `RowSample`
LAGS = 6  # highest order of the autoregressive noise model
Weigh = Callable[[int, Rows], Array]  # (joint, rows) -> weight (M,) [1] of each row
# The residual of a joint matters if its held-out rms exceeds both [noise floors], [standard deviations of its torque]
MIN_RESIDUAL_FLOORS, MIN_RESIDUAL_SHARE = 1.5, 0.02
# [1] of its mean square that a named law explains, in that share of blocks of rows, as neighbours are alike. Measured
# on arms (panda, UR10e, TX40, EMPS): at most 0.26 for laws other than friction of another form; 0.97 and more: springs
MIN_EXPLAINED_SHARE, MIN_BLOCK_SHARE, ROW_BLOCKS = 0.3, 0.8, 8
INERTIAL_DEVIATION = 0.3  # [1] plausible error of stated masses, and of moments over mass times radius
MIN_GYRATION_RADIUS = 0.02  # [m] added to the radius of gyration, for bodies that are stated as points
# [1] mean square change of base parameters, in plausible errors, from which on bodies moved too far, and share of it
# that a law must spare. Measured: at most 0.18 for the arms above; 1.5 and 0.7 for a Baxter without its spring
MAX_BODY_CHANGE, MIN_SPARED_SHARE = 1.0, 0.5
LARGE_RESIDUAL_FLOORS = 10.0  # [noise floors] held-out rms from which on a sentence says so
MIN_COEFFICIENT_GAIN = 0.02  # [1] share by which a law with one coefficient more must explain more, to be named first
MIN_INDEPENDENT_SHARE = 1e-6  # [1] of a column's sum of squares that fitted columns leave, for its law to be tried
SINGLE_JOINT_LAWS = (  # laws of single joints that are linear
    *EFFECT_NAMES,
    *("asymmetric_friction", "quadratic_friction", "load_friction", "spring", "cable_torque", "counterbalance"),
)
VARIABLE_WORDS = {"load": "torque", "a": "acceleration", "q": "position", "v": "velocity", "t": "time"}
MISFIT_DIGITS = 4  # significant digits of a misfit in a file


@dataclass(frozen=True, eq=False)
class RowSample(Frozen):
    """K evenly spaced rows: those whose number is a multiple of `stride`, a power of two.

    Rows are numbered by time, so that the sample does not depend on the order in which parts are added.
    """

    number: Indices  # (K,) number of each row: time over `period`
    period: float  # [s] between neighbouring rows
    stride: int  # [1] spacing of the sample, in rows
    q: Array  # (K, n) [rad or m]
    v: Array  # (K, n) [rad/s or m/s]
    a: Array  # (K, n) [rad/s2 or m/s2]
    torque: Array  # (K, n) [N.m or N]
    slope: Array  # (K, n) [N.m/s or N/s] derivative of the torque
    kept: Mask  # (K, n) whether the row of the joint is valid
    columns: Array  # (K, c) [torque per unit of the base parameter], joint by joint

    def __add__(self, other: RowSample) -> RowSample:
        both: dict[str, Any] = {key: np.concatenate([getattr(self, key), getattr(other, key)]) for key in SAMPLE_ARRAYS}
        return _thinned(replace(self, stride=max(self.stride, other.stride), **both))

    def of(self, joint: int, seen: Sequence[Indices]) -> Array:
        """Columns (K, m) of one joint [torque per unit of the base parameter]; `seen` are those of all joints."""
        start = sum(len(columns) for columns in seen[:joint])
        return self.columns[:, start : start + len(seen[joint])]


def sample_rows(task: Task, window: Rows, weights: Sequence[Array] | None = None) -> RowSample:
    """Sample of consecutive rows, with robust weights (M,) per joint [1], in [0, 1]."""
    period = task.band.factor / task.band.rate
    kept = window.steady & window.recorded
    root = [np.sqrt(w) for w in weights] if weights else [np.ones(len(kept))] * kept.shape[1]
    scale = np.where(kept, np.column_stack(root), 0.0)
    columns = [x * scale[:, j, None] for j, x in enumerate(window.columns)]
    joined = np.concatenate(columns, axis=1)
    signals = (window.q, window.v, window.a, window.torque * scale, window.slope * scale, joined)
    q, v, a, torque, slope, joined = (
        x.astype(np.float32).astype(np.float64) for x in signals
    )  # halves the size of files
    number = int(np.floor(window.t[0] / period)) + np.arange(len(window.t)) if len(window.t) else np.zeros(0, np.intp)
    return _thinned(RowSample(number, period, 1, q, v, a, torque, slope, kept, joined))


def _thinned(sample: RowSample) -> RowSample:
    """Sample at the smallest stride that satisfies the limits."""
    most = int(np.clip(MAX_COLUMN_ENTRIES // max(sample.columns.shape[1], 1), MIN_ROW_LIMIT, MAX_SAMPLE_ROWS))
    stride, here = sample.stride, sample.number % sample.stride == 0
    while np.count_nonzero(here) > most:
        stride *= 2
        here = sample.number % stride == 0
    if here.all():
        return replace(sample, stride=stride)
    return replace(sample, stride=stride, **{key: getattr(sample, key)[here] for key in SAMPLE_ARRAYS})


@dataclass(frozen=True, eq=False)
class JointFactors(Frozen):
    """Sums over one joint's rows z = [instruments x y]: m columns x, torque y; masked rows are zero.

    grams[d] = sum over k of z[k] z[k-d]'; `whole` is the sum over all rows, masked or not, of [x y]'[x y].
    """

    grams: Array  # (d, c, c) [products of the units of z], c = m + 1, or 2 m + 1 with instruments
    counts: Array  # (d,) [1] pairs of valid rows at each lag
    whole: Array  # (m + 1, m + 1) [products of the units of x, y]
    total: float  # [N.m or N] sum of y over all rows
    rows: int

    def __add__(self, other: JointFactors) -> JointFactors:
        return JointFactors(*(getattr(self, each.name) + getattr(other, each.name) for each in fields(self)))


@dataclass(frozen=True, eq=False)
class Factors(Frozen):
    """Factors of all joints, and statistics of the motion. They add over recordings, chunks and machines."""

    joints: tuple[JointFactors, ...]
    columns: tuple[Indices, ...]  # per joint (m,) base parameters that its torque depends on
    instruments: bool
    lower: Array  # (n,) [rad or m]
    upper: Array  # (n,) [rad or m]
    velocity: Array  # (n, n) [rad2/s2] sum of v v'
    acceleration: Array  # (n,) [rad2/s4] sum of a squared
    rows: int
    sample: RowSample | None = None  # sample of the rows; None for white noise
    parts: tuple[tuple[str, Factors], ...] = ()  # of each recording, with its SHA-256

    def __add__(self, other: Factors) -> Factors:
        one, two = dict(self.parts), dict(other.parts)
        return Factors(
            tuple(a + b for a, b in zip(self.joints, other.joints, strict=True)),
            self.columns,
            self.instruments,
            np.minimum(self.lower, other.lower),
            np.maximum(self.upper, other.upper),
            self.velocity + other.velocity,
            self.acceleration + other.acceleration,
            self.rows + other.rows,
            self.sample + other.sample if self.sample and other.sample else None,
            tuple({**one, **{key: one[key] + x if key in one else x for key, x in two.items()}}.items()),
        )


class Node(NamedTuple):
    """Sum over 2**level windows of rows; `start` is the number of the first window."""

    start: int
    level: int
    factors: Factors


def reduce_rows(task: Task, rows: Iterable[Rows], lags: int = LAGS, weigh: Weigh | None = None) -> Factors:
    """Factors of all rows, in one pass, as the sum over `window_factors`."""
    nodes = cascade(Node(k, 0, one) for k, one in enumerate(window_factors(task, rows, lags, weigh)))
    return total_factors(nodes) or _empty_factors(task, lags)


def window_factors(task: Task, rows: Iterable[Rows], lags: int = LAGS, weigh: Weigh | None = None) -> Iterator[Factors]:
    """Factors of each of consecutive windows of rows, of one recording or of several, up to the highest lag.

    Each row has a robust weight in [0, 1], or 1.
    """
    seen = tuple(map(np.flatnonzero, task.base.sees))
    empty = tails = [np.zeros((0, c + 1)) for c in _widths(task)]
    for window in rows:
        if window.first:
            tails = empty
        weights = [weigh(j, window) for j in range(len(seen))] if weigh else None
        found = [_reduce_joint(window, j, tail, lags, weights[j] if weights else None) for j, tail in enumerate(tails)]
        tails = [tail for _, tail in found]
        yield Factors(
            tuple(part for part, _ in found),
            seen,
            task.instruments,
            window.q.min(0),
            window.q.max(0),
            window.v.T @ window.v,
            (window.a**2).sum(0),
            len(window.t),
            sample_rows(task, window, weights) if lags else None,
        )


def cascade(nodes: Iterable[Node]) -> list[Node]:
    """Pairwise sums of neighbouring nodes, as far as pairs are complete. Nodes ascend without overlap.

    The order of all additions follows from the numbers of the windows alone. So the sum is the same to the last bit on
    whichever machine its parts were computed, and rounding errors hardly grow with the number of windows.

    Source: pairwise summation: Higham, Accuracy and Stability of Numerical Algorithms, 2002, section 4.2.
    """
    stack: list[Node] = []
    for node in nodes:
        while stack and stack[-1].level == node.level and node.start == stack[-1].start + 2**node.level:
            if stack[-1].start % 2 ** (node.level + 1):
                break
            left = stack.pop()
            node = Node(left.start, node.level + 1, left.factors + node.factors)
        stack.append(node)
    return stack


def total_factors(nodes: Sequence[Node]) -> Factors | None:
    """Sum of the nodes of a cascade, the smallest first; None if there is no node."""
    return fold(lambda right, left: left.factors + right, nodes[-2::-1], nodes[-1].factors) if nodes else None


def _reduce_joint(window: Rows, j: int, tail: Array, lags: int, weight: Array | None) -> tuple[JointFactors, Array]:
    """Factors of the joint, and the last rows for the lags of the next window."""
    known, old, m = bool(window.recorded[j]), len(tail), window.columns[j].shape[1]
    keep = window.steady[:, j] & known
    parts = [window.columns[j], window.torque[:, j, None]]
    parts = parts if window.instruments is None else [window.instruments[j], *parts]
    z = np.empty((old + len(keep), tail.shape[1]))
    c = z.shape[1] - 1
    z[:old], z[old:, c] = tail, keep
    rows = np.concatenate(parts, axis=1, out=z[old:, :c])
    plain = rows[:, c - m - 1 :]
    total, masked = float(plain[:, m].sum()), plain[~keep]
    whole = None if weight is None else plain.T @ plain
    rows[~keep] = 0
    if weight is not None:
        rows *= np.sqrt(weight)[:, None]
    grams, counts = np.zeros((lags + 1, c, c)), np.zeros(lags + 1)
    for d in range(lags + 1):
        start = max(old, d)
        now, before = z[start:], z[start - d : max(len(z), start) - d]
        grams[d] = now[:, :c].T @ before[:, :c]
        counts[d] = now[:, c] @ before[:, c]
    whole = grams[0, c - m - 1 :, c - m - 1 :] + masked.T @ masked if whole is None else whole
    share = float(known)  # 0 if the torque is not recorded
    return JointFactors(grams, counts, share * whole, share * total, known * len(keep)), z[max(0, len(z) - lags) :]


def _widths(task: Task) -> list[int]:
    """Number of columns in the factors of each joint."""
    sides = 2 if task.instruments else 1
    return [sides * int(seen.sum()) + 1 for seen in task.base.sees]


def _empty_factors(task: Task, lags: int) -> Factors:
    seen, n = tuple(map(np.flatnonzero, task.base.sees)), len(task.base.sees)
    empty = tuple(
        JointFactors(np.zeros((lags + 1, c, c)), np.zeros(lags + 1), np.zeros((len(columns) + 1,) * 2), 0.0, 0)
        for columns, c in zip(seen, _widths(task), strict=True)
    )
    zeros = np.zeros(n)
    return Factors(empty, seen, task.instruments, zeros + np.inf, zeros - np.inf, np.zeros((n, n)), zeros, 0)


@dataclass(frozen=True)
class Lack:
    """Laws that explain most of what a fit leaves of a joint's torque on held-out rows, the best one first."""

    joint: str
    share: float  # [1] of the mean square there that the best one explains, or of the change of bodies that it spares
    variable: str  # that it is a function of: torque, acceleration, position, velocity, time, or none: a constant
    effects: tuple[str, ...]
    moved: bool = False  # whether it would spare a change of bodies beyond what a description can be wrong by
    floors: float = 0.0  # [noise floors] held-out rms

    @property
    def sentence(self) -> str:
        """The flag."""
        which = " or ".join(effect.replace("_", " ") for effect in self.effects[:2])
        percent = f"{100 * self.share:.0f} %"
        fact = f"{self.variable} explains {percent} of the held-out residual of {self.joint}"
        fact += f", {self.floors:.0f} times its noise floor" if self.floors > LARGE_RESIDUAL_FLOORS else ""
        if self.moved:
            fact = "the fit moves bodies beyond what a description can be wrong by"
            fact = f"{fact}, {percent} of it for want of a law at {self.joint}"
        return f"{fact}: {which}? Run signid diagnose"


class Accuracy(Protocol):
    """Accuracy of a fit: rms (n,) [N.m or N] and R2 (n,) [1]."""

    @property
    def train_rms(self) -> Array: ...
    @property
    def held_out_rms(self) -> Array: ...
    @property
    def noise_floor(self) -> Array: ...
    @property
    def held_out_r2(self) -> Array: ...


class _Rows(NamedTuple):
    """K sampled rows of n joints, zero where they are not used."""

    columns: Array  # (n, K, b) of all base parameters
    torque: Array  # (n, K) [N.m or N]
    kept: Mask  # (K, n)
    motion: Motion

    def of(self, law: Law) -> Array:
        """Columns (K, k) of a law at its joint."""
        return np.asarray(law_columns(law, self.motion)[1][:, 0] * self.kept[:, list(law.joints)])


class _Trial(NamedTuple):
    """Law beside bodies near the description."""

    effect: Effect
    joint: int
    explained: float  # [1] share of the mean square of the held-out residual of the joint
    spared: float  # [1] share of the change of the bodies


def find_lacks(
    task: Task, both: tuple[Factors, Factors], fit: Accuracy, value: Array, stated: Parameters, sound: Mask
) -> Iterator[Lack]:
    """Missing laws of the joints of the mask sound (n,), from factors of training and held-out rows.

    value: (b,) [units of base] of the fit; stated: standard parameters of the description.
    """
    train, test = both
    if train.sample is None or test.sample is None or train is test:
        return
    trials, far = _try_laws(task, (_residual_rows(task, train), _residual_rows(task, test)), fit, value, stated, sound)
    left = [trial for trial in trials if trial.explained > MIN_EXPLAINED_SHARE]
    for joint in dict.fromkeys(trial.joint for trial in left):
        candidates = [(trial.explained, trial.effect) for trial in left if trial.joint == joint]
        floors = float(fit.held_out_rms[joint] / max(fit.noise_floor[joint], 1e-300))
        yield _name_lack(task.robot.joints[joint], candidates, floors)
    best = max(trials, key=lambda trial: trial.spared, default=None)
    if far and best is not None and best.spared > MIN_SPARED_SHARE and all(trial.joint != best.joint for trial in left):
        candidates = [(trial.spared, trial.effect) for trial in trials if trial.joint == best.joint]
        yield _name_lack(task.robot.joints[best.joint], candidates, 0.0, moved=True)


def _name_lack(name: str, laws: list[tuple[float, Effect]], floors: float, moved: bool = False) -> Lack:
    worth = {effect: share - MIN_COEFFICIENT_GAIN * len(effect.coefficients(effect.example)) for share, effect in laws}
    order = sorted((pair for pair in laws if pair[0] > MIN_EXPLAINED_SHARE), key=lambda pair: -worth[pair[1]])
    share, first = order[0]
    names = tuple(effect.name for _, effect in order if _variable(effect) == _variable(first))
    return Lack(name, share, _variable(first), names, moved, floors)


def _variable(effect: Effect) -> str:
    names = re.findall(r"\w+", effect.equation)
    return next((variable for name, variable in VARIABLE_WORDS.items() if name in names), "none")


def _candidates(task: Task, joint: int) -> list[Effect]:
    """Laws that are not fitted; friction of another form only where friction is missing."""
    fitted = {law.effect for law in task.laws if joint in law.joints}
    has = {effect.name for effect in fitted}.union(*(effect.contains for effect in fitted))
    new = [EFFECTS[name] for name in SINGLE_JOINT_LAWS if name not in has]
    rubs = any(effect.usual and effect.dissipative for effect in new)
    return [effect for effect in new if rubs or not effect.dissipative]


def _residual_rows(task: Task, factors: Factors) -> _Rows:
    rows = factors.sample
    assert rows is not None, "factors with a sample"
    columns = np.zeros((len(factors.columns), len(rows.number), task.base.rank))
    for j, seen in enumerate(factors.columns):
        columns[j][:, seen] = rows.of(j, factors.columns)
    t = np.asarray(rows.number * rows.period, np.float64)
    motion = Motion(task.robot, t, rows.q, rows.v, rows.a, slow=task.slow)
    return _Rows(columns, rows.torque.T, rows.kept, motion)


def _inertial_information(task: Task, stated: Parameters) -> Array:
    """Inverse covariance (b, b) of base parameters of a description whose bodies are wrong by plausible errors."""
    std = np.full(len(stated.values), 1e3)  # laws are free
    for k, (mass, *_, xx, _, yy, _, _, zz) in enumerate(stated.bodies()):
        size = max(abs(mass), 1e-3)
        radius = MIN_GYRATION_RADIUS + np.sqrt(max(xx + yy + zz, 0.0) / (2 * size))
        std[10 * k : 10 * k + 10] = INERTIAL_DEVIATION * size * np.repeat([1.0, radius, radius**2], [1, 3, 6])
    covariance = (task.base.combination * std**2) @ task.base.combination.T
    scale = np.sqrt(np.diag(covariance))
    return np.asarray(np.linalg.pinv(covariance / np.outer(scale, scale), 1e-12, True) / np.outer(scale, scale))


def _try_laws(
    task: Task, rows: tuple[_Rows, _Rows], fit: Accuracy, value: Array, stated: Parameters, sound: Mask
) -> tuple[list[_Trial], bool]:
    """All laws, fitted to training rows with bodies near the description; and whether bodies moved too far."""
    (train, test), centre = rows, task.base.combination @ stated.values
    weight = np.nan_to_num(1 / np.maximum(np.maximum(fit.train_rms, fit.noise_floor), 1e-300))
    wide = (train.columns * weight[:, None, None]).reshape(-1, len(value))
    gram, prior = wide.T @ wide, _inertial_information(task, stated)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    free = np.linalg.pinv(gram / np.outer(size, size), 1e-12, True) / np.outer(size, size)
    near = np.linalg.inv(gram + prior)
    start = near @ (wide.T @ (train.torque * weight[:, None]).ravel() + prior @ centre)

    def change(base: Array) -> float:
        return float((base - centre) @ prior @ (base - centre)) / len(value)

    matters = (fit.held_out_rms > MIN_RESIDUAL_FLOORS * fit.noise_floor) & (fit.held_out_r2 < 1 - MIN_RESIDUAL_SHARE**2)
    trials, moved = list[_Trial](), change(start)
    for joint in np.flatnonzero(sound & (matters | (moved > MAX_BODY_CHANGE))).tolist():
        rest = (train.torque[joint] - train.columns[joint] @ start) * weight[joint]
        before = min((test.torque[joint] - test.columns[joint] @ x for x in (value, start)), key=lambda x: float(x @ x))
        for effect in _candidates(task, joint):
            own, judged = (part.of(Law(effect, (joint,))) for part in rows)
            own = own * weight[joint]
            both, square = weight[joint] * train.columns[joint].T @ own, own.T @ own
            new = np.diag(square - both.T @ free @ both) > MIN_INDEPENDENT_SHARE * np.diag(square)
            if not new.any():
                continue
            shift = near @ both[:, new]
            found = least_squares((square[:, new] - both.T @ shift)[new], own[:, new].T @ rest)
            base = start - shift @ found
            after = test.torque[joint] - test.columns[joint] @ base - judged[:, new] @ found
            old, left = (np.array([x @ x for x in np.array_split(y, ROW_BLOCKS)]) for y in (before, after))
            steady = matters[joint] and old.any() and np.mean(left[old > 0] < old[old > 0]) >= MIN_BLOCK_SHARE
            explained = 1 - float(left.sum() / old.sum()) if steady else 0.0
            spared = 1 - change(base) / moved if moved > 0 and left.sum() <= old.sum() else 0.0
            trials.append(_Trial(effect, joint, explained, spared))
    return trials, moved > MAX_BODY_CHANGE


@dataclass(frozen=True, eq=False)
class Misfit(Frozen):
    """Size and correlation of what the laws of a model leave of the torque of n joints."""

    size: Array  # (n,) [N.m or N] rms; NaN where torque was not held out
    length: Array  # (n,) [s] time over which it counts as one observation of a torque that is correlated as long
    cutoff: float  # [Hz] of the rows that it was measured on

    def document(self, joints: Sequence[str]) -> dict[str, Any]:
        """JSON object for model.json, without joints of unknown misfit."""
        rows = zip(joints, self.size.tolist(), self.length.tolist(), strict=True)
        misfits = {
            name: {"rms": round_digits(rms, MISFIT_DIGITS), "length": round_digits(s, MISFIT_DIGITS)}
            for name, rms, s in rows
            if np.isfinite(rms)
        }
        return {"cutoff": round_digits(self.cutoff, MISFIT_DIGITS), "joints": misfits}


def measure_misfit(task: Task, test: Factors, value: Array) -> Misfit:
    """Misfit of base parameters `value` (b,) [units of base] on held-out rows, from factors alone."""
    period, n = task.band.factor / task.band.rate, len(test.joints)
    size, length = np.full(n, np.nan), np.full(n, np.nan)
    for j, (joint, columns) in enumerate(zip(test.joints, test.columns, strict=True)):
        if joint.counts[0]:
            c = np.append(-value[columns], 1.0)
            own = joint.grams[:, -len(c) :, -len(c) :]
            power = np.einsum("i,dij,j->d", c, own, c) / np.maximum(joint.counts, 1)  # autocovariance of the residual
            size[j], length[j] = np.sqrt(max(power[0], 0.0)), period
            if power[0] > 0:  # rows that count as one against a torque that is correlated as long
                length[j] *= 1 + 2 * np.sum(np.clip(power[1:] / power[0], -1, 1) ** 2)
    return Misfit(size, length, task.band.cutoff)


def read_misfit(content: Mapping[str, Any] | None, joints: Sequence[str]) -> Misfit | None:
    """Misfit in the content of a model.json, the object of `Misfit.document`; None if it has none."""
    if content is None:
        return None
    entries = [content["joints"].get(name, {"rms": np.nan, "length": np.nan}) for name in joints]
    size, length = (np.array([float(entry[key]) for entry in entries]) for key in ("rms", "length"))
    return Misfit(size, length, float(content["cutoff"]))
