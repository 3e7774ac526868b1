"""Recordings of position drives -> signs and zeros of their positions against the description, by the load."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.stats import t as student

from ...servos import Servo, ServoGrid
from ...types import Array, Robot
from ..plant.roll_out import tree_of
from .fit import (
    POINTS,
    ZeroFit,
    ZeroStart,
    ZeroTrial,
    best_zeros,
    fit_zeros,
    mirrored,
    noise_of,
    search,
    turned,
    weighted,
)
from .rows import MIN_USABLE_ROWS, Loads, foreseen, unexplained, zero_rows

LAST_FIT_ROWS, FIT_ROWS, SEARCH_ROWS = 1200, 400, 200  # rows of the last fit, of those before, and of the search
RIVALS = 2  # fits with another sign that are refined
MIN_ZERO_SECONDS = 1.5  # [s] of a recording
LEAST_BLOCKS = 4  # blocks without which nothing is said
MIN_ACTING = 1e-2  # share of the largest gravity torque that another zero must change: bodies are not known better
KNOWN_ZERO_STD = 0.35  # [rad] standard deviation from which a zero is not identifiable
MIN_CHANGED_ZERO = 0.1  # [rad] smaller zeros are within what masses of a description leave open
P_CHANGE = 0.95  # probability from which a change is said
P_SIGN = 0.9  # probability from which a sign is identifiable
MIN_CHANGE_SAVING = 0.02  # sum over joints of the log rms that all changes must save
WHOLE_RECORDINGS = 4  # recordings from which they are held out whole
NEGLIGIBLE_NATS = 0.5  # nats of errors of a block that count as none
MOST_NATS = 12.0  # nats that the evidence can reach; models of robots are not exact
CHANGE_COST = 4.0  # nats that a changed zero or sign must save, beyond the noise: a prior of 1/5 each and its width
LIKELY = 3  # trials of the search from which the choice starts, beside the description
MAX_GRAVITY_LOSS = 0.2  # sum of log rms by which gravity alone may fit worse with a sign that is tried
ZERO_DEVIATIONS = 6.0  # standard deviations of a zero that may be none


def find_zeros(
    robot: Robot, grids: Sequence[ServoGrid], servos: Mapping[str, Servo], seed: int = 0
) -> tuple[JointZero, ...]:
    """Signs and zeros of the revolute joints with drives; empty without enough rows or without gravity.

    Args:
        robot: with the joints of the grids alone.
        grids: recordings, all of the same joints.
        servos: drives that start a fit, for delays and limits.
        seed: of random starts.
    """
    long = [grid for grid in grids if len(grid) >= max(MIN_ZERO_SECONDS * grid.rate, MIN_USABLE_ROWS)]
    if not long:
        return ()
    whole = zero_rows(long, servos, LAST_FIT_ROWS)
    rows = whole.thinned(FIT_ROWS)
    turning = [j for j in range(len(rows.joints)) if rows.joints[j] in servos and turns(robot, j)]
    if not turning:
        return ()
    tree = tree_of(robot)
    coarse, fine = Loads(tree, rows.thinned(SEARCH_ROWS)), Loads(tree, rows)
    joints = acting(coarse, turning) if len(rows) else []
    if not joints or not coarse.lines or len(np.unique(rows.block)) < LEAST_BLOCKS:
        return ()
    trials = search(coarse, joints, seed)
    first = fit_zeros(fine, np.ones(len(rows.joints)), trials[0].signs, trials[0].zeros, joints)
    fine, noise = _weighed(fine, first)
    best = chosen(fine, noise, trials, joints)
    if best.changed:
        fine, noise = _weighed(fine, best)
        best = simplified(fine, noise, fit_zeros(fine, noise, *best.start), joints)
    return _Judged(_weighed(Loads(tree, whole), best), (fine, noise), coarse, best, joints=joints, trials=trials).all(
        turning
    )


def acting(loads: Loads, joints: Iterable[int]) -> list[int]:
    """Joints whose zeros change the load of a loop that is recorded."""
    n = len(loads.rows.joints)
    signs, used = np.ones(n), [line.joint for line in loads.lines]
    plain = loads.gravity(signs, np.zeros(n))[:, used]
    found = []
    for j in joints:
        turned_by = [loads.gravity(signs, turn * np.eye(n)[j])[:, used] for turn in POINTS[1:]]
        if max(np.abs(x - plain).max(initial=0.0) for x in turned_by) > MIN_ACTING * np.abs(plain).max(initial=0.0):
            found.append(j)
    return found


def _weighed(loads: Loads, fit: ZeroFit) -> tuple[Loads, Array]:
    """Rows with less weight where a fit leaves much, and the noise (n,) [rad or m] of their errors."""
    load = loads.torque(fit.signs, fit.zeros)
    loads = weighted(loads, load)
    return loads, noise_of(loads, load)


def turns(robot: Robot, j: int) -> bool:
    """Whether a joint is revolute and moves no other one."""
    drive = robot.drive[:, j]
    return not robot.prismatic[j] and np.count_nonzero(drive) == 1 and abs(drive).max() == 1


class _Judged:
    """A fit of zeros, with evidence for each of its signs and zeros."""

    def __init__(
        self,
        whole: tuple[Loads, Array],
        fine: tuple[Loads, Array],
        coarse: Loads,
        best: ZeroFit,
        *,
        joints: Sequence[int],
        trials: Sequence[ZeroTrial],
    ) -> None:
        self.last = fit_zeros(whole[0], whole[1], *best.start)
        self.whole = whole
        (self.loads, self.noise), self.coarse = fine, coarse
        self.best, self.joints, self.trials = best, joints, trials
        self.scores = held_out(*fine, best)
        n = len(best.signs)
        described = self._fit(np.ones(n), np.zeros(n), ())
        odds = log_odds(self.scores, held_out(*fine, described), min(best.changed, 1))
        self.sure = probability(odds) > P_CHANGE and self._saved(described) > MIN_CHANGE_SAVING

    def all(self, turning: Sequence[int]) -> tuple[JointZero, ...]:
        """Each revolute joint."""
        names = self.loads.rows.joints
        return tuple(
            self._joint(j) if j in self.joints else JointZero(names[j], 1, 0.5, None, None, False, False, 0.0)
            for j in turning
        )

    def _joint(self, j: int) -> JointZero:
        best, last, free = self.best, self.last, tuple(dict.fromkeys((*self.best.free, j)))
        own = last if j in best.free else fit_zeros(*self.whole, last.signs, last.zeros, free)
        shifted = best.signs[j] < 0 or j in best.free
        sign = probability(self._odds(self._flipped(j)))
        shift = probability(self._odds(self._plain(j))) if shifted else 0.0
        zero, std = float(own.zeros[j]), float(own.std[j])
        far = best.signs[j] < 0 or abs(zero) > max(2 * std, MIN_CHANGED_ZERO)
        changed = bool(self.sure and shifted and far and std < KNOWN_ZERO_STD and shift > P_CHANGE)
        undecided = far and not changed
        known = std < KNOWN_ZERO_STD and sign > P_SIGN and not undecided
        turn = int(best.signs[j])
        if undecided and turn < 0:
            turn, sign = 1, 1 - sign
        name = self.loads.rows.joints[j]
        return JointZero(name, turn, sign, zero, std, known, changed, shift if self.sure else 0.0)

    def _flipped(self, j: int) -> ZeroFit:
        """Best fit with the other sign of a joint."""
        locked = {j: -self.best.signs[j]}
        start = ZeroTrial(np.inf, self.best.signs, self.best.zeros)
        one = turned(self.coarse, start, [(j,)], locked)
        found = [self._fit(one.signs, one.zeros, tuple(dict.fromkeys((*self.best.free, j))))]
        if not self.sure:
            return found[0]
        others = [k for k in self.joints if k != j]
        rivals = [turned(self.coarse, start, [(j, k)], locked) for k in others]
        rivals += [trial for trial in self.trials if trial.signs[j] == locked[j]][:1]
        rivals = sorted([*rivals, mirrored(self.coarse, start, self.joints)], key=lambda trial: trial.score)
        for trial in rivals[:RIVALS]:
            rival = self._fit(trial.signs, trial.zeros, tuple(self.joints))
            kept = tuple(k for k in rival.free if abs(rival.zeros[k]) > 2 * rival.std[k])
            zeros = np.where(np.isin(np.arange(len(rival.zeros)), kept), rival.zeros, 0.0)
            found += [rival, self._fit(rival.signs, zeros, kept)]
        return min(found, key=cost)

    def _plain(self, j: int) -> ZeroFit:
        """Best fit with sign and zero of a joint as described."""
        signs, zeros = self.best.signs.copy(), self.best.zeros.copy()
        signs[j], zeros[j] = 1.0, 0.0
        return self._fit(signs, zeros, tuple(k for k in self.best.free if k != j))

    def _fit(self, signs: Array, zeros: Array, free: tuple[int, ...]) -> ZeroFit:
        return fit_zeros(self.loads, self.noise, signs, zeros, free)

    def _odds(self, other: ZeroFit) -> float:
        more = self.best.changed - other.changed
        return log_odds(self.scores, held_out(self.loads, self.noise, other), more)

    def _saved(self, described: ZeroFit) -> float:
        """Sum over joints of the log rms that the fit saves."""
        sizes = []
        for fit in (described, self.best):
            load = self.loads.torque(fit.signs, fit.zeros)
            sizes.append(sum(float(np.log(np.std(unexplained(line, load)) + 1e-9)) for line in self.loads.lines))
        return sizes[0] - sizes[1]


PRIOR = np.log(4.0)  # nats that each changed sign or zero is less likely before


def held_out(loads: Loads, noise: Array, fit: ZeroFit) -> Array:
    """Half the squared errors over their noise (B,) [nats] in each of B blocks, fitted without them.

    noise: (n,) [rad or m] of independent rows.
    """
    rows = loads.rows
    whole = len(np.unique(rows.recording)) >= WHOLE_RECORDINGS
    half = (rows.recording if whole else rows.block) % 2 == 0
    names, number = np.unique(rows.block, return_inverse=True)
    out = np.zeros(len(names))
    for mine in (half, ~half):
        here, there = loads.part(mine), loads.part(~mine)
        if not here.lines:  # nothing to learn from
            continue
        own = fit_zeros(here, noise, fit.signs, fit.zeros, fit.free)
        load, other = (x.torque(own.signs, own.zeros) for x in (here, there))
        for line in here.lines:
            left, use = foreseen(here, line, load, there, other)
            np.add.at(out, number[~mine][use], 0.5 * (left / noise[line.joint]) ** 2)
    return out


def log_odds(first: Array, second: Array, more: int) -> float:
    """Log odds of a first fit against a second one [nats], at most those by which its blocks are better on average.

    first: (B,) [nats] of its blocks; second: (B,) [nats] of the other's; more: changes of the first alone.
    """
    total, ratio = float(np.sum(second - first)), np.log((second + NEGLIGIBLE_NATS) / (first + NEGLIGIBLE_NATS))
    count = len(ratio)
    if count < 2 or total == 0.0:
        return float(-PRIOR * more)
    spread = float(np.std(ratio, ddof=1)) / np.sqrt(count)
    steady = float(np.sign(total) * np.mean(ratio)) / max(spread, 1e-12)
    sure = -float(student.logsf(max(steady, 0.0), count - 1))
    return float(np.clip(np.sign(total) * min(abs(total), sure), -MOST_NATS, MOST_NATS) - PRIOR * more)


def probability(odds: float) -> float:
    """Probability of log odds [nats]."""
    return float(1 / (1 + np.exp(-np.clip(odds, -30, 30))))


@dataclass(frozen=True)
class JointZero:
    """Position of the description = sign * recorded position + zero, of one joint."""

    joint: str
    sign: int  # 1 or -1
    sign_probability: float  # [1] 0.5 where gravity is the same with either sign
    zero: float | None  # [rad] None where it is not identifiable at all
    std: float | None  # [rad]
    identifiable: bool  # whether gravity shows sign and zero
    changed: bool  # whether it surely is not as the description says
    probability: float  # [1] that sign or zero are not as the description says

    @property
    def decided(self) -> bool:
        """Whether the sign may stand in a file: it is that of the description, or identifiable."""
        return self.sign > 0 or self.sign_probability >= P_SIGN


def chosen(loads: Loads, noise: Array, trials: Sequence[ZeroTrial], joints: Sequence[int]) -> ZeroFit:
    """Cheapest fit from the description and from the best trials; noise: (n,) [rad or m] of independent rows."""
    n = len(loads.rows.joints)
    starts = [fit_zeros(loads, noise, np.ones(n), np.zeros(n), ())]
    starts += [fit_zeros(loads, noise, trial.signs, trial.zeros, joints) for trial in trials[:LIKELY]]
    starts.sort(key=cost)
    ends = [simplified(loads, noise, start, joints) for start in starts[:2]]
    return min(ends, key=cost)


def cost(fit: ZeroFit) -> float:
    """Errors and changes of a fit in nats."""
    return fit.squares + CHANGE_COST * fit.changed


def simplified(loads: Loads, noise: Array, fit: ZeroFit, joints: Sequence[int]) -> ZeroFit:
    """Cheapest fit that changes of single joints lead to; noise: (n,) [rad or m]."""
    for _ in range(2 * len(joints)):
        best = fit
        for proposal in _neighbours(loads, fit, joints):
            other = fit_zeros(loads, noise, *proposal)
            best = other if cost(other) < cost(best) - 0.1 else best
        if best is fit:
            break
        fit = best
    return fit


def _neighbours(loads: Loads, fit: ZeroFit, joints: Sequence[int]) -> Iterator[ZeroStart]:
    """Fits with another sign or zero of one joint that may be cheaper; zeros that were free may be as described."""
    here = ZeroTrial(np.inf, fit.signs, fit.zeros)
    for j in joints:
        others = tuple(k for k in fit.free if k != j)
        at = {sign: best_zeros(loads, here, (j,), (sign,)) for sign in (1.0, -1.0)}
        least = min(one.score for one in at.values())
        for sign, one in at.items():
            plain = one.zeros.copy()
            plain[j] = 0.0
            other = sign != fit.signs[j]
            if other and one.score > least + MAX_GRAVITY_LOSS:
                continue
            if other or (j in fit.free and abs(fit.zeros[j]) < ZERO_DEVIATIONS * fit.std[j]):
                yield one.signs, plain, others
            if other or j not in fit.free:
                yield one.signs, one.zeros, (*others, j)
