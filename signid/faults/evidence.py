"""Session and model -> evidence for recording faults, and fits of its torques.

Evidence is up to 1500 rows, and their signals after a correction. A fit explains a joint's torque by a passive joint
with the model's bodies, or with a law that the model lacks. The amount of data is judged by rows and unknowns alone.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import NamedTuple

import numpy as np

from ..effects.base import BodyLaw, TorqueLaw
from ..model import Model
from ..recording.sampling.grid import POINTS, lagrange
from ..regression.bandwidth import Decimator
from ..regression.motion import Motion, build_motion, margin
from ..regression.projection import leave
from ..regression.rows import Task, consumed
from ..regression.session import Part, Session, longest_piece
from ..robot.dynamics import own_body
from ..types import INERTIAL, Array, Frozen, Indices, Mask, Robot
from .result import REFUSE, RecordingFault

SAMPLES = 2**16  # largest number of samples of all recordings together
SAMPLES_PER_ROW = 4  # samples of the filtered torque per row of identification, for lags between rows
ROWS = 1500  # largest number of rows of all recordings together
BLOCKS = 8  # smallest number of blocks of all recordings; a fault must show in most of them
LAG = 0.25  # [s] longest lag
SIGNALS = 6  # position, and those of `Signals`
PER_UNKNOWN = 2.5  # smallest number of rows per unknown, for the joint with most unknowns, to estimate noise
BEYOND = 3.0  # [1] largest cut-off over the highest frequency of the motion
MOTION = 6.25  # [Hz] highest frequency of a motion; rows beyond it have no new information
# [1] unexplained share after an accepted correction over that before, of some torques and of one; share of the blocks
REST_RATIO, LONE_REST_RATIO, MIN_AGREED = 0.5, 0.35, 0.8
SPARE = 1.05  # [1] recommended duration over the necessary one


@dataclass(frozen=True, eq=False)
class Curve(Frozen):
    """Uniform samples of n signals."""

    t: Array  # (M,) [s]
    x: Array  # (M, n) [any unit]

    def at(self, t: Array) -> Array:
        """Values (K, n) at t: (K,) [s] by the polynomial through the nearest samples; constant beyond the ends."""
        place = (np.clip(t, self.t[0], self.t[-1]) - self.t[0]) / (self.t[-1] - self.t[0]) * (len(self.t) - 1)
        return lagrange(self.x, place)

    def near(self, t: Array, lags: Array, column: int) -> tuple[Array, Array]:
        """Samples (K, P) of a column around the samples t: (K,) [s], and weights (L, P) of its values at t + lags.

        lags: (L,) [s]. Beyond the ends the column is constant.
        """
        step = (self.t[-1] - self.t[0]) / (len(self.t) - 1)
        first = int(np.floor(lags.min() / step)) - POINTS
        offsets = np.arange(first, int(np.ceil(lags.max() / step)) + POINTS)
        rows = np.rint((t - self.t[0]) / step).astype(int)[:, None] + offsets
        values = self.x[:, column].take(rows, mode="clip")
        return values, lagrange(np.eye(len(offsets)), lags / step - first)


@dataclass(frozen=True, eq=False)
class Correction(Frozen):
    """Columns and factors of n joints in a recording, and the lag of each torque column."""

    q_from: tuple[int, ...]  # (n,) column of each joint's position
    q_scale: Array  # (n,) [1] factor on the position
    tau_from: tuple[int, ...]  # (n,) column of each joint's torque
    tau_sign: Array  # (n,) [1] factor on the torque
    lag: Array  # (n,) [s] by which each column of torque is late

    @classmethod
    def none(cls, n: int) -> Correction:
        """Correction of n joints that changes nothing."""
        return cls(tuple(range(n)), np.ones(n), tuple(range(n)), np.ones(n), np.zeros(n))

    def exchange(self, order: tuple[int, ...], positions: bool = False, torques: bool = False) -> Correction:
        """Exchange columns: joint i gets those of joint order[i]."""
        at, exchanged = list(order), self
        if positions:
            exchanged = replace(exchanged, q_from=tuple(self.q_from[k] for k in at), q_scale=self.q_scale[at])
        if torques:
            exchanged = replace(exchanged, tau_from=tuple(self.tau_from[k] for k in at), tau_sign=self.tau_sign[at])
        return exchanged

    def scale(self, joints: tuple[int, ...], position: float = 1.0, torque: float = 1.0) -> Correction:
        """Multiply positions and torques of some joints by factors."""
        q, tau = (np.where(np.isin(np.arange(len(self.lag)), joints), x, 1.0) for x in (position, torque))
        return replace(self, q_scale=self.q_scale * q, tau_sign=self.tau_sign * tau)

    def earlier(self, joints: tuple[int, ...], lag: float) -> Correction:
        """Shift torques of some joints, which were recorded late by `lag` [s]."""
        late = self.lag.copy()
        late[[self.tau_from[j] for j in joints]] += lag
        return replace(self, lag=late)


class Signals(NamedTuple):
    """Signals of n joints in K rows."""

    v: Array  # (K, n) [rad/s or m/s]
    a: Array  # (K, n) [rad/s2 or m/s2]
    direction: Array  # (K, n) [1] of motion
    predicted: Array  # (K, n) [N.m or N] by the model without friction
    torque: Array  # (K, n) [N.m or N] as recorded

    def rows(self, rows: Mask | Indices) -> Signals:
        """Signals of some rows."""
        return Signals(*(signal[rows] for signal in self))


@dataclass(frozen=True, eq=False)
class FaultEvidence(Frozen):
    """K rows of n joints, and the recorded torque around them."""

    model: Model  # bodies and laws without memory, without friction
    signed: Mask  # (n,) whether torque is recorded with its sign
    rotors: Mask  # (n,) whether the model has a rotor at the joint
    q: Array  # (K, n) [rad or m]
    plain: Signals  # as recorded
    torques: tuple[Curve, ...]  # of each recording [N.m or N]
    moments: tuple[Array, ...]  # of each recording, (K_r,) times of its rows [s]
    block: Indices  # (K,) block of each row

    @property
    def robot(self) -> Robot:
        """Robot with the recorded joints."""
        return self.model.robot

    def corrected(self, correction: Correction) -> Signals:
        """Signals after a correction."""
        plain, torque = self.plain, self.late(correction.lag)[:, list(correction.tau_from)] * correction.tau_sign
        if correction.q_from == tuple(range(len(self.signed))) and np.all(correction.q_scale == 1):
            return plain._replace(torque=torque)
        motion = self.along(correction)
        direction = plain.direction[:, list(correction.q_from)] * np.sign(correction.q_scale)
        return Signals(motion.v, motion.a, direction, self.model.inverse(motion), torque)

    def along(self, correction: Correction) -> Motion:
        """Motion after a correction, with rows as samples."""
        q, v, a = (x[:, list(correction.q_from)] * correction.q_scale for x in (self.q, self.plain.v, self.plain.a))
        return Motion(self.robot, np.concatenate(self.moments), q, v, a)

    def late(self, lag: Array) -> Array:
        """Torque (K, n) [N.m or N] after the removal of lags; lag: (n,) [s] by which each column is late."""
        if not lag.any():
            return self.plain.torque
        late = np.empty_like(self.plain.torque)
        for d in np.unique(lag):
            pieces = [curve.at(t + d) for curve, t in zip(self.torques, self.moments, strict=True)]
            late[:, lag == d] = np.concatenate(pieces)[:, lag == d]
        return late


def gather(model: Model, session: Session, parts: Sequence[Part], signed: Mask | None = None) -> FaultEvidence | None:
    """Evidence from the longest stretch of each recording; None if all are too short.

    signed: (n,) joints whose torque was recorded with its sign, if the session has recovered signs.
    """
    task, most = session.task, SAMPLES // max(1, len(parts))
    frictionless = replace(model, laws=tuple(law for law in model.laws if not law.effect.dissipative))
    thin = Decimator(task.band.taps, max(1, task.band.factor // SAMPLES_PER_ROW))
    pieces = [_filtered(frictionless, task, part, thin, most) for part in parts]
    edge = round(LAG * task.band.rate / thin.factor)
    pieces = [(t, x) for t, x in pieces if len(t) > 2 * edge + BLOCKS]
    if not pieces:
        return None
    every = max(SAMPLES_PER_ROW, -(-sum(len(t) for t, _ in pieces) // ROWS))
    moments, rows = zip(*([x[edge : len(x) - edge : every] for x in piece] for piece in pieces), strict=True)
    blocks = -(-BLOCKS // len(rows))
    q, *signals = (np.ascontiguousarray(x) for x in np.split(np.concatenate(rows), SIGNALS, axis=1))
    direct = [law for law in frictionless.laws if isinstance(law.effect, BodyLaw | TorqueLaw)]
    plain = [law for law in direct if not law.effect.memory]
    rotors = model.bodies().armature @ np.abs(task.robot.drive)
    recorded = [recording.signed & np.array([bool(c) for c in recording.columns["tau"]]) for recording, _ in parts]
    recorded += [] if signed is None else [signed]
    return FaultEvidence(
        replace(frictionless, laws=tuple(plain)),
        np.asarray(np.all(recorded, axis=0)),
        np.asarray(rotors > 0),
        q,
        Signals(*signals),
        tuple(Curve(t, np.split(x, SIGNALS, axis=1)[-1]) for t, x in pieces),
        moments,
        np.concatenate([k * blocks + np.arange(len(t)) * blocks // len(t) for k, t in enumerate(moments)]),
    )


def _filtered(model: Model, task: Task, part: Part, thin: Decimator, most: int) -> tuple[Array, Array]:
    """Times (M,) and filtered q, v, a, direction, predicted and recorded torque (M, 6 n); M = 0 if it is too short."""
    samples, n = longest_piece(part, most), len(task.robot.joints)
    if len(samples.t) <= 2 * (margin(task.band, task.recorded_derivatives) + thin.half) + thin.factor:
        return np.zeros(0), np.zeros((0, SIGNALS * n))
    motion = build_motion(task.robot, samples, task.band, part[1].period, task.recorded_derivatives, task.slow)
    assert motion.recorded is not None, "recordings have torque by construction"
    torque = np.where(np.isnan(motion.recorded).any(axis=0), 0.0, motion.recorded)
    signals = (motion.q, motion.v, motion.a, motion.direction, model.inverse(motion), torque)
    return thin.at(motion.t), thin(np.concatenate(signals, axis=1))


ROUNDING = 1e-12  # [1] rounding error over the largest number
# [1] smallest standard deviation of an informative torque, over that of the second strongest, and over its own rms
WEAK, STEADY = 0.03, 0.05


class PassiveFit(NamedTuple):
    """Fits of T torques of each of n joints: gain * predicted + friction + rotor + offset, no coefficient negative.

    Only the offset may be negative.
    """

    gain: Array  # (n, T) [1] factor on the predicted torque
    unexplained: Array  # (n, T) [1] residual variance over the torque's variance
    residual: Array  # (n, K, T) [N.m or N]
    power: Array  # (n, T) [N2.m2 or N2] variance of the torque


def passive_columns(x: Signals) -> Array:
    """Columns (n, K, 4) of each joint less their means: predicted torque, viscous and Coulomb friction, and a rotor."""
    used = np.stack([x.predicted.T, x.v.T, x.direction.T, x.a.T], axis=1)
    return np.asarray(used - used.mean(axis=2, keepdims=True)).swapaxes(1, 2)


def covariances(signals: Sequence[Array], block: Indices) -> Array:
    """Covariances (B + 1, n, s, s) over all rows, then without each block (K,); signals: (K, n) [any units] each."""
    z = np.stack([signal.T for signal in signals], axis=1)
    z -= z.mean(axis=2, keepdims=True)
    blocks = [z[:, :, block == k] for k in np.unique(block)]
    parts = ([x.shape[2] * np.ones((1, 1)) for x in blocks], [x.sum(axis=2) for x in blocks])
    sums = [np.array(part)[..., None] for part in (*parts, [x @ x.swapaxes(1, 2) for x in blocks])]
    rows, mean, squares = (np.concatenate([x.sum(axis=0)[None], x.sum(axis=0) - x]) for x in sums)
    return np.asarray(squares[..., 0] / rows - mean @ mean.swapaxes(2, 3) / rows**2)


def fit_passive(x: Signals, torque: Array | None = None) -> PassiveFit:
    """Fit torques by `passive_columns` of each joint; torque: (n, K, T) [N.m or N], None: as recorded (T = 1)."""
    columns = passive_columns(x)
    y = x.torque.T[:, :, None] if torque is None else torque
    y = y - y.mean(axis=1, keepdims=True)
    across, power = columns.swapaxes(1, 2), np.einsum("jkt,jkt->jt", y, y)
    value, share = fit_products(across @ columns, across @ y, power)
    return PassiveFit(value[:, 0], share, y - columns @ value, power / y.shape[1])


def fit_products(gram: Array, right: Array, power: Array) -> tuple[Array, Array]:
    """Coefficients (n, k, T) and unexplained shares (n, T) [1] of passive fits, from products of columns and torques.

    gram: (n, k, k) [any units] of columns; right: (n, k, T) [any units] with torques; power: (n, T) [any units].
    """
    size = np.sqrt(np.maximum(np.diagonal(gram, axis1=1, axis2=2), 1e-300))[:, :, None]
    scaled, right = gram / (size * size.swapaxes(1, 2)), right / size
    value = nonnegative(scaled, right)
    rest = np.maximum(power - np.sum(value * (2 * right - scaled @ value), axis=1), 0.0)
    return value / size, np.where(power > 0, rest / np.where(power > 0, power, 1.0), 1.0)


def nonnegative(gram: Array, right: Array) -> Array:
    """Non-negative least-squares coefficients (n, k, T), by trial of all choices of coefficients that are not zero.

    gram: (n, k, k) products of columns; right: (n, k, T) products of columns and targets [any units].
    """
    count = gram.shape[-1]
    free = np.array(list(product((False, True), repeat=count)))
    both = free[:, :, None] & free[:, None, :]
    least = ROUNDING * np.max(gram, axis=(1, 2), initial=1e-280, keepdims=True)  # columns may be equal
    blocks = np.where(both, (gram + least * np.eye(count))[:, None], np.eye(count))
    value = (np.linalg.inv(blocks) * both) @ right[:, None]
    gain = np.where((value >= 0).all(axis=2), np.sum(value * right[:, None], axis=2), -np.inf)
    return np.take_along_axis(value, np.argmax(gain, axis=1)[:, None, None], axis=1)[:, 0]


def unexplained(x: Signals) -> Array:
    """Unexplained shares (n,) [1] of the torques' variances."""
    return fit_passive(x).unexplained[:, 0]


