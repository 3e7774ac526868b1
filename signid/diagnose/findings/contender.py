"""A selected law, its rivals, and the probability of each."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from ...types import Frozen
from ..data.column_groups import Group
from ..data.hypotheses import Key

CLIP = 500.0  # log odds beyond which a probability is 0 or 1 in double precision [-]


@dataclass(frozen=True, eq=False)
class Contender(Frozen):
    """A selected law m and its rivals.

    The probability of m is that of some law in its place, times that of m given that there is one:

        P(m) = 1 / (1 + exp(-L)) s_m,      L = min(min(E, u) + H, u, r),      s_m = exp(o_m) / sum over r of exp(o_r)

    with E the log posterior odds of the training rows, H the log Bayes factor of the held-out rows, u the limit by an
    unsteady gain or by joints that moved in step, r = 0 where the law is refused, else infinite, and o the log odds of
    every hypothesis in the place of m.
    """

    group: Group
    evidence: float  # E [-]
    shares: Mapping[Key, float]  # s of the law and of its rivals [1]
    candidates: Mapping[Key, Group]  # rivals to list, the most probable first
    unexplained: float  # share s of dependences without law [1]
    instead: Group | None = None  # most probable rival, where it is clearly more probable than the law
    steadiness: float = np.inf  # u [-]
    held_out: float = 0.0  # H [-]
    refused: bool = False  # whether held-out rows speak against the law, or its numbers are vague: r = 0
    log_at_scale: float = np.inf  # o of the law at k^2 times the variance, see `rank_contenders` [-]

    def with_held_out(self, log_bayes: float, refused: bool) -> Contender:
        """Add the evidence of the held-out rows.

        Args:
            log_bayes: log Bayes factor H of the held-out rows [-].
            refused: whether the law is no more probable than not: r = 0.
        """
        return replace(self, held_out=log_bayes, refused=refused)

    @property
    def log(self) -> float:
        """Log odds L that some law is in its place [-]."""
        most = min(self.steadiness, 0.0) if self.refused else self.steadiness
        return min(min(self.evidence, self.steadiness) + self.held_out, most)

    @property
    def probability(self) -> float:
        """P(m) [1]."""
        return self._any_law * self.shares.get(self.group.claim.key, 0.0)

    @property
    def unknown(self) -> float:
        """Probability that no law of the library is behind it [1]."""
        return self._any_law * self.unexplained

    @property
    def rivals(self) -> dict[Key, tuple[float, Group]]:
        """Probability of each rival to list [1], and its most probable shape."""
        return {key: (self._any_law * self.shares[key], group) for key, group in self.candidates.items()}

    @property
    def _any_law(self) -> float:
        return 1 / (1 + float(np.exp(-np.clip(self.log, -CLIP, CLIP))))
