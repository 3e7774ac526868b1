"""Faults as sentences: of recordings that nothing is fitted to, and of an identification.

An identification also has flags on delayed torque and on joints that fit badly. The delay of torque against the motion
follows from the correlation of the residual with the derivative of the torque.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import shorten
from ..estimation.excitation import ExcitationVerdict
from ..estimation.fit_quality import MIN_R2, Fit, judge_fit
from ..model import Model, stated_parameters
from ..recording.sampling import select_stretches
from ..regression.factors import Factors, Lack, find_lacks
from ..regression.projection import least_squares
from ..regression.rows import Rows, Task, read_rows
from ..regression.session import Options, Session, prepare
from ..types import Array, Mask, Recording
from .channels import naming_faults
from .evidence import FaultEvidence
from .examine import examine
from .result import NOTE, RecordingFault

NOISE_RATIO = 3.0  # [noise floors] held-out rms from which on it is more than noise
# A joint fits badly if its held-out rms exceeds MISFIT_FLOORS [noise floors] and its R2 is below MIN_R2, or R2 with
# the variance of the training torque is below POOR [1]. Measured on real arms with such a low R2: healthy joints have
# at most 33 floors (rokae motor side, UR10e, UR10e from point to point), joints whose physics the model lacks 81 and
# more (TX40's coupled wrist, joint 5; the dVRK's MTM with its loops; an AK80-6 pendulum's echoed command)
MISFIT_FLOORS, POOR = 50.0, 0.9
DESCRIBED_RMS_RATIO = 1.05  # [1] rms over that of the description, from which on the fit is worse
TRIFLE = 1e-3  # [1] held-out rms over the rms torque up to which no use of a model depends on it; heuristic
SECONDS = 30.0  # [s] total duration of the evenly spread stretches that are read
SPARE = 2.0  # [rows per column] smallest number of rows
# [s] smallest delay that is flagged, and largest one for a first-order estimate. Measured on real arms: TX40 -3.0 ms;
# UR10e, panda and EMPS within 3 standard deviations of 0. `judge_lags` finds longer delays
MIN_FLAGGED_DELAY, MAX_LINEAR_DELAY = 0.003, 0.04
SURELY_NONE = 0.5 * MIN_FLAGGED_DELAY  # [s] largest possible delay up to which no rows are read for it
# [standard deviations] smallest significant delay. Measured: 6 for rokae joint sensors; 11 and more for 8 ms, simulated
# with 2 % noise
SIGNIFICANT = 7.0
# [1] mean square over the joints of the difference from the common delay, in standard deviations, up to which delays
# have one cause, for certain and roughly. Measured: 41 TX40, 5.3 rokae motor side; simulated arms with torque 8 ms late
# or early 0.1 to 1.6, 3.9 (ur10, early)
COMMON_SCATTER, ROUGH_SCATTER = 3.0, 10.0
# [1] smallest mean reduction of the log variance of the residual. Measured: 0.26 TX40, 0.15 rokae; 0.46 and more for
# 8 ms, simulated without noise
MIN_VARIANCE_GAIN = 0.4
NEGATIVE = 0.5  # [1] share of joints with negative viscous friction from which on torque leads
YIELDS = 0.5  # [1] torque that a law leaves, over what a correction leaves, below which the law is named instead
NEXT = "run signid check on the recordings, then signid diagnose"


class IdentifiedData(NamedTuple):
    """Data of an identification."""

    session: Session
    train: Factors
    test: Factors  # held out
    recordings: Sequence[Recording]
    evidence: FaultEvidence | None  # with the description as model, from `described_evidence`


class Delay(NamedTuple):
    """Delay of torque, positive if it is recorded late."""

    common: float  # [s] mean of all joints, weighted by their precision
    std: float  # [s] its standard deviation, for independent residuals
    scatter: float  # [1] mean square difference of the joints from it, in standard deviations; NaN for one joint
    gain: float  # [1] mean log ratio of the residual's variance without and with the delays

    @property
    def sentence(self) -> str:
        """The flag."""
        side = "late" if self.common > 0 else "early"
        why = "two clocks or a filter" if self.common > 0 else "a command that acts later, or two clocks"
        return (
            f"the torque is recorded {1e3 * abs(self.common):.1f} ms {side} against the motion ({why}), which biases "
            "friction and rotor inertias: record both with one clock, or run signid diagnose, "
            "which has a law for delays"
        )

    def is_clear(self, negative: float) -> bool:
        """Whether it is large and certain enough for a flag; `negative`: share of negative viscous friction [1]."""
        if not MIN_FLAGGED_DELAY <= abs(self.common) <= MAX_LINEAR_DELAY or abs(self.common) < SIGNIFICANT * self.std:
            return False
        leads = self.common < 0 and negative >= NEGATIVE
        strong = (self.gain >= MIN_VARIANCE_GAIN or leads) and not self.scatter > ROUGH_SCATTER
        return strong or self.scatter <= COMMON_SCATTER


def identification_flags(
    rows: IdentifiedData, model: Model, excitation: ExcitationVerdict, fit: Fit, value: Array, base_value: Array
) -> tuple[tuple[str, ...], tuple[Lack, ...]]:
    """Sentences on recording faults, on laws that are missing and on joints that fit badly; and these laws.

    value, base_value: (b,) [units of base] base parameters by least squares, without physical constraints and with.
    """
    session, faults = rows.session, list[RecordingFault]()
    sentences = [flag for recording in rows.recordings for flag in recording.flags]
    moving = np.array([joint not in excitation.resting for joint in fit.joints])
    signed = np.all([recording.signed for recording in rows.recordings], axis=0)
    findings = examine(model, session, excitation, signed, rows.evidence).findings
    both, stated = (rows.train, rows.test), stated_parameters(session.task)
    lacks = list(find_lacks(session.task, both, fit, base_value, stated, signed & moving))
    faults = [f for f in findings if f.severity != NOTE and f.kind != "excitation" and _holds(f, fit, lacks)]
    sentences += [f"{fault.sentence}; {NEXT}" for fault in faults]
    late = any(fault.kind == "lag" for fault in faults) or _largest_delay(rows, signed & moving) < SURELY_NONE
    delay = None if late else estimate_delay(session, signed & moving)
    if delay is not None and delay.is_clear(_negative_viscosity(value, session.task)):
        sentences.append(delay.sentence)
    before = judge_fit(session, *both, session.task.base.combination @ stated.values)
    sound = moving & np.array([not any(joint in fault.joints for fault in faults) for joint in fit.joints])
    torques = [np.array([joint.total, joint.whole[-1, -1]]) / max(joint.rows, 1) for joint in rows.train.joints]
    mean, square = np.array(torques).T  # (n,) [N.m or N] and its square
    matters = fit.held_out_rms > TRIFLE * np.sqrt(square)
    bad = _bad(fit, np.maximum(square - mean**2, 0.0), sound)
    lacks = [lack for lack in lacks if sound[fit.joints.index(lack.joint)]]
    sentences += [lack.sentence for lack in lacks]
    larger = fit.held_out_rms > DESCRIBED_RMS_RATIO * before.held_out_rms
    worse = [
        f"the held-out torque of {fit.joints[j]} is predicted worse than by the description "
        f"(rms {fit.held_out_rms[j]:.3g} instead of {before.held_out_rms[j]:.3g} {fit.unit[j]}): do not use the "
        f"model for it; run signid diagnose with the description and the recordings"
        for j in np.flatnonzero(sound & matters & larger & (_floors(fit) > NOISE_RATIO))
    ]
    return (*dict.fromkeys(sentences), *bad, *worse), tuple(lacks)


def _bad(fit: Fit, variance: Array, sound: Mask) -> Iterator[str]:
    """A sentence on the joints whose held-out torque is poorly explained, far beyond noise.

    If it is nearly constant on the held-out rows, the variance (n,) of the training torque is used.
    """
    ratio, r2 = _floors(fit), fit.held_out_r2
    wide = 1 - fit.held_out_rms**2 / np.maximum(variance, 1e-300)
    hopeless = (ratio > NOISE_RATIO) & (r2 < MIN_R2) & (wide < MIN_R2)
    bad = sound & (hopeless | ((ratio > MISFIT_FLOORS) & ((r2 < MIN_R2) | (wide < POOR))))
    if bad.any():
        joints = [f"{fit.joints[j]} (held-out R2 {r2[j]:.2f})" for j in np.flatnonzero(bad)]
        yield (
            f"the model leaves much of the torque of {shorten(joints, 4)} unexplained, far beyond the noise floor: it "
            f"lacks an effect; run signid diagnose with model.json and the recordings"
        )


def _floors(fit: Fit) -> Array:
    """Held-out rms over the noise floor (n,) [1]."""
    return np.asarray(fit.held_out_rms / np.maximum(fit.noise_floor, 1e-300))


def _negative_viscosity(value: Array, task: Task) -> float:
    """Share [1] of negative estimates among the viscous coefficients that are individually identifiable."""
    base, signs = task.base, list[bool]()
    for k, label in enumerate(base.labels):
        if label.law is not None and task.laws[label.law].effect.name == "viscous_friction":
            rows = np.flatnonzero(base.combination[:, k])
            if len(rows) == 1 and np.count_nonzero(base.combination[rows[0]]) == 1:
                signs.append(bool(value[rows[0]] / base.combination[rows[0], k] <= 0))
    return float(np.mean(signs)) if signs else 0.0


def _holds(fault: RecordingFault, fit: Fit, lacks: Sequence[Lack]) -> bool:
    """Whether a fault remains after the fit: torque that the model, or better a law, explains belongs to its motion."""
    r2 = dict(zip(fit.joints, fit.held_out_r2.tolist(), strict=True))
    claimed = fault.measures.get("explained_after", fault.measures.get("explained", 1.0))
    left = [(1 - lack.share) * (1 - r2[lack.joint]) for lack in lacks if lack.joint in fault.joints and not lack.moved]
    if any(x < YIELDS * (1 - claimed) for x in left):
        return False
    return fault.kind != "unexplained torque" or not all(r2[joint] >= MIN_R2 for joint in fault.joints)


def _largest_delay(data: IdentifiedData, signed: Mask) -> float:
    """Largest common delay [s] that a sample of training rows allows, after any fit of their torque; infinite if few.

    The derivative of the recorded torque contains noise: at most that of the residual, all of it at the cut-off.
    """
    sample, band, sums = data.train.sample, data.session.task.band, np.zeros(2)
    if sample is None:
        return np.inf
    for j in np.flatnonzero(signed).tolist():
        kept = sample.kept[:, j]
        columns = sample.of(j, data.train.columns)[kept]
        both = np.stack([sample.torque[kept, j], sample.slope[kept, j]])
        if len(columns) < SPARE * columns.shape[1]:
            return np.inf
        columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        across, inverse = both @ columns, np.linalg.pinv(columns.T @ columns, 1e-10, True)
        rest, late, _, slope = (both @ both.T - across @ inverse @ across.T).ravel().tolist()
        rest = max(rest, 1e-12 * float(both[0] @ both[0]), 1e-300)  # samples are rounded
        sums += abs(late) / rest, slope / rest - (2 * np.pi * band.cutoff) ** 2
    return float(sums[0] / sums[1]) if sums[1] > 0 else np.inf


def estimate_delay(session: Session, signed: Mask) -> Delay | None:
    """Delay that best explains the residuals of each joint's least-squares fit; None if there are too few rows.

    To first order, torque that is recorded late by L differs by -L times its derivative. The derivative of the
    predicted torque is the instrument for that of the recorded torque, whose noise would bias delays towards zero. Rows
    near reversals are excluded, since dry friction leads the motion there. signed: (n,) joints that move and have
    signed torque.
    """
    whole = sum(sampling.duration for _, sampling in session.train)
    few = ((r, select_stretches(sampling, SECONDS * sampling.duration / whole)) for r, sampling in session.train)
    windows = [rows for part in few for rows in read_rows(session.task, *part) if len(rows.t) > 1]
    delays = [lag for j in np.flatnonzero(signed).tolist() if (lag := _joint_delay(windows, j)) is not None]
    if not delays:
        return None
    delay, std, gain = (np.array(x) for x in zip(*delays, strict=True))
    common = float(np.average(delay, weights=std**-2))
    scatter = float(np.sum(((delay - common) / std) ** 2) / (len(delay) - 1)) if len(delay) > 1 else float("nan")
    return Delay(common, float(np.sum(std**-2) ** -0.5), scatter, float(gain.mean()))


def _joint_delay(windows: list[Rows], joint: int) -> tuple[float, float, float] | None:
    """Delay of one joint [s], its std [s] and its gain [1]; None if its rows are not informative."""
    kept = [rows.steady[:, joint] & rows.recorded[joint] for rows in windows]
    pairs = list(zip(windows, kept, strict=True))
    if sum(int(k.sum()) for k in kept) < SPARE * max((rows.columns[joint].shape[1] for rows in windows), default=1):
        return None
    columns = np.concatenate([rows.columns[joint][k] for rows, k in pairs])
    torque = np.concatenate([rows.torque[k, joint] for rows, k in pairs])
    size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, factor = np.linalg.qr(columns / size)
    value = least_squares(factor, basis.T @ torque, 1e-10) / size
    rate = np.concatenate([rows.slope[k, joint] for rows, k in pairs])
    instrument = np.concatenate([np.gradient(rows.columns[joint] @ value, rows.t)[k] for rows, k in pairs])
    y, d, z = (x - basis @ (basis.T @ x) for x in (torque, rate, instrument))
    overlap = float(z @ d)
    if overlap <= 0 or not y.any():
        return None
    delay = -float(z @ y) / overlap
    rest = y + delay * d
    variance = float(rest @ rest) / len(y)
    std = max(variance * float(z @ z), 1e-300) ** 0.5 / overlap
    return delay, std, float(np.log(float(y @ y) / max(float(rest @ rest), 1e-300)))


OF_A_FIT = ("too little data", "excitation")  # kinds of faults that matter only for a fit
NO_EXCITATION = ExcitationVerdict(shares=np.ones(1), prior=np.ones(1))  # not judged: nothing is fitted


def recording_flags(
    model: Model, recordings: Sequence[Recording], options: Options | None = None, kinds: Collection[str] = ()
) -> tuple[str, ...]:
    """A sentence on each fault of recordings with signed torque: of some kinds, or all but those that matter for a fit.

    Raises:
        InputError: a recording cannot be used, or moves other joints than the model; the sentence says which and why.
    """
    session = prepare(model.robot, recordings, recordings, options)
    with naming_faults(session):
        severe = examine(model, session, NO_EXCITATION).severe
    said = (fault.sentence for fault in severe if (fault.kind in kinds if kinds else fault.kind not in OF_A_FIT))
    return tuple(dict.fromkeys(said))
