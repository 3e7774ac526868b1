"""Unsigned currents with unknown torque constants -> the constants."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ..errors import OptionError, RecordingError, shorten
from ..estimation.least_squares import estimate
from ..model import stated_inertials
from ..recording import same_joints, with_signs, without_torque
from ..regression.factors import Factors, JointFactors
from ..regression.rows import Task
from ..regression.session import Session
from ..types import (
    TWO_SIDED,
    Array,
    BaseMap,
    Estimate,
    Frozen,
    Indices,
    Mask,
    Progress,
    Reading,
    Recording,
    Robot,
    prismatic_unit,
)
from .infer import infer
from .observations import Observations, observe
from .result import Gain, Signs
from .samples import signs_of_rows

INERTIAL_ERROR = 0.2  # [1] relative standard deviation of a link's stated mass, first moment and inertia; heuristic
MAX_CONSTANT_STD = 0.5  # [1] relative standard deviation from which a constant counts as unknown; heuristic
START_GRID = np.geomspace(1e-4, 1e4, 81)  # [median ratio of the shared columns] values of 1/K tried as start; heuristic
MIN_SHARED_ENTRY = 1e-12  # [largest entry of the Gram matrix] of columns that joints share
GRAM_RIDGE = 1e-9  # [unit diagonal of a Gram matrix] regularisation
MIN_RESIDUAL_POWER = 1e-6  # [power of the torque] smallest residual; rounding
MIN_START_RATIO = 3.0  # [1] factor between two different starts; heuristic
MAX_LOG_STEPS = 15  # [iterations] of Gauss-Newton, at most; heuristic
MAX_LOG_STEP = 0.7  # [log] of a constant in one iteration: a factor of 2; heuristic
CONVERGED_LOG_STEP = 1e-4  # [log] step at which Gauss-Newton ends; heuristic
LOG_DIFFERENCE = 1e-3  # [log] of a constant, in finite differences of the base parameters; heuristic
MAX_LAST_STEP = 0.1  # [standard deviations] a longer last step makes the constant unknown; heuristic
UNINFORMATIVE_STD = 30.0  # [log] standard deviation of an uninformative constant: thirteen decades
EXACT_STD = 1e-4  # [log] standard deviation of an exact constant; keeps matrices regular
MAX_CONSTANT_ROUNDS = 5  # most rounds of signs and constants in turn
CONSTANT_TOLERANCE, DEVIATION_TOLERANCE = 0.01, 0.1  # change that ends rounds: [1], [standard deviations]
UNKNOWN_CONSTANT_STD = 0.3  # relative standard deviation [1] above which a constant counts as unknown
ROUGH_CONSTANT_STD = 0.1  # the same, above which a constant is flagged as rough


class UnknownConstants(OptionError):
    """Torque constants that are neither stated nor identifiable: of `joints`."""

    def __init__(self, robot: Robot, lost: Mask, fact: str, remedy: str) -> None:
        self.joints = tuple(robot.joints[j] for j in np.flatnonzero(lost))
        units = " or ".join(sorted({_constant_unit(robot, j) for j in np.flatnonzero(lost).tolist()}))
        super().__init__(f"{fact}; state torque_constant [{units} at the joint] in an actuators file, {remedy}")

    @property
    def flag(self) -> str:
        """Sentence on results without the currents of these joints."""
        return f"{self}; the current of {shorten(self.joints)} is left out of the comparison"

    def left_out(self, recordings: Sequence[Recording]) -> list[Recording]:
        """Recordings without the currents of these joints; raises this error if one has no other torque."""
        rest = [without_torque(recording, self.joints) for recording in recordings]
        if not all(any(recording.columns["tau"]) for recording in rest):
            raise self
        return rest


@dataclass(frozen=True, eq=False)
class Constants(Frozen):
    """Torque constants of n joints, as logarithms with their covariance."""

    log: Array  # (n,) logarithms of constants in [N.m/A or N/A]
    covariance: Array  # (n, n) of the logarithms [1]; 0: known constant; inf or large: unidentifiable
    described: bool = False  # whether the description was needed
    settled: bool = True  # whether signs and constants no longer changed in the last round

    @property
    def std(self) -> Array:
        """(n,) relative standard deviations [1]."""
        return np.sqrt(np.diag(self.covariance))


def share_constants(factors: Factors, base: BaseMap, unknown: Mask) -> Constants:
    """Torque constants K of the joints `unknown` (n,) from those of the others, at least one; torque / K was recorded.

    Gauss-Newton over K and base parameters, with each joint's residual in its recorded unit, since small K would
    otherwise make small residuals. The logarithm of a constant is one more parameter, whose column is the predicted
    torque. The start is a grid search over one joint after the other, the best identifiable constant first.

    Source: Gautier, Vandanjon, Presse, IEEE ICRA 1994 (drive gains beside inertial parameters).
    """
    n, rank = len(unknown), base.rank
    free = np.flatnonzero(unknown & np.array([joint.counts[0] > 0 for joint in factors.joints]))
    log, step = np.zeros(n), np.zeros(len(free))
    log[free] = _start_constants(factors, free, rank)
    value = estimate(_scaled(factors, log), base, np.zeros(rank)).value
    covariance = np.zeros((n, n))
    for _ in range(MAX_LOG_STEPS if len(free) else 0):
        scaled = _scaled(factors, log)
        joints, columns = list(scaled.joints), list(scaled.columns)
        for i, j in enumerate(free.tolist()):
            seen = columns[j]
            joints[j] = move(joints[j], np.column_stack([np.eye(len(seen)), -value[seen]]))
            columns[j] = np.append(seen, rank + i)
        estimated = estimate(
            replace(scaled, joints=tuple(joints), columns=tuple(columns)), base, np.zeros(rank + len(free))
        )
        value, step = estimated.value[:rank], np.clip(estimated.value[rank:], -MAX_LOG_STEP, MAX_LOG_STEP)
        log[free] += step
        covariance[np.ix_(free, free)] = estimated.covariance[rank:, rank:]
        if np.abs(step).max() < CONVERGED_LOG_STEP:
            break
    diverged = free[np.abs(step) > np.maximum(MAX_LAST_STEP * np.sqrt(np.diag(covariance)[free]), CONVERGED_LOG_STEP)]
    covariance[diverged, diverged] = np.inf
    return Constants(log, covariance)


def constant_sensitivity(estimated: Estimate, factors: Factors, base: BaseMap, joints: Mask, whiten: bool) -> Array:
    """Derivative (b, n) [units of base] of base parameters by the logarithms of constants; zero for other joints."""
    slopes = np.zeros((base.rank, len(joints)))
    for j in np.flatnonzero(joints).tolist():
        moved = _scaled(factors, LOG_DIFFERENCE * np.eye(len(joints))[j])
        slopes[:, j] = (estimate(moved, base, estimated.value, whiten).value - estimated.value) / LOG_DIFFERENCE
    return slopes


def move(joint: JointFactors, columns: Array, scale: float = 1.0) -> JointFactors:
    """Factors of a joint over k combinations of its m columns (m, k) [units of new over old], with scaled torque."""
    m, k = columns.shape
    copies = (joint.grams.shape[1] - 1) // max(m, 1)  # two with instruments, else one
    turn = np.zeros((copies * m + 1, copies * k + 1))
    turn[:-1, :-1], turn[-1, -1] = np.kron(np.eye(copies), columns), scale
    corner = turn[-m - 1 :, -k - 1 :]
    whole = corner.T @ joint.whole @ corner
    return replace(joint, grams=turn.T @ joint.grams @ turn, whole=whole, total=scale * joint.total)


def _scaled(factors: Factors, log: Array) -> Factors:
    """Factors in torque, with constants exp(log)."""
    joints = zip(factors.joints, factors.columns, np.exp(log).tolist(), strict=True)
    moved = tuple(move(joint, np.eye(len(seen)), scale) for joint, seen, scale in joints)
    return replace(factors, joints=moved, sample=None)


class _ConstantTrial(NamedTuple):
    """Best constant of one more joint."""

    gram: Array  # (b + 1, b + 1) of all joints that are scaled, with the one tried
    log: float  # of its constant
    margin: float  # of the explained power over any distinct constant [squared standard deviations]


def _start_constants(factors: Factors, free: Indices, rank: int) -> Array:
    """(k,) logarithms of the constants, found one after the other, the clearest first."""
    grams = []  # (b + 1, b + 1) of [all columns, torque], over the variance of the joint's own residual
    for joint, seen in zip(factors.joints, factors.columns, strict=True):
        own = joint.grams[0][-len(seen) - 1 :, -len(seen) - 1 :]
        power = float(own[-1, -1])
        variance = max(power - _explained_power(own), MIN_RESIDUAL_POWER * power, 1e-300) / max(joint.counts[0], 1)
        grams.append(np.zeros((rank + 1, rank + 1)))
        at = np.append(seen, rank)
        grams[-1][np.ix_(at, at)] = own / variance
    total = np.sum([gram for j, gram in enumerate(grams) if j not in free], axis=0)
    logs: dict[int, float] = {}
    while len(logs) < len(free):
        trials = {j: _try_constant(total, grams[j]) for j in free.tolist() if j not in logs}
        j = max(trials, key=lambda j: trials[j].margin)
        total, logs[j] = trials[j].gram, trials[j].log
    return np.array([logs[j] for j in free.tolist()])


def _explained_power(gram: Array) -> float:
    """Power of the torque that the columns explain."""
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    unit = gram / np.outer(size, size)
    lower = np.linalg.cholesky(unit[:-1, :-1] + GRAM_RIDGE * np.eye(len(gram) - 1))
    return float(np.sum(np.linalg.solve(lower, unit[:-1, -1]) ** 2) * gram[-1, -1])


def _try_constant(total: Array, gram: Array) -> _ConstantTrial:
    """Constant with which one more joint, and those that are scaled already, are explained best."""
    here, there = np.diag(total)[:-1], np.diag(gram)[:-1]
    both = (here > MIN_SHARED_ENTRY * here.max(initial=0.0)) & (there > MIN_SHARED_ENTRY * there.max(initial=0.0))
    middle = float(np.median(np.sqrt(here[both] / there[both]))) if both.any() else 1.0
    inverse = np.concatenate([-middle * START_GRID[::-1], middle * START_GRID])  # 1 / K; negative: all signs inverted
    scaled = [total + gram * np.outer(x, x) for x in (np.append(np.full(len(gram) - 1, k), 1.0) for k in inverse)]
    explained = np.array([_explained_power(g) for g in scaled])
    best = int(np.argmax(explained))
    apart = np.abs(np.log(np.abs(inverse / inverse[best]))) > np.log(MIN_START_RATIO)
    margin = float(explained[best] - explained[apart].max())
    return _ConstantTrial(scaled[best], float(-np.log(np.abs(inverse[best]))), margin)


def describe_constants(task: Task, factors: Factors) -> Constants:
    """Torque constants of n joints, each alone, from the rigid-body torque of the stated inertials.

    The recorded currents of a joint are regressed on that torque and on the joint's laws. The covariance includes noise
    and the error of the description; it is infinite where the torque is indistinguishable from the laws.
    """
    stated = stated_inertials(task.robot)
    bodies = task.base.combination[:, : stated.size]
    rigid, n = bodies @ stated.ravel(), len(factors.joints)
    log, noise, off = np.zeros(n), np.full(n, np.inf), np.zeros((n, stated.size))
    for j, (joint, seen) in enumerate(zip(factors.joints, factors.columns, strict=True)):
        laws = [k for k, label in enumerate(task.base.labels) if label.law is not None and label.joint == j]
        columns = np.column_stack([rigid[seen], task.base.combination[seen][:, laws]])
        if not joint.counts[0] or not rigid[seen].any():
            continue
        alone = replace(factors, joints=(move(joint, columns),), columns=(np.arange(len(laws) + 1),), sample=None)
        estimated = estimate(alone, task.base, np.zeros(len(laws) + 1))
        inverse, std = float(estimated.value[0]), float(np.sqrt(estimated.covariance[0, 0]))
        if inverse > 0 and std < MAX_CONSTANT_STD * inverse:
            log[j], noise[j] = -np.log(inverse), std / inverse
            gram = joint.grams[0][-len(seen) - 1 : -1, -len(seen) - 1 : -1]
            normal = columns.T @ gram @ columns
            size = np.sqrt(np.maximum(np.diag(normal), 1e-300))
            solved = np.linalg.pinv(normal / np.outer(size, size), rcond=1e-10, hermitian=True) / np.outer(size, size)
            off[j] = np.asarray(solved[0] @ columns.T @ gram @ bodies[seen])
    scales: list[Array] = []
    for body in stated:
        mass, second = body[0], max((body[4] + body[6] + body[9]) / 2, 0.0)
        scales.append(np.array([mass, *[np.sqrt(max(mass * second, 0.0))] * 3, *[second] * 6]))
    off *= INERTIAL_ERROR * np.concatenate(scales)
    return Constants(log, off @ off.T + np.diag(noise**2))


def combine(relative: Constants, described: Constants, known: Mask) -> Constants:
    """Combine relative constants from shared parameters with those from the description, weighted by their covariances.

    If the descriptions of several joints disagree by more than their covariance, it is inflated. The constant of joints
    `known` (n,) is exactly 1.
    """
    log, before = relative.log.copy(), relative.covariance.copy()
    lost = ~(relative.std < MAX_CONSTANT_STD)
    before[lost], before[:, lost] = 0.0, 0.0
    before += UNINFORMATIVE_STD**2 * (1.0 + np.diag(lost))
    at = np.flatnonzero(known | np.isfinite(described.std))
    if not len(at):
        return Constants(log, before)
    stated = np.where(known | known[:, None], EXACT_STD**2 * np.eye(len(log)), described.covariance)[np.ix_(at, at)]
    difference = np.where(known, 0.0, described.log)[at] - np.where(lost, 0.0, log)[at]
    log[lost] = 0.0
    shared = before[np.ix_(at, at)]
    freedom = max(int(np.sum(~lost[at])) - 1, 1)
    chi2 = float(difference @ np.linalg.solve(shared + stated, difference)) / freedom
    gain = np.linalg.solve(shared + max(chi2, 1.0) * stated, before[at]).T
    return Constants(log + gain @ difference, before - gain @ before[at])


@dataclass(frozen=True, eq=False)
class TorqueConstants(Frozen):
    """Torque constants that n joints lacked."""

    gains: tuple[Gain, ...]  # of the joints where they were unknown
    value: Array  # (n,) [N.m/A or N/A] where the constant was unknown, else 1
    covariance: Array  # (n, n) [1] of its logarithm, 0 elsewhere
    notes: tuple[str, ...]
    flags: tuple[str, ...]
    described: bool = False  # whether the inertials of the description set the scale

    def scale(self, recording: Recording) -> Recording:
        """The recording with its currents as torques."""
        reading = (recording.reading or Reading("")).with_constants(self._lines())
        return replace(recording, torque_per_unit=recording.torque_per_unit * self.value, scaled=None, reading=reading)

    def _lines(self) -> list[str]:
        """Lines of a reading that state the constants, as comments with their intervals."""
        whence = "description" if self.described else "motion"
        ends = [(gain.value - TWO_SIDED * gain.std, gain.value + TWO_SIDED * gain.std) for gain in self.gains]
        return [
            f"# {gain.joint} = {gain.value:.5g}  # {low:.5g} to {high:.5g} {gain.unit} (95 %), from the {whence}"
            for gain, (low, high) in zip(self.gains, ends, strict=True)
        ]

    def describe(self, signs: Signs) -> Signs:
        """The signs found in scaled recordings, with constants, notes and flags."""
        return replace(signs, gains=self.gains, notes=(*self.notes, *signs.notes), flags=(*self.flags, *signs.flags))


def find_gains(session: Session, progress: Progress | None = None) -> TorqueConstants | None:
    """The torque constants that recordings lack; None where they lack none.

    Each joint's signs are searched by itself, where its constant does not matter; the signed currents determine the
    constants, by the base parameters that joints share, and with those the signs are searched in all joints together;
    again until nothing changes. Where no joint's constant is known, or where joints share too little, the inertials
    that the description states set the scale. Recordings of which a part is learned from are used, whole.

    Raises:
        OptionError: a constant is not identifiable; the sentence says what to state.
        RecordingError: a constant is known in some recordings only.
    """
    robot, recordings = session.robot, session.recordings
    joints = same_joints(recordings)
    lacking = np.array([np.zeros(len(joints), bool) if r.scaled is None else ~r.scaled for r in recordings])
    for j in np.flatnonzero(lacking.any(axis=0) & ~lacking.all(axis=0)).tolist():
        first, other = recordings[int(np.argmax(lacking[:, j]))], recordings[int(np.argmin(lacking[:, j]))]
        raise RecordingError(
            f"{first.path or 'one recording'} lacks the torque constant of {joints[j]}, {other.path or 'another'} "
            f"needs none; state torque_constant of it in an actuators file, or use recordings of one kind together"
        )
    unknown = np.asarray(lacking[0])
    if not unknown.any():
        return None
    observed = observe(session.task, session.learned)
    anchors = observed.known & ~unknown
    if not anchors.any() and not stated_inertials(robot).any():
        fact = f"the torque constants of {_names(robot, unknown)} are not known, no torque of another joint is, and the"
        fact += " description states no inertials to set the scale"
        raise UnknownConstants(robot, unknown, fact, "of one at least")
    constants = _alternate(session, observed, unknown, progress)
    lost = unknown & ~(constants.std <= UNKNOWN_CONSTANT_STD)
    if lost.any():
        fact = f"the torque constant of {_names(robot, lost)} is not known, and neither parameters shared with other"
        fact += f" joints nor stated inertials determine it to {100 * UNKNOWN_CONSTANT_STD:.0f} %"
        raise UnknownConstants(robot, lost, fact, "or leave out the column of the current")
    value, std = np.where(unknown, np.exp(constants.log), 1.0), np.where(unknown, constants.std, 0.0)
    covariance = np.where(np.outer(unknown, unknown), constants.covariance, 0.0)
    gains = tuple(
        Gain(robot.joints[j], float(value[j]), float(value[j] * std[j]), _constant_unit(robot, j))
        for j in np.flatnonzero(unknown).tolist()
    )
    stds = zip(gains, std[unknown], strict=True)
    values = [f"{joint} {k:.3g} {unit} (+- {100 * s:.2g} %)" for (joint, k, _, unit), s in stds]
    sentences = [f"unknown torque constants were found from the motion: {shorten(values)}"]
    if anchors.any():
        sentences.append(
            f"torque constants rest on the torque of {_names(robot, anchors)}, which depends on the same inertials"
        )
    if constants.described:
        more = "also " if anchors.any() else ""
        sentences.append(
            f"torque constants rest {more}on the inertials that the description states, taken to be right to "
            f"{100 * INERTIAL_ERROR:.0f} % a link"
        )
    sentences.append("standard deviations of parameters include the common uncertainty of these torque constants")
    flags = []
    if not constants.settled:
        flags.append(
            f"signs and torque constants still changed in the last of {MAX_CONSTANT_ROUNDS} rounds: either may be "
            f"wrong; state torque_constant in an actuators file"
        )
    if rough := [f"{robot.joints[j]} ({100 * std[j]:.0f} %)" for j in np.flatnonzero(std > ROUGH_CONSTANT_STD)]:
        flags.append(
            f"torque constants are known only roughly, of {shorten(rough)}: parameters there may be off by as much; "
            f"state torque_constant in an actuators file"
        )
    return TorqueConstants(gains, value, covariance, tuple(sentences), tuple(flags), constants.described)


def _alternate(session: Session, observed: Observations, unknown: Mask, progress: Progress | None) -> Constants:
    """Signs and constants in turn."""
    constants = Constants(np.zeros(len(unknown)), np.diag(np.where(unknown, np.inf, 0.0)))
    signs = np.zeros_like(observed.torque)
    for k in range(MAX_CONSTANT_ROUNDS):
        if progress is not None:
            progress("finding torque constants", k / MAX_CONSTANT_ROUNDS)
        last, signs = signs, _infer_signs(session.task, observed, constants, session.options.seed)
        if np.array_equal(last, signs):
            break
        before = constants
        parts = []
        for part, (recording, sampling) in enumerate(session.learned):
            at = observed.part == part
            t, first, row_signs = observed.t[at], np.flatnonzero(observed.first[at]), signs[at].astype(np.int8)
            parts.append((with_signs(recording, signs_of_rows(recording, sampling, t, first, row_signs)), sampling))
        constants = _estimate_constants(session.task, session.reduce(parts), unknown)
        change = np.abs(constants.log - before.log)
        if last.any() and np.all(change <= np.maximum(CONSTANT_TOLERANCE, DEVIATION_TOLERANCE * constants.std)):
            break
    else:
        return replace(constants, settled=False)
    return constants


def _infer_signs(task: Task, observed: Observations, constants: Constants, seed: int) -> Array:
    """Signs (N, n) [1]: joints with known constants together, each other joint by itself."""
    known = constants.std <= UNKNOWN_CONSTANT_STD
    alone = np.diag(observed.known & ~known)
    signs = np.sign(observed.torque)
    for group in (observed.known & known, *alone[alone.any(axis=1)]):
        if (group & ~observed.signed).any():
            torque = np.where(group, observed.torque * np.exp(constants.log), 0.0)
            inferred = infer(task, replace(observed, known=group, torque=torque), seed)
            signs[:, group] = inferred.refined.signs[:, group]
    return signs


def _estimate_constants(task: Task, factors: Factors, unknown: Mask) -> Constants:
    """Constants from parameters shared with joints of known constant; from the description where that is too little."""
    recorded = np.array([joint.counts[0] > 0 for joint in factors.joints])
    anchors = recorded & ~unknown
    shared = share_constants(factors, task.base, unknown) if anchors.any() else None
    if shared is not None and np.all(shared.std[unknown] <= UNKNOWN_CONSTANT_STD):
        return shared
    described = describe_constants(task, factors)
    reference = int(np.argmin(np.where(unknown, described.std, np.inf)))
    if shared is not None and not np.isfinite(described.std[reference]):
        return shared
    relative = share_constants(factors, task.base, recorded & (np.arange(len(unknown)) != reference))
    return replace(combine(relative, described, anchors), described=True)


def _constant_unit(robot: Robot, joint: int) -> str:
    return prismatic_unit("N.m/A") if robot.prismatic[joint] else "N.m/A"


def _names(robot: Robot, joints: Mask) -> str:
    return shorten([robot.joints[j] for j in np.flatnonzero(joints)])
