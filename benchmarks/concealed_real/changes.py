"""Known changes: laws and bodies of the simulation, torques and positions of the recordings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
import pinocchio as pin

from signid.model import Model
from signid.types import Law, Recording

from .band import Array, ratios, rest
from .sets import columns_of, rebuilt

USUAL = 8.0  # Hz
Columns = Mapping[str, Array]
Change = Callable[[Columns], Columns]


@dataclass(frozen=True)
class Scene:
    """A robot that was identified, and the recordings that are diagnosed and judged by."""

    model: Model  # of A
    b: Recording
    c: Recording
    cutoff: float | None  # [Hz] of the control's diagnosis
    rest: Array  # (M, n) [N.m or N] what the model leaves of B in that band

    @property
    def band(self) -> float:
        """The cut-off, or a usual one where there is no diagnosis [Hz]."""
        return self.cutoff or USUAL

    def ratios(self, model: Model, b: Recording | None = None) -> Array:
        """(n,) rms of the torque that a change makes over what the control leaves [1]."""
        return ratios(rest(model, b or self.b, self.cutoff), self.rest)


def without(model: Model, effect: str, joint: int | None = None) -> Model:
    """The model without a law at a joint, or at any.

    Args:
        model: a simulation.
        effect: of the law.
        joint: its joint; None: all.
    """
    return replace(
        model, laws=tuple(x for x in model.laws if x.effect.name != effect or joint not in (None, *x.joints))
    )


def scaled_law(model: Model, effect: str, joint: int, factor: float) -> Model:
    """The model with the numbers of a law at a joint multiplied.

    Args:
        model: a simulation.
        effect: of the law.
        joint: its joint.
        factor: of all its numbers.
    """

    def one(law: Law) -> Law:
        if law.effect.name != effect or law.joints != (joint,):
            return law
        return replace(law, parameters={key: factor * x for key, x in law.parameters.items()})

    return replace(model, laws=tuple(map(one, model.laws)))


def with_body(model: Model, body: int, added: Array) -> Model:
    """The model with ten inertial parameters added to a body.

    Args:
        model: a simulation.
        body: 0-based.
        added: (10,) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    inertials = model.inertials.copy()
    inertials[body] += added
    return replace(model, inertials=inertials)


def tilted(model: Model, x: float, y: float) -> Model:
    """The model as if its base were turned about its own x and y.

    Args:
        model: a simulation.
        x: [rad].
        y: [rad].
    """
    bodies = model.robot.model.copy()
    bodies.gravity.linear = pin.exp3(np.array([x, y, 0.0])).T @ bodies.gravity.linear
    return replace(model, robot=replace(model.robot, model=bodies))


def shifted(columns: Columns, samples: int) -> Columns:
    """Torques recorded so many samples late, or early where negative; the ends repeat the nearest.

    Args:
        columns: of a recording.
        samples: by which torque is late.
    """
    tau = columns["tau"]
    return {**columns, "tau": tau[np.clip(np.arange(len(tau)) - samples, 0, len(tau) - 1)]}


def times(columns: Columns, joint: int, factor: float) -> Columns:
    """The torque of a joint multiplied.

    Args:
        columns: of a recording.
        joint: 0-based.
        factor: [1].
    """
    tau = columns["tau"].copy()
    tau[:, joint] *= factor
    return {**columns, "tau": tau}


def plus(columns: Columns, joint: int, offset: float) -> Columns:
    """The position of a joint, and the desired one, with an offset.

    Args:
        columns: of a recording.
        joint: 0-based.
        offset: [rad or m].
    """
    found = dict(columns)
    for key in {"q", "q_des"} & columns.keys():
        found[key] = columns[key].copy()
        found[key][:, joint] += offset
    return found


def swapped(columns: Columns, pair: tuple[int, int]) -> Columns:
    """The torques of two joints exchanged.

    Args:
        columns: of a recording.
        pair: 0-based joints.
    """
    tau = columns["tau"].copy()
    tau[:, list(pair)] = tau[:, list(pair[::-1])]
    return {**columns, "tau": tau}


def recorded(recording: Recording, model: Model, change: Change) -> Recording:
    """A recording whose columns are changed.

    Args:
        recording: of the model's joints.
        model: gives the robot.
        change: of its columns.
    """
    return rebuilt(model.robot, change(columns_of(recording)))
