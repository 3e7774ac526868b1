"""A case with one known change, elementary changes of models and recordings, and their size in a band."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import pinocchio as pin

from signid.diagnose.holdout import ResidualRows, residual_rows
from signid.identify import Identification
from signid.model import Model, stated_inertials
from signid.recording.sampling import samples
from signid.regression.motion import build_motion
from signid.regression.session import Options, prepare
from signid.robot.dynamics import own_body
from signid.simulation.rollout import restrict_joints
from signid.types import Array, Law, Recording

from .sets import columns_of, rebuilt

Joints = tuple[int, ...]


@dataclass(frozen=True)
class Truth:
    """Expected findings for the change."""

    effects: tuple[str, ...]  # effects that count as right
    joints: Joints | None  # None: any
    numbers: Mapping[str, float] = field(default_factory=dict)  # parameters to be added to the simulation
    totals: Mapping[str, float] = field(default_factory=dict)  # parameters including those of the simulation
    std: float = 0.0  # standard deviation of these parameters; 0 for an exact change
    fault: str = ""  # recording fault of an accepted flag or refusal: sign, swap, late, early or gain
    last: bool = False  # payload and link_inertia of the last joint are equivalent


@dataclass(frozen=True)
class Case:
    """A model and recordings with one known change."""

    kind: str
    what: str
    model: Model
    b: Recording
    c: Recording
    truth: Truth
    complete: Model | None = None  # for physics missing by nature: a model that includes it
    before: Recording | None = None  # the same rows without the change, if they differ from the control's
    other: bool = False  # B differs from the control's recording, so rows cannot be compared


BLOCKS, LEAST = 20, 4  # time blocks per recording, fewest blocks for a standard error
ROUNDING = 1e-9  # tolerance over the mean square [1]


@dataclass(frozen=True)
class Worse:
    """Both models at one joint of a held-out recording."""

    joint: str
    given: float  # rms [N.m or N]
    extended: float
    error: float  # standard error of the difference of mean squares, as a share of the given mean square [1]
    worse: bool  # the extended model is worse by more than the standard error


def filtered(model: Model, recording: Recording, cutoff: float | None) -> ResidualRows:
    """Rows of a recording below a cut-off [Hz] (None: chosen), with their motions and filter.

    Raises:
        RecordingError: every stretch is shorter than the filter.
    """
    own = restrict_joints(model, [recording])[0]
    session = prepare(own.robot, [recording], [recording], replace(Options(effects=()), cutoff=cutoff))
    return residual_rows(session.task, restrict_joints(own, [recording])[0], session.held_out)


def residual(model: Model, recording: Recording, cutoff: float | None) -> Array:
    """Residual (M, n) [N.m or N] of these rows, measured - predicted; NaN in excluded rows."""
    return np.asarray(filtered(model, recording, cutoff).residual)


def rms(x: Array) -> Array:
    """Root mean square (n,) over included rows; NaN without rows."""
    count = np.isfinite(x).sum(axis=0)
    return np.asarray(np.sqrt(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan)))


def ratios(changed: Array, control: Array) -> Array:
    """Rms torque of a change over the rms residual of the control (n,) [1], from residuals (M, n) of the same rows."""
    return np.nan_to_num(rms(changed - control) / rms(control))


def ratios_apart(changed: Array, control: Array) -> Array:
    """Rms excess residual (M, n) over the rms residual of the control (N, n), (n,) [1], of different recordings."""
    total, plain = rms(changed), rms(control)
    return np.nan_to_num(np.sqrt(np.maximum(total**2 - plain**2, 0.0)) / plain)


def compare(given: Array, extended: Array, joints: Sequence[str]) -> list[Worse]:
    """Compare mean squares of residuals (M, n) per joint, with a standard error from blocks in time."""
    found = []
    for j, joint in enumerate(joints):
        both = np.isfinite(given[:, j]) & np.isfinite(extended[:, j])
        before, after = given[both, j] ** 2, extended[both, j] ** 2
        if not len(before) or not before.any():
            continue
        blocks = [np.mean(x) for x in np.array_split(after - before, min(BLOCKS, len(before)))]
        error = float(np.std(blocks, ddof=1) / np.sqrt(len(blocks))) if len(blocks) >= LEAST else np.inf
        gain = float(np.mean(after) - np.mean(before))
        worse = gain > error + ROUNDING * float(np.mean(before))
        small, large = (float(np.sqrt(np.mean(x))) for x in (before, after))
        found.append(Worse(joint, small, large, error / float(np.mean(before)), worse))
    return found


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
    """Standard deviations by effect and joint of laws that are single base parameters."""
    base, laws = found.base, found.session.task.laws
    stds = {}
    for row, std in zip(base.combination, found.estimate.std, strict=True):
        used = np.flatnonzero(row)
        label = base.labels[used[0]]
        if len(used) == 1 and label.law is not None and label.joint is not None and np.isfinite(std):
            stds[laws[label.law].effect.name, label.joint] = float(std / abs(row[used[0]]))
    return stds


def without(model: Model, effect: str, joint: int | None = None) -> Model:
    """Remove a law at one joint, or at all (None)."""
    return replace(
        model, laws=tuple(x for x in model.laws if x.effect.name != effect or joint not in (None, *x.joints))
    )


def scaled_law(model: Model, effect: str, joint: int, factor: float) -> Model:
    """Scale the parameters of a law at a joint."""

    def one(law: Law) -> Law:
        if law.effect.name != effect or law.joints != (joint,):
            return law
        return replace(law, parameters={key: factor * x for key, x in law.parameters.items()})

    return replace(model, laws=tuple(map(one, model.laws)))


def with_body(model: Model, body: int, added: Array) -> Model:
    """Add ten inertial parameters (10,) in Pinocchio's order [kg, kg.m, kg.m2] to a body."""
    inertials = model.inertials.copy()
    inertials[body] += added
    return replace(model, inertials=inertials)


