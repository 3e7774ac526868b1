"""Rows of recordings for signs and zeros: smooth motion, loads, errors of the loops, and what else explains these.

Pinocchio from Python takes two to four times as long as the compiled dynamics here (3 to 7 joints, 200 rows).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import pinocchio as pin
from numba import njit
from scipy.signal import butter, filtfilt

from ...frozen import Frozen
from ...servos import Servo, ServoGrid
from ...types import Array, Mask, Robot
from ..plant.course import smooth
from ..plant.grid import commands_at

CUTOFF = 10.0  # [Hz] of motion and errors; at 6 Hz, zeros of a simulated SO-101 are biased by up to two std
EDGE = 0.3  # [s] left out beside ends and switched drives
BLOCK = 3.0  # [s] of a block; residuals of different blocks count as independent
PLAY = 0.012  # [rad or m] over which dry friction turns (SO-101: least residual of 0.003 to 0.025)
MIN_SLIDING_SPEED = 0.03  # [rad/s or m/s] slower joints may stick, and dry friction is then unknown
TURNING = 0.2  # share of the usual speed of a joint below which it turns round (zeros of a simulated Go2: no bias)
FULL = 0.97  # share of the largest error that a drive answers from which a row counts as saturated
MIN_USABLE_ROWS = 40  # usable rows of a joint; a joint with fewer is not used
RECORDINGS = 6  # least number of recordings of which each is one block
FLOOR = 1e-5  # [rad or m] rms error that counts as none
MAX_MU = 1.5  # largest friction by load, of the load; gears of servos hold their load without current (SO-101)
REST_ERROR_STD = 0.004  # [rad or m] of the error of a loop at rest without load: q and q_des share their zero
ROWS_PER_SAMPLE = 20  # rows whose errors count as one in the weight of that knowledge
TINY = 1e-30


@dataclass(frozen=True, eq=False)
class ZeroRows(Frozen):
    """N rows of all recordings, n joints. A joint whose error is not usable in a row has NaN there."""

    joints: tuple[str, ...]
    q: Array  # (N, n) [rad or m]
    v: Array  # (N, n) [rad/s or m/s]
    a: Array  # (N, n) [rad/s2 or m/s2]
    error: Array  # (N, n) [rad or m] of the loop, filtered
    rush: Array  # (N, n) [rad/s or m/s] speed of the command: an error of the delay
    slide: Array  # (N, n) [1] direction of dry friction, -1 to 1; at rest that of the last motion
    block: Array  # (N,) [1] number of the block
    recording: Array  # (N,) [1] number of the recording

    def __len__(self) -> int:
        return len(self.q)

    def part(self, use: Mask | slice) -> ZeroRows:
        """Some rows: a mask (N,), or a slice."""
        names = ("q", "v", "a", "error", "rush", "slide", "block", "recording")
        return replace(self, **{name: getattr(self, name)[use] for name in names})

    def thinned(self, most: int) -> ZeroRows:
        """About `most` rows, evenly."""
        return self.part(slice(0, None, max(round(len(self) / most), 1)))


def zero_rows(grids: Sequence[ServoGrid], servos: Mapping[str, Servo], most: int) -> ZeroRows:
    """Rows of grids in which a joint slides, evenly, about `most`; delays and limits are those of drives."""
    paths = list(dict.fromkeys(grid.path or f"{k}" for k, grid in enumerate(grids)))
    motions = [smooth(grid.q, grid.rate, CUTOFF) for grid in grids]
    speed = np.abs(np.concatenate([motion.v for motion in motions]))
    moving = speed > MIN_SLIDING_SPEED
    usual = np.sqrt(np.sum(np.where(moving, speed, 0.0) ** 2, axis=0) / np.maximum(moving.sum(axis=0), 1))
    slow = np.asarray(np.maximum(MIN_SLIDING_SPEED, TURNING * usual))
    parts, blocks = [], 0
    for k, (grid, motion) in enumerate(zip(grids, motions, strict=True)):
        error = np.column_stack([_error(grid, j, servos.get(joint)) for j, joint in enumerate(grid.joints)])
        slide = slides(motion.q)
        unknown = np.cumsum(np.abs(slide) == 1, axis=0) == 0  # before a joint has slid for the first time
        error[unknown | (np.abs(motion.v) < slow)] = np.nan
        block = blocks + (np.arange(len(grid)) * grid.step / BLOCK).astype(int)
        blocks = int(block[-1]) + 1
        number = np.full(len(grid), paths.index(grid.path or f"{k}"))
        rush = _filtered(np.gradient(grid.command, grid.step, axis=0), grid.rate)
        parts.append((*motion, error, rush, _filtered(slide, grid.rate), block, number))
    rows = ZeroRows(grids[0].joints, *(np.concatenate(some) for some in zip(*parts, strict=True)))
    return rows.part(np.asarray(np.isfinite(rows.error).any(axis=1))).thinned(most)


def fixed_columns(rows: ZeroRows, j: int, use: Mask) -> Array:
    """Damping, dry friction, armature, delay and constant of one joint in the rows `use` (N,): (M, 5) [any unit]."""
    v = rows.v[use, j]
    return np.column_stack([v, rows.slide[use, j], rows.a[use, j], rows.rush[use, j], np.ones_like(v)])


@njit(cache=True)
def slides(q):  # type: ignore[no-untyped-def]
    """Direction of dry friction (N, n) [1] along positions q (N, n) [rad or m], kept at rest."""
    out = np.zeros_like(q)
    for i in range(1, len(q)):
        for j in range(q.shape[1]):
            out[i, j] = min(max(out[i - 1, j] + (q[i, j] - q[i - 1, j]) / PLAY, -1.0), 1.0)
    return out


def _error(grid: ServoGrid, j: int, servo: Servo | None) -> Array:
    """Filtered error (N,) [rad or m] of a joint; NaN while its drive is off or gives its limit, and near that."""
    nothing = np.full(len(grid), np.nan)
    edge = max(int(EDGE * grid.rate), 1)
    if servo is None or not grid.driven[j] or len(grid) < 4 * edge:
        return nothing
    command = commands_at(grid, j, "velocity", servo.delay, np.inf, 1)[0]
    error = grid.gain[j] * (command - grid.q[:, j])
    usable = _away_from(grid.on[:, j] < 0.5, edge)
    most = servo.effort_limit / servo.kp if servo.kp > 0 else np.inf
    unsaturated = usable & _away_from(np.abs(error) > FULL * most, edge // 2)
    usable = unsaturated if 2 * unsaturated.sum() > usable.sum() else usable
    usable[:edge] = usable[-edge:] = False
    return np.where(usable, _filtered(error, grid.rate), np.nan)


def _filtered(x: Array, rate: float) -> Array:
    b, a = butter(3, min(2 * CUTOFF / rate, 0.8))
    return np.asarray(filtfilt(b, a, x, axis=0))


def _away_from(bad: Mask, edge: int) -> Mask:
    """Rows (N,) that are further than `edge` rows from every bad one."""
    near = np.convolve(bad.astype(float), np.ones(2 * edge + 1), mode="full")[edge : edge + len(bad)]
    return np.asarray(near < 0.5)


@dataclass(frozen=True, eq=False)
class LoopLine(Frozen):
    """Errors of one joint without what needs no load: M rows, times their weights; the last one is knowledge."""

    joint: int
    use: Mask  # (N,) rows
    weight: Array  # (M - 1,) [1] square root of the weights
    error: Array  # (M,) [rad or m] error, without its part in the fixed columns
    basis: Array  # (M, 5) [1] orthonormal basis of the fixed columns
    slide: Array  # (M,) direction of dry friction [1]

    def of(self, load: Array) -> Array:
        """Weighted load of the joint, (M, K) [N.m or N]; load: (N, n, K) [N.m or N] of all joints in K trials."""
        own = load[self.use, self.joint] * self.weight[:, None]
        return np.concatenate([own, np.zeros_like(own[:1])])

    def without(self, x: Array) -> Array:
        """Columns without their part in the fixed columns; x: (M, ...) [any unit]."""
        return np.asarray(x - self.basis @ (self.basis.T @ x))


@dataclass(frozen=True, eq=False)
class Loads:
    """Rows of recordings with the bodies that they move."""

    chain: Chain
    rows: ZeroRows
    weights: Array | None = None  # (N, n) [1]
    lines: tuple[LoopLine, ...] = field(init=False)

    def __post_init__(self) -> None:
        weights = np.ones_like(self.rows.q) if self.weights is None else self.weights
        lines = [_line(self.rows, j, np.sqrt(weights[:, j])) for j in range(len(self.rows.joints))]
        object.__setattr__(self, "lines", tuple(line for line in lines if line is not None))

    def part(self, use: Mask) -> Loads:
        """Some of the rows: a mask (N,)."""
        weights = None if self.weights is None else self.weights[use]
        return replace(self, rows=self.rows.part(use), weights=weights)

    def gravity(self, signs: Array, zeros: Array) -> Array:
        """Load at rest (N, n) [N.m or N] at positions sign q + zero, in the direction of the recorded positions.

        signs: (n,) [1] 1 or -1; zeros: (n,) [rad or m].
        """
        still = np.zeros_like(self.rows.q)
        return self.chain.torque(signs * self.rows.q + zeros, still, still) * signs

    def torque(self, signs: Array, zeros: Array) -> Array:
        """Load of the motion (N, n) [N.m or N] with positions sign q + zero.

        signs: (n,) [1] 1 or -1; zeros: (n,) [rad or m].
        """
        q, v, a = (signs * x for x in (self.rows.q, self.rows.v, self.rows.a))
        return self.chain.torque(q + zeros, v, a) * signs


def responses(line: LoopLine, load: Array) -> tuple[Array, Array]:
    """Compliance (2, K) [rad/(N.m) or m/N] of load and of friction by load, and the squared errors (K,) that are left.

    load: (M, K) [N.m or N] in the rows of the line, for K trials.
    """
    a, b = line.without(load), line.without(np.abs(load) * line.slide[:, None])
    y = line.error
    ay, by, aa, bb, ab = y @ a, y @ b, *(np.einsum("mk,mk->k", p, q) for p, q in ((a, a), (b, b), (a, b)))
    det = np.maximum(aa * bb - ab**2, 1e-9 * aa * bb + TINY)
    both = np.array([(bb * ay - ab * by) / det, (aa * by - ab * ay) / det])
    alone = np.array([ay / np.maximum(aa, TINY), 0 * ay])
    most = (ay + MAX_MU * by) / np.maximum(aa + 2 * MAX_MU * ab + MAX_MU**2 * bb, TINY)
    c = np.where(both[1] < 0, alone, np.where(both[1] > MAX_MU * both[0], np.array([most, MAX_MU * most]), both))
    c = np.where(c[0] > 0, c, 0.0)  # a drive does not push along its load
    left = y @ y - 2 * (c[0] * ay + c[1] * by) + c[0] ** 2 * aa + 2 * c[0] * c[1] * ab + c[1] ** 2 * bb
    return c, np.maximum(left, 0.0)


def unexplained(line: LoopLine, load: Array) -> Array:
    """Weighted error (M - 1,) [rad or m] of a line without its response to the load (N, n) [N.m or N]."""
    own = line.of(load[..., None])
    (a, b), _ = responses(line, own)
    return np.asarray(line.error - line.without(a * own[:, 0] + b * line.slide * np.abs(own[:, 0])))[:-1]


def foreseen(here: Loads, line: LoopLine, load: Array, there: Loads, other: Array) -> tuple[Array, Mask]:
    """Errors in other rows (M,) [rad or m] of what one joint's line predicts there, weighted; and these rows (N,).

    load: (N, n) [N.m or N] in the rows of `here`; other: (N, n) [N.m or N] in those of `there`.
    """
    j, use = line.joint, np.isfinite(there.rows.error[:, line.joint])
    (a, b), _ = responses(line, line.of(load[..., None]))
    pull = a[0] * load + b[0] * here.rows.slide * np.abs(load)
    x, y, _ = _stacked(here.rows, j, line.use, line.weight)
    y[:-1] -= line.weight * pull[line.use, j]
    numbers = np.linalg.lstsq(x, y, rcond=None)[0]
    pull = a[0] * other + b[0] * there.rows.slide * np.abs(other)
    left = there.rows.error[use, j] - pull[use, j] - fixed_columns(there.rows, j, use) @ numbers
    return left * (1.0 if there.weights is None else np.sqrt(there.weights[use, j])), use


def _stacked(rows: ZeroRows, j: int, use: Mask, weight: Array) -> tuple[Array, Array, Array]:
    """Fixed columns (M, 5), error (M,) [rad or m] and direction of friction (M,) of a line.

    The last row says that a loop without load rests without error; use: (N,); weight: (M - 1,) [1].
    """
    error, columns = rows.error[use, j] * weight, fixed_columns(rows, j, use) * weight[:, None]
    free = np.column_stack([columns, columns[:, 1] * np.abs(rows.q[use, j])])
    noise = np.std(error - free @ np.linalg.lstsq(free, error, rcond=None)[0]) + FLOOR
    columns = np.vstack([columns, [0, 0, 0, 0, noise * np.sqrt(ROWS_PER_SAMPLE) / REST_ERROR_STD]])
    return columns, np.append(error, 0.0), np.append(rows.slide[use, j], 0.0)


def _line(rows: ZeroRows, j: int, weight: Array) -> LoopLine | None:
    """Line of a joint; None if too few rows are usable."""
    use = np.isfinite(rows.error[:, j])
    if use.sum() < MIN_USABLE_ROWS:
        return None
    columns, error, slide = _stacked(rows, j, use, weight[use])
    basis = np.linalg.qr(columns / (np.linalg.norm(columns, axis=0) + 1e-12))[0]
    error = error - basis @ (basis.T @ error)
    if not np.sqrt(np.mean(error**2)) > FLOOR:
        return None
    return LoopLine(j, use, weight[use], error, basis, slide)


class Bodies(NamedTuple):
    """Joints of a robot in Pinocchio's order, m of them, with the bodies that they carry."""

    parent: Array  # (m,) [1] number of the parent joint, -1 for the base
    rotation: Array  # (m, 3, 3) [1] from the frame of a joint at zero to its parent's
    place: Array  # (m, 3) [m] in the frame of the parent
    axis: Array  # (m, 3) [1] in the frame of the joint
    slides: Mask  # (m,)
    mass: Array  # (m,) [kg]
    centre: Array  # (m, 3) [m]
    inertia: Array  # (m, 3, 3) [kg.m2] about the centre
    gravity: Array  # (3,) [m/s2]


