"""What a search for a motion hands back."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...types import Array, Frozen, Law, Trajectory

ENOUGH = 100.0  # lambda at which the right one of two hypotheses was always found


@dataclass(frozen=True, eq=False)
class Use(Frozen):
    """Largest share of each limit that a motion uses, per joint: 1 is the limit itself, 0 where there is none."""

    position: Array  # (n,) [1] distance from the middle of the range over half the range
    velocity: Array  # (n,) [1]
    acceleration: Array  # (n,) [1]
    torque: Array  # (n,) [1]

    @property
    def largest(self) -> float:
        """Of all limits and joints."""
        return float(max(np.max(getattr(self, name)) for name in ("position", "velocity", "acceleration", "torque")))


@dataclass(frozen=True, eq=False)
class Excitation(Frozen):
    """An exciting motion, and what it is predicted to tell.

    Predictions are for torque sampled at the trajectory's rate with independent errors of standard deviation `noise`.
    """

    trajectory: Trajectory
    kind: str  # family of motions
    criterion: str
    value: float  # of the criterion: log det of the scaled information, or the condition number
    log_det: float  # of the information of the base parameters, each in units of its column's reference size
    condition: float  # of the base regressor, rows over noise, columns over their reference size
    expressions: tuple[str, ...]  # b formulas of the base parameters, laws included
    std: Array  # (b,) [units of base] predicted standard deviations
    relative_std: Array  # (b,) [1] over the size that the model states, NaN where it states none
    noise: Array  # (n,) [N.m or N] that is assumed
    use: Use
    distance: float | None  # [m] smallest between links that could meet; None where nothing could, or nothing is known
    seed: int
    evaluations: int
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Separation(Frozen):
    """A motion that tells two hypotheses apart, or the finding that none does."""

    trajectory: Trajectory
    laws: tuple[Law, Law]
    distances: tuple[float, float]  # lambda [1]: first seen with the second fitted, second seen with the first fitted
    shares: tuple[float, float]  # [1] of either law's torque, less what the nuisance explains, that the other leaves
    median: float  # [1] of the smaller distance over the pool of random motions
    structural: bool  # no motion of the pool tells them apart
    noise: Array  # (n,) [N.m or N] that is assumed
    use: Use
    distance: float | None  # [m] smallest between links that could meet
    seed: int
    notes: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()

    @property
    def enough(self) -> bool:
        """Whether this motion tells them apart beyond doubt, whichever is true."""
        return min(self.distances) >= ENOUGH


def budget_notes(motions: int) -> tuple[str, ...]:
    """A note on a search that its budget ended, and how many motions it judged; none for 0."""
    told = f"the search ended with its budget after {motions} motions, not at an optimum: others may tell more"
    return (told,) if motions else ()
