"""View of given values instead of a motion: (..., m) arrays or numbers."""

from __future__ import annotations

from typing import Any

from ..types import Array, View


class Trial:
    """A View of given values; zero where none is given."""

    __slots__ = ("a", "direction", "dt", "inertia", "joints", "load", "q", "recorded", "t", "torque", "v", "whole")

    def __init__(
        self,
        q: Any = 0.0,
        v: Any = 0.0,
        *,
        a: Any = 0.0,
        load: Any = 0.0,
        direction: Any = 0.0,
        inertia: Any = 0.0,
        torque: Any = 0.0,
        recorded: Any = 0.0,
        t: Any = 0.0,
        dt: float = 0.0,
        joints: tuple[int, ...] = (),
        whole: Any = None,
    ) -> None:
        self.q: Array = q  # (..., m) [rad or m]
        self.v: Array = v  # (..., m) [rad/s or m/s]
        self.a: Array = a  # (..., m) [rad/s2 or m/s2]
        self.load: Array = load  # (..., m) [N.m or N]
        self.direction: Array = direction  # (..., m) [1]
        self.inertia: Array = inertia  # (..., m) [kg.m2 or kg]
        self.torque: Array = torque  # (..., m) [N.m or N]
        self.recorded: Array = recorded  # (..., m) [N.m or N]
        self.t: Array = t  # (..., 1) [s]
        self.dt, self.joints, self.whole = dt, joints, whole

    def __getitem__(self, i: Any) -> View:
        """Index the leading axis of all arrays."""
        names = ("q", "v", "a", "load", "direction", "inertia", "torque", "recorded", "t")
        cut = {name: getattr(self, name) for name in names}
        return Trial(
            **{name: x[i] if getattr(x, "ndim", 0) else x for name, x in cut.items()},
            dt=self.dt,
            joints=self.joints,
            whole=self.whole,
        )
