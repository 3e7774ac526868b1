"""The momentum observer's residual -> contacts, by thresholds that follow from noise and covariance."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..model import Model
from ..robot import configuration
from ..robot.dynamics import own_body, point_jacobian
from ..types import Array
from .events import Contact

GAIN = 50.0  # [1/s] of the observer: its residual follows a contact with a time constant of 20 ms
SIGMAS = 6.0  # [standard deviations] threshold: below one false alarm per day of seven joints for Gaussian noise
PEAK = 1.5  # [1] threshold over the largest residual of the quiet stretch
LEAVE = 0.5  # [1] share of the threshold below which a contact ends
LASTING = 0.004  # [s] above the threshold before a contact begins
APART = 0.1  # [s] below `LEAVE` before a contact ends
LOADED = 0.25  # [1] share of the threshold above which a joint is listed beside those that exceed it
FEWEST = 3  # joints that a direction of the force needs


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
                    begin = now - self.above - _rise(size)
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


def _rise(size: float) -> float:
    """Time [s] that a constant torque needs to reach the threshold, which it exceeds by now."""
    return float(min(1.0, 1.0 / max(size, 1.0)) / GAIN)


def _first_order(x: Array, keep: float, powers: Array, state: Array) -> Array:
    """First-order low-pass (K, n) of x (K, n) from a state (n,)."""
    from scipy.signal import lfilter  # slow to import

    return np.asarray(lfilter([1 - keep], [1.0, -keep], x, axis=0) + powers * state)
