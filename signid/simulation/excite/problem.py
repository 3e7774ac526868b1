"""Problem of finding an exciting motion: model, parameters to identify, limits, noise and reference sizes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...effects import EFFECTS
from ...errors import OptionError
from ...model import Model
from ...regression.base_parameters import build_base
from ...regression.motion import Motion, base_rows
from ...types import Array, BaseMap, Frozen, Indices, Law, Result, Trajectory
from .families import Family, random_parameters
from .limits import Collision, Limits, build_collision
from .slopes import row_slopes

DIRECTION_SPEED = 0.01  # [rad/s or m/s] speed below which the direction of motion is proportional to the velocity
REFERENCES = 20  # random motions for reference sizes
REFERENCE_SAMPLES = 200  # samples of each of these motions
TORQUE_NOISE_SHARE = 0.01  # [1] torque noise over the torque limit, or over the rms torque without a limit
HOME_POSTURES = 200  # random candidates for the home posture
MIN_LAMBDA = 100.0  # [1] lambda at which the right one of two hypotheses was always found


@dataclass(frozen=True, eq=False)
class ExcitationProblem(Frozen):
    """Model, parameters to be identified, and limits of a motion."""

    model: Model
    laws: tuple[Law, ...]  # laws whose coefficients are to be identified, besides the bodies
    base: BaseMap
    limits: Limits
    noise: Array  # (n,) [N.m or N] assumed standard deviation of the torque
    size: Array  # (b,) [noise per unit of base] reference size of each column
    collision: Collision | None  # None: self-collision is not checked
    clearance: float  # [m] smallest distance between links
    home: Array  # (n,) [rad or m] posture that obeys all limits

    @cached_property
    def wanted(self) -> list[Indices]:
        """Standard parameters of each joint's columns, the argument `wanted` of `base_rows`."""
        return [self.base.independent[seen] for seen in self.base.sees]

    @cached_property
    def value(self) -> Array:
        """Base parameters (b,) [units of base] of the model; laws that it does not have count as zero."""
        known = {(law.effect.name, law.joints): law.effect.coefficients(law.parameters) for law in self.model.laws}
        places = ((law.effect, law.joints) for law in self.laws)
        stated = [known.get((effect.name, at), [0.0] * max(1, len(effect.linear()))) for effect, at in places]
        return np.asarray(
            self.base.combination @ np.concatenate([self.model.inertials.ravel(), *map(np.array, stated)])
        )

    def motion(self, t: Array, q: Array, v: Array, a: Array, slow: Array | float = DIRECTION_SPEED) -> Motion:
        """Motion at instants t (N,) [s]: q (N, n) [rad or m], v (N, n) [rad/s or m/s], a (N, n) [rad/s2 or m/s2].

        Below a speed slow (n,) [rad/s or m/s] the direction of motion is proportional to the velocity.
        """
        return Motion(self.model.robot, t, q, v, a, slow=np.broadcast_to(slow, self.noise.shape))

    def rows(self, motion: Motion) -> list[Array]:
        """Base regressor (N, m_j) of each joint, over noise and reference size [1]."""
        found = base_rows(motion, self.laws, self.wanted)
        return [x / scale for x, scale in zip(found, self._scales, strict=True)]

    def row_slopes(self, motion: Motion, weights: Sequence[Array]) -> Array:
        """Derivatives (3, N, n) of the sum of weights times rows by position, velocity and acceleration.

        weights: (N, m_j) [1] of the rows of each joint.
        """
        scaled = [weight / scale for weight, scale in zip(weights, self._scales, strict=True)]
        return row_slopes(motion, self.laws, self.wanted, scaled)

    @cached_property
    def _scales(self) -> list[Array]:
        """Noise times reference size (m_j,) of each joint's columns."""
        return [s * self.size[seen] for s, seen in zip(self.noise, self.base.sees, strict=True)]

    def information(self, rows: Sequence[Array]) -> Array:
        """Information (b, b) [1] of scaled base parameters, from rows (N, m_j) [1] per joint."""
        out = np.zeros((self.base.rank, self.base.rank))
        for x, seen in zip(rows, self.base.sees, strict=True):
            out[np.ix_(seen, seen)] += x.T @ x
        return out

    def use(self, trajectory: Trajectory) -> Use:
        """Largest share of each limit along a trajectory."""
        limits, robot = self.limits, self.model.robot
        share = np.abs(limits.shares(trajectory.q, trajectory.v, trajectory.a)).max(1) * limits.margin
        torque = self.model.inverse(Motion(robot, trajectory.t, trajectory.q, trajectory.v, trajectory.a))
        return Use(share[0], share[1], share[2], (np.abs(torque) / limits.torque).max(0))


def build_design(
    model: Model, laws: tuple[Law, ...], family: Family, limits: Limits, clearance: float, seed: int
) -> tuple[ExcitationProblem, tuple[str, ...]]:
    """Problem of finding an exciting motion, and a note if self-collision is not checked.

    Torque noise is 1 % of each joint's torque limit; for joints without a limit, 1 % of the rms torque along random
    motions of the family. The reference size of a base parameter's column is its rms along these motions. Besides the
    bodies, the coefficients of `laws` are to be identified. The clearance is the smallest distance between links [m].

    Raises:
        OptionError: no posture obeys the limits, or the clearance is negative or infinite.
    """
    if not 0 <= clearance < np.inf:
        raise OptionError(f"the clearance is {clearance:g} m; give 0 or more")
    base = build_base(model.robot, laws, seed)
    collision, why = build_collision(model.robot, limits, clearance, seed)
    home = _find_home(model, limits, collision, clearance, seed)
    rng = np.random.default_rng(seed)
    t = np.linspace(0, family.duration, REFERENCE_SAMPLES)
    basis = family.basis(t)
    drawn = [family.sample(model.robot.joints, random_parameters(basis, limits, rng), t) for _ in range(REFERENCES)]
    q, v, a = (np.concatenate([getattr(motion, key) for motion in drawn]) for key in "qva")
    times = np.tile(t, REFERENCES)
    torque = model.inverse(Motion(model.robot, times, q, v, a))
    rms = np.maximum(np.sqrt(np.mean(torque**2, axis=0)), 1e-9)
    noise = TORQUE_NOISE_SHARE * np.where(np.isfinite(limits.torque), limits.torque, rms)
    noise = noise.astype(np.float32).astype(float)  # scales of all rows: alike for every BLAS kernel
    bare = ExcitationProblem(model, laws, base, limits, noise, np.ones(base.rank), collision, clearance, home)
    size = np.sqrt(np.diag(bare.information(bare.rows(bare.motion(times, q, v, a)))) / len(times))
    return replace(bare, size=np.maximum(size.astype(np.float32), 1e-30).astype(float)), (why,) if why else ()


