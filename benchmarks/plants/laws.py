"""The planted laws that step with the robot, gathered for all of its joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .faults import Fault
from .torques import LEVELS, LOADED, MEMORIES, TORQUES, Moment, crossed_torque

Array = NDArray[np.float64]


class Laws:
    """Friction levels and torques of n joints from one step to the next."""

    def __init__(self, faults: Sequence[Fault], joints: Sequence[str], levels: Sequence[float], step: float) -> None:
        """Only the faults count that are laws of this kind.

        Args:
            faults: all that is planted.
            joints: n names.
            levels: (n,) [N.m] of the dry friction that the joints have anyway.
            step: [s].
        """
        self._joints, self._own, self._step = tuple(joints), np.array(levels, dtype=float), step
        self._levels = [(self._at(f.joint), LEVELS[f.effect], f.numbers) for f in faults if f.effect in LEVELS]
        self._torques = [(self._at(f.joint), TORQUES[f.effect], f.numbers) for f in faults if f.effect in TORQUES]
        self._crossed = [
            (self._at(f.joint), self._at(f.partner), f.numbers) for f in faults if f.effect == "crossed_torque"
        ]
        held = [f for f in faults if f.effect in MEMORIES]
        self._memories = [(self._at(f.joint), MEMORIES[f.effect], f.numbers) for f in held]
        self._held = [(0.0, 0.0) for _ in held]  # state and torque of each
        self._drags = [f.numbers["coefficient"] for f in faults if f.effect == "fluid_drag"]
        self._pushes = [
            (p["start"], p["end"], np.array([p["force_x"], p["force_y"], p["force_z"]]))
            for p in (f.numbers for f in faults if f.effect == "external_contact")
        ]
        self.loaded = any(f.effect in LOADED for f in faults)
        self.tip = bool(self._drags or self._pushes)

    @property
    def any(self) -> bool:
        """Whether there is anything that must step."""
        return bool(self._levels or self._torques or self._crossed or self._memories or self.tip)

    def at(self, t: float, q: Array, v: Array, load: Array) -> tuple[Array, Array]:
        """What the motors must add, and the level of dry friction about it, (n,) each [N.m].

        Args:
            t: [s].
            q: (n,) [rad].
            v: (n,) [rad/s].
            load: (n,) [N.m] that the bodies ask for.

        Raises:
            ValueError: where friction would drive the joint.
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
                f"friction would drive {self._joints[j]} at {t:.4g} s: its level would be {level[j]:.4g} N.m; "
                "give the joint more coulomb_friction, or the fault less"
            )
        return torque, level

    def advance(self, v: Array) -> None:
        """Laws with memory live through a step.

        Args:
            v: (n,) [rad/s], the mean over the step.
        """
        self._held = [
            law(z, float(v[j]), self._step, **numbers)
            for (j, law, numbers), (z, _) in zip(self._memories, self._held, strict=True)
        ]

    def force(self, t: float, w: Array) -> Array:
        """(3,) [N] that the last link's centre of mass exerts on the world, moving at w (3,) [m/s]."""
        force = sum((c * float(np.linalg.norm(w)) * w for c in self._drags), np.zeros(3))
        return force + sum((push for start, end, push in self._pushes if start <= t <= end), np.zeros(3))

    def _at(self, joint: Any) -> int:
        return self._joints.index(joint)
