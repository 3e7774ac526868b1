"""Primitive changes of models and recordings, and the setup that they are applied to."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from signid.identify import Identification
from signid.model import Model
from signid.types import Law, Recording

from .band import Array, ratios, residual
from .sets import columns_of, rebuilt

DEFAULT_BAND = 8.0  # Hz
Columns = Mapping[str, Array]
Change = Callable[[Columns], Columns]


@dataclass(frozen=True)
class Setup:
    """The model identified from A, and the recordings B to diagnose and C to judge by."""

    model: Model
    b: Recording
    c: Recording
    cutoff: float | None  # of the control's diagnosis [Hz]
    residual: Array  # (M, n) of the model on B in that band [N.m or N]
    std: Mapping[tuple[str, int], float] = field(default_factory=dict)  # of identified laws, by effect and joint

    @property
    def band(self) -> float:
        """The cut-off, or a default where the control has none [Hz]."""
        return self.cutoff or DEFAULT_BAND

    def ratios(self, model: Model, b: Recording | None = None) -> Array:
        """(n,) rms of the torque that a change makes over the rms residual of the control [1]."""
        return ratios(residual(model, b or self.b, self.cutoff), self.residual)


def identified_std(found: Identification) -> dict[tuple[str, int], float]:
    """Standard deviations of the laws that are base parameters by themselves, by effect and joint.

    Args:
        found: the identification of A.
    """
    base, laws = found.base, found.session.task.laws
    stds = {}
    for row, std in zip(base.combination, found.estimate.std, strict=True):
        used = np.flatnonzero(row)
        label = base.labels[used[0]]
        if len(used) == 1 and label.law is not None and label.joint is not None and np.isfinite(std):
            stds[laws[label.law].effect.name, label.joint] = float(std / abs(row[used[0]]))
    return stds


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