def unexplained_by_others(x: Signals) -> Array:
    """Unexplained shares (n, n, 2) [1] of each torque (second axis) and its negative by each joint's columns."""
    n, both = x.torque.shape[1], np.concatenate([x.torque, -x.torque], axis=1)
    shares = fit_passive(x, np.broadcast_to(both, (n, *both.shape))).unexplained
    return shares.reshape(n, 2, n).swapaxes(1, 2)


def agreement(before: Signals, after: Signals, block: Indices, joints: Sequence[int], moved: Sequence[int]) -> float:
    """Share [1] of the blocks in which a correction reduces the residual of some joints' torques.

    block: (K,) of each row; moved: the joints that have the same torques after the correction.
    """
    sizes = []
    for x, places in ((before, joints), (after, moved)):
        fit = fit_passive(x)
        square = np.sum(fit.residual[places, :, 0] ** 2 / fit.power[places], axis=0)
        sizes.append(np.array([square[block == k].sum() for k in np.unique(block)]))
    return float(np.mean(sizes[1] < sizes[0]))


def far_better(before: Array, after: Array, informative: Mask) -> Indices:
    """Informative joints that a correction improves much; before, after: (n,) [1] unexplained shares."""
    ratio = np.where(informative, after / np.maximum(before, 1e-300), 1.0)
    return np.flatnonzero((ratio <= REST_RATIO) & (ratio.min() <= LONE_REST_RATIO))


