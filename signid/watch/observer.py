"""Residual of blocks -> residual of the momentum observer, with the signals that its thresholds need.

For lasting changes, blocks become frames of 20 ms: residual, columns of possible changes, error of the model there.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin

from ..effects.base import BodyLaw, RecordingLaw, TransmissionLaw
from ..effects.bodies import add_body
from ..effects.law import law_torque
from ..model import Model
from ..regression.motion import Motion
from ..robot import configuration
from ..robot.dynamics import own_body
from ..types import Array, Law, Mask
from .intake import VELOCITY_HALF_WINDOW, Blocks

OBSERVER_GAIN = 50.0  # [1/s] of the observer: its residual follows a contact with a time constant of 20 ms
RINGING_TIME = 0.15  # [s] for which a sudden change of torque is remembered: links and gears swing after it
COMMON_EFFECTS = ("viscous_friction", "coulomb_friction", "torque_offset")  # computed for all joints at once
LAG_EFFECTS = ("time_delay", "torque_lag")  # laws with a memory along time: not used
# friction of a joint that begins to creep, over that in motion: Armstrong-Helouvry et al., Automatica 30(7), 1994
CREEP_FRICTION_GROWTH, CREEP_SPEED_RATIO = 0.5, 3.0  # [1] its excess, and the multiple of the slow speed where it fades
FRAME_DURATION = 0.02  # [s] duration of a frame
JOINT_COLUMNS = ("viscous_friction", "coulomb_friction", "torque_gain", "torque_offset")  # then the payload
PAYLOAD_COLUMNS = ("mass", "first_moment_x", "first_moment_y", "first_moment_z")
LINK_COLUMNS = 10  # columns of the last link: PAYLOAD_COLUMNS, then its inertia
FRAME_COLUMNS = len(JOINT_COLUMNS) + LINK_COLUMNS
UNSEEN_ERROR_RATIO = 1.0  # [1] error over value of a base parameter that the identification could not see


class Observed(NamedTuple):
    """K blocks of n joints after the observer."""

    residual: Array  # (K, n) [N.m or N]
    columns: Array  # (K, 4, n) [rad/s or m/s, 1, N.m or N, 1] of the changes of a joint's own laws: frames.LOCAL
    low: Array  # (K, n) [N.m or N] least residual that unknown friction leaves
    high: Array  # (K, n) [N.m or N] the largest
    rate: Array  # (K, n) [N.m/s or N/s] of the predicted torque, its largest of the last moments
    friction: Array  # (K, n) [N.m or N] size of the predicted friction

    def beyond(self, base: Array) -> tuple[Array, Array]:
        """Residual (K, n) without known changes, and what friction cannot explain of it (K, n) [N.m or N].

        base: (n, 4) coefficients of the columns [units of the laws].
        """
        r = self.residual - np.einsum("kcn,nc->kn", self.columns, base)
        return r, np.maximum(np.maximum(r - self.high, self.low - r), 0.0)


class Observer:
    """First-order filter of the residual: De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IEEE/RSJ IROS 2006."""

    def __init__(self, joints: int) -> None:
        self.state, self.rate, self.empty = np.zeros((9, joints)), np.zeros(joints), True

    def restart(self) -> None:
        """Begin a new stretch: the residual is zero, but what its thresholds need is as it was."""
        self.state[:], self.empty = 0.0, True

    def observe(self, found: Residual, step: float) -> Observed:
        """Blocks of `step` [s] through the filter."""
        from scipy.signal import lfilter  # slow to import

        motion, predicted = found.motion, found.predicted
        signals = (motion.v, motion.direction, predicted, np.ones_like(predicted))
        given = np.stack([found.residual, *signals, found.low, found.high, found.friction, predicted], axis=1)
        if self.empty:
            self.state[7:], self.empty = given[0, 7:], False
        keep, count = float(np.exp(-OBSERVER_GAIN * step)), len(given)
        powers = np.power(keep, np.arange(1.0, count + 1.0))
        whole = lfilter([1 - keep], [1.0, -keep], given, axis=0) + powers[:, None, None] * self.state
        self.state = whole[-1]
        fade = np.exp(-step / RINGING_TIME * np.arange(1.0, count + 1.0))[:, None]
        rate = OBSERVER_GAIN * np.abs(predicted - whole[:, 8])  # derivative of the filtered torque
        rate = fade * np.maximum.accumulate(np.maximum(rate / fade, self.rate), axis=0)
        self.rate = rate[-1]
        return Observed(whole[:, 0], whole[:, 1:5], whole[:, 5], whole[:, 6], rate, whole[:, 7])


class Residual(NamedTuple):
    """K blocks of n joints."""

    motion: Motion  # at the middle of each block
    predicted: Array  # (K, n) [N.m or N]
    residual: Array  # (K, n) [N.m or N] measured minus predicted
    near: Mask  # (K, n) whether the direction of friction is uncertain
    low: Array  # (K, n) [N.m or N] least residual that friction of any direction, or of a joint at rest, leaves there
    high: Array  # (K, n) [N.m or N] the largest
    friction: Array  # (K, n) [N.m or N] size of the predicted friction


class Momentum:
    """Bodies and laws of a model, prepared for blocks.

    Source: De Luca, Albu-Schaeffer, Haddadin, Hirzinger, IEEE/RSJ IROS 2006; Haddadin, De Luca, Albu-Schaeffer, IEEE
    T-RO 33(6), 2017.
    """

    def __init__(self, model: Model) -> None:
        self.robot = model.robot
        self.bodies = model.bodies()
        rotors, self.bodies.armature = self.bodies.armature.copy(), np.zeros(self.bodies.nv)
        self.rotors = np.asarray((self.robot.drive * rotors[:, None]).T @ self.robot.drive)
        self.weightless = self.bodies.copy()
        self.weightless.gravity = pin.Motion.Zero()
        self.data, self.light = self.bodies.createData(), self.weightless.createData()
        self.level = {name: np.zeros(len(self.robot.joints)) for name in COMMON_EFFECTS}
        self.others: list[Law] = []
        self.ignored: list[str] = []
        recorded: list[Law] = []
        for law in model.laws:
            name = law.effect.name
            if name in COMMON_EFFECTS:
                self.level[name][law.joints[0]] += law.effect.coefficients(law.parameters)[0]
            elif isinstance(law.effect, TransmissionLaw) or name in LAG_EFFECTS or getattr(law.effect, "memory", False):
                self.ignored.append(name)
            elif isinstance(law.effect, RecordingLaw):
                recorded.append(law)
            elif not isinstance(law.effect, BodyLaw):
                self.others.append(law)
        self.recorded = replace(model, laws=tuple(recorded)) if recorded else None
        self.grown = np.zeros(len(self.robot.joints))  # (n,) [N.m or N] change of Coulomb friction since then
        self.slow = np.zeros(len(self.robot.joints))  # (n,) [rad/s or m/s]

    def load(self, inertial: Array) -> None:
        """Add a payload to the last link.

        inertial: (10,) in Pinocchio's order [kg, kg.m, kg.m2].
        """
        tip = own_body(self.robot, len(self.robot.joints) - 1) + 1
        for bodies in (self.bodies, self.weightless):
            add_body(bodies, tip, [float(x) for x in inertial])

    def residual(self, blocks: Blocks) -> Residual:
        """Measured minus predicted torque of each block, with what unknown friction at low speed can leave."""
        if self.recorded is not None:
            motion = Motion(self.robot, blocks.t, blocks.q, blocks.v, np.zeros_like(blocks.v), blocks.tau)
            acted = self.recorded.acted(motion)
            assert acted.recorded is not None, "it had torque before"
            blocks = blocks._replace(q=acted.q, tau=acted.recorded)
        momentum, force = self._terms(blocks)
        step, tau = blocks.step, _middle(blocks.tau)
        rigid = np.diff(momentum, axis=0) / step - _middle(force)
        acceleration = np.diff(blocks.v, axis=0) / step
        middle = blocks.t[:-1] + step[:, 0] / 2
        q, v = _middle(blocks.q), _middle(blocks.v)
        motion = Motion(self.robot, middle, q, v, acceleration, tau, slow=np.maximum(self.slow, 1e-9))
        vars(motion)["load"] = rigid
        laws, reversing = self._laws(motion)
        predicted = rigid + acceleration @ self.rotors + laws
        near = np.abs(v) < self.slow + VELOCITY_HALF_WINDOW * np.abs(acceleration)
        low, high = (np.where(near, side - motion.direction, 0.0) for side in (-1.0, 1.0))
        more = CREEP_FRICTION_GROWTH * np.abs(motion.direction) * np.exp(-np.abs(v) / (CREEP_SPEED_RATIO * self.slow))
        friction = np.abs(self.level["viscous_friction"] * v) + reversing
        low, high = (low - more) * reversing, (high + more) * reversing
        return Residual(motion, predicted, tau - predicted, near, low, high, friction)

    def _terms(self, blocks: Blocks) -> tuple[Array, Array]:
        """Momentum M v and C' v - g of the bodies at each edge, (K+1, n) each."""
        position, rate = configuration(self.robot, blocks.q), blocks.v @ self.robot.drive.T
        nv = self.bodies.nv
        momentum, force, still = np.empty((len(position), nv)), np.empty((len(position), nv)), np.zeros(nv)
        rnea: Callable[..., Array] = pin.rnea
        for i, (q, v) in enumerate(zip(position, rate, strict=True)):
            momentum[i] = rnea(self.weightless, self.light, q, still, v)
            np.dot(v, pin.computeCoriolisMatrix(self.bodies, self.data, q, v), out=force[i])
            force[i] -= pin.computeGeneralizedGravity(self.bodies, self.data, q)
        return momentum @ self.robot.drive, force @ self.robot.drive

    def _laws(self, motion: Motion) -> tuple[Array, Array]:
        """Torque of all laws (K, n), and the size of friction that changes sign with the direction (K, n)."""
        level = self.level
        torque = level["viscous_friction"] * motion.v + level["coulomb_friction"] * motion.direction
        torque += level["torque_offset"]
        reversing = np.broadcast_to(np.abs(level["coulomb_friction"]) + self.grown, torque.shape).copy()
        full = replace(motion, v=np.where(motion.v < 0, -1.0, 1.0) * np.maximum(np.abs(motion.v), self.slow))
        vars(full)["load"] = motion.load
        for law in self.others:
            rows, added = law_torque(law, motion)
            torque[:, list(rows)] += added
            if law.effect.reverses:
                rows, added = law_torque(law, full)
                reversing[:, list(rows)] += np.abs(added)
        return torque, reversing

    def regressor(self, q: Array, v: Array, a: Array) -> Array:
        """Regressor (F, n, nb, 10) of the bodies [N.m or N per kg, kg.m, kg.m2].

        q: (F, n) [rad or m]; v: (F, n) [rad/s or m/s]; a: (F, n) [rad/s2 or m/s2].
        """
        position, drive = configuration(self.robot, q), self.robot.drive
        out = np.empty((len(q), self.bodies.nv, 10 * (self.bodies.njoints - 1)))
        for i, state in enumerate(zip(position, v @ drive.T, a @ drive.T, strict=True)):
            out[i] = pin.computeJointTorqueRegressor(self.bodies, self.data, *state)
        return np.asarray((drive.T @ out).reshape(len(q), drive.shape[1], -1, 10))