def tilted(model: Model, x: float, y: float) -> Model:
    """Tilt the base about its own x and y [rad]."""
    bodies = model.robot.model.copy()
    bodies.gravity.linear = pin.exp3(np.array([x, y, 0.0])).T @ bodies.gravity.linear
    return replace(model, robot=replace(model.robot, model=bodies))


def shifted(columns: Columns, samples: int) -> Columns:
    """Delay the torques by samples (negative: advance) and repeat the end values."""
    tau = columns["tau"]
    return {**columns, "tau": tau[np.clip(np.arange(len(tau)) - samples, 0, len(tau) - 1)]}


def times(columns: Columns, joint: int, factor: float) -> Columns:
    """Scale the torque of a joint by a factor [1]."""
    tau = columns["tau"].copy()
    tau[:, joint] *= factor
    return {**columns, "tau": tau}


def plus(columns: Columns, joint: int, offset: float) -> Columns:
    """Add an offset [rad or m] to the measured and desired position of a joint."""
    found = dict(columns)
    for key in {"q", "q_des"} & columns.keys():
        found[key] = columns[key].copy()
        found[key][:, joint] += offset
    return found


def swapped(columns: Columns, pair: tuple[int, int]) -> Columns:
    """Exchange the torques of two joints."""
    tau = columns["tau"].copy()
    tau[:, list(pair)] = tau[:, list(pair[::-1])]
    return {**columns, "tau": tau}


def recorded(recording: Recording, model: Model, change: Change) -> Recording:
    """Apply a change to the columns of a recording."""
    return rebuilt(model.robot, change(columns_of(recording)))


SHARE, PLACE, RADIUS = 0.1, (0.05, 0.02, 0.1), 0.05  # mass over the robot's mass [1], centre [m], radius [m]
WIDER = 3.0  # cut-off of the accelerations over that of the diagnosis [1]


def load_of(model: Model) -> Array:
    """Inertial parameters (10,) about the last joint's frame of a ball with a tenth of the robot's mass."""
    stated = stated_inertials(model.robot)[-1]
    place = np.array(PLACE) if len(model.robot.joints) > 1 else stated[1:4] / stated[0]
    ball = pin.Inertia(1.0, place, 0.4 * RADIUS**2 * np.eye(3)).toDynamicParameters()
    mass = min(float(x[:, 0].sum()) for x in (model.inertials, stated_inertials(model.robot)))
    return np.asarray(SHARE * mass * ball)


def carrying(recording: Recording, model: Model, load: Array | None, cutoff: float) -> Recording:
    """Add the torque of a body (10,) at the last link to a recording; cut the ends, where acceleration is unknown.

    Without a load: the same rows without the body. The cut-off [Hz] is that of the diagnosis.
    """
    session = prepare(model.robot, [recording], [recording], Options(effects=(), cutoff=WIDER * cutoff))
    given, sampling = session.held_out[0]
    span = max(sampling.spans, key=sampling.length)
    window = samples(given, sampling, span, 0, sampling.length(span))
    motion = build_motion(model.robot, window, session.task.band, sampling.period)
    edge = (len(window.t) - len(motion)) // 2
    inside = slice(edge, edge + len(motion))
    tau = window.tau[inside]
    if load is not None:
        loaded = with_body(model, own_body(model.robot, len(model.robot.joints) - 1), load)
        bare = motion[:]
        tau = tau + loaded.inverse(bare) - model.inverse(bare)
    more = {key: getattr(window, key) for key in ("dq", "ddq", "q_des")}
    rows = {key: x[inside] for key, x in more.items() if x is not None}
    return rebuilt(model.robot, {"t": motion.t, "q": window.q[inside], "tau": tau, **rows})
