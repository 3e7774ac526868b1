"""States at which laws are evaluated in a simulation step: trials of one instant, for B copies of a robot."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...types import Array, Indices, View
from .dynamics import Dynamics

NONE = np.empty(0, dtype=np.intp)


class Unknown:
    """Quantities of a view that are unknown in a simulation step."""

    @property
    def torque(self) -> Array:
        """Motor torque (..., c) [N.m or N], unknown in a step.

        Raises:
            AttributeError: always.
        """
        raise AttributeError("the motor torque is unknown in a simulation step; write the law without it")

    recorded = torque

    def __getitem__(self, i: Any) -> View:
        raise TypeError("a moment is a single sample and cannot be indexed")


class Moment(Unknown):
    """R trials of B states of c coordinates; costly quantities are computed on first use.

    It also is the view of a law that acts on all coordinates.
    """

    soft, flex, at = NONE, NONE, ...

    def __init__(self, dynamics: Dynamics, copies: int) -> None:
        count = dynamics.bodies.drive.shape[1]
        self.dynamics, self.dt, self.t = dynamics, 0.0, np.zeros((1, copies, 1))
        self.joints, self.whole = tuple(range(count)), self
        self.q = self.v = self.direction = np.zeros((1, copies, count))  # (R, B, c) [rad], [rad/s], [1]
        self.inertia = np.zeros((copies, count))  # (B, c) [kg.m2]
        self.rest()
        self._load: Array | None = None
        self._jacobian: Array | None = None

    def rest(self) -> None:
        """Set the acceleration to zero."""
        still = np.zeros_like(self.inertia)
        self.changed(still, still, 1.0)

    def changed(self, before: Array, after: Array, dt: float) -> None:
        """Store the change of velocity in the last step, from which the acceleration follows.

        Args:
            before: (B, c) [rad/s or m/s].
            after: (B, c) [rad/s or m/s].
            dt: duration of that step [s].
        """
        self._step = before, after, dt

    @property
    def a(self) -> Array:
        """Acceleration (B, c) of the last step [rad/s2 or m/s2]."""
        before, after, dt = self._step
        return (after - before) / dt

    def cut(self, signal: Array) -> Array:
        """All coordinates of a signal.

        Args:
            signal: (..., c) [any unit].
        """
        return signal

    def set(self, t: float | Array, dt: float, q: Array, v: Array, direction: Array) -> None:
        """Set the trials; the first one is the state.

        Args:
            t: time () or (B,) [s].
            dt: duration of the coming step [s].
            q: (R, B, c) [rad or m].
            v: (R, B, c) [rad/s or m/s].
            direction: (R, B, c) [1].
        """
        self.t[0, :, 0], self.dt, self.q, self.v, self.direction = t, dt, q, v, direction
        self._load = self._jacobian = None

    @property
    def load(self) -> Array:
        """Rigid-body torque (B, c) of the state, at the acceleration of the last step [N.m or N]."""
        if self._load is None:
            self._load = self.dynamics.load(self.q[0], self.v[0], self.a)
        return self._load

    @property
    def jacobian(self) -> Array:
        """Jacobian (B, 3, n) of the last link's centre of mass, one column per joint [m/rad or 1]."""
        if self._jacobian is None:
            self._jacobian = self.dynamics.jacobian(self.q[0])
        return self._jacobian


class MomentView(Unknown):
    """View of some coordinates of a moment; with `soft`, positions are those of the links behind elastic joints."""

    def __init__(self, whole: Moment, index: Indices, joints: tuple[int, ...], soft: Indices, flex: Indices) -> None:
        self.whole, self.joints = whole, joints
        first, last = int(index[0]), int(index[-1])
        run = np.array_equal(index, np.arange(first, last + 1))
        self.at = (..., slice(first, last + 1) if run else index)
        self.soft, self.flex = soft, flex

    def cut(self, signal: Array) -> Array:
        """Coordinates (..., m) of a signal.

        Args:
            signal: (..., c) [any unit].
        """
        if not len(self.soft):
            return np.asarray(signal[self.at])
        out = signal[self.at].copy()
        out[..., self.soft] += signal[..., self.flex]
        return out

    @property
    def dt(self) -> float:
        return self.whole.dt

    @property
    def t(self) -> Array:  # (1, B, 1) [s]
        return self.whole.t

    @property
    def q(self) -> Array:
        return self.cut(self.whole.q)

    @property
    def v(self) -> Array:
        return self.cut(self.whole.v)

    @property
    def a(self) -> Array:
        return self.cut(self.whole.a)

    @property
    def load(self) -> Array:  # the motor of an elastic joint carries the load of its link
        return np.asarray(self.whole.load[self.at])

    @property
    def direction(self) -> Array:
        return np.asarray(self.whole.direction[self.at])

    @property
    def inertia(self) -> Array:
        return np.asarray(self.whole.inertia[self.at])
