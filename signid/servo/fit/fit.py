"""Output-error fit of drives: Gauss-Newton with bounds and Levenberg damping along ratios and common scales.

The cost may have several valleys: along scales of torque that the data hardly set, and at limits that are not reached.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.linalg import block_diag

from ...errors import OptionError, shorten
from ...frozen import Frozen
from ...model import Model
from ...servos import LOOP_NUMBERS, Servo, ServoGrid
from ...types import Array, Mask, Robot
from ..given import UNSHARED, Assumptions, Name, unions
from ..plant.course import (
    FIT_SUBSTEP,
    SEARCH_SUBSTEP,
    RobotCourse,
    bodies_of,
    course,
    groups,
    part,
    recorded_course,
    refined,
    single,
)
from .coordinates import Coordinates, slots, started, typical
from .normal import (
    Certainty,
    FitPoint,
    FitWindows,
    Normal,
    certainty,
    cost,
    covariance,
    normal,
    residuals,
    settle,
    shoot,
    slopes_at,
    window_places,
    windows_of,
)

CENTRAL_GAIN = 0.05  # relative gain of the cost below which differences become central
WIDENING_GAIN, TOLERANCE = 1e-3, 2e-4  # relative gain of the cost below which differences widen, or the fit ends
DIFFERENCE_FACTORS = (1.0, 4.0)  # differences that are tried one after another
FIRST_DAMPING, MIN_DAMPING, DAMPING_RISE, DAMPING_FALL, DAMPING_TRIALS = 1e-2, 1e-7, 6.0, 0.1, 6  # [1] factors
SMALLEST_NOISE = 1e-5  # [rad or m]
WEAK_KP_STD = 0.2  # standard deviation of kp over kp from which other scales are tried
SCALE_FACTORS = (10.0, 0.1)
LIMIT_FACTORS = (0.6, 0.35)  # limits of torque over stiffness at the start times the largest error
MIN_LIMIT_INFLUENCE = 1.0  # squared influence of a relative change of a limit, over the noise: below it is not reached
MAX_SCANNED = 2  # joints of a group that are tried
SCAN_STEPS = 6  # steps from another scale
MIN_VALLEY_GAIN = 0.02  # gain of the logarithm of the squared residual that is worth another valley


@dataclass(frozen=True, eq=False)
class ServoFit(Frozen):
    """Fitted drives: P free numbers, n joints of the grids, W windows.

    Independent branches without a common number are fitted apart; the covariance between them is zero.
    """

    servos: Mapping[str, Servo]  # by joint, fitted
    names: tuple[Name, ...]  # P: joint, number
    owners: tuple[tuple[str, ...], ...]  # P: all joints that have the number
    values: Array  # (P,) [SERVO_UNITS]
    covariance: Array  # (P, P) [products of SERVO_UNITS] robust, never below the classical one; NaN of a coarse fit
    information: Array  # (P, P) [inverse products of SERVO_UNITS] Gauss-Newton, states eliminated; NaN of a coarse fit
    residual_rms: Array  # (n,) [rad or m] over the windows; NaN for joints without a servo
    windows: tuple[tuple[int, int], ...]  # W: index of the grid, first row
    window_squares: Array  # (W, n) mean square of the residual of each window [rad2 or m2]; NaN without a servo
    saturated_share: Array  # (n,) share of samples at the effort limit while on [1]
    iterations: int
    at_bound: Mask  # (P,) whether a number stands at a bound of `assumptions`: it then has no variance
    spread: Array  # (P,) [SERVO_UNITS] standard deviation between recordings, 0 where they agree
    notes: tuple[str, ...] = ()

    @property
    def free(self) -> tuple[Name, ...]:
        """Free numbers of every joint."""
        each = zip(self.names, self.owners, strict=True)
        return tuple((joint, number) for (_, number), joints in each for joint in joints)

    @property
    def std(self) -> Array:
        """Standard deviations (P,) in SERVO_UNITS."""
        return np.sqrt(np.diag(self.covariance))


RELINEARISED_STEPS = 8  # most steps about the simulated motion
LINEAR_STEP = 0.002  # [s] of the rows that a fit about the simulated motion is linear in


def fit_servos(
    model: Model,
    grids: Sequence[ServoGrid],
    servos: Mapping[str, Servo],
    free: Sequence[tuple[str, str]],
    *,
    window: float = 0.8,
    relinearise: bool = True,
    iterations: int = 15,
    scales: bool = True,
    coarse: bool = False,
    usual: Mapping[str, float] | None = None,
    assumptions: Assumptions | None = None,
    courses: Sequence[RobotCourse] = (),
) -> ServoFit:
    """Fit the free numbers of drives to the measured positions.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints and one rate.
        servos: drives to start from, by joint; joints without one follow the recorded motion.
        free: joint and number, one of LOOP_NUMBERS; a number that starts at zero or infinity gets a typical start.
        window: length of a window [s]; use .2 first where drives saturate.
        relinearise: whether to fit again about the simulated motion.
        iterations: most steps of the first fit.
        scales: whether to start again from other scales of joints whose scale is weakly identifiable.
        coarse: whether to end where a step gains little, without intervals, in longer substeps.
        usual: kp by joint [N.m/rad or N/m], about which a scale that the data do not set stays.
        assumptions: joints with equal numbers, also of different branches; priors and bounds.
        courses: along the recorded motions, where they are known.

    Raises:
        OptionError: unknown joint or number, or no free number.
    """
    grids = tuple(grids)
    _check(grids, servos, free)
    robot = bodies_of(model, grids[0].joints)
    courses = tuple(courses) or tuple(recorded_course(model, grid) for grid in grids)
    acting = [j for j, joint in enumerate(grids[0].joints) if joint in servos]
    branches, assumed = groups(robot, acting), assumptions or Assumptions()
    rest = branches, coarse, usual or {}, assumed
    task = _Task(grids, robot, courses, dict(servos), tuple(free), tuple(window_places(grids, window)), *rest)
    names = robot.joints
    equal = [[joint for joint in members if joint in servos] for members in assumed.equal]
    linked = unions([*([names[j] for j in branch] for branch in branches), *filter(None, equal)])
    joints = tuple(sorted(tuple(sorted(map(names.index, members))) for members in linked))  # share a body or a number
    first = replace(task, coarse=coarse or (relinearise and not scales))
    fits = [_fit_group(first, group, iterations, scales=scales) for group in joints]
    steps = 0
    if relinearise:
        steps = max(f.solved.steps for f in fits)
        task = replace(task, about=_about(task, joints, fits))
        fits = [_fit_group(task, g, min(RELINEARISED_STEPS, iterations), f) for g, f in zip(joints, fits, strict=True)]
    return _collect(task, joints, fits, steps)


@dataclass(frozen=True, eq=False)
class _Task:
    grids: tuple[ServoGrid, ...]
    robot: Robot
    courses: tuple[RobotCourse, ...]  # along the recorded motion
    servos: Mapping[str, Servo]
    free: tuple[tuple[str, str], ...]
    places: tuple[tuple[int, int, int], ...]  # of the windows
    branches: tuple[tuple[int, ...], ...]  # joints that share moved bodies
    coarse: bool
    usual: Mapping[str, float]
    assumptions: Assumptions
    about: tuple[RobotCourse, ...] = ()  # along the simulated motion


@dataclass(frozen=True, eq=False)
class _Group:
    windows: FitWindows
    where: Coordinates
    solved: Solved


def _check(grids: Sequence[ServoGrid], servos: Mapping[str, Servo], free: Sequence[tuple[str, str]]) -> None:
    if not grids:
        raise OptionError("no recording was given to the fit of servos; give at least one")
    joints, rate = grids[0].joints, grids[0].rate
    for grid in grids:
        if grid.joints != joints:
            raise OptionError(f"{grid.path or 'a recording'} moves other joints; fit recordings of the same joints")
        if grid.rate != rate:
            raise OptionError(
                f"{grid.path or 'a grid'} has {grid.rate:g} Hz, the first one {rate:g}; give all one rate"
            )
    for joint in servos:
        if joint not in joints or not all(grid.driven[joints.index(joint)] for grid in grids):
            raise OptionError(f"joint {joint!r} has no commands; choose from {shorten(joints)}")
    for joint, number in free:
        if joint not in servos or number not in LOOP_NUMBERS:
            raise OptionError(f"no number {number!r} of a servo at {joint!r}; choose from {shorten(LOOP_NUMBERS, 20)}")


def _fit_group(
    task: _Task, joints: tuple[int, ...], iterations: int, before: _Group | None = None, scales: bool = True
) -> _Group:
    names, motions = [task.robot.joints[j] for j in joints], [along.motion for along in task.courses]
    sizes = [typical(task.servos[name], j, task.grids, motions) for name, j in zip(names, joints, strict=True)]
    free = [[number for joint, number in task.free if joint == name] for name in names]
    drives = tuple(started(task.servos[name], mine, size) for name, mine, size in zip(names, free, sizes, strict=True))
    branches = [[joints.index(j) for j in branch] for branch in task.branches if branch[0] in joints]
    equal = [[joint for joint in members if joint in names] for members in task.assumptions.equal]
    same: dict[str, list[int]] = {}
    for number in LOOP_NUMBERS:  # labels of the joints: those with the same one share the number
        shared = unions([*([name] for name in names), *(filter(None, equal) if number != UNSHARED else ())])
        same[number] = [next(k for k, members in enumerate(shared) if name in members) for name in names]
    usual = [task.usual.get(name, 0.0) for name in names]
    assumed = task.assumptions
    priors = {(names.index(j), number): x for (j, number), x in assumed.priors.items() if j in names}
    bounds = {(names.index(j), number): x for (j, number), x in assumed.bounds.items() if j in names}
    where = Coordinates(drives, slots(free, sizes, same, usual, priors, bounds))
    recorded, about = ([part(one, joints) for one in some] for some in (task.courses, task.about))
    longest = SEARCH_SUBSTEP if task.coarse else FIT_SUBSTEP
    windows = windows_of(task.grids, joints, drives, recorded, task.places, about, longest=longest)
    windows = windows.apart(branches) if len(branches) > 1 else windows
    point = before.solved.point if before else FitPoint(where.start, windows.q0, windows.v0)
    solved = solve(windows, where, point, iterations if where.slots else 0, task.coarse)
    return _Group(windows, where, solved if before or not scales else scan(windows, where, solved, iterations))


def _about(task: _Task, joints: Sequence[tuple[int, ...]], fits: Sequence[_Group]) -> tuple[RobotCourse, ...]:
    """Courses along the simulated motions, on finer rows."""
    rate = task.grids[0].rate
    finer = int(np.ceil(1 / (LINEAR_STEP * rate) - 1e-9))
    motions = [refined(along.motion.q, rate, finer) for along in task.courses]
    if single(task.robot):  # linear about any motion
        return tuple(course(task.robot, motion) for motion in motions)
    for group, fit in zip(joints, fits, strict=True):
        paths = fit.solved.residual + fit.windows.measured
        for (grid, first, rows), path in zip(task.places, paths, strict=True):
            some = slice(first * finer, (first + rows) * finer)
            for kept, simulated in zip(motions[grid], refined(path[: rows + 1], rate, finer), strict=True):
                kept[some, group] = simulated[: rows * finer]
    return tuple(course(task.robot, motion) for motion in motions)


def _collect(task: _Task, joints: Sequence[tuple[int, ...]], fits: Sequence[_Group], steps: int) -> ServoFit:
    names = [
        tuple((task.robot.joints[g[s.joint]], s.number) for s in f.where.slots)
        for g, f in zip(joints, fits, strict=True)
    ]
    flat = [name for group in names for name in group]
    order = [flat.index(name) for name in task.free if name in flat]
    n, lengths = len(task.robot.joints), [rows for _, _, rows in task.places]
    squares, share = np.full((len(lengths), n), np.nan), np.full(n, np.nan)
    servos = dict(task.servos)
    for group, fit in zip(joints, fits, strict=True):
        columns = list(group)
        squares[:, columns] = np.sum(fit.solved.residual**2, axis=1) / (fit.windows.rows[:, None] + 1)
        point, windows = fit.solved.point, fit.windows
        hits = shoot(windows, fit.where.copies(point.values[None]), point.q0[None], point.v0[None])[1][0].sum(0)
        on = (windows.joined.column("on")[windows.places[:, :-1]] > 0.5) & windows.inside[:, 1:, None]
        share[columns] = np.asarray(hits / np.maximum(windows.joined.parts * on.sum((0, 1)), 1))
        for j, servo in zip(group, fit.where.at(fit.solved.point.values).servos, strict=True):
            servos[task.robot.joints[j]] = servo
    owners = [
        tuple(task.robot.joints[g[j]] for j in s.joints)
        for g, f in zip(joints, fits, strict=True)
        for s in f.where.slots
    ]
    certain = [_certainty(fit, task) for fit in fits]
    rms, reordered = np.sqrt(np.average(squares, axis=0, weights=lengths)), np.ix_(order, order)
    return ServoFit(
        servos,
        tuple(flat[i] for i in order),
        tuple(owners[i] for i in order),
        np.concatenate([f.solved.point.values for f in fits])[order],
        block_diag(*(one.covariance for one, _ in certain))[reordered],
        block_diag(*(information for _, information in certain))[reordered],
        rms,
        tuple((k, first) for k, first, _ in task.places),
        squares,
        share,
        steps + max(f.solved.steps for f in fits),
        np.concatenate([f.where.at_bounds(f.solved.point.values) for f in fits])[order],
        np.concatenate([one.spread for one, _ in certain])[order],
    )


def _certainty(fit: _Group, task: _Task) -> tuple[Certainty, Array]:
    """Certainty and information (P, P) of a group, with its priors; NaN of a coarse fit.

    The others are those about a number at its bound, which has no variance.
    """
    values, count = fit.solved.point.values, len(fit.where.slots)
    if task.coarse:
        return Certainty(np.full((count, count), np.nan), np.zeros(count)), np.full((count, count), np.nan)
    slopes, prior = slopes_at(fit.windows, fit.where, fit.solved.point), np.diag(fit.where.stated_precision)
    at = normal(fit.windows, slopes, fit.solved.residual, fit.solved.point, fit.solved.noise)
    ratios, inside = np.eye(count), ~fit.where.at_bounds(values)
    for i in range(count):
        ratios[fit.where.scaled(i), i] = values[fit.where.scaled(i)]
    shas = [grid.sha256 or grid.path for grid in task.grids]
    recording = np.array([shas.index(shas[k]) for k, _, _ in task.places])
    rows, covariance, spread = np.ix_(inside, inside), np.zeros((count, count)), np.zeros(count)
    own = at._replace(each=at.each[:, inside][:, :, inside], scores=at.scores[:, inside])
    covariance[rows], spread[inside] = certainty(own, recording, prior[rows], ratios[rows])
    return Certainty(covariance, spread), at.information + prior


class Solved(NamedTuple):
    """End of a fit."""

    point: FitPoint
    residual: Array  # (W, T, n) [rad or m] at the point
    noise: Array  # (n,) [rad or m]
    steps: int

    @property
    def badness(self) -> float:
        """Sum over joints of the logarithm of the squared residual, to compare ends of one fit."""
        return float(2 * np.log(self.noise).sum())


def solve(windows: FitWindows, where: Coordinates, point: FitPoint, iterations: int, coarse: bool = False) -> Solved:
    """Minimise the weighted output error from a point; `coarse`: until a step gains little.

    Dry friction makes the cost rough: where no step along the model of small differences brings it down, larger
    differences see over the roughness. Derivatives serve further steps, which count for nothing, as long as these gain
    enough, and not so much that the derivatives must be others.

    iterations: most times that derivatives are computed.
    """
    damping, steps, wide, central = FIRST_DAMPING, 0, 0, False
    last, slopes = 1 if coarse else len(DIFFERENCE_FACTORS), None
    residual = residuals(windows, where, point)
    noise = noise_of(residual[windows.inside], robust=True)
    left_over = iterations
    while left_over > 0:
        known = slopes is not None
        left_over -= not known
        slopes = slopes or slopes_at(windows, where, point, DIFFERENCE_FACTORS[wide], central)
        here = normal(windows, slopes, residual, point, noise)
        now = cost(windows, residual, point, noise) + where.prior_cost(point.values)
        then, tried = np.inf, damping
        for _ in range(1 if known else DAMPING_TRIALS):
            values = damped(where, here, point.values, tried)
            if np.isfinite(values).all():
                state = here.state + np.einsum("wps,p->ws", here.across, values - point.values)
                states = -np.einsum("wsu,wu->ws", here.inverse, state)
                new, left = settle(windows, where, point, (values, states), noise)
                then = cost(windows, left, new, noise) + where.prior_cost(values)
            if np.isfinite(then) and then < now:
                break
            tried *= DAMPING_RISE
        small = not then < now * (1 - (WIDENING_GAIN if coarse or wide + 1 < len(DIFFERENCE_FACTORS) else TOLERANCE))
        far = then < now * (1 - CENTRAL_GAIN)
        if then < now:
            point, residual, steps = new, left, steps + 1
            damping = max(tried * DAMPING_FALL, MIN_DAMPING)
            noise = noise_of(residual[windows.inside])
        elif not known:
            damping = tried
        slopes = None if small or far else slopes
        if small and not known:
            wide, damping = wide + (central or coarse), min(damping, FIRST_DAMPING)
        if wide == last:
            break
        central = central or not (far or coarse)
    return Solved(point, residual, noise, steps)


def noise_of(residual: Array, robust: bool = False) -> Array:
    """Size (n,) of the residual (M, n) of each joint [rad or m]; `robust`: by its median."""
    middle = np.median(residual**2, axis=0) / 0.455 if robust else np.mean(residual**2, axis=0)
    return np.asarray(np.maximum(np.sqrt(middle), SMALLEST_NOISE))


def damped(where: Coordinates, here: Normal, values: Array, damping: float) -> Array:
    """Values after a Gauss-Newton step within bounds, damped along ratios and scales; values: (P,) [SERVO_UNITS]."""
    slope, x = where.slope(values), where.x(values)
    precision, off = where.prior(values)
    information = here.information * np.outer(slope, slope) + np.diag(precision)
    gradient = here.scores.sum(0) * slope + precision * off
    ratios = where.ratios(values)
    size = np.diag(ratios.T @ information @ ratios) + 1e-12
    back = np.linalg.inv(ratios)
    low, high = where.allowed(values)
    longest = np.array([slot.longest for slot in where.slots])
    room = low - x, np.maximum(high - x, 0.0)
    dx = _bounded(information + damping * back.T @ (size[:, None] * back), gradient, room, longest)
    return where.values_at(np.clip(x + dx, low, np.maximum(high, x)))


def _bounded(matrix: Array, gradient: Array, room: tuple[Array, Array], most: Array) -> Array:
    """Step (P,) of a quadratic model; coordinates that would leave their bounds stay there.

    room: (P,) each, the least and the largest step.
    """
    step, free = np.zeros(len(gradient)), np.ones(len(gradient), dtype=bool)
    for _ in range(len(gradient)):
        step[~free] = np.clip(step, *room)[~free]
        rest = gradient + matrix[:, ~free] @ step[~free]
        step[free] = -np.linalg.solve(matrix[np.ix_(free, free)], rest[free])
        out = free & ((step < room[0]) | (step > room[1]))
        if not out.any() or (free & ~out).sum() == 0:
            break
        free &= ~out
    return np.clip(step, -most, most)


def scan(windows: FitWindows, where: Coordinates, solved: Solved, iterations: int) -> Solved:
    """Best end of a fit over the scales of its weak joints and the limits that it does not reach, one by one."""
    slopes = slopes_at(windows, where, solved.point)
    best, at = solved, normal(windows, slopes, solved.residual, solved.point, solved.noise)
    for i in (*untouched(where, solved, at), *weakest(where, solved, at)):
        ends = [best]
        for factor in SCALE_FACTORS if where.slots[i].number == "kp" else LIMIT_FACTORS:
            values = best.point.values.copy()
            if where.slots[i].number == "kp":
                values[where.scaled(i)] *= factor
            else:
                values[i] = factor * where.slots[i].typical
            start = FitPoint(values, best.point.q0, best.point.v0)
            ends.append(solve(windows, where, start, min(SCAN_STEPS, iterations)))
        other = min(ends, key=lambda end: end.badness)
        if other.badness < best.badness - MIN_VALLEY_GAIN:
            best = solve(windows, where, other.point, iterations)
    return best


def weakest(where: Coordinates, solved: Solved, at: Normal) -> list[int]:
    """Slots of the stiffnesses with the widest intervals, if these are wide: at most MAX_SCANNED."""
    std = np.sqrt(np.diag(covariance(at.information, at.scores)))
    share = {i: float(std[i] / solved.point.values[i]) for i, slot in enumerate(where.slots) if slot.number == "kp"}
    return sorted((i for i in share if share[i] > WEAK_KP_STD), key=lambda i: -share[i])[:MAX_SCANNED]


def untouched(where: Coordinates, solved: Solved, at: Normal) -> list[int]:
    """Slots of the limits of torque without influence, at joints with the largest residuals: at most MAX_SCANNED."""
    weight = np.diag(at.information) * solved.point.values**2
    found = [i for i, s in enumerate(where.slots) if s.number == "effort_limit" and weight[i] < MIN_LIMIT_INFLUENCE]
    return sorted(found, key=lambda i: -float(solved.noise[where.slots[i].joint]))[:MAX_SCANNED]
