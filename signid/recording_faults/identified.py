"""Flags of an identification: recording faults, delayed torque, joints that fit badly."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from ..errors import shorten
from ..estimation.excitation import ExcitationVerdict
from ..estimation.fit_quality import LITTLE, Fit, judge_fit
from ..model import Model, stated_inertials, stated_laws, stated_parameters
from ..regression.factors import Factors
from ..regression.rows import Task
from ..regression.session import Session
from ..types import Array, Mask, Recording, Robot
from .delay import Delay, estimate_delay
from .examine import examine
from .result import NOTE, RecordingFault

LOUD = 3.0  # [noise floors] held-out rms from which on it is more than noise
# A joint fits badly if its held-out rms exceeds FAR [noise floors], and its held-out R2 is below `LITTLE`, or R2 with
# the variance of the training torque is below POOR [1]. Measured on real arms with such a low R2: healthy joints have
# at most 33 floors (rokae motor side, UR10e, UR10e from point to point), joints whose physics the model lacks 81 and
# more (TX40's coupled wrist, joint 5; the dVRK's MTM with its loops; an AK80-6 pendulum's echoed command)
FAR, POOR = 50.0, 0.9
WORSE = 1.05  # [1] rms over that of the description, from which on the fit is worse
TRIFLE = 1e-3  # [1] held-out rms over the rms torque up to which no use of a model depends on it; heuristic
USABLE = 0.5  # [1] smallest share of bodies with mass, for the description to be used as a simulation
NEXT = "run signid check on the recordings, then signid diagnose"


class IdentifiedData(NamedTuple):
    """Data of an identification."""

    session: Session
    train: Factors
    test: Factors  # held out
    recordings: Sequence[Recording]  # empty if only factors were given


def identification_flags(
    rows: IdentifiedData, model: Model, excitation: ExcitationVerdict, fit: Fit, value: Array
) -> tuple[str, ...]:
    """Sentences on recording faults, and on joints that fit badly for another reason.

    Args:
        rows: data of the identification.
        model: identified model.
        excitation: excitation of the recordings.
        fit: fit of the model.
        value: (b,) [units of base] base parameters by least squares, without physical constraints.
    """
    session, faults = rows.session, list[RecordingFault]()
    sentences = [flag for recording in rows.recordings for flag in recording.flags]
    moving = np.array([joint not in excitation.resting for joint in fit.joints])
    if rows.recordings:
        signed = np.all([recording.signed for recording in rows.recordings], axis=0)
        faults = _faults(session, _described(session.robot) or model, excitation, fit, signed)
        sentences += [f"{fault.sentence}; {NEXT}" for fault in faults]
        delay = None if any(fault.kind == "lag" for fault in faults) else estimate_delay(session, signed & moving)
        if delay is not None and delay.is_clear(_negative_viscosity(value, session.task)):
            sentences.append(_delay_sentence(delay))
    stated = session.task.base.combination @ stated_parameters(session.task).values
    described = judge_fit(session, rows.train, rows.test, stated)
    sound = moving & np.array([not any(joint in fault.joints for fault in faults) for joint in fit.joints])
    worse = _worse(fit, described, sound & _matters(fit, rows.train))
    return (*dict.fromkeys(sentences), *_bad(fit, rows.train, sound), *worse)


def _faults(
    session: Session, simulation: Model, excitation: ExcitationVerdict, fit: Fit, signed: Mask
) -> list[RecordingFault]:
    """Recording faults except poor excitation, which an identification reports itself."""
    found = examine(simulation, session, excitation, signed).findings
    return [f for f in found if f.severity != NOTE and f.kind != "excitation" and _holds(f, fit)]


def _bad(fit: Fit, train: Factors, sound: Mask) -> Iterator[str]:
    """A sentence on the joints whose held-out torque is poorly explained, far beyond noise.

    If it is nearly constant on the held-out rows, the variance of the training torque is used.
    """
    ratio, r2 = _floors(fit), fit.held_out_r2
    wide = 1 - fit.held_out_rms**2 / np.maximum(_variance(train), 1e-300)
    hopeless = (ratio > LOUD) & (r2 < LITTLE) & (wide < LITTLE)
    bad = sound & (hopeless | ((ratio > FAR) & ((r2 < LITTLE) | (wide < POOR))))
    if bad.any():
        each = [f"{fit.joints[j]} (held-out R2 {r2[j]:.2f})" for j in np.flatnonzero(bad)]
        yield (
            f"the model leaves much of the torque of {shorten(each, 4)} unexplained, far beyond the noise floor: it "
            f"lacks an effect; run signid diagnose with model.json and the recordings"
        )


def _worse(fit: Fit, described: Fit, sound: Mask) -> Iterator[str]:
    """A sentence on each joint that the description predicts better on the same held-out rows."""
    worse = sound & (fit.held_out_rms > WORSE * described.held_out_rms) & (_floors(fit) > LOUD)
    for j in np.flatnonzero(worse):
        yield (
            f"the held-out torque of {fit.joints[j]} is predicted worse than by the description "
            f"(rms {fit.held_out_rms[j]:.3g} instead of {described.held_out_rms[j]:.3g} {fit.unit[j]}): do not use the "
            f"model for it; run signid diagnose with the description and the recordings"
        )


def _matters(fit: Fit, train: Factors) -> Mask:
    """Joints (n,) whose held-out rms is more than a trifle of their torque."""
    square = np.array([joint.whole[-1, -1] / max(joint.rows, 1) for joint in train.joints])
    return np.asarray(fit.held_out_rms > TRIFLE * np.sqrt(square))


def _floors(fit: Fit) -> Array:
    """Held-out rms over the noise floor (n,) [1]."""
    return np.asarray(fit.held_out_rms / np.maximum(fit.noise_floor, 1e-300))


def _variance(factors: Factors) -> Array:
    """Variance (n,) [N2.m2 or N2] of the torque."""
    square = [joint.whole[-1, -1] / max(joint.rows, 1) for joint in factors.joints]
    mean = [joint.total / max(joint.rows, 1) for joint in factors.joints]
    return np.asarray(np.maximum(np.array(square) - np.array(mean) ** 2, 0.0))


def _negative_viscosity(value: Array, task: Task) -> float:
    """Share [1] of negative estimates among the viscous coefficients that are individually identifiable."""
    base, signs = task.base, list[bool]()
    for k, label in enumerate(base.labels):
        if label.law is not None and task.laws[label.law].effect.name == "viscous_friction":
            rows = np.flatnonzero(base.combination[:, k])
            if len(rows) == 1 and np.count_nonzero(base.combination[rows[0]]) == 1:
                signs.append(bool(value[rows[0]] / base.combination[rows[0], k] <= 0))
    return float(np.mean(signs)) if signs else 0.0


def _holds(fault: RecordingFault, fit: Fit) -> bool:
    """Whether a fault remains after the fit: torque that the model explains belongs to its motion."""
    if fault.kind != "unexplained torque":
        return True
    r2 = dict(zip(fit.joints, fit.held_out_r2, strict=True))
    return not all(r2[joint] >= LITTLE for joint in fault.joints)


def _described(robot: Robot) -> Model | None:
    """Simulation of the description, if most of its bodies have a mass."""
    inertials = stated_inertials(robot)
    if np.mean(inertials[:, 0] > 0) < USABLE:
        return None
    return Model(robot, inertials, stated_laws(robot))


def _delay_sentence(delay: Delay) -> str:
    side = "late" if delay.common > 0 else "early"
    why = "two clocks or a filter" if delay.common > 0 else "a command that acts later, or two clocks"
    return (
        f"the torque is recorded {1e3 * abs(delay.common):.1f} ms {side} against the motion ({why}), which biases "
        f"friction and rotor inertias: record both with one clock, or run signid diagnose, which has a law for delays"
    )
