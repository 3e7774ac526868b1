"""UR10e: a payload, and friction that depends on speed and load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.extend.holdout import residual_rows
from signid.regression.session import prepare

from .data import HELD_OUT, LOADED, UNLOADED, ur10e_model, ur10e_recording
from .row import Array, Row, Target, attempt, first_is, found, rms, within

PAYLOAD = 2.805  # mass weighed by the authors of the recordings [kg]
NEAR, ERROR, ROLLED = (
    0.05,
    1.3,
    5.0,
)  # bounds [1]: mass error, held-out error over the unloaded fit's, gain of the roll-out at 0.5 s
SPEED = ("stribeck_friction", "quadratic_friction", "viscous_friction", "asymmetric_friction")


def payload() -> Iterator[Row]:
    """Diagnose the loaded recording with the unloaded robot's model, without and with an unloaded reference."""
    loaded, healthy = ur10e_recording(LOADED), [ur10e_recording(UNLOADED[0])]
    for text, reference in (("2.805 kg payload", []), ("the same, unloaded recording as reference", healthy)):
        yield attempt(
            "UR10e",
            text,
            lambda reference=reference: signid.diagnose(ur10e_model(), [loaded], reference=reference),  # type: ignore[misc]
            _payload_targets,
        )[0]


def _payload_targets(diagnosis: Diagnosis) -> Sequence[Target]:
    carried = found(diagnosis, "payload")
    mass = carried[0].law.parameters["mass"] if carried else 0.0
    usual = _unloaded_error(diagnosis.cutoff)
    worst = float(np.max(diagnosis.after.held_out_rms / usual))
    error = " ".join(f"{x:.2f}" for x in diagnosis.after.held_out_rms / usual)
    targets = [
        first_is(diagnosis, "payload"),
        within("mass", mass, PAYLOAD, NEAR, "kg"),
        Target("held-out error over the unloaded fit's", error, f"each <= {ERROR}", worst <= ERROR),
    ]
    if diagnosis.rollout_before is None or diagnosis.rollout_after is None:
        return [*targets, Target("roll-out 0.5 s", "none", f">= {ROLLED} times better", False)]
    before, after = (1e3 * rms(r.rms(0.5)) for r in (diagnosis.rollout_before, diagnosis.rollout_after))
    better = f"{before:.1f} -> {after:.1f} mrad ({before / after:.1f} times)"
    return [*targets, Target("roll-out 0.5 s", better, f">= {ROLLED} times better", before >= ROLLED * after)]


def _unloaded_error(cutoff: float) -> Array:
    """Held-out residual (n,) [N.m] of the unloaded robot's own fit in the same band."""
    options = signid.Options(effects=(), cutoff=cutoff)
    model, held_out = ur10e_model(), ur10e_recording(HELD_OUT)
    session = prepare(model.robot, [held_out], [held_out], options)
    rest = residual_rows(session.task, model, session.held_out).residual
    return np.sqrt(np.nanmean(rest**2, axis=0))


def jointwise() -> Iterator[Row]:
    """Diagnose recordings of single joints at many speeds: friction is not linear in speed."""
    logs = [ur10e_recording(f"20_01_22_joint_{j}", "jointwise_motion") for j in range(1, 7)]
    yield attempt(
        "UR10e",
        "speed dependence of friction",
        lambda: signid.diagnose(ur10e_model(), logs, held_out=logs),
        _speed_targets,
    )[0]


def _speed_targets(diagnosis: Diagnosis) -> Sequence[Target]:
    speed = [f for f in diagnosis.findings if f.law.effect.name in SPEED]
    first = bool(diagnosis.findings) and diagnosis.findings[0] in speed
    what = ", ".join(f"{f.law.effect.name} {diagnosis.robot.joints[f.law.joints[0]]}" for f in speed)
    return [Target("dependence on speed named first", what or "none", "a law of speed", first)]
