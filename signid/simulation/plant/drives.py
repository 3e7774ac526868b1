"""Laws of position drives in a simulation of torque: they replace what they name in the controller of their joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...effects.base import of_kind
from ...effects.drive import COMMAND_STAGES, STAGES, DriveLaw, DriveState
from ...types import Array, Law
from .control import Plan


def commanded(laws: Sequence[Law], t: Array, plan: Plan) -> Plan:
    """Plan whose desired positions (K, n) are those that the drives act on at instants t (K,) [s]."""
    desired, speed = plan.desired.copy(), plan.speed.copy()
    for law in sorted(laws, key=_stage):
        effect, [j] = of_kind(law.effect, DriveLaw), law.joints
        if effect.stage in COMMAND_STAGES:
            desired[:, j] = effect.moved(t, desired[:, j], **law.parameters)
            speed[:, j] = np.gradient(desired[:, j], t)
    return replace(plan, desired=desired, speed=speed)


class JointDrives:
    """Drives of the joints with drive laws; the stiffness and the damping of the controller are laws where none is.

    stiffness, damping: (B, n) of the controller [N.m/rad and N.m.s/rad, or N/m and N.s/m].
    """

    def __init__(self, laws: Sequence[Law], stiffness: Array, damping: Array) -> None:
        acting = [law for law in laws if _effect(law).stage not in COMMAND_STAGES]
        self.joints: dict[int, dict[str, list[Law]]] = {}  # laws by joint and stage
        for law in acting:
            stages = self.joints.setdefault(law.joints[0], {stage: [] for stage in STAGES})
            stages[_effect(law).stage].append(law)
        self.stiffness, self.damping = stiffness, damping

    def torque(self, command: Array, q: Array, v: Array, desired: Array, speed: Array, forward: Array) -> Array:
        """Torque (B, n) of the motors [N.m or N]: that of the controller where no drive law acts.

        command: (B, n) torque of the controller [N.m or N]; forward: (B, n) its feed-forward part [N.m or N].
        q: (B, n) measured, desired: (B, n) asked for [rad or m]; v: (B, n), speed: (B, n) likewise [rad/s or m/s].
        """
        out = command.copy() if self.joints else command
        for j, stages in self.joints.items():
            x = DriveState(q[:, j], v[:, j], desired[:, j], speed[:, j], desired[:, j] - q[:, j], np.zeros(len(q)))
            for stage, laws in stages.items():
                x = self._stage(x, j, stage, laws)
                if stage == "damping":
                    x = replace(x, torque=x.torque + forward[:, j])
            out[:, j] = x.torque
        return out

    def _stage(self, x: DriveState, j: int, stage: str, laws: Sequence[Law]) -> DriveState:
        if stage == "error":
            for law in laws:
                x = replace(x, error=_effect(law).acts(x, **law.parameters))
            return x
        if stage == "gain" and not laws:
            return replace(x, torque=self.stiffness[:, j] * x.error)
        if stage == "damping" and not laws:
            return replace(x, torque=x.torque + self.damping[:, j] * (x.reference - x.v))
        for law in laws:
            x = replace(x, torque=_effect(law).acts(x, **law.parameters))
        return x


def _effect(law: Law) -> DriveLaw:
    return of_kind(law.effect, DriveLaw)


def _stage(law: Law) -> int:
    return STAGES.index(_effect(law).stage)