@dataclass(frozen=True, eq=False)
class Chain(Frozen):
    """Bodies moved by n coordinates."""

    bodies: Bodies
    drive: Array  # (m, n) speed of each joint per coordinate [1]
    rest: Array  # (m,) [rad or m] position of each joint at coordinates of zero

    def torque(self, q: Array, v: Array, a: Array) -> Array:
        """Inverse dynamics (N, n) [N.m or N].

        q: (N, n) [rad or m]; v: (N, n) [rad/s or m/s]; a: (N, n) [rad/s2 or m/s2].
        """
        turn = self.drive.T
        x = (np.ascontiguousarray(y) for y in (q @ turn + self.rest, v @ turn, a @ turn))
        return np.asarray(_torque(*x, self.bodies) @ self.drive)


class _Motion(NamedTuple):
    """Motion of m joints at one instant, in their own frames."""

    turn: Array  # (m, 3, 3) [1] to the frame of the parent
    at: Array  # (m, 3) [m] in the frame of the parent
    w: Array  # (m, 3) [rad/s]
    alpha: Array  # (m, 3) [rad/s2]
    acc: Array  # (m, 3) [m/s2]


def chain_of(robot: Robot) -> Chain | None:
    """Chain of a robot; None if a joint has several axes."""
    model = robot.model
    joints = list(model.joints)[1:]
    if any(joint.nv != 1 for joint in joints) or [joint.idx_v for joint in joints] != list(range(model.nv)):
        return None
    data, at = model.createData(), pin.neutral(model)
    pin.computeJointJacobians(model, data, at)
    every = (np.reshape(pin.getJointJacobian(model, data, i + 1, pin.LOCAL), (6, -1)) for i in range(model.nv))
    own = [jacobian[:, i] for i, jacobian in enumerate(every)]
    slides = np.array([bool(np.linalg.norm(column[3:]) < 0.5) for column in own])
    axis = np.array([column[:3] if slide else column[3:] for column, slide in zip(own, slides, strict=True)])
    places, bodies = list(model.jointPlacements)[1:], list(model.inertias)[1:]
    carried = Bodies(
        np.array([parent - 1 for parent in list(model.parents)[1:]]),
        np.array([place.rotation for place in places]),
        np.array([place.translation for place in places]),
        axis,
        slides,
        np.array([body.mass for body in bodies]),
        np.array([body.lever for body in bodies]),
        np.array([body.inertia for body in bodies]),
        np.array(model.gravity.linear),
    )
    return Chain(carried, np.asarray(robot.drive, float), np.asarray(robot.rest, float) * np.ones(model.nv))


