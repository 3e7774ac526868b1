"""Factors and parameters -> fit: rms of the residual and R2, from factors alone."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..regression.factors import Factors
from ..regression.session import Session
from ..types import Array, Frozen, Indices, Result, Robot

MIN_R2 = 0.5  # [1] held-out R2 below which a joint's torque is poorly predicted
CONSTANT_TORQUE_SHARE = 1e-12  # [1] variance of a torque, over its power, below which it is constant up to rounding


@dataclass(frozen=True, eq=False)
class Course(Frozen):
    """Residual traces: M filtered rows of n joints; NaN where no torque counts."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # unit of torque of each joint
    prismatic: tuple[bool, ...]
    stretch: Indices  # (M,) number of each row's stretch without gaps
    recording: Indices  # (M,) number of each row's recording
    t: Array  # (M,) [s] since the start of the recording if its stamps begin far from 0
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    torque: Array  # (M, n) [N.m or N] measured
    before: Array  # (M, n) [N.m or N] measured - predicted by the original model
    after: Array  # (M, n) [N.m or N] measured - predicted by the new model

    def __len__(self) -> int:
        return len(self.t)


@dataclass(frozen=True, eq=False)
class Fit(Result):
    """Accuracy of the predicted torque per joint; held-out rows took no part in the estimation."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]
    train_rms: Array  # (n,) [N.m or N] of the residual
    held_out_rms: Array  # (n,) [N.m or N]
    noise_floor: Array  # (n,) [N.m or N] rms of what white measurement noise leaves in the band
    held_out_r2: Array  # (n,) [1], NaN where torque is not recorded, or does not vary
    irreducible_rms: Array  # (n,) [N.m or N] of all that no model could predict: noise of any colour, reversals
    refit: bool = False  # whether the written model was fitted again to all rows afterwards

    def in_amperes(self, joint: int, numbers: tuple[float, float, float, float]) -> Fit:
        """The fit with another joint in A: rms of training and held-out rows, noise floor [A], and R2 [1]."""
        columns = [x.copy() for x in (self.train_rms, self.held_out_rms, self.noise_floor, self.held_out_r2)]
        for column, number in zip(columns, numbers, strict=True):
            column[joint] = number
        unit = tuple("A" if j == joint else own for j, own in enumerate(self.unit))
        train, held_out, floor, r2 = columns
        return replace(self, unit=unit, train_rms=train, held_out_rms=held_out, noise_floor=floor, held_out_r2=r2)

    @property
    def sentences(self) -> tuple[str, ...]:
        """A sentence on each joint whose torque is poorly predicted, or whose held-out torque is constant."""
        sentences = []
        for joint, rms, r2 in zip(self.joints, self.held_out_rms, self.held_out_r2, strict=True):
            if r2 < MIN_R2:
                sentences.append(
                    f"the model predicts little of the torque of {joint} (held-out R2 {r2:.2f}): it lacks an effect "
                    f"there, or the torque does not belong to this motion; run signid check and signid diagnose"
                )
            elif np.isfinite(rms) and np.isnan(r2):
                sentences.append(
                    f"the held-out torque of {joint} is constant, so it has no R2; hold out a recording in which the "
                    f"robot moves"
                )
        return tuple(sentences)


def judge_fit(session: Session, train: Factors, test: Factors, base_value: Array) -> Fit:
    """Fit of base_value (b,) [units of base] on training and held-out data, from factors alone."""
    (trained, _), (held_out, r2) = factor_rms(train, base_value), factor_rms(test, base_value)
    floor = session.task.band.torque_floor
    return Fit(session.robot.joints, _units(session.robot), trained, held_out, floor, r2, floor)


def friction_at_rest(session: Session, fit: Fit) -> tuple[str, ...]:
    """A note on the Coulomb friction that residuals of postures allow, where the direction of approach is not known.

    Friction that holds a joint lies anywhere between both signs of the level, with an rms of at least level / sqrt(3).
    """
    fitted = any(law.effect.name == "coulomb_friction" for law in session.task.laws)
    if fitted or not any(recording.static for recording in session.recordings):
        return ()
    known = [k for k, rms in enumerate(fit.train_rms) if np.isfinite(rms)]
    levels = [f"{fit.joints[k]} 0 to {np.sqrt(3) * fit.train_rms[k]:.2g} {fit.unit[k]}" for k in known]
    advice = "velocities just before each posture (dq_J) give the direction of approach, and the level"
    return (f"Coulomb friction that the residuals at rest allow: {', '.join(levels)}; {advice}",)


def fit_rows(
    robot: Robot,
    residual: Array,
    torque: Array,
    floor: Array,
    learned: Array | None = None,
    irreducible: Array | None = None,
) -> Fit:
    """Fit from a residual (M, n) [N.m or N] on held-out rows and the measured torque (M, n) [N.m or N].

    NaN rows are ignored. The noise floor is (n,) [N.m or N]. The residual learned (L, n) [N.m or N] is that on training
    rows; None: nothing was fitted, the training rms is NaN. The rms irreducible (n,) [N.m or N] is of all that no model
    could predict; None: the noise floor.
    """
    spread = np.nansum((torque - _finite_mean(torque)) ** 2, axis=0)
    return Fit(
        joints=robot.joints,
        unit=_units(robot),
        train_rms=np.full(len(robot.joints), np.nan) if learned is None else rms_of(learned),
        held_out_rms=rms_of(residual),
        noise_floor=floor,
        held_out_r2=1 - np.nansum(residual**2, axis=0) / np.where(spread > 0, spread, np.nan),
        irreducible_rms=floor if irreducible is None else irreducible,
    )


def rms_of(x: Array) -> Array:
    """Root mean square (n,) [unit of x] over the rows of x (M, n) [any unit] that are not NaN; NaN if all are."""
    return np.asarray(np.sqrt(_finite_mean(x**2)))


def _units(robot: Robot) -> tuple[str, ...]:
    return tuple("N" if prismatic else "N.m" for prismatic in robot.prismatic)


def _finite_mean(x: Array) -> Array:
    """Mean (n,) over the finite rows; NaN if there is none."""
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x, axis=0) / np.where(count > 0, count, np.nan))


def factor_rms(factors: Factors, value: Array) -> tuple[Array, Array]:
    """Residual rms [N.m or N] and R2 [1] per joint, of value (b,) [units of base]; NaN without recorded torque."""
    rms, r2 = np.full((2, len(factors.joints)), np.nan)
    for j, (joint, columns) in enumerate(zip(factors.joints, factors.columns, strict=True)):
        if joint.rows == 0:
            continue
        c = np.append(-value[columns], 1.0)
        rest = max(float(c @ joint.whole @ c), 0.0)
        spread = joint.whole[-1, -1] - joint.total**2 / joint.rows
        rms[j] = np.sqrt(rest / joint.rows)
        r2[j] = 1 - rest / spread if spread > CONSTANT_TORQUE_SHARE * joint.whole[-1, -1] else np.nan
    return rms, r2
