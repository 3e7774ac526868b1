"""What a model leaves of recorded torque along a motion, beside what another left: rows to be looked at."""

from __future__ import annotations

from dataclasses import dataclass

from ..types import Array, Frozen, Indices


@dataclass(frozen=True, eq=False)
class Course(Frozen):
    """M rows of n joints, through the filter of the rows; NaN where no torque counts."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # of torque, one a joint
    prismatic: tuple[bool, ...]
    stretch: Indices  # (M,) number of the stretch without gaps that a row is of
    recording: Indices  # (M,) number of the recording
    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    torque: Array  # (M, n) [N.m or N] measured
    before: Array  # (M, n) [N.m or N] measured - predicted by the model before
    after: Array  # (M, n) [N.m or N] measured - predicted

    def __len__(self) -> int:
        return len(self.t)
