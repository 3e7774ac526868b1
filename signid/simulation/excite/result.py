"""Results of searches for a motion."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Array, Frozen, Law, Result, Trajectory

ENOUGH = 100.0  # [1] lambda at which the right one of two hypotheses was always found


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
        return min(self.distances) >= ENOUGH


def budget_notes(motions: int) -> tuple[str, ...]:
    """Note on a search that ended with its budget after some evaluated motions; empty for 0."""
    note = (
        f"the search ended with its budget after {motions} motions, not at an optimum: other motions may be more "
        f"informative"
    )
    return (note,) if motions else ()
