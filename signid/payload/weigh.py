"""Payload from the difference of two estimates, or of one recording; what a model carries, and a further load."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numpy.typing import ArrayLike

from ..effects import EFFECTS
from ..errors import OptionError
from ..estimation.feasible import ConsistentFit, fit_consistent
from ..estimation.least_squares import estimate
from ..model import Model, ModelSource, as_model, stated_parameters
from ..regression.factors import LAGS, Factors
from ..regression.session import Part, Session
from ..robot.dynamics import own_body
from ..signs.torque_constants import constant_sensitivity
from ..types import (
    INERTIAL,
    INERTIAL_UNITS,
    Array,
    BaseMap,
    Estimate,
    Frozen,
    Input,
    Label,
    Law,
    Mask,
    Parameters,
    Progress,
    Result,
    Robot,
    pseudo_inertia,
)

# [1] standard deviation of the change of friction and offsets between recordings: share of the coefficient, and of the
# joint's rms torque; the larger one counts
FRICTION_CHANGE_SHARE, TORQUE_CHANGE_SHARE = 0.1, 0.01
PRIOR_GYRATION_RADIUS, PRIOR_MIN_MASS, PRIOR_MAX_DISTANCE = 0.05, 0.05, 0.3  # [m, kg, m] of the load
MIN_CORRELATION_EIGENVALUE = 1e-9  # [1] smallest eigenvalue of a correlation matrix that is not positive
DIRECTION_RANK_TOLERANCE = 1e-8  # [1] smallest singular value over the largest, columns scaled
CERTAIN_MASS_DEVIATIONS = 3.0  # standard deviations above which a mass is certain
TORQUE_CONSTANT_STD = 0.03  # [1] relative: a magnet loses a tenth of a per cent per kelvin
DRIFT_NOTE_RATIO, MISFIT_NOTE_RATIO = 3.0, 10.0  # [1] changes of friction and misfit over their usual sizes
NEGATIVE_MASS_DEVIATIONS = 3.0  # standard deviations of a mass below zero above which it is an error
DERIVATIVE_STEP = 1e-6  # [1] step of numerical derivatives, over a parameter's size


@dataclass(frozen=True, eq=False)
class Difference(Frozen):
    """Base parameters with the load less those without it: difference = columns @ load + noise."""

    columns: Array  # (b, 10) [units of base per unit of the load]
    value: Array  # (b,) [units of base]
    covariance: Array  # (b, b) [units of base] of noise and of changes of friction, times the misfit
    load: Array  # (10,) [kg, kg.m, kg.m2] by generalised least squares
    spread: Array  # (10, 10) its covariance [products of the units]; infinite variance if unidentifiable
    misfit: float  # [1] variance of the residual over that of noise, at least 1
    drifted: float  # [1] largest change of friction or offset, over its standard deviation

    @property
    def estimate(self) -> Estimate:
        """Difference as an estimate of base parameters; its information is the inverse of the covariance."""
        size = np.sqrt(np.diag(self.covariance))
        information = np.linalg.inv(self.covariance / np.outer(size, size)) / np.outer(size, size)
        return Estimate(self.value, self.covariance, information, np.zeros(0), ())

    def feasible(self) -> ConsistentFit:
        """Nearest physically possible load, sought from a compact body with the difference's mass and centre."""
        names, b = zip(INERTIAL, INERTIAL_UNITS, strict=True), len(self.value)
        labels = tuple(Label(f"{name}_load", unit, body=0) for name, unit in names)
        sees = np.ones((1, b), bool)
        alone = BaseMap(labels, np.zeros(b, int), self.columns, ("",) * b, ("",) * b, sees, np.ones(1), 1.0)
        mass = max(float(self.load[0]), PRIOR_MIN_MASS)
        centre = self.load[1:4] / mass
        centre = centre * min(1.0, PRIOR_MAX_DISTANCE / max(float(np.linalg.norm(centre)), 1e-9))
        turn = mass * (PRIOR_GYRATION_RADIUS**2 * np.eye(3) + centre @ centre * np.eye(3) - np.outer(centre, centre))
        values = [mass, *(mass * centre), *turn[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
        return fit_consistent(alone, self.estimate, Parameters(labels, np.array(values)))


def subtract(base: BaseMap, body: int, bare: Estimate, loaded: Estimate, factors: Factors, added: Array) -> Difference:
    """Fit the difference of two estimates by a body that is added to one of the robot's bodies.

    The robot's own parameters are equal in both estimates and cancel. Friction and offsets may have changed by about a
    tenth. `factors` are those of the recordings without the load, for the sizes of torque and speed. The covariance
    added: (b, b) [units of base] widens the intervals but does not weight the fit, since most of this error is equal
    with and without the load.

    Source: Khalil, Gautier, Lemoine, Identification of the payload inertial parameters of industrial manipulators, IEEE
    ICRA 2007.
    """
    known = np.isfinite(bare.std) & np.isfinite(loaded.std)
    count, columns = int(known.sum()), base.combination[:, 10 * body : 10 * body + 10]
    value, noise = loaded.value - bare.value, bare.covariance + loaded.covariance
    change, size = changes(base, bare, factors)
    covariance = np.where(np.outer(known, known), noise, 0.0) + (change * size**2) @ change.T
    far = 1e3 * (np.abs(bare.value) + np.abs(loaded.value) + np.sqrt(np.diag(covariance)) + 1.0)
    covariance[~known] = covariance[:, ~known] = 0.0
    covariance[~known, ~known] = far[~known] ** 2
    covariance = _positive(covariance)
    root = np.linalg.cholesky(covariance)
    inverse, spread, rank = _solve(np.linalg.solve(root, columns))
    gain = inverse @ np.linalg.inv(root)
    load = gain @ value
    left = np.linalg.solve(root, value - columns @ load)
    misfit = max(1.0, float(left @ left) / max(count - rank, 1))
    drifted = float(np.abs(size * (change.T @ np.linalg.solve(root.T, left))).max(initial=0.0))
    finite = np.where(np.isinf(np.diag(spread))[:, None], 0.0, gain)
    spread = misfit * spread + finite @ np.where(np.outer(known, known), added, 0.0) @ finite.T
    return Difference(columns, value, misfit * covariance, load, spread, misfit, drifted)


def _positive(covariance: Array) -> Array:
    """Covariance (b, b), with the magnitude of negative eigenvalues, which that of instruments can have."""
    size = np.sqrt(np.diag(covariance))
    values, vectors = np.linalg.eigh(covariance / np.outer(size, size))
    if values[0] > 0:
        return covariance
    wide = (vectors * np.maximum(np.abs(values), MIN_CORRELATION_EIGENVALUE)) @ vectors.T
    return np.asarray((wide + wide.T) / 2 * np.outer(size, size))


def _solve(columns: Array) -> tuple[Array, Array, int]:
    """Least squares of white rows: estimator (10, b), covariance of the ten parameters, rank."""
    size = np.linalg.norm(columns, axis=0)
    size = np.where(size > 1e-300, size, np.inf)  # a column of zeros has no information
    left, s, right = np.linalg.svd(columns / size, full_matrices=False)
    kept = s > DIRECTION_RANK_TOLERANCE * s[0]
    inverse = (right[kept].T / s[kept]) / size[:, None]
    spread = inverse @ inverse.T
    lost = (np.sum(right[~kept] ** 2, axis=0) > 1e-8) | np.isinf(size)
    spread[lost, lost] = np.inf
    return inverse @ left[:, kept].T, spread, int(kept.sum())


def changes(base: BaseMap, bare: Estimate, factors: Factors) -> tuple[Array, Array]:
    """Columns (b, l) of the friction and offsets that may have changed, and standard deviations (l,) [unit of each]."""
    speed = np.sqrt(np.diag(factors.velocity) / factors.rows)
    torque = [np.sqrt(joint.whole[-1, -1] / max(joint.rows, 1)) for joint in factors.joints]
    place = {int(k): row for row, k in enumerate(base.independent)}
    which, sizes = [], []
    for k, label in enumerate(base.labels):
        if label.joint is not None and "kg" not in label.unit:  # the inertia of a rotor does not change
            own = abs(bare.value[place[k]]) if k in place else 0.0
            natural = torque[label.joint] / (max(speed[label.joint], 0.05) if ".s/" in label.unit else 1.0)
            which.append(k)
            sizes.append(max(FRICTION_CHANGE_SHARE * own, TORQUE_CHANGE_SHARE * natural))
    return base.combination[:, which], np.array(sizes)


def weigh(
    session: Session, sides: Sequence[Sequence[Part]], inputs: tuple[Input, ...], progress: Progress | None = None
) -> Payload:
    """Load that the parts of the second side have, and those of the first lack.

    Raises:
        RecordingError: every stretch of a side is shorter than the filter.
    """
    options = session.options
    lags = LAGS if options.whiten else 0
    factors = [session.reduce(side, progress=progress, lags=lags) for side in sides]
    base = session.task.base
    prior = base.combination @ stated_parameters(session.task).values
    bare, loaded = (estimate(replace(f, sample=None), base, prior, options.whiten) for f in factors)
    scaled = [recording.torque_per_unit != 1 for recording in session.recordings]
    currents = np.any(scaled, axis=0)  # (n,) times a constant
    added = _beyond_noise(base, prior, (bare, loaded), factors, currents, options.whiten)
    body = own_body(session.robot, len(session.robot.joints) - 1)
    difference = subtract(base, body, bare, loaded, factors[0], added)
    fitted = difference.feasible()
    lost = np.isinf(np.diag(difference.spread))
    parts = {"mass": lost[:1], "centre of mass": lost[1:4], "inertia": lost[4:]}
    unidentifiable = tuple(name for name, some in parts.items() if some.any())
    return Payload(
        robot=session.robot,
        link=session.robot.links[body],
        inertial=fitted.parameters.bodies()[0],
        covariance=difference.spread,
        unidentified=unidentifiable,
        moved=fitted.moved,
        misfit=difference.misfit,
        drifted=difference.drifted,
        inputs=inputs,
        cutoff=session.task.band.cutoff,
        seed=options.seed,
        flags=_flags(difference, unidentifiable),
        notes=(*session.notes, *fitted.notes, *_notes(difference)),
    )


def _beyond_noise(
    base: BaseMap, prior: Array, found: Sequence[Estimate], factors: Sequence[Factors], currents: Mask, whiten: bool
) -> Array:
    """Covariance (b, b) of the difference due to model discrepancy and to errors of torque constants."""
    turns, total = [], np.zeros((base.rank, base.rank))
    for one, own in zip(found, factors, strict=True):
        total += np.nan_to_num(estimate(own, base, prior, whiten).covariance - one.covariance, nan=0.0)
        turns.append(constant_sensitivity(one, own, base, currents, whiten))
    apart = TORQUE_CONSTANT_STD * (turns[1] - turns[0])
    return np.asarray(total + apart @ apart.T)


def _flags(difference: Difference, unidentifiable: Sequence[str]) -> tuple[str, ...]:
    what = " and the ".join(unidentifiable)
    flags = [f"the {what} of a load is not identifiable from these recordings"] if unidentifiable else []
    mass, std = float(difference.load[0]), float(np.sqrt(difference.spread[0, 0]))
    if np.isfinite(std) and mass < CERTAIN_MASS_DEVIATIONS * std:
        flags.append(
            f"no load is certain: the difference has a mass of {mass:.2g} kg, with a standard deviation of {std:.2g} kg"
        )
    return tuple(flags)


def _notes(difference: Difference) -> list[str]:
    notes = []
    if difference.misfit > MISFIT_NOTE_RATIO:
        notes.append(
            f"the misfit beside the load is {difference.misfit:.0f} times the variance of noise: intervals are "
            f"{np.sqrt(difference.misfit):.1f} times wider"
        )
    if difference.drifted > DRIFT_NOTE_RATIO:
        notes.append(f"friction or an offset changed by {difference.drifted:.1f} times what is usual from day to day")
    return notes


class LoadMoment(NamedTuple):
    """When the load was picked up, or put down."""

    t: float  # [s] in the recording
    std: float  # [s]
    picked_up: bool


@dataclass(frozen=True, eq=False)
class Payload(Result):
    """Body that the last link carries. `flags` name unreliable results; empty if there are none."""

    robot: Robot
    link: str  # link that carries the load; the load is expressed in the frame of its joint
    inertial: Array  # (10,) in Pinocchio's order, about the joint's frame [kg, kg.m, kg.m2]; NaN: no load was found
    covariance: Array  # (10, 10) of the difference before it was made feasible [products of their units]
    unidentified: tuple[str, ...]  # unidentifiable ones of mass, centre and inertia
    moved: float  # [standard deviations] largest change of an identifiable number by feasibility
    misfit: float  # [1] variance of the residual of the difference over that of noise; above 1 it widens the intervals
    drifted: float  # [1] largest change of friction or offset, over its prior standard deviation
    inputs: tuple[Input, ...]
    cutoff: float  # [Hz]
    seed: int
    flags: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    moments: tuple[LoadMoment, ...] = ()  # in one recording; empty for separate recordings
    bare: Model | None = None  # the given model

    @property
    def found(self) -> bool:
        """Whether there is a load."""
        return bool(np.isfinite(self.inertial[0]))

    @property
    def load(self) -> Load:
        """Load about the frame of the last joint."""
        return Load(self.inertial, self.covariance)

    @property
    def mass(self) -> tuple[float, float]:
        """Mass of the load, and its standard deviation [kg]."""
        return self.load.mass

    @property
    def centre(self) -> tuple[Array, Array]:
        """Centre of mass (3,) [m], and its standard deviation (3,) [m]."""
        return self.load.centre

    @property
    def inertia(self) -> tuple[Array, Array]:
        """Inertia (6,) about the centre of mass, xx, xy, yy, xz, yz, zz [kg.m2], and its standard deviation (6,)."""
        return self.load.inertia

    @property
    def law(self) -> Law:
        """Load as a law of a model.

        Raises:
            OptionError: no load was found.
        """
        if not self.found:
            raise OptionError("no load was found, so it is no law; see the flags of the result")
        effect = EFFECTS["payload"]
        values = dict(zip(effect.parameters, self.inertial.tolist(), strict=True))
        return Law(effect, (len(self.robot.joints) - 1,), values)

    @property
    def model(self) -> Model:
        """The given model with the load, beside what it carried before.

        Raises:
            OptionError: no load was found.
        """
        if not self.found or self.bare is None:
            raise OptionError("no load was found, so no model has it; see the flags of the result")
        return with_payload(self.bare, self.inertial, self.covariance)


def carried(model: Model) -> Load | None:
    """Sum of the payloads of a model about the frame of its last joint; None without any.

    The covariance is zero if the model states none (`payload_covariance`).
    """
    laws = [law for law in model.laws if law.effect.name == "payload"]
    if not laws:
        return None
    total = np.sum([law.effect.coefficients(law.parameters) for law in laws], axis=0)
    known = model.payload_covariance
    return Load(total, np.zeros((len(INERTIAL),) * 2) if known is None else known)


def with_payload(model: ModelSource, inertial: ArrayLike, covariance: ArrayLike | None = None) -> Model:
    """Model that carries a further load at its last link, in one law with what it carries already.

    >>> signid.with_payload("3r", [0.3, 0, 0, 0.05]).laws[0].parameters["mass"]
    0.3

    A negative mass takes a load off. If nothing is left within three standard deviations, the model carries none. The
    covariance of the model's base parameters grows by that of the load.

    Args:
        model: rigid bodies and laws.
        inertial: (10,) [kg, kg.m, kg.m2] mass, first moments and inertia about the frame of the last joint, in
            Pinocchio's order; (4,): a point mass.
        covariance: (4, 4) or (10, 10) [products of their units] of their errors; infinite variances are
            unidentifiable. None: unknown, then also of the sum.

    Raises:
        OptionError: an array has another shape, a number is not finite, a variance is not positive, or more is taken
            off than the model carries.
    """
    model = as_model(model, "with_payload")
    effect, numbers = EFFECTS["payload"], np.asarray(inertial, float)
    shapes = [numbers.shape, (len(numbers),) * 2 if covariance is None else np.shape(covariance)]
    if shapes not in ([(4,), (4, 4)], [(10,), (10, 10)]) or not np.isfinite(numbers).all():
        raise OptionError(
            f"a payload has 4 or 10 finite numbers and a covariance of as many rows and columns, not shapes "
            f"{shapes[0]} and {shapes[1]}"
        )
    if covariance is not None and not np.all(np.diag(covariance) > 0):
        raise OptionError("a payload has a variance that is not positive; leave out a covariance that is not known")
    added = np.array(effect.coefficients(dict(zip(effect.parameters, numbers.tolist(), strict=False))))
    own = np.zeros((len(INERTIAL),) * 2)
    if covariance is not None:
        np.fill_diagonal(own, np.inf)  # the inertia of a point mass is not identified
        own[: len(numbers), : len(numbers)] = covariance
    before = carried(model) or Load(np.zeros(len(INERTIAL)), np.zeros_like(own))
    total, errors = before.inertial + added, before.covariance + own
    if total[0] < -NEGATIVE_MASS_DEVIATIONS * np.sqrt(errors[0, 0]):
        raise OptionError(
            f"the model of {model.robot.name} carries {before.inertial[0]:.3g} kg, so {-added[0]:.3g} kg cannot be "
            f"taken off; give a smaller load"
        )
    laws = tuple(law for law in model.laws if law.effect.name != "payload")
    if total[0] <= 0:
        return replace(model, laws=laws, payload_covariance=None)
    law = Law(effect, (len(model.robot.joints) - 1,), dict(zip(effect.parameters, total.tolist(), strict=True)))
    unknown = covariance is None or (before.inertial[0] > 0 and model.payload_covariance is None)
    return replace(_less_sure(model, own), laws=(*laws, law), payload_covariance=None if unknown else errors)


def _less_sure(model: Model, covariance: Array) -> Model:
    """Model whose base parameters have the errors of a load as well, where these are finite."""
    base = model.covariance
    if base is None:
        return model
    first = len(INERTIAL) * own_body(model.robot, len(model.robot.joints) - 1)
    columns = base.combination[:, first : first + len(INERTIAL)]
    finite = np.isfinite(np.diag(covariance))
    known = np.where(np.outer(finite, finite), covariance, 0.0)
    return replace(model, covariance=replace(base, matrix=base.matrix + columns @ known @ columns.T))


@dataclass(frozen=True, eq=False)
class Load(Frozen):
    """Inertial parameters of a body about the origin of a frame."""

    inertial: Array  # (10,) in Pinocchio's order [kg, kg.m, kg.m2]
    covariance: Array  # (10, 10) [products of their units]; infinite variance if unidentifiable

    @property
    def mass(self) -> tuple[float, float]:
        """Mass of the load, and its standard deviation [kg]."""
        return float(self.inertial[0]), float(self._std(lambda x: x[:1])[0])

    @property
    def centre(self) -> tuple[Array, Array]:
        """Centre of mass (3,) [m], and its standard deviation (3,) [m]."""
        return self.inertial[1:4] / self.inertial[0], self._std(lambda x: x[1:4] / x[0])

    @property
    def inertia(self) -> tuple[Array, Array]:
        """Inertia (6,) about the centre of mass, xx, xy, yy, xz, yz, zz [kg.m2], and its standard deviation (6,)."""
        return _about_centre(self.inertial), self._std(_about_centre)

    def seen_from(self, frame: pin.SE3) -> Load:
        """The same body about the origin and along the axes of a frame, whose placement in the present one is given."""
        change = np.column_stack([_moved(x, frame.inverse().homogeneous) for x in np.eye(len(INERTIAL))])
        finite = np.isfinite(np.diag(self.covariance))
        covariance = change @ np.where(np.outer(finite, finite), self.covariance, 0.0) @ change.T
        lost = np.abs(change[:, ~finite]).max(axis=1, initial=0.0) > 0
        covariance[lost, lost] = np.inf
        return Load(change @ self.inertial, covariance)

    def _std(self, of: Callable[[Array], Array]) -> Array:
        """Standard deviations (k,) of a function of the ten numbers; infinite if unidentifiable."""
        x, finite = self.inertial, np.isfinite(np.diag(self.covariance))
        size = np.maximum(np.abs(x), 1e-3 * np.abs(x).max()) * DERIVATIVE_STEP
        slope = np.column_stack([(of(x + d) - of(x - d)) / (2 * s) for d, s in zip(np.diag(size), size, strict=True)])
        known = np.where(np.outer(finite, finite), self.covariance, 0.0)
        std = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slope, known, slope), 0.0))
        return np.where(np.abs(slope[:, ~finite]).max(axis=1, initial=0.0) > 0, np.inf, std)


def _about_centre(inertial: Array) -> Array:
    """Inertia (6,) about the centre of mass [kg.m2], in Pinocchio's order, of ten parameters about a frame's origin."""
    m, (x, y, z) = inertial[0], inertial[1:4]
    shift = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    return np.asarray(inertial[4:] - shift / m)


def _moved(inertial: Array, frame: Array) -> Array:
    """Ten parameters in another frame, in which the present one is placed by a homogeneous matrix (4, 4)."""
    pseudo = frame @ pseudo_inertia(inertial) @ frame.T
    inertia = np.trace(pseudo[:3, :3]) * np.eye(3) - pseudo[:3, :3]
    return np.array([pseudo[3, 3], *pseudo[:3, 3], *inertia[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]])
