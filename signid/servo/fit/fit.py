"""Output-error fit of drives over short windows of the closed loop (multiple shooting)."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...errors import OptionError, shorten
from ...frozen import Frozen
from ...model import Model
from ...servos import SERVO_NUMBERS, Servo, ServoGrid
from ...types import Array, Robot
from ..plant.course import Moved, RobotCourse, bodies_of, course, groups, part, recorded_course, single
from ..plant.substeps import substeps
from .coordinates import Coordinates, slots
from .intervals import covariance
from .scan import scan
from .shots import Shots, build_shots, shoot, window_starts
from .solve import Solved, first_point, normal_at, solve
from .typical import started, typical


@dataclass(frozen=True, eq=False)
class ServoFit(Frozen):
    """Fitted drives: P free numbers, n joints of the grids, W windows.

    Joints of independent branches are fitted apart; the covariance between branches is zero.
    """

    servos: Mapping[str, Servo]  # by joint, fitted
    names: tuple[tuple[str, str], ...]  # P: joint, number
    values: Array  # (P,) [SERVO_UNITS]
    covariance: Array  # (P, P) [products of SERVO_UNITS] robust, never below the classical one; NaN of a coarse fit
    information: Array  # (P, P) [inverse products of SERVO_UNITS] Gauss-Newton, states eliminated; NaN of a coarse fit
    residual_rms: Array  # (n,) [rad or m] over the windows; NaN for joints without a servo
    windows: tuple[tuple[int, int], ...]  # W: index of the grid, first row
    window_squares: Array  # (W, n) mean square of the residual of each window [rad2 or m2]; NaN without a servo
    saturated_share: Array  # (n,) share of samples at the effort limit while on [1]
    iterations: int
    notes: tuple[str, ...] = ()

    @property
    def std(self) -> Array:
        """Standard deviations (P,) in SERVO_UNITS."""
        return np.sqrt(np.diag(self.covariance))


AGAIN = 8  # most steps about the simulated motion


def fit_servos(
    model: Model,
    grids: Sequence[ServoGrid],
    servos: Mapping[str, Servo],
    free: Sequence[tuple[str, str]],
    *,
    window: float = 0.8,
    shared: Sequence[str] = (),
    own: Collection[str] = (),
    relinearise: bool = True,
    iterations: int = 15,
    scales: bool = True,
    coarse: bool = False,
    usual: Mapping[str, float] | None = None,
) -> ServoFit:
    """Fit the free numbers of drives to the measured positions.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints and one rate.
        servos: drives to start from, by joint; joints without one follow the recorded motion.
        free: joint and number, one of SERVO_NUMBERS; a number that starts at zero or infinity gets a typical start.
        window: length of a window [s]; use .2 first where drives saturate.
        shared: numbers with one value for all joints of a branch, "delay".
        own: joints whose branches share nothing.
        relinearise: whether to fit again about the simulated motion.
        iterations: most steps of the first fit.
        scales: whether to start again from other scales of joints whose scale is weakly identifiable.
        coarse: whether to end where a step gains little, without intervals.
        usual: kp by joint [N.m/rad or N/m], about which a scale that the data do not set stays.

    Raises:
        OptionError: unknown joint or number, or no free number.
    """
    grids = tuple(grids)
    _check(grids, servos, free)
    robot = bodies_of(model, grids[0].joints)
    courses = tuple(recorded_course(model, grid) for grid in grids)
    acting = [j for j, joint in enumerate(grids[0].joints) if joint in servos]
    rest = tuple(shared), frozenset(own), coarse, usual or {}
    task = _Task(grids, robot, courses, dict(servos), tuple(free), window, *rest)
    joints = groups(robot, acting)
    fits = [_fit_group(task, group, iterations, scales=scales) for group in joints]
    steps = 0
    if relinearise and not single(robot):
        steps = max(f.solved.steps for f in fits)
        task = replace(task, about=_about(task, joints, fits))
        fits = [_fit_group(task, g, min(AGAIN, iterations), f) for g, f in zip(joints, fits, strict=True)]
    return _collect(task, joints, fits, steps)


@dataclass(frozen=True, eq=False)
class _Task:
    grids: tuple[ServoGrid, ...]
    robot: Robot
    courses: tuple[RobotCourse, ...]  # along the recorded motion
    servos: Mapping[str, Servo]
    free: tuple[tuple[str, str], ...]
    window: float
    shared: tuple[str, ...]
    own: frozenset[str]
    coarse: bool
    usual: Mapping[str, float]
    about: tuple[RobotCourse, ...] = ()  # along the simulated motion


@dataclass(frozen=True, eq=False)
class _Group:
    shots: tuple[Shots, ...]
    where: Coordinates
    solved: Solved


def _check(grids: Sequence[ServoGrid], servos: Mapping[str, Servo], free: Sequence[tuple[str, str]]) -> None:
    if not grids:
        raise OptionError("no recording was given to the fit of servos; give at least one")
    joints = grids[0].joints
    for grid in grids:
        if grid.joints != joints:
            raise OptionError(f"{grid.path or 'a recording'} moves other joints; fit recordings of the same joints")
    for joint in servos:
        if joint not in joints or not all(grid.driven[joints.index(joint)] for grid in grids):
            raise OptionError(f"joint {joint!r} has no commands; choose from {shorten(joints)}")
    for joint, number in free:
        if joint not in servos or number not in SERVO_NUMBERS:
            raise OptionError(f"no number {number!r} of a servo at {joint!r}; choose from {shorten(SERVO_NUMBERS, 20)}")


def _fit_group(
    task: _Task, joints: tuple[int, ...], iterations: int, before: _Group | None = None, scales: bool = True
) -> _Group:
    names = [task.robot.joints[j] for j in joints]
    sizes = [typical(task.servos[name], j, task.grids, task.courses) for name, j in zip(names, joints, strict=True)]
    free = [[number for joint, number in task.free if joint == name] for name in names]
    drives = tuple(started(task.servos[name], mine, size) for name, mine, size in zip(names, free, sizes, strict=True))
    shared = () if task.own.intersection(names) else task.shared
    where = Coordinates(drives, slots(free, sizes, shared, [task.usual.get(name, 0.0) for name in names]))
    shots = tuple(_shots(task, k, joints, drives) for k in range(len(task.grids)))
    point = before.solved.point if before else first_point(shots, where)
    solved = solve(shots, where, point, iterations if where.slots else 0, task.coarse)
    return _Group(shots, where, solved if before or not scales else scan(shots, where, solved, iterations))


def _shots(task: _Task, k: int, joints: tuple[int, ...], drives: Sequence[Servo]) -> Shots:
    grid, measured = task.grids[k], part(task.courses[k], joints)
    about = part(task.about[k], joints) if task.about else measured
    inertia = np.diagonal(measured.mass, axis1=1, axis2=2).min(0)
    return build_shots(grid, joints, about, measured, task.window, substeps(grid.step, drives, inertia))


def _about(task: _Task, joints: Sequence[tuple[int, ...]], fits: Sequence[_Group]) -> tuple[RobotCourse, ...]:
    """Courses along the simulated motions."""
    out = []
    for k, grid in enumerate(task.grids):
        q, v = task.courses[k].motion.q.copy(), task.courses[k].motion.v.copy()
        for group, fit in zip(joints, fits, strict=True):
            shots = fit.shots[k]
            paths = fit.solved.residual[k] + shots.measured
            for places, path in zip(shots.places, paths, strict=True):
                q[np.ix_(places, group)] = path
                v[np.ix_(places, group)] = np.gradient(path, grid.step, axis=0)
        out.append(course(task.robot, Moved(q, v, np.gradient(v, grid.step, axis=0))))
    return tuple(out)


def _collect(task: _Task, joints: Sequence[tuple[int, ...]], fits: Sequence[_Group], steps: int) -> ServoFit:
    names = [
        tuple((task.robot.joints[g[s.joint]], s.number) for s in f.where.slots)
        for g, f in zip(joints, fits, strict=True)
    ]
    flat = [name for group in names for name in group]
    order = [flat.index(name) for name in task.free if name in flat]
    windows = tuple((k, int(i)) for k, grid in enumerate(task.grids) for i in window_starts(grid, task.window)[0])
    n = len(task.robot.joints)
    squares, share = np.full((len(windows), n), np.nan), np.full(n, np.nan)
    servos = dict(task.servos)
    for group, fit in zip(joints, fits, strict=True):
        columns = list(group)
        squares[:, columns] = np.concatenate([np.mean(r**2, axis=1) for r in fit.solved.residual])
        share[columns] = _saturated(fit)
        for j, servo in zip(group, fit.where.servos_at(fit.solved.point.values), strict=True):
            servos[task.robot.joints[j]] = servo
    certain = [_certainty(fit, task.coarse) for fit in fits]
    rms = np.sqrt(np.average(squares, axis=0, weights=_lengths(task, windows)))
    return ServoFit(
        servos,
        tuple(flat[i] for i in order),
        np.concatenate([f.solved.point.values for f in fits])[order],
        _blocks([spread for spread, _ in certain], order),
        _blocks([information for _, information in certain], order),
        rms,
        windows,
        squares,
        share,
        steps + max(f.solved.steps for f in fits),
    )


def _certainty(fit: _Group, coarse: bool) -> tuple[Array, Array]:
    """Covariance and information (P, P) of a group; NaN of a coarse fit."""
    if coarse:
        return (np.full((len(fit.where.slots),) * 2, np.nan),) * 2
    at = normal_at(fit.shots, fit.where, fit.solved)
    return covariance(at.information, at.scores), at.information


def _lengths(task: _Task, windows: Sequence[tuple[int, int]]) -> list[int]:
    rows = [window_starts(grid, task.window)[1] for grid in task.grids]
    return [rows[k] for k, _ in windows]


def _saturated(fit: _Group) -> Array:
    """Share (n,) of the time with the drive on that it spends at its limit."""
    point, hits, on = fit.solved.point, np.zeros(len(fit.where.servos)), np.zeros(len(fit.where.servos))
    copies = fit.where.table(point.values[None])
    for shots, q0, v0 in zip(fit.shots, point.q0, point.v0, strict=True):
        hits += shoot(shots, fit.where.servos, copies, q0[None], v0[None])[1][0].sum(0)
        held = shots.grid.on[:, list(shots.joints)] > 0.5
        on += shots.parts * held[shots.places[:, :-1]].sum((0, 1))
    return np.asarray(hits / np.maximum(on, 1))


def _blocks(parts: Sequence[Array], order: Sequence[int]) -> Array:
    """Matrix of independent blocks, in another order."""
    total = sum(map(len, parts))
    out, k = np.zeros((total, total)), 0
    for one in parts:
        out[k : k + len(one), k : k + len(one)] = one
        k += len(one)
    return out[np.ix_(order, order)]
