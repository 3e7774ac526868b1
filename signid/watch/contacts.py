"""Momentum observer, and contacts by its residual."""

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
from ..robot.dynamics import own_body, point_jacobian
from ..types import Array, Law, Mask
from .blocks import HALF, Blocks
from .events import Contact

USUAL = ("viscous_friction", "coulomb_friction", "torque_offset")  # computed for all joints at once
SLOWED = ("time_delay", "torque_lag")  # laws with a memory along time: not used
STATIC = 1.3  # [1] friction at standstill over that in motion: Armstrong-Helouvry et al., Automatica 30(7), 1994
GAIN = 50.0  # [1/s] of the observer: its residual follows a contact with a time constant of 20 ms
SIGMAS = 6.0  # [standard deviations] threshold: below one false alarm per day of seven joints for Gaussian noise
PEAK = 1.5  # [1] threshold over the largest residual of the quiet stretch
LEAVE = 0.5  # [1] share of the threshold below which a contact ends
LASTING = 0.004  # [s] above the threshold before a contact begins
APART = 0.1  # [s] below `LEAVE` before a contact ends
LOADED = 0.25  # [1] share of the threshold above which a joint is listed beside those that exceed it
FEWEST = 3  # joints that a direction of the force needs


class Residual(NamedTuple):
    """K blocks of n joints."""

    motion: Motion  # at the middle of each block
    predicted: Array  # (K, n) [N.m or N]
    residual: Array  # (K, n) [N.m or N] measured minus predicted
    near: Mask  # (K, n) whether the direction of friction is uncertain
    uncertain: Array  # (K, n) [N.m or N] largest error of friction there


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
        self.level = {name: np.zeros(len(self.robot.joints)) for name in USUAL}
        self.others: list[Law] = []
        self.ignored: list[str] = []
        recorded: list[Law] = []
        for law in model.laws:
            name = law.effect.name
            if name in USUAL:
                self.level[name][law.joints[0]] += law.effect.coefficients(law.parameters)[0]
            elif isinstance(law.effect, TransmissionLaw) or name in SLOWED or getattr(law.effect, "memory", False):
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
        """Measured minus predicted torque of each block, with the uncertainty of friction at low speed."""
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
        near = np.abs(v) < self.slow + HALF * np.abs(acceleration)
        uncertain = np.where(near, (STATIC + np.abs(motion.direction)) * reversing, 0.0)
        return Residual(motion, predicted, tau - predicted, near, uncertain)

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


