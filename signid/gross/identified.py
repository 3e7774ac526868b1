"""An identification -> flags: gross faults of its recordings, torque that leads or lags, joints that do not fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from ..errors import shorten
from ..excitation import ExcitationVerdict
from ..fit import LITTLE, LOUD, Fit
from ..model import Model, stated_inertials, stated_laws
from ..session import Session
from ..types import Array, BaseMap, Law, Mask, Robot
from .delay import Delay, estimate_delay
from .examine import examine
from .result import NOTE, Finding

# Noise floors from which on a held-out R2 below `POOR` is flagged. Measured on real arms: at most 32 where R2 is below
# 0.9 and the joint is healthy (rokae motor side, joint 6: R2 0.84; UR10e joint 5: 0.86, 17 floors); 130 and more at the
# TX40's coupled wrist (R2 0.63 and -9)
FAR, POOR = 100.0, 0.9
WORSE = 1.05  # times the rms of the description's own prediction
USABLE = 0.5  # share of the bodies that must have a mass, for the description to judge recordings
NEXT = "run signid check on the recordings, then signid diagnose"


def fit_flags(fit: Fit, described: Fit, faulty: Sequence[str] = ()) -> Iterator[str]:
    """A sentence on the joints that hardly fit, and one on those that the description predicts better.

    Args:
        fit: of the identified model.
        described: of the description, on the same rows.
        faulty: joints with a gross fault, which is the reason already.
    """
    ratio = fit.held_out_rms / np.maximum(fit.noise_floor, 1e-300)
    bad = ((fit.held_out_r2 < LITTLE) & (ratio > LOUD)) | ((fit.held_out_r2 < POOR) & (ratio > FAR))
    bad &= np.array([joint not in faulty for joint in fit.joints])
    if bad.any():
        each = [f"{fit.joints[j]} (held-out R2 {fit.held_out_r2[j]:.2f})" for j in np.flatnonzero(bad)]
        yield (
            f"the model leaves much of the torque of {shorten(each, 4)} unexplained, far beyond the noise floor: run "
            f"signid diagnose with model.json and the recordings, it says what the model lacks"
        )
    worse = (fit.held_out_rms > WORSE * described.held_out_rms) & (ratio > LOUD)
    for j in np.flatnonzero(worse & np.array([joint not in faulty for joint in fit.joints])):
        yield (
            f"the held-out torque of {fit.joints[j]} is predicted worse than by the description "
            f"(rms {fit.held_out_rms[j]:.3g} instead of {described.held_out_rms[j]:.3g} {fit.unit[j]}): do not use the "
            f"model for it; run signid diagnose with the description and the recordings"
        )


def recording_flags(
    session: Session, model: Model, excitation: ExcitationVerdict, fit: Fit, signed: Mask, negative: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Sentences on what is wrong with the recordings, and the joints that they are about.

    Judged by the bodies of the description, or by those of the identified model where the description has none.

    Args:
        session: the recordings.
        model: that was identified from them.
        excitation: of the same recordings.
        fit: of the model.
        signed: (n,) joints whose torque was recorded with its sign.
        negative: share of the joints whose viscous friction was estimated as negative [1].
    """
    judge = _described(session.robot) or model
    gross = examine(judge, session, excitation, signed)
    faults = [f for f in gross.findings if f.severity != NOTE and f.kind != "excitation" and _holds(f, fit)]
    sentences = [f"{fault.sentence}; {NEXT}" for fault in faults]
    joints = {joint for fault in faults for joint in fault.joints}
    delay = None if any(fault.kind == "lag" for fault in faults) else estimate_delay(session, signed)
    if delay is not None and delay.is_clear(negative):
        sentences.append(_delay_sentence(delay))
    return tuple(sentences), tuple(sorted(joints))


def negative_viscosity(value: Array, base: BaseMap, laws: Sequence[Law]) -> float:
    """Share of the viscous coefficients that least squares estimates as negative [1]; of those told one by one.

    Args:
        value: (b,) [units of base] by least squares, without physical constraints.
        base: what the values are.
        laws: that the labels of `base` refer to.
    """
    signs = []
    for k, label in enumerate(base.labels):
        if label.law is not None and laws[label.law].effect.name == "viscous_friction":
            rows = np.flatnonzero(base.combination[:, k])
            if len(rows) == 1 and np.count_nonzero(base.combination[rows[0]]) == 1:
                signs.append(value[rows[0]] / base.combination[rows[0], k] <= 0)
    return float(np.mean(signs)) if signs else 0.0


def _holds(fault: Finding, fit: Fit) -> bool:
    """Whether a fault counts beside a fitted model: torque that this explains does follow its motion."""
    if fault.kind != "unexplained torque":
        return True
    r2 = dict(zip(fit.joints, fit.held_out_r2, strict=True))
    return not all(r2[joint] >= LITTLE for joint in fault.joints)


def _described(robot: Robot) -> Model | None:
    """The simulation that the description states, if most of its bodies have a mass."""
    inertials = stated_inertials(robot)
    if np.mean(inertials[:, 0] > 0) < USABLE:
        return None
    return Model(robot, inertials, stated_laws(robot))


def _delay_sentence(delay: Delay) -> str:
    side = "late" if delay.common > 0 else "early"
    why = "two clocks or a filter" if delay.common > 0 else "a command that acts later, or two clocks"
    return (
        f"the torque is recorded {1e3 * abs(delay.common):.1f} ms {side} against the motion ({why}), and parameters of "
        f"friction and rotors take its place: record both with one clock, or run signid diagnose, which has a law for "
        f"delays"
    )
