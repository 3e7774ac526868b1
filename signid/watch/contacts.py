"""Contacts by the residual of the observer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..model import Model
from ..robot import configuration
from ..robot.dynamics import own_body, point_jacobian
from ..types import Array
from .events import Contact
from .observer import GAIN

LEAVE = 0.5  # [1] share of the threshold below which a contact ends
LASTING = 0.004  # [s] above the threshold before a contact begins
APART = 0.1  # [s] below `LEAVE` before a contact ends
LOADED = 0.25  # [1] share of the threshold above which a joint is listed beside those that exceed it
FEWEST = 3  # joints that a direction of the force needs


class Contacts:
    """State of the contact that is going on."""

    def __init__(self, model: Model) -> None:
        self.robot = model.robot
        self.bodies = model.bodies()
        self.data = self.bodies.createData()
        self.above = self.below = self.peak = 0.0
        self.before: float | None = None  # [s] time of the last block
        self.begun: Contact | None = None
        self.most: tuple[float, Array, Array, Array] | None = (
            None  # ratio, of each joint, residual, position at the largest moment
        )

    def restart(self) -> None:
        """Begin a new stretch."""
        self.above, self.below, self.before = 0.0, 0.0, None

    def find(self, t: Array, r: Array, ratio: Array, q: Array, late: float) -> list[Contact]:
        """Events of K blocks.

        t: (K,) [s]; r: (K, n) residual [N.m or N]; ratio: (K, n) of it to its threshold [1]; q: (K, n) [rad or m];
        late: delay of the blocks [s].
        """
        largest = ratio.max(axis=1)
        before, self.before = self.before, float(t[-1])
        if self.begun is None and not (largest > 1).any():
            self.above = 0.0
            return []
        events: list[Contact] = []
        before = float(t[0]) if before is None else before
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

    def close(self, t: float, end: float, cause: str | None = None) -> Contact:
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
