"""Parts of a session without and with a load -> the load, with standard deviations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..estimation.least_squares import estimate
from ..model import stated_parameters
from ..regression.factors import LAGS, Factors
from ..regression.session import Part, Session
from ..robot.dynamics import own_body
from ..signs.torque_constants.constants import constant_sensitivity
from ..types import Array, BaseMap, Estimate, Input, Mask, Progress
from .difference import Difference, subtract
from .result import Payload

CERTAIN = 3.0  # standard deviations above which a mass is certain
CONSTANT = 0.03  # relative standard deviation of a torque constant: a magnet loses a tenth of a per cent per kelvin
DRIFT, MISFIT = 3.0, 10.0  # [1] changes of friction and misfit, in usual sizes, above which a note is given


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
    apart = CONSTANT * (turns[1] - turns[0])
    return np.asarray(total + apart @ apart.T)


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
