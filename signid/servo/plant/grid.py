"""Recordings of servo joints on uniform grids: positions interpolated, held commands averaged over each row.

The average of a held command over a row keeps its time exactly; sampling it would shift it by half a row where
stamps are uneven.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from ...errors import RecordingError
from ...faults.commands.response import content_rows
from ...servos import ServoGrid
from ...types import Array, Mask, Recording, Robot

DEFAULT_MAX_RATE = 250.0  # [Hz] of a grid by default; enough for loops of position drives
GAP = 0.25  # [s] without samples, beyond 5 periods, ends a grid
MIN_STRETCH_SECONDS = 0.2  # [s] shorter stretches between gaps are left out
STEP_ERROR_RATIO = 0.5  # first error over rms error, from which it is a step (mauicv: .8 to 2.5), no droop (XL330: 0)
REST_SHARE, MOVED_SHARE, START = 0.02, 0.05, 0.15  # motion over first error: at rest, and within START [s] that ends it


def servo_grids(recording: Recording, robot: Robot, rate: float | None = None) -> tuple[ServoGrid, ...]:
    """Grids of a recording, one for each stretch without gaps.

    Args:
        recording: recording with q_des of at least one joint.
        robot: its robot; `Robot.registers` and `Robot.servo` give gains and nominal voltages.
        rate: of the grid [Hz]; by default the rate of the stamps, at most 250 Hz.

    Raises:
        RecordingError: no joint has commands, or every stretch is too short.
    """
    x = recording.read()
    if x.q_des is None:
        raise RecordingError(
            f"{recording.path or 'the recording'} has no commanded position; add columns q_des_J of the servo joints"
        )
    servo: Any = getattr(x, "servo", None)
    more = {key: getattr(servo, key, None) for key in ("dq_des", "tau_ff", "on", "volt")}
    volt, nominal = more["volt"], _nominal(robot, recording.joints, "voltage")
    registers: Mapping[tuple[str, str], Mapping[str, float]] = getattr(robot, "registers", {})
    name = Path(recording.path).name
    here = [registers.get((name, joint), {}).get("kp_register", np.nan) for joint in recording.joints]
    gain = np.array(here, float) / _nominal(robot, recording.joints, "kp_register")
    return grids_of_arrays(
        recording.joints,
        x.t,
        x.q,
        x.q_des,
        command_speed=more["dq_des"],
        feed_forward=more["tau_ff"],
        on=more["on"],
        voltage=None if volt is None else np.where(np.isfinite(nominal), volt / nominal, 1.0),
        gain=np.where(np.isfinite(gain), gain, 1.0),
        driven=[bool(column) for column in recording.columns.get("q_des", ())],
        rate=rate,
        path=recording.path,
        sha256=recording.sha256,
        origin=x.origin,
    )


def servo_grid(recording: Recording, robot: Robot, rate: float | None = None) -> ServoGrid:
    """Longest grid of `servo_grids`."""
    return max(servo_grids(recording, robot, rate), key=len)


def grids_of_arrays(
    joints: Sequence[str],
    t: ArrayLike,
    q: ArrayLike,
    q_des: ArrayLike,
    *,
    command_speed: ArrayLike | None = None,
    feed_forward: ArrayLike | None = None,
    on: ArrayLike | None = None,
    voltage: ArrayLike | None = None,
    gain: ArrayLike = 1.0,
    driven: Sequence[bool] | None = None,
    rate: float | None = None,
    path: str = "",
    sha256: str = "",
    origin: float = 0.0,
) -> tuple[ServoGrid, ...]:
    """Grids of arrays, one for each stretch without gaps.

    Args:
        joints: n names.
        t: (N,) stamps [s], ascending; rows without a position are left out.
        q: (N, n) or (N,) measured positions [rad or m].
        q_des: (N, n) commands in force from each stamp; NaN where the drive is without command, which turns it off.
        command_speed: (N, n) [rad/s or m/s].
        feed_forward: (N, n) torque of the command [N.m or N].
        on: (N, n) 1 while the drive holds.
        voltage: (N, n) relative to the nominal supply [1].
        gain: (n,) firmware gain relative to the nominal one [1].
        driven: (n,) whether each joint has a drive, also if it has no command here: torque off; by default those with
            commands.
        rate: of the grid [Hz]; by default the rate of the stamps, at most 250 Hz.
        path: of the file.
        sha256: of the file.
        origin: added to the stamps [s].

    Raises:
        RecordingError: no joint has commands, or every stretch is too short.
    """
    n, stamps = len(joints), np.asarray(t, float)
    table = {"q": q, "u": q_des, "speed": command_speed, "forward": feed_forward, "on": on, "volt": voltage}
    columns = {k: np.reshape(np.asarray(x, float), (len(stamps), n)) for k, x in table.items() if x is not None}
    keep = np.isfinite(stamps) & np.isfinite(columns["q"]).all(1)
    keep[keep] = np.diff(stamps[keep], prepend=-np.inf) > 0
    own = content_rows(stamps[keep], columns["q"][keep])
    stamps, columns = stamps[keep][own], {k: x[keep][own] for k, x in columns.items()}
    source = path or "the recording"
    have = np.asarray(np.isfinite(columns["u"]).any(0) if driven is None else driven)
    if not have.any():
        raise RecordingError(f"{source} has no commanded position; give q_des of at least one joint")
    columns = _held(columns, have)
    if len(stamps) < 3:
        raise RecordingError(f"{source} has {len(stamps)} usable rows; record the robot in motion")
    period = float(np.median(np.diff(stamps)))
    whole = round(1 / period)
    near = float(whole) if abs(1 / period - whole) < 0.005 / period else float(f"{1 / period:.4g}")
    rate = min(near, DEFAULT_MAX_RATE) if rate is None else float(rate)
    parts = _stretches(stamps, max(GAP, 5 * period), source)
    flags = tuple(bool(x) for x in have)
    gains = np.broadcast_to(np.asarray(gain, float), (n,))
    return tuple(
        ServoGrid(
            tuple(joints),
            rate,
            origin + float(stamps[part][0]),
            **_resample(stamps[part], {k: x[part] for k, x in columns.items()}, rate),
            gain=gains,
            driven=flags,
            path=path,
            sha256=sha256,
        )
        for part in parts
    )


def _stretches(t: Array, gap: float, source: str) -> list[slice]:
    """Rows of the stretches without gaps."""
    edges = [0, *(np.flatnonzero(np.diff(t) > gap) + 1).tolist(), len(t)]
    parts = [slice(a, b) for a, b in zip(edges, edges[1:], strict=False) if b - a > 3]
    parts = [part for part in parts if t[part][-1] - t[part][0] >= MIN_STRETCH_SECONDS]
    if not parts:
        raise RecordingError(
            f"{source} has no stretch of {MIN_STRETCH_SECONDS:g} s without gaps; record for longer, or check the stamps"
        )
    return parts


def _held(columns: Mapping[str, Array], driven: Mask) -> dict[str, Array]:
    """Columns without NaN: the last value is held; joints without a command are off, their command is q."""
    u = columns["u"]
    on = np.isfinite(u) * np.nan_to_num(columns.get("on", np.ones_like(u)), nan=1.0)
    filled = {k: _fill(x) for k, x in columns.items()}
    filled["u"] = np.where(driven & np.isfinite(filled["u"]), filled["u"], columns["q"])
    filled["volt"] = np.where(np.isfinite(filled["volt"]), filled["volt"], 1.0) if "volt" in filled else np.ones_like(u)
    for key in ("speed", "forward"):
        if key in filled:
            filled[key] = np.nan_to_num(filled[key])
    return filled | {"q": columns["q"], "on": np.where(driven, on > 0.5, False).astype(float)}


def _fill(x: Array) -> Array:
    """Columns with NaN replaced by the last value before, or the first one after."""
    out = x.copy()
    for column in out.T:
        known = np.flatnonzero(np.isfinite(column))
        if 0 < len(known) < len(column):
            place = np.maximum(np.searchsorted(known, np.arange(len(column)), side="right") - 1, 0)
            column[:] = column[known[place]]
    return out


def _resample(t: Array, columns: Mapping[str, Array], rate: float) -> dict[str, Any]:
    rows = int(np.floor((t[-1] - t[0]) * rate * (1 + 1e-9) + 1e-6)) + 1
    at = t[0] + np.arange(rows) / rate
    edges = np.append(at, at[-1] + 1 / rate)
    row = np.clip(np.searchsorted(t, at + 0.01 / rate, side="right") - 1, 0, len(t) - 1)
    held = {key: _averaged(t, columns[key], edges) for key in ("u", "speed", "forward") if key in columns}
    return {
        "q": _linear(t, columns["q"], at),
        "command": held["u"],
        "command_speed": held.get("speed"),
        "feed_forward": held.get("forward"),
        "on": columns["on"][row],
        "voltage": _linear(t, columns["volt"], at),
    }


def _linear(t: Array, x: Array, at: Array) -> Array:
    return np.column_stack([np.interp(at, t, column) for column in x.T])


def _averaged(t: Array, x: Array, edges: Array) -> Array:
    """Averages (rows, n) of held values between edges."""
    offset = x[0]
    area = np.vstack([np.zeros((1, x.shape[1])), np.cumsum((x[:-1] - offset) * np.diff(t)[:, None], axis=0)])
    inside = _linear(t, area, edges)
    beyond = np.maximum(edges - t[-1], 0)[:, None] * (x[-1] - offset)
    return np.asarray(offset + np.diff(inside + beyond, axis=0) / np.diff(edges)[:, None])


def _nominal(robot: Robot, joints: Sequence[str], key: str) -> Array:
    stated: Mapping[str, Mapping[str, Any]] = getattr(robot, "servo", {})
    return np.array([float(stated.get(joint, {}).get(key, np.nan)) for joint in joints])


def commands_at(grid: ServoGrid, joint: int, kd_on: str, delay: float, profile: float, parts: int) -> Array:
    """Command, its speed and feed-forward averaged over each substep, and how they change in it (7, N parts).

    Rows 0 to 2 are averages, continuous in the delay; 3 to 5 what acts first in a substep less what acts afterwards;
    6 the share of the substep that the first takes.
    joint: column of the grid; kd_on: one of KD_ON; delay [s]; profile: largest speed of the command [rad/s or m/s];
    parts: substeps of a row.
    """
    held = np.zeros((7, len(grid) * parts))
    u, h = np.repeat(grid.command[:, joint], parts), grid.step / parts
    if np.isfinite(profile):
        limit(u, np.repeat(grid.q[:, joint], parts), np.repeat(grid.on[:, joint], parts), profile * h)
    late = max(delay, 0.0) / h
    held[6] = late - np.floor(late)
    held[0], held[3] = _delayed(u, late, held_before(grid, joint))
    if kd_on == "error":
        held[1], held[4] = _delayed(np.repeat(command_speed(grid, joint), parts), late)
    if grid.feed_forward is not None:
        held[2], held[5] = _delayed(np.repeat(grid.feed_forward[:, joint], parts), late)
    return held


def command_speed(grid: ServoGrid, joint: int) -> Array:
    """Speed of the command (N,) [rad/s or m/s] as recorded, else from row to row."""
    if grid.command_speed is not None:
        return grid.command_speed[:, joint]
    return np.diff(grid.command[:, joint], prepend=grid.command[0, joint]) * grid.rate


def held_before(grid: ServoGrid, joint: int) -> float:
    """Command in force before the first row [rad or m]: the first one, or the position where a drive starts from rest.

    A drive whose joint is at rest in the first two rows, far from its first command, and leaves for it soon after held
    its position until then.
    """
    q, first = grid.q[:, joint], float(grid.command[0, joint])
    error = first - float(q[0])
    moved = (q[: int(round(START * grid.rate)) + 2] - q[0]) * np.sign(error)
    large = abs(error) > STEP_ERROR_RATIO * np.sqrt(np.mean((grid.command[:, joint] - q) ** 2))
    starts = large and abs(moved[1]) < REST_SHARE * abs(error) and moved.max() > MOVED_SHARE * abs(error)
    return float(q[0]) if starts else first


def _delayed(u: Array, steps: float, first: float | None = None) -> tuple[Array, Array]:
    """Averages over each step of a signal that is held from step to step and acts `steps` later, and its falls.

    A fall is what acts first in a step less what acts afterwards. `first` acts before the signal.
    """
    first = u[0] if first is None else first
    whole = int(np.floor(steps))
    share = steps - whole
    late = np.concatenate([np.full(min(whole + 1, len(u)), first), u])
    start = max(whole + 1 - len(u), 0)  # longer than the recording
    now = late[1 : 1 + len(u)] if not start else np.full(len(u), first)
    before = late[: len(u)] if not start else now
    return np.asarray((1.0 - share) * now + share * before), np.asarray(before - now)


@njit(cache=True)
def limit(u, q, on, most):  # type: ignore[no-untyped-def]
    """Limit the change of a command to `most` a step, in place; it follows the position while the drive is off."""
    state = q[0]
    for k in range(len(u)):
        if on[k] > 0.5:
            state += min(max(u[k] - state, -most), most)
        else:
            state = q[k]
        u[k] = state
