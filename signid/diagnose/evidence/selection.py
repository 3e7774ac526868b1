"""Selected hypotheses, and the posterior by which they were selected."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

from ...types import Array, Frozen
from ..data.column_groups import Group
from ..data.hypotheses import Key
from ..data.normal_equations import Fitted
from ..data.whitened_rows import Whitened
from .bayes_factors import Evidence
from .posterior_odds import Odds, Posterior


@dataclass(frozen=True, eq=False)
class Selection(Frozen):
    """Selected hypotheses, with the dispersion and the prior scale that were estimated together with them."""

    posterior: Posterior
    selected: tuple[Group, ...]
    log_odds: Mapping[Group, float]  # log posterior odds of each when it was selected [-]
    dispersion: Array  # (n,) c, variance of the whitened residual [1]
    prior_scale: float  # k: errors of the given simulation, in standard deviations of their prior [1]
    first: Mapping[Key, Odds] = field(default_factory=dict)  # odds of each hypothesis beside the given simulation alone

    @property
    def evidence(self) -> Evidence:
        """Evidence of the rows."""
        return self.posterior.evidence

    @property
    def data(self) -> Whitened:
        """Whitened rows."""
        return self.posterior.evidence.data

    def fit(self) -> Fitted:
        """Maximum a posteriori fit of nuisance parameters and selected laws."""
        return self.evidence.fit(self.selected, self.dispersion, self.prior_scale)

    def with_selected(self, selected: Sequence[Group], log_odds: Mapping[Group, float] | None = None) -> Selection:
        """Replace the selected hypotheses; the prior scale becomes the most likely one beside them.

        Args:
            selected: the new hypotheses.
            log_odds: log posterior odds of each when it was selected [-]; None: as before.
        """
        scale = self.evidence.prior_scale(selected, self.dispersion)
        log = self.log_odds if log_odds is None else log_odds
        return replace(self, selected=tuple(selected), log_odds=log, prior_scale=scale)

    def without(self, group: Group) -> Selection:
        """Remove one hypothesis.

        Args:
            group: the selected hypothesis to remove.
        """
        return self.with_selected([other for other in self.selected if other is not group])
