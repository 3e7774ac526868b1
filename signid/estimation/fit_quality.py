"""Factors and parameters -> fit: how much of the torque is predicted, from factors alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..regression.factors import Factors
from ..regression.session import Session
from ..types import Array, Frozen, Indices, Robot

LITTLE = 0.5  # held-out R2 below which a joint's torque is hardly predicted
CONSTANT = 1e-12  # of a torque's power: less variance is rounding


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


@dataclass(frozen=True, eq=False)
class Fit(Frozen):
    """How well torque is predicted, per joint; held-out rows took no part in the estimation."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]
    train_rms: Array  # (n,) [N.m or N] of the residual
    held_out_rms: Array  # (n,) [N.m or N]
    noise_floor: Array  # (n,) [N.m or N] rms of what white measurement noise leaves in the band
    held_out_r2: Array  # (n,) [1], NaN where torque is not recorded, or does not vary
    irreducible_rms: Array  # (n,) [N.m or N] of all that no model could predict: noise of any colour, reversals

    @property
    def sentences(self) -> tuple[str, ...]:
        """One on each joint whose torque the model hardly predicts, or that does not put it to the test."""
        found = []
        for joint, rms, r2 in zip(self.joints, self.held_out_rms, self.held_out_r2, strict=True):
            if r2 < LITTLE:
                found.append(
                    f"the model predicts little of the torque of {joint} (held-out R2 {r2:.2f}): something is missing "
                    f"from it there, or the recorded torque is not this motion's"
                )
            elif np.isfinite(rms) and np.isnan(r2):
                found.append(
                    f"the torque of {joint} does not vary in what is held out, so that no R2 judges it; hold out a "
                    f"recording in which the robot moves"
                )
        return tuple(found)


def judge_fit(session: Session, train: Factors, test: Factors, base_value: Array) -> Fit:
    """Residual rms in training and held out, from factors alone.

    Args:
        session: gives joints and noise floor.
        train: factors of the training recordings.
        test: factors of the held-out recordings.
        base_value: (b,) [units of base].
    """
    robot, (learned, _), (judged, r2) = session.robot, _rms(train, base_value), _rms(test, base_value)
    units = tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic)
    floor = session.task.band.torque_floor
    return Fit(robot.joints, units, learned, judged, floor, r2, floor)


def fit_rows(
    robot: Robot,
    residual: Array,
    torque: Array,
    floor: Array,
    learned: Array | None = None,
    irreducible: Array | None = None,
) -> Fit:
    """The fit of M rows of torque residuals; rows that are NaN do not count.

    Args:
        robot: gives the joints.
        residual: (M, n) [N.m or N] measured - predicted, of what was held out.
        torque: (M, n) [N.m or N] measured.
        floor: (n,) [N.m or N] noise floor.
        learned: (L, n) [N.m or N] residual in training; None: nothing was fitted, the training rms is NaN.
        irreducible: (n,) [N.m or N] rms of all that no model could predict; None: the noise floor.
    """
    spread = np.nansum((torque - _mean(torque)) ** 2, axis=0)
    return Fit(
        joints=robot.joints,
        unit=tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic),
        train_rms=np.full(len(robot.joints), np.nan) if learned is None else rms_of(learned),
        held_out_rms=rms_of(residual),
        noise_floor=floor,
        held_out_r2=1 - np.nansum(residual**2, axis=0) / np.where(spread > 0, spread, np.nan),
        irreducible_rms=floor if irreducible is None else irreducible,
    )


def rms_of(x: Array) -> Array:
    """Root mean square (n,) [unit of x] over the rows that are not NaN; NaN where all are.

    Args:
        x: (M, n) [any unit].
    """
    return np.asarray(np.sqrt(_mean(x**2)))


def _mean(x: Array) -> Array:
    """(n,) of the rows that count; NaN where none does."""
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x, axis=0) / np.where(count > 0, count, np.nan))


def _rms(factors: Factors, value: Array) -> tuple[Array, Array]:
    """Residual rms [N.m or N] and R2 [1] per joint, NaN where no torque is recorded."""
    rms, r2 = np.full((2, len(factors.joints)), np.nan)
    for j, (joint, columns) in enumerate(zip(factors.joints, factors.columns, strict=True)):
        if joint.rows == 0:
            continue
        c = np.append(-value[columns], 1.0)
        rest = max(float(c @ joint.whole @ c), 0.0)
        spread = joint.whole[-1, -1] - joint.total**2 / joint.rows
        rms[j] = np.sqrt(rest / joint.rows)
        r2[j] = 1 - rest / spread if spread > CONSTANT * joint.whole[-1, -1] else np.nan
    return rms, r2
