"""Base parameters -> standard parameters, by the method that is asked for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from ..deadline import seconds_left
from ..model import stated_parameters
from ..regression.factors import Factors
from ..regression.session import Session
from ..types import Estimate, Parameters
from .feasible import fit_consistent, standard_from_base
from .fit_quality import judge_fit
from .pbrp import Bounds, bounds_around, read_bounds, retrieve

WORSE = 1.05  # times the training rms of least squares, from which on a fit that time cut short is dropped
CUT_SHORT = (
    "the {} fit that time cut short predicts torque worse than plain least squares, whose parameters are given instead "
    "(--method wls): they need not be physically consistent"
)
METHODS = ("convex", "wls", "pbrp")  # the first by default; the last after a tree of sign choices


@dataclass(frozen=True)
class Search:
    """How penalty-based parameter retrieval searches: see `signid.estimation.pbrp`."""

    bounds: str | Path | None = None  # TOML file of the box; None: around the description
    global_algorithm: str = "GN_CRS2_LM"
    local_algorithm: str = "LD_LBFGS"
    total_mass: tuple[float, float] | None = None  # [kg]


class Standard(NamedTuple):
    """Standard parameters and how they came about."""

    parameters: Parameters
    moved: float  # standard deviations by which they move the estimate at most
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()


def choose_standard(session: Session, found: Estimate, method: str, search: Search, seed: int) -> Standard:
    """Standard parameters that belong to an estimate.

    Args:
        session: gives robot and base map.
        found: base parameters.
        method: one of METHODS.
        search: of penalty-based parameter retrieval.
        seed: of it.
    """
    base, prior = session.task.base, stated_parameters(session.task)
    if method == "wls":
        return Standard(standard_from_base(base, found.value, prior), 0.0)
    if method == "convex":
        fitted = fit_consistent(base, found, prior)
        return Standard(fitted.parameters, fitted.moved, fitted.notes)
    got = retrieve(
        base,
        found,
        prior,
        _box(session, found, prior, search),
        global_algorithm=search.global_algorithm,
        local_algorithm=search.local_algorithm,
        total_mass=search.total_mass,
        seed=seed,
    )
    moves = np.abs(base.combination @ got.parameters.values - found.value) / found.std
    flags = [] if got.feasible else ["retrieval found no parameters that a real robot could have; use --method convex"]
    flags += [] if got.converged else ["retrieval spent its budget before it converged; use --method convex"]
    return Standard(got.parameters, float(np.max(moves)), got.notes, tuple(flags))


def choose_in_time(
    session: Session, train: Factors, found: Estimate, method: str, search: Search, seed: int
) -> tuple[Standard, str]:
    """Standard parameters and their method: plain least squares where time cut the search short with a worse fit.

    Args:
        session: gives robot and base map.
        train: factors that the estimate comes from.
        found: base parameters.
        method: one of METHODS.
        search: of penalty-based parameter retrieval.
        seed: of it.
    """
    chosen = choose_standard(session, found, method, search, seed)
    if method == "wls" or seconds_left() > 0:
        return chosen, method
    value = session.task.base.combination @ chosen.parameters.values
    cut, plain = (judge_fit(session, train, train, v).train_rms for v in (value, found.value))
    if not np.any(cut > WORSE * plain):
        return chosen, method
    plainly = choose_standard(session, found, "wls", search, seed)
    return plainly._replace(flags=(*chosen.flags, CUT_SHORT.format(method))), "wls"


def _box(session: Session, found: Estimate, prior: Parameters, search: Search) -> Bounds | None:
    if search.bounds is None:
        return None
    return read_bounds(search.bounds, session.robot.links, bounds_around(session.task.base, found, prior))
