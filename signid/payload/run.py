"""Recordings without and with a load -> the load's mass, centre and inertia, with standard deviations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..deadline import ends_in_time
from ..effects import EFFECTS
from ..errors import OptionError, RecordingError
from ..estimation.least_squares import estimate
from ..model import Model, ModelSource, stated_inertials, stated_laws, stated_parameters
from ..recording import Recordings, as_recordings
from ..recording_faults import recording_flags
from ..regression.factors import LAGS, Factors
from ..regression.prepare import prepare
from ..regression.session import Options
from ..robot import as_robot
from ..robot.dynamics import own_body
from ..signs.torque_constants.constants import constant_sensitivity
from ..types import Array, BaseMap, Estimate, Input, Law, Mask, Progress, Recording, Result, Robot
from .difference import Difference, subtract

CERTAIN = 3.0  # standard deviations above which a mass is certain
CONSTANT = 0.03  # relative standard deviation of a torque constant: a magnet loses a tenth of a per cent per kelvin
DRIFT, MISFIT = 3.0, 10.0  # [1] changes of friction and misfit, in usual sizes, above which a note is given
ROLES = ("recording, without the load", "recording, with the load")
STEP = 1e-6  # [1] step of numerical derivatives, over a parameter's size


@dataclass(frozen=True, eq=False)
class Payload(Result):
    """Body that the last link carries. `flags` name unreliable results; empty if there are none."""

    robot: Robot
    link: str  # link that carries the load; the load is expressed in the frame of its joint
    inertial: Array  # (10,) in Pinocchio's order, about the joint's frame [kg, kg.m, kg.m2]
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

    @property
    def law(self) -> Law:
        """Load as a law of a model."""
        effect = EFFECTS["payload"]
        values = dict(zip(effect.parameters, self.inertial.tolist(), strict=True))
        return Law(effect, (len(self.robot.joints) - 1,), values)

    def _std(self, of: Callable[[Array], Array]) -> Array:
        """Standard deviations (k,) of a function of the ten numbers; infinite if unidentifiable."""
        x, finite = self.inertial, np.isfinite(np.diag(self.covariance))
        size = np.maximum(np.abs(x), 1e-3 * np.abs(x).max()) * STEP
        slope = np.column_stack([(of(x + d) - of(x - d)) / (2 * s) for d, s in zip(np.diag(size), size, strict=True)])
        known = np.where(np.outer(finite, finite), self.covariance, 0.0)
        std = np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", slope, known, slope), 0.0))
        return np.where(np.abs(slope[:, ~finite]).max(axis=1, initial=0.0) > 0, np.inf, std)


@ends_in_time
def payload(
    robot: ModelSource,
    without: Recordings,
    carrying: Recordings,
    *,
    options: Options | None = None,
    progress: Progress | None = None,
) -> Payload:
    """Identify the load of the last link from recordings without it and with it.

    Base parameters are estimated from both. Parameters of the robot itself are equal in both and cancel in the
    difference; friction and offsets may have changed a little. The difference is projected onto the nearest physically
    possible body. Misfit beyond noise and such changes widens the intervals.

    Args:
        robot: as `load_robot` gives it.
        without: recordings of the robot alone.
        carrying: recordings of the robot with the load.
        options: effects, cut-off and the like.
        progress: called with the current step and the share that is done.

    Raises:
        RecordingError: a recording cannot be used, or lacks signs of torque.
        OptionError: one side has no recording, or one was given twice.

    Source: Khalil, Gautier, Lemoine, IEEE ICRA 2007; feasible bodies: Wensing, Kim, Slotine, IEEE RA-L 3(1), 2018.
    """
    robot, options = as_robot(robot, "payload"), options or Options()
    without, carrying = (as_recordings(side, robot, "payload") for side in (without, carrying))
    both = [*without, *carrying]
    _check(without, carrying)
    session = prepare(robot, both, both, options)
    sides = session.train[: len(without)], session.train[len(without) :]
    lags = LAGS if options.whiten else 0
    factors = [session.reduce(side, progress=progress, lags=lags) for side in sides]
    base = session.task.base
    prior = base.combination @ stated_parameters(session.task).values
    bare, loaded = (estimate(replace(f, sample=None), base, prior, options.whiten) for f in factors)
    currents = np.any([recording.torque_per_unit != 1 for recording in both], axis=0)  # (n,) times a constant
    added = _beyond_noise(base, prior, (bare, loaded), factors, currents, options.whiten)
    body = own_body(session.robot, len(session.robot.joints) - 1)
    difference = subtract(base, body, bare, loaded, factors[0], added)
    fitted = difference.feasible()
    lost = np.isinf(np.diag(difference.spread))
    parts = {"mass": lost[:1], "centre of mass": lost[1:4], "inertia": lost[4:]}
    unidentifiable = tuple(name for name, some in parts.items() if some.any())
    roles = zip((without, carrying), ROLES, strict=True)
    found = Payload(
        robot=session.robot,
        link=session.robot.links[body],
        inertial=fitted.parameters.bodies()[0],
        covariance=difference.spread,
        unidentified=unidentifiable,
        moved=fitted.moved,
        misfit=difference.misfit,
        drifted=difference.drifted,
        inputs=tuple(Input(r.path, r.sha256, role) for side, role in roles for r in side),
        cutoff=session.task.band.cutoff,
        seed=options.seed,
        flags=_flags(difference, unidentifiable),
        notes=(*session.notes, *fitted.notes, *_notes(difference)),
    )
    return replace(found, flags=(*_fault_flags(found, without, carrying), *found.flags))


def _fault_flags(found: Payload, without: Sequence[Recording], carrying: Sequence[Recording]) -> tuple[str, ...]:
    """Recording faults of either side: of the described robot alone, and with the load that was found."""
    bare = Model(found.robot, stated_inertials(found.robot), stated_laws(found.robot))
    sides = ((bare, without), (replace(bare, laws=(*bare.laws, found.law)), carrying))
    return tuple(dict.fromkeys(flag for model, side in sides for flag in recording_flags(model, side)))


def _beyond_noise(
    base: BaseMap, prior: Array, found: Sequence[Estimate], factors: Sequence[Factors], currents: Mask, whiten: bool
) -> Array:
    """Covariance (b, b) of the difference due to model discrepancy and to errors of torque constants."""
    turns, total = [], np.zeros((base.rank, base.rank))
    for one, own in zip(found, factors, strict=True):
        total += np.nan_to_num(estimate(own, base, prior, whiten).covariance - one.covariance, nan=0.0)
        turns.append(constant_sensitivity(one, own, base, currents, whiten))
    apart = CONSTANT * (turns[1] - turns[0])
    return np.asarray(total + apart @ apart.T)


def _check(without: Sequence[Recording], carrying: Sequence[Recording]) -> None:
    for name, side in (("without", without), ("with", carrying)):
        if not side:
            raise OptionError(f"no recording {name} the load was given; the load is the difference of the two")
    both = [*without, *carrying]
    if len({recording.sha256 for recording in both}) < len(both):
        raise OptionError("the same samples were given twice; give each recording once, without the load or with it")
    for recording in both:
        if not recording.signed.all():
            name = recording.path or "a recording"
            raise RecordingError(f"{name} lacks signs of torque; a load is found from torque that has its sign")


def _flags(difference: Difference, unidentifiable: Sequence[str]) -> tuple[str, ...]:
    what = " and the ".join(unidentifiable)
    flags = [f"the {what} of a load is not identifiable from these recordings"] if unidentifiable else []
    mass, std = float(difference.load[0]), float(np.sqrt(difference.spread[0, 0]))
    if np.isfinite(std) and mass < CERTAIN * std:
        flags.append(
            f"no load is certain: the difference has a mass of {mass:.2g} kg, with a standard deviation of {std:.2g} kg"
        )
    return tuple(flags)


def _notes(difference: Difference) -> list[str]:
    notes = []
    if difference.misfit > MISFIT:
        notes.append(
            f"the misfit beside the load is {difference.misfit:.0f} times the variance of noise: intervals are "
            f"{np.sqrt(difference.misfit):.1f} times wider"
        )
    if difference.drifted > DRIFT:
        notes.append(f"friction or an offset changed by {difference.drifted:.1f} times what is usual from day to day")
    return notes


def _about_centre(inertial: Array) -> Array:
    """Inertia (6,) about the centre of mass [kg.m2], in Pinocchio's order, of ten parameters about a frame's origin."""
    m, (x, y, z) = inertial[0], inertial[1:4]
    shift = np.array([y * y + z * z, -x * y, x * x + z * z, -x * z, -y * z, x * x + y * y])
    return np.asarray(inertial[4:] - shift / m)
