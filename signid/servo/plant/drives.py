"""Drives of some joints on the substeps of recordings, as the compiled closed loop reads them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ...servos import DRIVE_LAWS, LOOP_NUMBERS, Servo, ServoGrid
from ...types import Array, Indices
from .grid import commands_at
from .kernel import SHORT
from .torque import DELAY, PROFILE, Drives

LONGEST, COARSE, MOST = 0.002, 0.004, 32  # [s] of a substep, in fits and in searches for laws; substeps of a row
TURN = 0.35  # [rad] of the fastest oscillation in a substep
KEPT = 20_000_000  # values of commands that are kept, [160 MB]


def substeps(step: float, servos: Sequence[Servo], inertia: Array, finer: int = 1, longest: float = LONGEST) -> int:
    """Substeps of a row: of at most `longest` [s], and short against the fastest oscillation of the loop.

    step: of a row [s]; inertia: (n,) of the robot at the joints [kg.m2 or kg]; finer: their number is a multiple of it.
    """
    fastest = max(
        (
            np.sqrt((servo.kp + servo.spring_stiffness) / max(servo.armature + own, 1e-9))
            for servo, own in zip(servos, inertia, strict=True)
        ),
        default=0.0,
    )
    short = any(servo.backlash_gap > 0 or servo.gear_exponent > 0 for servo in servos)
    longest = min(SHORT, longest) if short else longest
    count = np.clip(np.ceil(step * max(1 / longest, fastest / TURN) - 1e-9), 1, MOST)
    return finer * int(np.ceil(count / finer))


class Copies(NamedTuple):
    """C copies of the drives of n joints."""

    numbers: Array  # (C, n, 32) [LOOP_UNITS] in the order of LOOP_NUMBERS
    laws: Indices  # (C, n) index in DRIVE_LAWS
    kd_on: tuple[str, ...]  # n


def copies_of(copies: Sequence[Sequence[Servo]]) -> Copies:
    """Drives of n joints as arrays, of each of C copies; what damping acts on is that of the first copy."""
    numbers = [[[getattr(servo, name) for name in LOOP_NUMBERS] for servo in servos] for servos in copies]
    laws = [[DRIVE_LAWS.index(servo.law) for servo in servos] for servos in copies]
    return Copies(np.array(numbers, float), np.array(laws), tuple(servo.kd_on for servo in copies[0]))


@dataclass(frozen=True, eq=False)
class JoinedGrids:
    """Recordings of n joints, one after another: R rows."""

    grids: tuple[ServoGrid, ...]
    joints: tuple[int, ...]  # n columns of the grids
    parts: int  # substeps of a row
    _held: dict[tuple[int, str, float, float], Array] = field(default_factory=dict)

    def column(self, name: str) -> Array:
        """Values (R, n) of a field of the grids."""
        rows = [np.broadcast_to(getattr(grid, name), grid.q.shape)[:, self.joints] for grid in self.grids]
        return np.ascontiguousarray(np.concatenate(rows))

    @cached_property
    def _supply(self) -> tuple[Array, Array, Array]:
        """Whether a drive holds, voltage and firmware gain, each (R, n) [1]."""
        return self.column("on"), self.column("voltage"), self.column("gain")

    def drives(self, copies: Copies) -> Drives:
        """Copies of drives along these rows."""
        found: dict[tuple[int, str, float, float], int] = {}
        variant = np.empty(copies.laws.shape, dtype=np.intp)
        for c, copy in enumerate(copies.numbers):
            for j, p in enumerate(copy):
                key = (j, copies.kd_on[j], float(p[DELAY]), float(p[PROFILE]))
                variant[c, j] = found.setdefault(key, len(found))
        commands = np.stack([self._commands(*key) for key in found], axis=1)
        step = self.grids[0].step / self.parts
        return Drives(copies.numbers, copies.laws, variant, commands, *self._supply, self.parts, step)

    def _commands(self, j: int, kd_on: str, delay: float, profile: float) -> Array:
        """Commands (7, R parts) of a joint; the last ones are kept."""
        key = (j, kd_on, delay, profile)
        if key not in self._held:
            if sum(each.size for each in self._held.values()) > KEPT:
                self._held.clear()
            each = [commands_at(grid, self.joints[j], kd_on, delay, profile, self.parts) for grid in self.grids]
            self._held[key] = np.concatenate(each, axis=1)
        return self._held[key]
