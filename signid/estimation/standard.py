"""Base parameters -> standard parameters, by the chosen method."""

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
from .pbrp import bounds_around, read_bounds, retrieve

MAX_RMS_RATIO = 1.05  # [1] training rms over that of least squares, above which a fit that time cut short is dropped
CUT_SHORT_NOTE = (
    "the {} fit that time cut short predicts torque worse than plain least squares, whose parameters are given instead "
    "(--method wls); they may be physically infeasible: allow more time"
)
STANDARD_METHODS = ("convex", "wls", "pbrp")  # the default is the first; after a tree of sign choices, the last


@dataclass(frozen=True)
class Search:
    """Options of penalty-based parameter retrieval, see `signid.estimation.pbrp`."""

    bounds: str | Path | None = None  # TOML file of the box; None: around the description
    global_algorithm: str = "GN_CRS2_LM"
    local_algorithm: str = "LD_LBFGS"
    total_mass: tuple[float, float] | None = None  # [kg] range of the total mass


class Standard(NamedTuple):
    """Standard parameters of an estimate."""

    parameters: Parameters
    moved: float  # [standard deviations] largest change of a base parameter
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()


def choose_standard(session: Session, found: Estimate, method: str, search: Search, seed: int) -> Standard:
    """Standard parameters of an estimate, by one of STANDARD_METHODS."""
    base, prior = session.task.base, stated_parameters(session.task)
    if method == "wls":
        return Standard(standard_from_base(base, found.value, prior), 0.0)
    if method == "convex":
        fitted = fit_consistent(base, found, prior)
        return Standard(fitted.parameters, fitted.moved, fitted.notes)
    box = bounds_around(base, found, prior)
    if search.bounds is not None:
        box = read_bounds(search.bounds, session.robot.links, box)
    pbrp = retrieve(
        base,
        found,
        prior,
        box,
        global_algorithm=search.global_algorithm,
        local_algorithm=search.local_algorithm,
        total_mass=search.total_mass,
        seed=seed,
    )
    moves = np.abs(base.combination @ pbrp.parameters.values - found.value) / found.std
    flags = [] if pbrp.best.feasible else ["retrieval found no physically feasible parameters; use --method convex"]
    flags += [] if pbrp.best.converged else ["retrieval spent its budget before it converged; use --method convex"]
    return Standard(pbrp.parameters, float(np.max(moves)), pbrp.notes, tuple(flags))


def choose_in_time(
    session: Session, train: Factors, found: Estimate, method: str, search: Search, seed: int
) -> tuple[Standard, str]:
    """Standard parameters and their method; plain least squares if time cut the search short with a worse fit."""
    chosen = choose_standard(session, found, method, search, seed)
    if method == "wls" or seconds_left() > 0:
        return chosen, method
    value = session.task.base.combination @ chosen.parameters.values
    cut, plain = (judge_fit(session, train, train, v).train_rms for v in (value, found.value))
    if not np.any(cut > MAX_RMS_RATIO * plain):
        return chosen, method
    fallback = choose_standard(session, found, "wls", search, seed)
    return fallback._replace(flags=(*chosen.flags, CUT_SHORT_NOTE.format(method))), "wls"
