"""Session and model -> evidence for recording faults: up to 1500 rows, and their signals after a correction."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..effects.base import BodyLaw, TorqueLaw
from ..model import Model
from ..regression.bandwidth import Decimator
from ..regression.motion import Motion, build_motion, margin
from ..regression.rows import Task
from ..regression.session import Part, Session, longest_piece
from ..types import Array, Frozen, Indices, Mask, Robot

SAMPLES = 2**16  # largest number of samples of all recordings together
FINE = 4  # samples of the filtered torque per row of identification, for lags between rows
ROWS = 1500  # largest number of rows of all recordings together
BLOCKS = 8  # smallest number of blocks of all recordings; a fault must show in most of them
LAG = 0.25  # [s] longest lag
# Nodes of the interpolating polynomial. Measured error: 3 % for a sine of four samples per period, 0.05 % for eight
NODES = 6
SIGNALS = 6  # position, and those of `Signals`


@dataclass(frozen=True, eq=False)
class Curve(Frozen):
    """Uniform samples of n signals."""

    t: Array  # (M,) [s]
    x: Array  # (M, n) [any unit]

    def at(self, t: Array) -> Array:
        """Values (K, n) at t: (K,) [s] by the polynomial through the nearest samples; constant beyond the ends."""
        count, last = min(NODES, len(self.t)), len(self.t) - 1
        place = (np.clip(t, self.t[0], self.t[-1]) - self.t[0]) / (self.t[-1] - self.t[0]) * last
        start = np.clip(np.floor(place).astype(np.intp) - count // 2 + 1, 0, last + 1 - count)
        nodes, off = np.arange(count), place - start
        value = np.zeros((len(t), self.x.shape[1]))
        for k in nodes:
            others = nodes[nodes != k]
            weight = np.prod((off[:, None] - others) / (k - others), axis=1)
            value += weight[:, None] * self.x[start + k]
        return value


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
        at, found = list(order), self
        if positions:
            found = replace(found, q_from=tuple(self.q_from[k] for k in at), q_scale=self.q_scale[at])
        if torques:
            found = replace(found, tau_from=tuple(self.tau_from[k] for k in at), tau_sign=self.tau_sign[at])
        return found

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


def gather(model: Model, session: Session, parts: Sequence[Part]) -> FaultEvidence | None:
    """Evidence from the longest stretch of each recording; None if all are too short."""
    task, most = session.task, SAMPLES // max(1, len(parts))
    frictionless = replace(model, laws=tuple(law for law in model.laws if not law.effect.dissipative))
    thin = Decimator(task.band.taps, max(1, task.band.factor // FINE))
    pieces = [_filtered(frictionless, task, part, thin, most) for part in parts]
    edge = round(LAG * task.band.rate / thin.factor)
    pieces = [(t, x) for t, x in pieces if len(t) > 2 * edge + BLOCKS]
    if not pieces:
        return None
    every = max(FINE, -(-sum(len(t) for t, _ in pieces) // ROWS))
    moments, rows = zip(*([x[edge : len(x) - edge : every] for x in piece] for piece in pieces), strict=True)
    each = -(-BLOCKS // len(rows))
    q, *signals = (np.ascontiguousarray(x) for x in np.split(np.concatenate(rows), SIGNALS, axis=1))
    direct = [law for law in frictionless.laws if isinstance(law.effect, BodyLaw | TorqueLaw)]
    plain = [law for law in direct if not law.effect.memory]
    rotors = model.bodies().armature @ np.abs(task.robot.drive)
    recorded = [recording.signed & np.array([bool(c) for c in recording.columns["tau"]]) for recording, _ in parts]
    return FaultEvidence(
        replace(frictionless, laws=tuple(plain)),
        np.asarray(np.all(recorded, axis=0)),
        np.asarray(rotors > 0),
        q,
        Signals(*signals),
        tuple(Curve(t, np.split(x, SIGNALS, axis=1)[-1]) for t, x in pieces),
        moments,
        np.concatenate([k * each + np.arange(len(t)) * each // len(t) for k, t in enumerate(moments)]),
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