def _compiled(function):  # type: ignore[no-untyped-def]
    return njit(cache=True, error_model="numpy")(function)


@_compiled
def _get(x, i):  # type: ignore[no-untyped-def]
    return x[i, 0], x[i, 1], x[i, 2]


@_compiled
def _put(x, i, a):  # type: ignore[no-untyped-def]
    x[i, 0], x[i, 1], x[i, 2] = a


@_compiled
def _cross(a, b):  # type: ignore[no-untyped-def]
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@_compiled
def _sum(a, b, s):  # type: ignore[no-untyped-def]
    """Vector a + s b."""
    return a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]


@_compiled
def _out(m, i, x):  # type: ignore[no-untyped-def]
    """Matrix i of m, times x."""
    return (
        m[i, 0, 0] * x[0] + m[i, 0, 1] * x[1] + m[i, 0, 2] * x[2],
        m[i, 1, 0] * x[0] + m[i, 1, 1] * x[1] + m[i, 1, 2] * x[2],
        m[i, 2, 0] * x[0] + m[i, 2, 1] * x[1] + m[i, 2, 2] * x[2],
    )


@_compiled
def _in(m, i, x):  # type: ignore[no-untyped-def]
    """Transposed matrix i of m, times x."""
    return (
        m[i, 0, 0] * x[0] + m[i, 1, 0] * x[1] + m[i, 2, 0] * x[2],
        m[i, 0, 1] * x[0] + m[i, 1, 1] * x[1] + m[i, 2, 1] * x[2],
        m[i, 0, 2] * x[0] + m[i, 1, 2] * x[1] + m[i, 2, 2] * x[2],
    )


