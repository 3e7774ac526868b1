"""What the benchmark tells: rows, and verdicts on them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from .truth import Judged


class Verdict(NamedTuple):
    """A target, and whether it is met; None where it is only told."""

    sentence: str
    met: bool | None


@dataclass(frozen=True)
class Target:
    """What is asked of a row; None: nothing."""

    segments: float | None = None  # share with the true sign, at least
    samples: float | None = None  # share, at least
    off: float | None = None  # at most
    ratio: float | None = None  # at most
    error: float | None = None  # at most
    seconds: float | None = None  # at most


@dataclass(frozen=True)
class Row:
    """Signs and parameters found from one or some recordings without signs."""

    group: str  # "1R", "Panda"
    case: str
    method: str  # exact or tree
    segments: int
    right: int
    mixed: int  # segments that hold both signs
    samples: float  # share of all samples that have their true sign
    small: float  # the same of those below the threshold
    parameters: int
    off: float  # [1] distance from the sign-known estimate in torque, over that estimate's size
    ratio: float  # [1] distance from the truth over that of the sign-known estimate, nan without truth
    error: float  # distance from the truth, in the units of the case, nan without
    error_search: float  # of the parameters that the signs were found with
    error_known: float  # of the sign-known estimate
    held_out: tuple[float, ...]  # (n,) [N.m or N] rms on signed torque that was not learned from
    held_out_known: tuple[float, ...]  # (n,) of the sign-known estimate
    seconds: float  # more than the sign-known identification takes
    whole: float  # [s] the whole identification
    optimal: bool
    gap: float
    nodes: int
    flags: tuple[str, ...]
    judged: tuple[Judged, ...]
    target: Target = Target()

    @property
    def perfect(self) -> bool:
        """Whether each segment has its true sign."""
        return self.right == self.segments

    @property
    def worse(self) -> float:
        """Largest ratio of held-out errors over the joints, without signs over with them."""
        pairs = zip(self.held_out, self.held_out_known, strict=True)
        return max((mine / max(known, 1e-300) for mine, known in pairs), default=float("nan"))

    @property
    def misses(self) -> tuple[str, ...]:
        """What of the target is not reached."""
        want, share = self.target, self.right / max(self.segments, 1)
        least = {"segments": (share, want.segments), "samples": (self.samples, want.samples)}
        names = ("off", "ratio", "error", "seconds")
        most = {name: (getattr(self, name), getattr(want, name)) for name in names}
        below = [f"{k} {x:.5g} < {w:g}" for k, (x, w) in least.items() if w is not None and not x >= w]
        return (*below, *(f"{k} {x:.3g} > {w:g}" for k, (x, w) in most.items() if w is not None and not x <= w))

    @property
    def holds(self) -> bool:
        """Whether the target is reached."""
        return not self.misses
