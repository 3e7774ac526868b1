"""Held-out rows against those of the fit: errors of short roll-outs, and torques beyond the bounds of limits."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import decimals, shorten
from ...model import Model
from ...servos import Servo, ServoGrid
from ...types import Array
from ..fit import ServoFit, fit_servos, start_limits
from ..plant.course import recorded_course
from ..plant.roll_out import roll_out_along
from ..search.choice import SHORT, Candidate
from ..search.data import ServoData, position_noise
from ..search.laws import STEPS, WORTH, largest_torques, limited
from .facts import demand
from .identifiable import RARE, JointFacts

HORIZON = 1.0  # [s] of the roll-outs, from measured states
FAR = 3.0  # [1] held-out rms over that of the training data, from which it is flagged
LOUD = 3.0  # [1] held-out rms over the noise of positions, from which it is more than noise; as of torque
TRIFLE = 0.02  # [1] held-out rms over that of the tracking error, below which no use of a model depends on it
ALIKE = 0.9  # [1] limit of held-out rows over the bound of the training data, below which the two contradict


@dataclass(frozen=True)
class HeldOutError:
    """Rms error of one joint over roll-outs of one second [rad or m]."""

    joint: str
    unit: str
    trained: float  # on the data of the fit
    held_out: float
    far: bool  # whether the held-out one is far above that of the fit, and matters


def held_out_errors(model: Model, data: ServoData, servos: Mapping[str, Servo]) -> dict[str, HeldOutError]:
    """Errors of each joint with a drive on the data of the fit and on held-out data, by the same linearised loop."""
    trained, unseen = (_rms(model, servos, grids) for grids in (data.train, data.held_out))
    noise, tracking = position_noise(data.held_out), _tracking(data.held_out)
    far = (unseen > FAR * trained) & (unseen > LOUD * noise) & (unseen > TRIFLE * tracking)
    unit = ["m" if model.robot.prismatic[model.robot.index(joint)] else "rad" for joint in data.joints]
    return {
        joint: HeldOutError(
            joint,
            unit[j],
            float(trained[j]),
            float(unseen[j]),
            bool(far[j]),
        )
        for j, joint in enumerate(data.joints)
        if joint in servos
    }


def far_flags(errors: Mapping[str, HeldOutError]) -> Iterator[str]:
    """A sentence on the joints whose held-out positions are predicted far worse than those of the fit."""
    if far := [one for one in errors.values() if one.far]:
        each = [
            f"{x.joint} ({decimals(1e3 * x.held_out)} m{x.unit} instead of {decimals(1e3 * x.trained)})" for x in far
        ]
        yield (
            f"the held-out motion of {shorten(each, 4)} is predicted far worse than that of the training data, in rms "
            f"over one second: the model lacks an effect that acts there; run signid diagnose with model.json and the "
            f"recordings, or learn from such motion as well"
        )


def compared(
    model: Model,
    data: ServoData,
    servos: Mapping[str, Servo],
    facts: Mapping[str, JointFacts],
    errors: Mapping[str, HeldOutError],
) -> dict[str, JointFacts]:
    """Facts of the joints with what held-out rows say of limits that the data of the fit do not reach."""
    torques = {joint: _demand(model, data, servos[joint], joint, fact) for joint, fact in facts.items()}
    beyond = {
        joint: torque
        for joint, torque in torques.items()
        if not servos[joint].effort_limit < np.inf and torque > facts[joint].largest_torque
    }
    if not beyond:
        return dict(facts)
    limits = _limits(model, data, servos, beyond)
    found = dict(facts)
    for joint, torque in beyond.items():
        limit = limits.get(joint, np.inf)
        limit = limit if limit > ALIKE * facts[joint].largest_torque else np.inf
        if errors[joint].far or limit < np.inf:
            found[joint] = replace(facts[joint], held_out_torque=torque, held_out_limit=limit)
    return found


def _demand(model: Model, data: ServoData, servo: Servo, joint: str, fact: JointFacts) -> float:
    """Torque [N.m or N] that held-out rows ask of a drive, exceeded in a share RARE of them."""
    j, damping = data.joints.index(joint), fact.drive_damping
    rows = [demand(servo, grid, recorded_course(model, grid).motion.v[:, j], j, damping) for grid in data.held_out]
    return float(np.quantile(np.abs(np.concatenate(rows)), 1 - RARE))


def _limits(
    model: Model, data: ServoData, servos: Mapping[str, Servo], joints: Mapping[str, float]
) -> dict[str, float]:
    """Effort limits [N.m or N] with which short windows of held-out rows are predicted notably better than without."""
    top = largest_torques(replace(data, train=data.held_out), {joint: servos[joint] for joint in joints})
    start = limited(Candidate(servos, ()), start_limits(model, data.held_out, servos, top), "effort")

    def fitted(drives: Mapping[str, Servo], free: Sequence[tuple[str, str]], steps: int) -> ServoFit:
        return fit_servos(
            model,
            data.held_out,
            drives,
            free,
            window=SHORT,
            relinearise=False,
            iterations=steps,
            scales=False,
            coarse=True,
        )

    found = fitted(start.servos, [(joint, "effort_limit") for joint in joints], STEPS).servos
    without, limits = (fitted(drives, (), 0).residual_rms for drives in (servos, found))  # states as measured
    helps = dict(zip(data.joints, limits < WORTH * without, strict=True))
    return {joint: found[joint].effort_limit for joint in joints if helps[joint]}


def _rms(model: Model, servos: Mapping[str, Servo], grids: Sequence[ServoGrid]) -> Array:
    """Rms (n,) [rad or m] of roll-outs along the recorded motion, restarted from measured states."""
    with np.errstate(over="ignore", invalid="ignore"):
        errors = [roll_out_along(recorded_course(model, grid), servos, grid, HORIZON) - grid.q for grid in grids]
        return np.asarray(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)))


def _tracking(grids: Sequence[ServoGrid]) -> Array:
    """Rms (n,) [rad or m] of command - position while the drives are on."""
    return np.asarray(np.sqrt(np.mean(np.concatenate([g.on * (g.command - g.q) for g in grids]) ** 2, axis=0)))