@_compiled
def _about(axis, angle, x):  # type: ignore[no-untyped-def]
    """Vector x, turned by an angle about an axis."""
    s, c = np.sin(angle), np.cos(angle)
    along = (1 - c) * (axis[0] * x[0] + axis[1] * x[1] + axis[2] * x[2])
    return _sum(_sum((c * x[0], c * x[1], c * x[2]), _cross(axis, x), s), axis, along)


@_compiled
def _move(bodies, i, q, v, a, motion):  # type: ignore[no-untyped-def]
    """Place and motion of joint i from those of its parent; gravity is an acceleration of the base."""
    rotation, slides, gravity = bodies.rotation, bodies.slides, bodies.gravity
    turn, at, w, alpha, acc = motion
    p, own, here = bodies.parent[i], _get(bodies.axis, i), _get(bodies.place, i)
    if slides[i]:
        here = _sum(here, _out(rotation, i, own), q)
    for k in range(3):  # rows of rotation after the turn: each is turned back
        x = rotation[i, k, 0], rotation[i, k, 1], rotation[i, k, 2]
        turn[i, k, 0], turn[i, k, 1], turn[i, k, 2] = x if slides[i] else _about(own, -q, x)
    _put(at, i, here)
    spin, rise, fall = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (-gravity[0], -gravity[1], -gravity[2])
    if p >= 0:
        spin, rise = _get(w, p), _get(alpha, p)
        fall = _sum(_sum(_get(acc, p), _cross(rise, here), 1.0), _cross(spin, _cross(spin, here)), 1.0)
    spin, rise, fall = _in(turn, i, spin), _in(turn, i, rise), _in(turn, i, fall)
    if slides[i]:
        fall = _sum(_sum(fall, own, a), _cross(spin, own), 2 * v)
    else:
        rise = _sum(_sum(rise, own, a), _cross(spin, own), v)
        spin = _sum(spin, own, v)
    _put(w, i, spin)
    _put(alpha, i, rise)
    _put(acc, i, fall)


