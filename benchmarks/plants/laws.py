"""Planted laws that are evaluated at each simulation step, for all joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .faults import Fault
from .torques import LEVELS, LOADED, MEMORIES, TORQUES, Moment, crossed_torque

Array = NDArray[np.float64]


class Laws:
    """Friction levels and torques of n joints at each step."""

    def __init__(self, faults: Sequence[Fault], joints: Sequence[str], levels: Sequence[float], step: float) -> None:
        """Collect the laws of this kind from all faults.

        Args:
            faults: all planted faults.
            joints: joint names (n,).
            levels: dry friction of the drives (n,) [N.m].
            step: time step [s].
        """
        self._joints, self._own, self._step = tuple(joints), np.array(levels, dtype=float), step
        self._levels = [(self._at(f.joint), LEVELS[f.effect], f.numbers) for f in faults if f.effect in LEVELS]
        self._torques = [(self._at(f.joint), TORQUES[f.effect], f.numbers) for f in faults if f.effect in TORQUES]
        self._crossed = [
            (self._at(f.joint), self._at(f.partner), f.numbers) for f in faults if f.effect == "crossed_torque"
        ]
        held = [f for f in faults if f.effect in MEMORIES]
        self._memories = [(self._at(f.joint), MEMORIES[f.effect], f.numbers) for f in held]
        self._held = [(0.0, 0.0) for _ in held]  # state and torque of each law with memory
        self._drags = [f.numbers["coefficient"] for f in faults if f.effect == "fluid_drag"]
        self._pushes = [
            (p["start"], p["end"], np.array([p["force_x"], p["force_y"], p["force_z"]]))
            for p in (f.numbers for f in faults if f.effect == "external_contact")
        ]
        self.loaded = any(f.effect in LOADED for f in faults)
        self.tip = bool(self._drags or self._pushes)

    @property
    def any(self) -> bool:
        """Whether any law must be evaluated at each step."""
        return bool(self._levels or self._torques or self._crossed or self._memories or self.tip)

    def at(self, t: float, q: Array, v: Array, load: Array) -> tuple[Array, Array]:
        """Torque that the motors must add, and the level of dry friction, (n,) each [N.m].

        Args:
            t: time [s].
            q: positions (n,) [rad].
            v: velocities (n,) [rad/s].
            load: rigid-body torque (n,) [N.m].

        Raises:
            ValueError: for a negative friction level, which would drive the joint.
        """
        moments = [Moment(t, *x) for x in zip(q.tolist(), v.tolist(), load.tolist(), strict=True)]
        torque, level = np.zeros(len(moments)), self._own.copy()
        for j, law, numbers in self._levels:
            level[j] += law(moments[j], **numbers)
        for j, law, numbers in self._torques:
            torque[j] += law(moments[j], **numbers)
        for j, k, numbers in self._crossed:
            torque[j] += crossed_torque(moments[j].q, moments[k].q, **numbers)
        for (j, _, _), (_, held) in zip(self._memories, self._held, strict=True):
            torque[j] += held
        if level.min() < 0:
            j = int(level.argmin())
            raise ValueError(
                f"friction would drive {self._joints[j]} at {t:.4g} s (level {level[j]:.4g} N.m); "
                "increase the joint's coulomb_friction or reduce the fault"
            )
        return torque, level

    def advance(self, v: Array) -> None:
        """Advance the laws with memory by one step.

        Args:
            v: mean velocities over the step (n,) [rad/s].
        """
        self._held = [
            law(z, float(v[j]), self._step, **numbers)
            for (j, law, numbers), (z, _) in zip(self._memories, self._held, strict=True)
        ]

    def force(self, t: float, w: Array) -> Array:
        """Force (3,) [N] of the last link's centre of mass on the world, at velocity w (3,) [m/s]."""
        force = sum((c * float(np.linalg.norm(w)) * w for c in self._drags), np.zeros(3))
        return force + sum((push for start, end, push in self._pushes if start <= t <= end), np.zeros(3))

    def _at(self, joint: Any) -> int:
        return self._joints.index(joint)