class Contacts:
    """State of the observer and of the contact that is going on."""

    def __init__(self, model: Model) -> None:
        self.model, self.robot, n = model, model.robot, len(model.robot.joints)
        self.bodies = model.bodies()
        self.data = self.bodies.createData()
        self.r, self.margin = np.zeros(n), np.zeros(n)
        self.above = self.below = self.peak = 0.0
        self.begun: Contact | None = None
        self.most: tuple[float, Array, Array, Array] | None = (
            None  # ratio, of each joint, residual, position at the largest moment
        )

    def restart(self) -> None:
        """Begin a new stretch: the observer is empty."""
        self.r[:], self.margin[:] = 0.0, 0.0
        self.above = self.below = 0.0

    def filtered(self, residual: Array, uncertain: Array, step: float) -> tuple[Array, Array]:
        """Residual (K, n) of the observer and the part (K, n) of it that uncertain friction can cause [N.m or N].

        residual: (K, n) of blocks [N.m or N]; uncertain: (K, n) largest error of friction [N.m or N]; step: [s].
        """
        keep = float(np.exp(-GAIN * step))
        powers = np.power(keep, np.arange(1.0, len(residual) + 1.0))[:, None]
        out = []
        for x, state in ((residual, self.r), (uncertain, self.margin)):
            y = _first_order(x, keep, powers, state)
            state[:] = y[-1]
            out.append(y)
        return out[0], out[1]

    def find(self, t: Array, r: Array, margin: Array, threshold: Array, q: Array, late: float) -> list[Contact]:
        """Events of K blocks.

        t: (K,) [s]; r: (K, n) residual, margin: (K, n) and threshold: (n,) of it [N.m or N]; q: (K, n) [rad or m];
        late: delay of the blocks [s].
        """
        ratio = np.maximum(np.abs(r) - margin, 0.0) / threshold
        largest = ratio.max(axis=1)
        if self.begun is None and not (largest > 1).any():
            self.above = 0.0
            return []
        events: list[Contact] = []
        before = float(t[0] - (t[1] - t[0])) if len(t) > 1 else float(t[0])
        for k, (now, size) in enumerate(zip(t.tolist(), largest.tolist(), strict=True)):
            step, before = max(now - before, 0.0), now
            if self.begun is None:
                self.above = self.above + step if size > 1 else 0.0
                if size > 1 and self.above >= min(LASTING, step * 1.5):
                    rise = min(1.0, 1.0 / max(size, 1.0)) / GAIN  # [s] a constant torque needs to reach the threshold
                    begin = now - self.above - float(rise)
                    self.begun = self._contact(now + late, ratio[k], r[k], q[k], begin)
                    self.most, self.below = (size, ratio[k].copy(), r[k].copy(), q[k].copy()), 0.0
                    self.peak = now
                    events.append(self.begun)
                continue
            assert self.most is not None, "it is set with `begun`"
            if size > self.most[0]:
                self.most, self.peak = (size, ratio[k].copy(), r[k].copy(), q[k].copy()), now
            self.below = self.below + step if size < LEAVE else 0.0
            if self.below >= APART:
                events.append(self.close(now + late, self._end(now)))
        return events

    def _end(self, now: float) -> float:
        """End of the force [s]: before the decay of the residual, and not before its largest moment."""
        assert self.most is not None, "a contact is going on"
        return max(now - self.below - float(np.log(self.most[0] / LEAVE)) / GAIN, self.peak)

    def close(self, t: float, end: float, cause: str = "") -> Contact:
        """End of the contact, with its largest torque."""
        assert self.begun is not None and self.most is not None, "a contact is going on"
        _, ratio, r, q = self.most
        begun, self.begun, self.above = self.begun, None, 0.0
        ended = self._contact(t, ratio, r, q, begun.start)
        names = self.robot.joints
        listed = {*begun.joints, *ended.torque}
        torque = {name: float(x) for name, x in zip(names, r, strict=True) if name in listed}
        return replace(ended, torque=torque, end=max(end, begun.start), cause=cause)

    def _contact(self, t: float, ratio: Array, r: Array, q: Array, start: float) -> Contact:
        names = self.robot.joints
        over = np.flatnonzero(ratio > 1)
        loaded = over if len(over) else np.array([int(np.argmax(ratio))])
        torque = {names[j]: float(r[j]) for j in np.flatnonzero(ratio > LOADED)}
        body = own_body(self.robot, int(loaded.max()))
        return Contact(
            t,
            tuple(names[j] for j in loaded),
            self.robot.links[body],
            torque,
            self._direction(body, q, r) if loaded.max() + 1 >= FEWEST else None,
            start,
        )

    def _direction(self, body: int, q: Array, r: Array) -> tuple[float, float, float] | None:
        """Direction in the world of a force at the centre of mass of a body that loads the joints by r."""
        position = configuration(self.robot, q[None])[0]
        lever = self.bodies.inertias[body + 1].lever
        jacobian = point_jacobian(self.bodies, self.data, position, body + 1, lever) @ self.robot.drive
        force = np.linalg.lstsq(jacobian.T, -r, rcond=1e-3)[0]
        size = float(np.linalg.norm(force))
        return None if not size > 0 else (float(force[0] / size), float(force[1] / size), float(force[2] / size))


def _first_order(x: Array, keep: float, powers: Array, state: Array) -> Array:
    """First-order low-pass (K, n) of x (K, n) from a state (n,)."""
    from scipy.signal import lfilter  # slow to import

    return np.asarray(lfilter([1 - keep], [1.0, -keep], x, axis=0) + powers * state)
