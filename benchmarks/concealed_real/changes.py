"""Elementary changes of models and recordings, and the setup of a set."""

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

DEFAULT_BAND = 8.0  # cut-off if the control has none [Hz]
Columns = Mapping[str, Array]
Change = Callable[[Columns], Columns]


@dataclass(frozen=True)
class Setup:
    """Model identified from A, diagnosed recording B and held-out recording C."""

    model: Model
    b: Recording
    c: Recording
    cutoff: float | None  # cut-off of the control's diagnosis [Hz]
    residual: Array  # residual of the model on B in this band (M, n) [N.m or N]
    std: Mapping[tuple[str, int], float] = field(
        default_factory=dict
    )  # standard deviations of identified laws by effect and joint

    @property
    def band(self) -> float:
        """Cut-off [Hz], by default DEFAULT_BAND."""
        return self.cutoff or DEFAULT_BAND

    def ratios(self, model: Model, b: Recording | None = None) -> Array:
        """Rms torque of a change over the rms residual of the control (n,) [1]."""
        return ratios(residual(model, b or self.b, self.cutoff), self.residual)


def identified_std(found: Identification) -> dict[tuple[str, int], float]:
    """Standard deviations by effect and joint of laws that are single base parameters.

    Args:
        found: identification of A.
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
    """Remove a law at one joint or at all.

    Args:
        model: simulation model.
        effect: effect of the law.
        joint: joint of the law; None: all.
    """
    return replace(
        model, laws=tuple(x for x in model.laws if x.effect.name != effect or joint not in (None, *x.joints))
    )


def scaled_law(model: Model, effect: str, joint: int, factor: float) -> Model:
    """Scale the parameters of a law at a joint.

    Args:
        model: simulation model.
        effect: effect of the law.
        joint: joint of the law.
        factor: factor on all parameters.
    """

    def one(law: Law) -> Law:
        if law.effect.name != effect or law.joints != (joint,):
            return law
        return replace(law, parameters={key: factor * x for key, x in law.parameters.items()})

    return replace(model, laws=tuple(map(one, model.laws)))


def with_body(model: Model, body: int, added: Array) -> Model:
    """Add ten inertial parameters to a body.

    Args:
        model: simulation model.
        body: index of the body, 0-based.
        added: inertial parameters (10,) in Pinocchio's order [kg, kg.m, kg.m2].
    """
    inertials = model.inertials.copy()
    inertials[body] += added
    return replace(model, inertials=inertials)


def tilted(model: Model, x: float, y: float) -> Model:
    """Tilt the base about its own x and y.

    Args:
        model: simulation model.
        x: rotation about x [rad].
        y: rotation about y [rad].
    """
    bodies = model.robot.model.copy()
    bodies.gravity.linear = pin.exp3(np.array([x, y, 0.0])).T @ bodies.gravity.linear
    return replace(model, robot=replace(model.robot, model=bodies))


def shifted(columns: Columns, samples: int) -> Columns:
    """Delay the torques by samples (negative: advance) and repeat the end values.

    Args:
        columns: columns of a recording.
        samples: delay of the torque.
    """
    tau = columns["tau"]
    return {**columns, "tau": tau[np.clip(np.arange(len(tau)) - samples, 0, len(tau) - 1)]}


def times(columns: Columns, joint: int, factor: float) -> Columns:
    """Scale the torque of a joint.

    Args:
        columns: columns of a recording.
        joint: index of the joint, 0-based.
        factor: factor on the torque [1].
    """
    tau = columns["tau"].copy()
    tau[:, joint] *= factor
    return {**columns, "tau": tau}


def plus(columns: Columns, joint: int, offset: float) -> Columns:
    """Add an offset to the measured and desired position of a joint.

    Args:
        columns: columns of a recording.
        joint: index of the joint, 0-based.
        offset: added offset [rad or m].
    """
    found = dict(columns)
    for key in {"q", "q_des"} & columns.keys():
        found[key] = columns[key].copy()
        found[key][:, joint] += offset
    return found


def swapped(columns: Columns, pair: tuple[int, int]) -> Columns:
    """Exchange the torques of two joints.

    Args:
        columns: columns of a recording.
        pair: indices of the joints, 0-based.
    """
    tau = columns["tau"].copy()
    tau[:, list(pair)] = tau[:, list(pair[::-1])]
    return {**columns, "tau": tau}


def recorded(recording: Recording, model: Model, change: Change) -> Recording:
    """Apply a change to the columns of a recording.

    Args:
        recording: recording of the model's joints.
        model: model of the robot.
        change: change of the columns.
    """
    return rebuilt(model.robot, change(columns_of(recording)))