def informative_torques(x: Signals, signed: Mask) -> Mask:
    """Mask (n,) of joints with torque that is recorded with its sign, signed: (n,), and strong enough to inform."""
    size = np.where(signed, np.std(x.torque, axis=0), 0.0)
    strong = np.sort(size)[-2:][0] if len(size) > 2 else size.max(initial=0.0)
    rms = np.sqrt(np.mean(x.torque**2, axis=0))
    return np.asarray(signed & (size > 0) & (size >= WEAK * strong) & (size >= STEADY * rms))


SPRING = "a spring"


def missing_laws(evidence: FaultEvidence) -> Iterator[tuple[str, Array]]:
    """Each kind of missing law, in words, and the shares (n,) [1] of the torques' variances that it leaves.

    Friction, rotor and offset of every joint may have any size and sign, since a simulation may state too much of them.
    Beside these, all ten numbers of the body that one joint moves may be others: a payload, a counterbalance, a wrong
    link.
    """
    x, count, joints = evidence.plain, len(evidence.q), np.flatnonzero(evidence.signed)
    plain = [np.stack([np.ones(count), x.v[:, j], x.direction[:, j], x.a[:, j]], axis=1) for j in joints]
    size = np.maximum(np.std(x.torque, axis=0), 1e-300)
    y = [leave((x.torque - x.predicted)[:, j], plain[k]) / size[j] for k, j in enumerate(joints)]
    shares = np.ones(len(size))
    shares[joints] = np.mean(np.square(y), axis=1)
    yield "friction or a rotor of another size", shares
    for k, j in enumerate(joints):
        spring = (
            leave(leave(x.torque[:, j] - x.predicted[:, j], plain[k]), leave(evidence.q[:, [j]], plain[k])) / size[j]
        )
        yield f"{SPRING} at {evidence.robot.joints[j]}", np.where(np.arange(len(size)) == j, np.mean(spring**2), shares)
    bodies = evidence.along(Correction.none(len(size))).bodies.reshape(count, len(size), -1, len(INERTIAL))
    for moved, joint in enumerate(evidence.robot.joints):
        columns = bodies[:, :, own_body(evidence.robot, moved)]
        beyond = [leave(columns[:, j], plain[k]) / size[j] for k, j in enumerate(joints)]
        rest = leave(np.concatenate(y), np.concatenate(beyond)).reshape(len(joints), count)
        shares = shares.copy()
        shares[joints] = np.mean(rest**2, axis=1)
        yield f"another body than stated at the link that {joint} moves", shares