def usual_laws(model: Model, effects: Sequence[str]) -> tuple[Law, ...]:
    """Laws of the given effects at every joint.

    Raises:
        OptionError: there is no such effect, or it is not linear in its parameters at a single joint.
    """
    for name in effects:
        effect = EFFECTS[name]
        if effect.scope != "joint" or not effect.parameters or len(effect.linear()) < len(effect.parameters):
            raise OptionError(
                f"{name} is not linear in its parameters at a single joint and cannot be optimised for; leave it out, "
                "and use separate to find a motion for it"
            )
    return tuple(Law(EFFECTS[name], (j,)) for name in effects for j in range(len(model.robot.joints)))


def _find_home(model: Model, limits: Limits, collision: Collision | None, clearance: float, seed: int) -> Array:
    """Home posture (n,) [rad or m], with the smallest share of the torque limits; motions shrink towards it."""
    robot, rng = model.robot, np.random.default_rng(seed)
    low, up = limits.middle - limits.half, limits.middle + limits.half
    q = np.vstack([limits.middle, np.clip(0.0, low, up), rng.uniform(low, up, (HOME_POSTURES, len(low)))])
    still = np.zeros_like(q)
    torque = model.inverse(Motion(robot, np.arange(len(q), dtype=float), q, still, still))
    share = np.abs(torque / limits.torque).max(1)
    if share.min() >= limits.margin:
        j = int(np.argmax(np.abs(torque / limits.torque)[np.argmin(share)]))
        raise OptionError(
            f"gravity takes {share.min():.0%} of the torque limit of joint {robot.joints[j]} in the best of {len(q)} "
            f"postures, so there is no motion; raise the torque limit, or narrow the position limits"
        )
    if collision is not None:
        apart = (collision.distance(q) >= clearance) & (share < limits.margin)
        if not apart.any():
            raise OptionError(
                f"none of {len(q)} postures has links {clearance:g} m apart and obeys the torque limits; "
                "lower the clearance, or widen the position limits"
            )
        share = np.where(apart, share, np.inf)
    return np.asarray(q[np.argmin(share)])


@dataclass(frozen=True, eq=False)
class Use(Frozen):
    """Largest share of each limit that a motion uses, per joint: 1 is the limit itself, 0 means no limit."""

    position: Array  # (n,) [1] distance from the middle of the range over half the range
    velocity: Array  # (n,) [1]
    acceleration: Array  # (n,) [1]
    torque: Array  # (n,) [1]

    @property
    def largest(self) -> float:
        """Largest share of all limits and joints."""
        return float(max(np.max(getattr(self, name)) for name in ("position", "velocity", "acceleration", "torque")))


@dataclass(frozen=True, eq=False)
class Excitation(Result):
    """Exciting motion, and the predicted precision of the parameters.

    The prediction assumes torque at the trajectory's rate with independent errors of standard deviation `noise`.
    """

    trajectory: Trajectory
    kind: str  # family of motions, or "random"
    criterion: str
    value: float  # value of the criterion: log det of the scaled information, or the condition number
    log_det: float  # log det of the information of base parameters, scaled by their reference sizes
    condition: float  # condition number of the base regressor, rows over noise, columns over their reference size
    expressions: tuple[str, ...]  # b formulas of the base parameters, laws included
    std: Array  # (b,) [units of base] predicted standard deviations
    relative_std: Array  # (b,) [1] over the values of the model, NaN where these are zero
    noise: Array  # (n,) [N.m or N] assumed standard deviation of the torque
    use: Use
    distance: float | None  # [m] smallest distance between links; None if self-collision was not checked
    seed: int
    evaluations: int
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Separation(Result):
    """Motion that distinguishes two laws, or the finding that none does."""

    trajectory: Trajectory
    laws: tuple[Law, Law]
    distances: tuple[float, float]  # lambda [1]: first law true and second fitted, second true and first fitted
    shares: tuple[float, float]  # [1] lambda over the true law's own sum of squares
    median: float  # [1] median of the smaller distance over the pool of random motions
    structural: bool  # whether no motion of the pool distinguishes the laws
    noise: Array  # (n,) [N.m or N] assumed standard deviation of the torque
    use: Use
    distance: float | None  # [m] smallest distance between links; None if self-collision was not checked
    seed: int
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()

    @property
    def enough(self) -> bool:
        """Whether this motion reliably distinguishes the laws, whichever is true."""
        return min(self.distances) >= MIN_LAMBDA


def budget_notes(motions: int) -> tuple[str, ...]:
    """Note on a search that ended with its budget after some evaluated motions; empty for 0."""
    note = (
        f"the search ended with its budget after {motions} motions, not at an optimum: other motions may be more "
        f"informative"
    )
    return (note,) if motions else ()
