"""A selected law, what could stand in its place, and how probable each of them is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ...types import Frozen
from ..data.column_groups import Group
from ..data.hypotheses import Key

CLIP = 500.0  # log odds beyond which a probability is 0 or 1 to the last digit


@dataclass(frozen=True, eq=False)
class Contender(Frozen):
    """A selected law m and its rivals.

    The probability of m is that of some law in its place, times that of m given that there is one:

        P(m) = 1 / (1 + exp(-L)) s_m,      L = min(min(E, c) + H, c, r),      s_m = exp(o_m) / sum over r of exp(o_r)

    with E the log posterior odds of the learned rows, H the log Bayes factor of the held-out rows, c the most that a
    gain of uneven size is worth, r = 0 where the held-out rows refuse the law, else infinite, and o the log odds of
    everything that could stand in the place of m.
    """

    group: Group
    evidence: float  # E [-]
    shares: Mapping[Key, float]  # s of the law and of its rivals [1]
    candidates: Mapping[Key, Group]  # rivals that are worth listing, the likeliest first
    unexplained: float  # share that no law of the library has [1]
    instead: Group | None = None  # likeliest law in its place, where that is clearly likelier
    steadiness: float = np.inf  # c [-]
    held_out: float = 0.0  # H [-]
    refused: bool = False  # r = 0
    log_at_scale: float = np.inf  # o of the law at k^2 times the variance, see `rank_contenders` [-]

    @property
    def log(self) -> float:
        """Log odds L that some law is in its place [-]."""
        most = min(self.steadiness, 0.0) if self.refused else self.steadiness
        return min(min(self.evidence, self.steadiness) + self.held_out, most)

    @property
    def probability(self) -> float:
        """P(m) [1]."""
        return self._there * self.shares.get(self.group.claim.key, 0.0)

    @property
    def unknown(self) -> float:
        """Probability that no law of the library is behind it [1]."""
        return self._there * self.unexplained

    @property
    def rivals(self) -> dict[Key, tuple[float, Group]]:
        """Probability of each rival that is worth listing [1], and its likeliest shape."""
        return {key: (self._there * self.shares[key], group) for key, group in self.candidates.items()}

    @property
    def _there(self) -> float:
        return 1 / (1 + float(np.exp(-np.clip(self.log, -CLIP, CLIP))))
