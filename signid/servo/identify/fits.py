"""Fits of chosen drives to all training data, and of the weight of bodies under stated gains."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...errors import shorten
from ...model import Model
from ...parameters import Array
from ...servos import SERVO_NUMBERS, Servo, ServoGrid
from ...types import Robot
from ..fit import ServoFit, fit_servos
from ..given import Assumptions
from ..plant import roll_out
from ..search.choice import Candidate, fit_candidate
from ..search.data import ServoData
from ..search.problem import Estimates, ServoProblem
from .result import ServoRollOut, ServoTrace
from .scale import Stated, first_candidate, implied_ratios, scaled_masses, stated_drive

MAX_OWN_ITERATIONS = 6  # most iterations of a fit of equal joints with own numbers
HORIZON = 1.0  # [s] between measured states of short roll-outs
DIVERGED_ERROR = 1e3  # error from which on a simulation counts as diverged [rad or m]
STATED, IDEAL = "stated numbers", "q = q_des"


def final_fit(problem: ServoProblem, data: ServoData, candidate: Candidate) -> ServoFit:
    """Fit to all training data, about the simulated motion in the end."""
    candidate, fit = fit_candidate(problem.model, data.train, candidate, problem.options.window, relinearise=True)
    return replace(fit, servos=candidate.servos)


def number_std(fit: ServoFit, name: str) -> dict[str, float]:
    """Standard deviation of one number of each joint where it is free."""
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    each = zip(fit.names, fit.owners, std, strict=True)
    return {joint: float(s) for (_, number), joints, s in each if number == name for joint in joints}


def weigh_bodies(problem: ServoProblem) -> ServoProblem:
    """Problem whose bodies have the weight that gains imply if these set the scale, and a flag on each that changes."""
    if problem.assumptions.scale != "kp":
        return problem
    problem.say("weighing bodies", 0.05)
    model, rows, stated = problem.model, problem.searched, problem.assumptions.stated
    start = first_candidate(model.robot, rows, problem.regressed, Assumptions(stated=stated))
    fit = fit_servos(model, rows.train, start.servos, start.free, window=problem.options.window)
    gains = {joint: of["kp"] for joint, of in stated.items() if "kp" in of}
    said = []
    for members, ratio, error in implied_ratios(problem.sets, fit.servos, number_std(fit, "kp"), gains):
        model = scaled_masses(model, members, ratio)
        said.append(
            f"with the stated kp, the part that {shorten(list(members))} move is {ratio:.2f} +- {1.96 * error:.2f} "
            f"times as heavy as the description says, and the model has these masses; --known masses if the "
            f"description is right"
        )
    return replace(problem, model=model, flags=(*problem.flags, *said))


def own_numbers(problem: ServoProblem, fit: ServoFit, candidate: Candidate) -> dict[str, Estimates]:
    """Numbers of equal joints with their standard deviations, fitted again without that assumption; empty if none."""
    if not candidate.assumptions.equal:
        return {}
    alone = fit_servos(
        problem.model,
        problem.searched.train,
        fit.servos,
        fit.free,
        window=candidate.window or problem.options.window,
        relinearise=False,
        iterations=MAX_OWN_ITERATIONS,
        scales=False,
        usual=candidate.usual,
        assumptions=replace(candidate.assumptions, equal=()),
    )
    std = {name: number_std(alone, name) for name in SERVO_NUMBERS}
    return {
        joint: {name: (getattr(alone.servos[joint], name), s[joint]) for name, s in std.items() if s.get(joint, 0) > 0}
        for members in candidate.assumptions.equal
        for joint in members
    }


def block(fit: ServoFit, joint: str) -> tuple[tuple[str, ...], Array]:
    """Free numbers of a joint within their bounds, and their covariance; a shared number counts for each joint."""
    owned = enumerate(zip(fit.owners, fit.at_bound, strict=True))
    own = [k for k, (joints, bound) in owned if joint in joints and not bound]
    return tuple(fit.names[k][1] for k in own), np.asarray(fit.covariance[np.ix_(own, own)])


def number_at_bound(fit: ServoFit, joint: str) -> list[str]:
    """Numbers of a joint that stand at their bounds."""
    each = zip(fit.names, fit.owners, fit.at_bound, strict=True)
    return [number for (_, number), joints, bound in each if bound and joint in joints]


def closed_loops(
    model: Model,
    servos: Mapping[str, Servo],
    grids: Sequence[ServoGrid],
    held_out: bool = True,
    nominal: tuple[Model, Mapping[str, Servo]] | None = None,
) -> tuple[ServoRollOut, tuple[ServoTrace, ...]]:
    """Roll-outs of recordings from commands alone, whole and from measured states every second.

    nominal: model and drives of stated numbers, for comparison; q = q_des without, and where their loop diverges, as
        that of a gain that is stated without damping.
    """
    traces, positions = list[ServoTrace](), list[tuple[Array, ...]]()
    for grid in grids:
        whole, short = _both(model, servos, grid)
        beside = (grid.command, grid.command) if nominal is None else _both(*nominal, grid)
        t = np.asarray(grid.origin + np.arange(len(grid)) * grid.step, float)
        traces.append(ServoTrace(grid.path, grid.joints, t, grid.command, grid.q, whole, beside[0], short))
        positions.append((whole, short, *beside))
    joints, measured = grids[0].joints, np.vstack([grid.q for grid in grids])
    driven = np.array([joint in servos for joint in joints]) & np.any([grid.driven for grid in grids], axis=0)
    units = tuple("m" if model.robot.prismatic[model.robot.index(joint)] else "rad" for joint in joints)
    own, own_short, usual, usual_short = (
        _rms(np.vstack(each) - measured, driven) for each in zip(*positions, strict=True)
    )
    if nominal is not None and np.isinf(usual).any():
        return closed_loops(model, servos, grids, held_out)
    name = IDEAL if nominal is None else STATED
    tracking = _rms(np.vstack([grid.command - grid.q for grid in grids]), driven)
    return ServoRollOut(joints, units, own, own_short, usual, usual_short, name, held_out, tracking), tuple(traces)


def _both(model: Model, servos: Mapping[str, Servo], grid: ServoGrid) -> tuple[Array, Array]:
    """Positions (N, n) [rad or m] of the whole roll-out, and of one that restarts every second."""
    with np.errstate(all="ignore"):
        return roll_out(model, servos, grid), roll_out(model, servos, grid, HORIZON)


def whole_rms(model: Model, servos: Mapping[str, Servo], grids: Sequence[ServoGrid]) -> Array:
    """Rms (n,) [rad or m] of whole recordings from commands alone; inf where it diverges, NaN without commands."""
    errors = [roll_out(model, servos, grid) - grid.q for grid in grids]
    return _rms(np.vstack(errors), np.array([joint in servos for joint in grids[0].joints]))


def nominal_servos(robot: Robot, servos: Mapping[str, Servo], stated: Stated) -> dict[str, Servo]:
    """Drives of the stated numbers; empty unless every joint has a stated gain."""
    if not all(stated.get(joint, {}).get("kp", 0.0) > 0 for joint in servos):
        return {}
    return {joint: stated_drive(robot, joint).with_(**stated[joint]) for joint in servos}


def _rms(error: Array, driven: Array) -> Array:
    """Root mean square (n,) of errors (N, n); inf where one diverges, NaN for joints without commands."""
    with np.errstate(over="ignore", invalid="ignore"):
        rms = np.sqrt(np.mean(error**2, axis=0))
    return np.where(driven, np.where(rms <= DIVERGED_ERROR, rms, np.inf), np.nan)
