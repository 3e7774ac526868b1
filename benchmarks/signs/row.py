"""Rows of the benchmark and their targets."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from .truth import SegmentScore


class TargetResult(NamedTuple):
    """Text of a target and whether it is met; None for information only."""

    sentence: str
    met: bool | None


@dataclass(frozen=True)
class Target:
    """Targets of a row; None: no target."""

    segments: float | None = None  # least share with the true sign
    samples: float | None = None  # least share with the true sign
    off: float | None = None  # at most
    ratio: float | None = None  # at most
    error: float | None = None  # at most
    seconds: float | None = None  # at most


@dataclass(frozen=True)
class Row:
    """Signs and parameters recovered from unsigned recordings."""

    group: str  # "1R", "Panda"
    case: str
    method: str  # exact or tree
    segments: int
    right: int
    mixed: int  # segments with both signs
    samples: float  # share of samples with their true sign
    small: float  # the same for samples below the threshold
    parameters: int
    off: float  # torque distance from the signed estimate over that estimate's size [1]
    ratio: float  # distance from the truth over that of the signed estimate [1], nan without truth
    error: float  # distance from the truth in the units of the case, nan without truth
    error_search: float  # the same for the parameters of the sign search
    error_known: float  # the same for the signed estimate
    held_out: tuple[float, ...]  # rms residual on held-out signed torque (n,) [N.m or N]
    held_out_known: tuple[float, ...]  # the same for the signed estimate (n,) [N.m or N]
    seconds: float  # time in addition to the signed identification
    whole: float  # time of the whole identification [s]
    optimal: bool
    gap: float
    nodes: int
    flags: tuple[str, ...]
    judged: tuple[SegmentScore, ...]
    target: Target = Target()

    @property
    def perfect(self) -> bool:
        """Whether all segments have their true sign."""
        return self.right == self.segments

    @property
    def worse(self) -> float:
        """Largest ratio over joints of held-out errors without signs to those with signs."""
        pairs = zip(self.held_out, self.held_out_known, strict=True)
        return max((mine / max(known, 1e-300) for mine, known in pairs), default=float("nan"))

    @property
    def misses(self) -> tuple[str, ...]:
        """Missed parts of the target."""
        want, share = self.target, self.right / max(self.segments, 1)
        least = {"segments": (share, want.segments), "samples": (self.samples, want.samples)}
        names = ("off", "ratio", "error", "seconds")
        most = {name: (getattr(self, name), getattr(want, name)) for name in names}
        below = [f"{k} {x:.5g} < {w:g}" for k, (x, w) in least.items() if w is not None and not x >= w]
        return (*below, *(f"{k} {x:.3g} > {w:g}" for k, (x, w) in most.items() if w is not None and not x <= w))

    @property
    def holds(self) -> bool:
        """Whether the target is met."""
        return not self.misses