class Amount(NamedTuple):
    """Amount of data."""

    rows: int  # filtered rows of all recordings with new information
    unknowns: int  # of the joint with most of them
    seconds: float  # [s] of training data
    needed: float  # [s] of training data needed for `PER_UNKNOWN`
    whole: float  # [s] of training data and held-out data of the same recordings

    @property
    def enough(self) -> bool:
        """Whether there are enough rows to distinguish noise from unknowns."""
        return self.rows >= PER_UNKNOWN * self.unknowns


def judge_amount(session: Session, parts: Sequence[Part]) -> Amount:
    """Number of filtered rows and of unknowns."""
    band, task = session.task.band, session.task
    reach = consumed(band, task.recorded_derivatives)
    lengths = [s.length(span) for _, s in parts for span in s.spans]
    density, lost = 2 * min(band.cutoff, max(MOTION, band.cutoff / BEYOND)), len(lengths) * reach / band.rate
    rows = sum(int(max(0, length - reach) / band.rate * density) for length in lengths)
    unknowns = max((len(task.seen(j)) for j in range(len(task.robot.joints))), default=0)
    seconds, wanted = sum(s.duration for _, s in parts), PER_UNKNOWN * unknowns
    rest = sum(s.duration for r, s in session.held_out if any(r is used and s is not other for used, other in parts))
    needed = max(wanted / density + lost, seconds * wanted / max(rows, 1))
    return Amount(rows, unknowns, seconds, needed, seconds + rest)


def amount_fault(amount: Amount, joints: int) -> RecordingFault:
    """Fault of too little data to distinguish noise from unknowns."""
    training = "" if amount.whole == amount.seconds else " of training data"
    fact = f"{amount.seconds:.3g} s{training} of {joints} joint{'s' if joints > 1 else ''} are too little"
    why = f"{amount.rows} filtered rows per joint for {amount.unknowns} unknowns are too few to estimate the noise"
    measures = {"rows": float(amount.rows), "unknowns": float(amount.unknowns), "needed": amount.needed}
    share = amount.whole / amount.seconds if amount.seconds else 1.0
    advice = f"record for {np.ceil(SPARE * share * amount.needed):.0f} s or more"
    return RecordingFault("too little data", (), REFUSE, measures, f"{fact}: {why}; {advice}")
