"""Recordings without and with a load -> the load's mass, centre and inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..deadline import ends_in_time
from ..errors import OptionError, RecordingError
from ..estimation.feasible import fit_consistent
from ..estimation.least_squares import estimate
from ..model import stated_parameters
from ..regression.factors import LAGS, Factors
from ..regression.prepare import prepare
from ..regression.session import Options
from ..robot.dynamics import own_body
from ..signs.torque_constants.constants import constant_sensitivity
from ..types import (
    INERTIAL,
    INERTIAL_UNITS,
    Array,
    BaseMap,
    Estimate,
    Input,
    Label,
    Mask,
    Parameters,
    Progress,
    Recording,
    Robot,
)
from .difference import Difference, subtract
from .result import Payload

RADIUS, LIGHT, FAR = 0.05, 0.05, 0.3  # prior load: radius of gyration [m], least mass [kg], farthest centre [m]
CERTAIN = 3.0  # standard deviations above which a mass is certain
CONSTANT = 0.03  # relative standard deviation of a torque constant: a magnet loses a tenth of a per cent per kelvin
DRIFT, MISFIT = 3.0, 10.0  # [1] changes of friction and misfit, in usual sizes, above which a note is given
ROLES = ("recording, without the load", "recording, with the load")


@ends_in_time
def payload(
    robot: Robot,
    without: Sequence[Recording],
    carrying: Sequence[Recording],
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
    options, both = options or Options(), [*without, *carrying]
    _check(without, carrying)
    session = prepare(robot, both, both, options)
    sides = session.train[: len(without)], session.train[len(without) :]
    lags = LAGS if options.whiten else 0
    factors = [session.reduce(side, progress=progress, lags=lags) for side in sides]
    base = session.task.base
    prior = base.combination @ stated_parameters(session.task).values
    bare, loaded = (estimate(replace(f, sample=None), base, prior, options.whiten) for f in factors)
    added = _beyond_noise(base, prior, (bare, loaded), factors, _currents(both), options.whiten)
    body = own_body(session.robot, len(session.robot.joints) - 1)
    difference = subtract(base, body, bare, loaded, factors[0], added)
    fitted = fit_consistent(_one_body(difference), difference.estimate, _before(difference))
    inertial = fitted.parameters.bodies()[0]
    unidentifiable = _unidentifiable(difference)
    roles = zip((without, carrying), ROLES, strict=True)
    return Payload(
        robot=session.robot,
        link=session.robot.links[body],
        inertial=inertial,
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


def _beyond_noise(
    base: BaseMap,
    prior: Array,
    found: tuple[Estimate, Estimate],
    factors: Sequence[Factors],
    currents: Mask,
    whiten: bool,
) -> Array:
    """Covariance (b, b) of the difference due to model discrepancy and to errors of torque constants."""
    turns, total = [], np.zeros((base.rank, base.rank))
    for one, own in zip(found, factors, strict=True):
        total += np.nan_to_num(estimate(own, base, prior, whiten).covariance - one.covariance, nan=0.0)
        turns.append(constant_sensitivity(one, own, base, currents, whiten))
    apart = CONSTANT * (turns[1] - turns[0])
    return np.asarray(total + apart @ apart.T)


def _currents(recordings: Sequence[Recording]) -> Mask:
    """(n,) whether the torque of a joint is a current times its constant."""
    return np.asarray(np.any([recording.torque_per_unit != 1 for recording in recordings], axis=0))


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


def _one_body(difference: Difference) -> BaseMap:
    """The load alone as what the difference is made of."""
    names = zip(INERTIAL, INERTIAL_UNITS, strict=True)
    labels = tuple(Label(f"{name}_load", unit, body=0) for name, unit in names)
    b = len(difference.value)
    return BaseMap(
        labels, np.zeros(b, int), difference.columns, ("",) * b, ("",) * b, np.ones((1, b), bool), np.ones(1), 1.0
    )


def _before(difference: Difference) -> Parameters:
    """A compact body with the mass and the centre of the difference, as a starting point."""
    mass, moment = max(float(difference.load[0]), LIGHT), difference.load[1:4]
    centre = moment / mass
    centre = centre * min(1.0, FAR / max(float(np.linalg.norm(centre)), 1e-9))
    turn = mass * (RADIUS**2 * np.eye(3) + centre @ centre * np.eye(3) - np.outer(centre, centre))
    values = [mass, *(mass * centre), *turn[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]]]
    return Parameters(_one_body(difference).labels, np.array(values))


def _unidentifiable(difference: Difference) -> tuple[str, ...]:
    lost = np.isinf(np.diag(difference.spread))
    parts = (("mass", lost[:1]), ("centre of mass", lost[1:4]), ("inertia", lost[4:]))
    return tuple(name for name, some in parts if some.any())


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
