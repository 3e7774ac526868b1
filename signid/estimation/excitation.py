"""Factors -> verdict: whether the motion makes the parameters identifiable, relative to random motion of equal size."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from ..errors import RecordingError, named_for_caller
from ..regression.factors import Factors
from ..regression.motion import Motion, base_rows
from ..regression.rows import Task
from ..types import INERTIAL, Array, BaseMap, Estimate, Frozen, Robot

MIN_INFO = 0.02  # [1] smallest share of the information of random motion of equal size, in the weakest direction
IN_STEP = 0.98  # [1] correlation of two joints' velocities from which on they move in step
MAX_REST = 0.01  # [1] rms velocity below which a joint is at rest, over that of the fastest joint
RANDOM_STATES = 2000  # states of the random motion
PRIOR_MASS_SHARE, PRIOR_LENGTH = 0.3, 0.1  # prior uncertainty of inertials: 30 % of the mass [1], at 10 cm [m]


@dataclass(frozen=True, eq=False)
class ExcitationVerdict(Frozen):
    """Information of a motion, relative to random motion of equal size.

    `shares` are ascending, one per direction in base-parameter space. For each insufficient direction `weak` names the
    base parameters in it, and `unidentified` describes them in words.
    """

    shares: Array  # (b,) [1]
    prior: Array  # (b,) [units of base] prior standard deviation of each base parameter
    weak: tuple[tuple[str, ...], ...] = ()
    unidentified: tuple[str, ...] = ()  # "the rotational inertia of links a and b"
    resting: tuple[str, ...] = ()  # joints that did not move
    in_step: tuple[tuple[str, ...], ...] = ()  # groups of joints with proportional velocities
    small: tuple[str, ...] = ()  # base parameters whose standard deviation exceeds the prior one

    @property
    def sufficient(self) -> bool:
        """Whether every direction has enough information."""
        return bool(self.shares[0] >= MIN_INFO) if len(self.shares) else False

    @property
    def sentences(self) -> tuple[str, ...]:
        """Reasons for insufficient excitation, with advice; empty if it is sufficient."""
        if self.sufficient:
            return ()
        sentences = []
        if self.resting:
            them = "it" if len(self.resting) == 1 else "them"
            sentences.append(f"{_joints(self.resting)} did not move: move {them}, or hold with --lock")
        sentences += [f"{_joints(group)} moved in step: move them out of step" for group in self.in_step]
        sentences.append(
            f"the motion gives {max(self.shares[0], 0):.2%} of the information of random motion of the same size (at "
            f"least {MIN_INFO:.0%} is needed): {_join_names(self.unidentified)} cannot be identified; record a motion "
            f"by signid excite"
        )
        return tuple(map(named_for_caller, sentences))


def judge_excitation(task: Task, factors: Factors, estimated: Estimate, seed: int = 0) -> ExcitationVerdict:
    """Verdict on recordings, from the generalised eigenvalues of their Gram matrix and that of a random motion.

    Source: criterion of optimal excitation (Swevers et al., IEEE T-RA 13(5), 1997), made relative, so that it does not
    depend on units or on the size of the motion.

    Raises:
        RecordingError: numbers of the recordings differ too much in size.
    """
    robot, base = task.robot, task.base
    weight = 1 / np.maximum(estimated.noise, 1e-12 * estimated.noise.max(initial=1e-300)) ** 2
    ours = np.zeros((base.rank, base.rank))
    for joint, columns, w in zip(factors.joints, factors.columns, weight, strict=True):
        ours[np.ix_(columns, columns)] += w * joint.whole[:-1, :-1]
    speed = np.sqrt(np.diag(factors.velocity) / factors.rows)
    acceleration = np.sqrt(factors.acceleration / factors.rows)
    best = _random_information(task, factors, speed, acceleration, weight, seed)
    size = np.sqrt(np.maximum(np.diag(best), 1e-300))
    scaled = best / np.outer(size, size) + 1e-12 * np.eye(base.rank)
    root = np.linalg.cholesky(scaled)
    half = np.linalg.solve(root, ours / np.outer(size, size))
    try:
        shares, vectors = np.linalg.eigh(np.linalg.solve(root, half.T))  # generalised eigenvalues
    except np.linalg.LinAlgError:
        raise RecordingError(
            "the information of the recordings cannot be computed, since their numbers differ too much in size; check "
            "the units of the columns"
        ) from None
    directions = np.linalg.solve(root.T, vectors)
    torque = np.array([np.sqrt(f.whole[-1, -1] / max(f.rows, 1)) for f in factors.joints])
    prior = _prior_sizes(robot, base, torque, speed)
    weak = []  # the leading base parameters of each weak direction, three at most
    for direction in (directions[:, k] / size / prior for k in np.flatnonzero(shares < MIN_INFO)):
        order = np.argsort(-np.abs(direction))[:3]
        weak.append([int(i) for i in order if abs(direction[i]) > 0.1 * abs(direction[order[0]])])
    uncertain = estimated.std > prior
    resting = np.flatnonzero((speed <= MAX_REST * speed.max(initial=1e-300)) & (speed.max() > 0))
    return ExcitationVerdict(
        shares=shares,
        prior=prior,
        weak=tuple(tuple(base.expressions[i] for i in group) for group in weak),
        unidentified=_in_words(robot, base, dict.fromkeys(i for group in weak for i in group)),
        resting=tuple(robot.joints[j] for j in resting),
        in_step=tuple(tuple(robot.joints[j] for j in group) for group in in_step(factors.velocity / factors.rows)),
        small=tuple(e for e, u in zip(base.expressions, uncertain, strict=True) if u),
    )


def _prior_sizes(robot: Robot, base: BaseMap, torque: Array, speed: Array) -> Array:
    """Prior standard deviations (b,) [units of base] from masses (at least 0.1 kg), rms torque and velocity (n,)."""
    sizes = []
    for k, label in enumerate(base.labels):
        if label.joint is None:
            body = robot.model.inertias[k // 10 + 1]
            order = {"m": 0, "mx": 1, "my": 1, "mz": 1}.get(INERTIAL[k % 10], 2)
            sizes.append(PRIOR_MASS_SHARE * max(body.mass, 0.1) * PRIOR_LENGTH**order)
        elif "kg" in label.unit:
            sizes.append(PRIOR_MASS_SHARE)
        else:
            per = max(speed[label.joint], 0.05) if ".s/" in label.unit else 1.0
            sizes.append(PRIOR_MASS_SHARE * torque[label.joint] / per)
    return np.asarray(np.maximum(np.sqrt((base.combination**2) @ np.array(sizes) ** 2), 1e-300))


def _random_information(
    task: Task, factors: Factors, speed: Array, acceleration: Array, weight: Array, seed: int
) -> Array:
    """Gram matrix (b, b) of as many rows of independent random states of equal size."""
    rng, n = np.random.default_rng(seed), len(speed)
    floor = 0.05 * speed.max(initial=1e-300)  # a joint at rest is compared with one that moves a little
    width = np.maximum((factors.upper - factors.lower) / 2, 1e-3)
    q = (factors.upper + factors.lower) / 2 + width * rng.uniform(-1, 1, (RANDOM_STATES, n))
    v = rng.standard_normal((RANDOM_STATES, n)) * np.maximum(speed, floor)
    a = rng.standard_normal((RANDOM_STATES, n)) * np.maximum(acceleration, 0.05 * acceleration.max(initial=1e-300))
    motion = Motion(task.robot, np.arange(RANDOM_STATES, dtype=np.float64), np.asarray(q), v, a)
    columns = base_rows(motion, task.laws, task.wanted)
    out = np.zeros((task.base.rank, task.base.rank))
    for j, x in enumerate(columns):
        seen = task.seen(j)
        out[np.ix_(seen, seen)] += weight[j] * factors.joints[j].rows / RANDOM_STATES * x.T @ x
    return out


def _in_words(robot: Robot, base: BaseMap, which: Iterable[int]) -> tuple[str, ...]:
    """Descriptions of base parameters by their leading standard parameters, grouped by kind."""
    owners: dict[str, list[str]] = {}
    for label in (base.labels[base.independent[i]] for i in which):
        if label.body is not None:
            kind = {"m": "mass"}.get(label.name.split("_")[0], "rotational inertia")
            kind = "centre of mass" if label.name[:2] in ("mx", "my", "mz") else kind
            owner = robot.links[label.body]
        else:
            kind, owner = label.name.rsplit("_", 1)[0].replace("_", " "), robot.joints[label.joint or 0]
        owners.setdefault(f"the {kind} of {'link' if label.body is not None else 'joint'}", []).append(owner)
    unique = {kind: sorted(set(found), key=found.index) for kind, found in owners.items()}
    return tuple(f"{kind}{'s' if len(found) > 1 else ''} {_join_names(found)}" for kind, found in unique.items())


def in_step(velocity: Array) -> tuple[tuple[int, ...], ...]:
    """Groups of joints with proportional velocities; velocity (n, n) [rad2/s2, m.rad/s2 or m2/s2]: mean products."""
    speed = np.sqrt(np.diag(velocity))
    size = np.where(speed > 0, speed, np.inf)
    alike = (np.abs(velocity / size[:, None] / size) > IN_STEP) & (speed > MAX_REST * speed.max(initial=1e-300))
    groups = dict.fromkeys(tuple(np.flatnonzero(row).tolist()) for row in alike)
    return tuple(group for group in groups if len(group) > 1)


def _joints(names: Sequence[str]) -> str:
    return f"joint{'s' if len(names) > 1 else ''} {_join_names(names)}"


def _join_names(names: Sequence[str]) -> str:
    return " and ".join([", ".join(names[:-1]), names[-1]] if len(names) > 1 else names)