def _middle(x: Array) -> Array:
    return (x[1:] + x[:-1]) / 2


class Frames(NamedTuple):
    """F frames of n joints."""

    t: Array  # (F,) [s] end of each frame
    residual: Array  # (F, n) [N.m or N]
    columns: Array  # (F, n, 14) [N.m or N per unit]: JOINT_COLUMNS, then those of the last link
    usable: Array  # (F, n) [1] False where the direction of friction is uncertain
    moving: Array  # (F, n) [1] whether it is faster than that
    errors: Array  # (F, n, b) [N.m or N] of the predicted torque by each error of the model of one standard deviation
    std: Array  # (F, n) [N.m or N] of the predicted torque by all of them
    blocks: int  # blocks of a frame


class Framer:
    """Blocks that wait for their frame, and the factor of the model's covariance."""

    def __init__(self, model: Model, momentum: Momentum) -> None:
        self.momentum, self.robot = momentum, model.robot
        self.tip = own_body(model.robot, len(model.robot.joints) - 1)
        self.factor, self.friction = _factor(model)
        self.waiting: list[Array] = []
        self.blocks = 0

    def narrow(self, spread: Array) -> None:
        """Errors of the model from now on, as the quiet stretch left them.

        spread: (b, b) factor of their covariance [1].
        """
        self.factor = self.factor @ spread
        self.friction = [(rows, factors @ spread) for rows, factors in self.friction]

    def restart(self) -> None:
        """Begin a new stretch."""
        self.waiting = []

    def frames(self, found: Residual) -> Frames | None:
        """Complete frames, with the blocks that waited."""
        motion = found.motion
        n = motion.q.shape[1]
        if not self.blocks:
            step = float(np.diff(motion.t).mean()) if len(motion.t) > 1 else FRAME_DURATION
            self.blocks = max(1, round(FRAME_DURATION / max(step, 1e-9)))
        signals = (motion.q, motion.v, motion.a, motion.direction, found.predicted, found.residual, found.near)
        table = np.column_stack([motion.t, *signals])
        if self.waiting:
            table = np.concatenate([*self.waiting, table])
        count = len(table) // self.blocks
        self.waiting = [table[count * self.blocks :]]
        if not count:
            return None
        whole = table[: count * self.blocks].reshape(count, self.blocks, -1)
        mean = whole.mean(axis=1)
        q, v, a, direction, predicted, residual, near = np.split(mean[:, 1:], 7, axis=1)
        bodies = self.momentum.regressor(q, v, a)
        columns = np.empty((count, n, FRAME_COLUMNS))
        for k, signal in enumerate((v, direction, predicted, np.ones_like(v))):
            columns[:, :, k] = signal
        columns[:, :, len(JOINT_COLUMNS) :] = bodies[:, :, self.tip]
        errors = self._errors(bodies, v, direction)
        std = np.linalg.norm(errors, axis=2)
        moving = np.abs(v) > self.momentum.slow
        return Frames(whole[:, -1, 0], residual, columns, near == 0, moving, errors, std, self.blocks)

    def _errors(self, bodies: Array, v: Array, direction: Array) -> Array:
        """Errors (F, n, b) of the predicted torque by the covariance of the model [N.m or N]."""
        count, n = v.shape
        errors = bodies.reshape(count, n, -1) @ self.factor
        for signal, (rows, factors) in zip((v, direction, np.ones_like(v)), self.friction, strict=False):
            errors[:, rows] += signal[:, rows, None] * factors
        return errors


def _factor(model: Model) -> tuple[Array, list[tuple[list[int], Array]]]:
    """Factor (10 nb, b) of the covariance of inertials, and those of viscous, Coulomb friction and offsets."""
    known = model.covariance
    if known is None or not len(known.values):
        return np.zeros((10 * len(model.robot.links), 0)), []
    matrix = np.array(known.matrix)
    lost = ~np.isfinite(np.diag(matrix))
    matrix[lost, :] = matrix[:, lost] = 0.0
    matrix[lost, lost] = (UNSEEN_ERROR_RATIO * known.values[lost]) ** 2
    size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    values, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    root = size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
    whole = np.linalg.pinv(known.combination) @ root
    place = {label: k for k, label in enumerate(known.labels)}
    friction = []
    for name in ("viscous_friction", "coulomb_friction", "torque_offset"):
        rows = [j for j, number in enumerate(model.robot.numbers) if f"{name}_{number}" in place]
        factors = whole[[place[f"{name}_{model.robot.numbers[j]}"] for j in rows]]
        friction.append((rows, factors.reshape(len(rows), -1)))
    return whole[: 10 * len(model.robot.links)], friction