@_compiled
def _torque(q, v, a, bodies):  # type: ignore[no-untyped-def]
    """Recursive Newton-Euler algorithm (Luh, Walker, Paul 1980), all in the frames of the joints."""
    rows, m = q.shape
    out = np.empty((rows, m))
    turn, at = np.empty((m, 3, 3)), np.empty((m, 3))
    w, alpha, acc, f, n = np.zeros((5, m, 3))
    motion = _Motion(turn, at, w, alpha, acc)
    parent, _, _, axis, slides, mass, centre, inertia, _ = bodies
    for t in range(rows):
        for i in range(m):
            _move(bodies, i, q[t, i], v[t, i], a[t, i], motion)
            c, spin, rise = _get(centre, i), _get(w, i), _get(alpha, i)
            push = _sum(_sum(_get(acc, i), _cross(rise, c), 1.0), _cross(spin, _cross(spin, c)), 1.0)
            push = (mass[i] * push[0], mass[i] * push[1], mass[i] * push[2])
            twist = _sum(_out(inertia, i, rise), _cross(spin, _out(inertia, i, spin)), 1.0)
            _put(f, i, push)
            _put(n, i, _sum(twist, _cross(c, push), 1.0))
        for i in range(m - 1, -1, -1):
            own, p = (f if slides[i] else n), parent[i]
            out[t, i] = axis[i, 0] * own[i, 0] + axis[i, 1] * own[i, 1] + axis[i, 2] * own[i, 2]
            if p >= 0:
                push = _out(turn, i, _get(f, i))
                twist = _sum(_out(turn, i, _get(n, i)), _cross(_get(at, i), push), 1.0)
                _put(f, p, _sum(_get(f, p), push, 1.0))
                _put(n, p, _sum(_get(n, p), twist, 1.0))
    return out
