"""Closed-loop roll-outs of held-out recordings, beside those of the stated numbers."""

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

SHORT = 1.0  # [s] of the short roll-outs
STATED, FOLLOWS = "stated numbers", "q = q_des"


def assess(
    model: Model,
    nominal_model: Model,
    servos: Mapping[str, Servo],
    stated: Stated,
    grids: Sequence[ServoGrid],
    held_out: bool,
) -> tuple[ServoRollOut, tuple[ServoTrace, ...]]:
    """Roll-outs of recordings, whole and restarted every second, of the drives found and of the nominal ones."""
    robot = model.robot
    nominal = nominal_servos(robot, servos, stated)
    traces, short = [], []
    for grid in grids:
        usual = roll_out(nominal_model, nominal, grid) if nominal else grid.command
        again = roll_out(nominal_model, nominal, grid, SHORT) if nominal else grid.command
        short.append((roll_out(model, servos, grid, SHORT), again))
        traces.append(
            ServoTrace(
                path=grid.path,
                joints=grid.joints,
                t=np.asarray(grid.origin + np.arange(len(grid)) * grid.step, float),
                command=grid.command,
                measured=grid.q,
                simulated=roll_out(model, servos, grid),
                nominal=usual,
                one_second=short[-1][0],
            )
        )
    joints = grids[0].joints
    driven = np.array([joint in servos for joint in joints])
    measured = np.vstack([grid.q for grid in grids])
    units = tuple("m" if robot.prismatic[robot.index(joint)] else "rad" for joint in joints)
    rolled = ServoRollOut(
        joints=joints,
        units=units,
        whole_rms=_rms(np.vstack([trace.simulated for trace in traces]) - measured, driven),
        one_second_rms=_rms(np.vstack([own for own, _ in short]) - measured, driven),
        nominal_whole_rms=_rms(np.vstack([trace.nominal for trace in traces]) - measured, driven),
        nominal_one_second_rms=_rms(np.vstack([usual for _, usual in short]) - measured, driven),
        nominal=STATED if nominal else FOLLOWS,
        held_out=held_out,
    )
    return rolled, tuple(traces)


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
    """Root mean square (n,) of errors (N, n); inf where a simulation diverges, NaN for joints without commands."""
    with np.errstate(over="ignore", invalid="ignore"):
        rms = np.sqrt(np.mean(error**2, axis=0))
    return np.where(driven, np.where(np.isfinite(rms), rms, np.inf), np.nan)
