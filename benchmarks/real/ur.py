"""UR10e: a payload, and friction that depends on speed and load."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.diagnose.extend.holdout import residual_rows
from signid.regression.prepare import prepare

from .data import JUDGED, LOADED, UNLOADED, ur10e_model, ur10e_recording
from .row import Array, Row, Target, attempt, first_is, found, rms, within

PAYLOAD = 2.805  # kg, weighed by those who recorded
NEAR, ERROR, ROLLED = 0.05, 1.3, 5.0  # of its mass; over the unloaded fit's; times better at 0.5 s
CUTOFF = 5.0  # Hz
SPEED = ("stribeck_friction", "quadratic_friction", "viscous_friction", "asymmetric_friction")


def payload() -> Iterator[Row]:
    """The loaded recording, by the simulation of the unloaded robot, without and with its unloaded recordings."""
    loaded, healthy = ur10e_recording(LOADED), [ur10e_recording(UNLOADED[0])]
    for text, reference in (("2.805 kg payload", []), ("the same, unloaded recording as reference", healthy)):
        yield attempt(
            "UR10e",
            text,
            lambda reference=reference: signid.diagnose(ur10e_model(), [loaded], reference=reference),  # type: ignore[misc]
            _judge_payload,
        )[0]


def _judge_payload(told: Diagnosis) -> Sequence[Target]:
    carried = found(told, "payload")
    mass = carried[0].law.parameters["mass"] if carried else 0.0
    usual = _unloaded_error(told.cutoff)
    worst = float(np.max(told.after.held_out_rms / usual))
    error = " ".join(f"{x:.2f}" for x in told.after.held_out_rms / usual)
    targets = [
        first_is(told, "payload"),
        within("mass", mass, PAYLOAD, NEAR, "kg"),
        Target("held-out error over the unloaded fit's", error, f"each <= {ERROR}", worst <= ERROR),
    ]
    if told.rollout_before is None or told.rollout_after is None:
        return [*targets, Target("roll-out 0.5 s", "none", f">= {ROLLED} times better", False)]
    before, after = (1e3 * rms(r.rms(0.5)) for r in (told.rollout_before, told.rollout_after))
    better = f"{before:.1f} -> {after:.1f} mrad ({before / after:.1f} times)"
    return [*targets, Target("roll-out 0.5 s", better, f">= {ROLLED} times better", before >= ROLLED * after)]


def _unloaded_error(cutoff: float) -> Array:
    """(n,) [N.m] held-out residual of the unloaded robot's own fit, in the same band."""
    options = signid.Options(effects=(), cutoff=cutoff)
    model, judged = ur10e_model(), ur10e_recording(JUDGED)
    session = prepare(model.robot, [judged], [judged], options)
    rest = residual_rows(session.task, model, session.held_out).residual
    return np.sqrt(np.nanmean(rest**2, axis=0))


def jointwise() -> Iterator[Row]:
    """One joint after another at many speeds: friction is not linear in speed."""
    logs = [ur10e_recording(f"20_01_22_joint_{j}", "jointwise_motion") for j in range(1, 7)]
    yield attempt(
        "UR10e", "speed dependence of friction", lambda: signid.diagnose(ur10e_model(), logs, held_out=logs), _speed
    )[0]


def _speed(told: Diagnosis) -> Sequence[Target]:
    speed = [f for f in told.findings if f.law.effect.name in SPEED]
    first = bool(told.findings) and told.findings[0] in speed
    what = ", ".join(f"{f.law.effect.name} {told.robot.joints[f.law.joints[0]]}" for f in speed)
    return [Target("dependence on speed named first", what or "none", "a law of speed", first)]
