"""Closed-loop roll-outs of recordings, beside those of the stated numbers or q = q_des."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ...model import Model
from ...parameters import Array
from ...servos import Servo, ServoGrid
from ...types import Robot
from ..plant import roll_out
from .result import ServoRollOut, ServoTrace
from .start import Stated, stated_drive

HORIZON = 1.0  # [s] between measured states of short roll-outs
FARTHEST = 1e3  # error from which on a simulation counts as diverged [rad or m]
STATED, IDEAL = "stated numbers", "q = q_des"


def closed_loops(
    model: Model,
    servos: Mapping[str, Servo],
    grids: Sequence[ServoGrid],
    held_out: bool = True,
    nominal: tuple[Model, Mapping[str, Servo]] | None = None,
) -> tuple[ServoRollOut, tuple[ServoTrace, ...]]:
    """Roll-outs of recordings from commands alone, whole and from measured states every second.

    nominal: model and drives of stated numbers, for comparison; default: q = q_des.
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
    return np.where(driven, np.where(rms <= FARTHEST, rms, np.inf), np.nan)
