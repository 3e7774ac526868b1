"""How likely the rows are under one noise model or another, everything that is fitted integrated out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.special import logsumexp

from ..types import Array, Frozen, Indices
from .evidence import Evidence
from .fitted import solve
from .found import Found
from .group import Group
from .noise import Noise
from .noise_model import update_joints
from .setting import Setting
from .whitened import columns_of
from .whitening import Whitening


class _Terms(NamedTuple):
    """What one joint adds to the normal equations of all that is fitted, and to the log density."""

    place: Indices  # (a,) which of the fitted columns it has
    gram: Array  # (a, a) [1 per coefficient, squared]
    right: Array  # (a,) [1 per coefficient]
    log: float  # log density of rows that nothing is fitted to


@dataclass(frozen=True, eq=False)
class Likelihood(Frozen):
    """Of rows with some laws selected; what one of them gains when the noise may explain its torque instead."""

    setting: Setting
    evidence: Evidence
    found: Found

    def penalty(self, group: Group) -> float:
        """By how much the noise model that is likeliest without a law makes the rows likelier without it, log [-].

        The discrepancy may take over what the law explained; never positive.

        Args:
            group: one of the selected laws.
        """
        true = tuple(g for g in self.found.true if g is not group)
        joints, now = self.evidence.data.rows(group), self.setting.noise
        gained = self._gained(self.found.true, joints, now)
        return float(min(0.0, gained - self._gained(true, joints, now)))

    def _gained(self, true: Sequence[Group], joints: Sequence[int], now: Noise) -> float:
        """Log of how much likelier the rows are under the noise model that is likeliest beside some laws [-]."""
        logs = np.zeros((2, len(self.evidence.scales)))
        for k, trust in enumerate(self.evidence.scales.tolist()):
            rest = replace(self.found, true=tuple(true), trust=trust)
            other = update_joints(self.setting, self.evidence, rest, joints, colour=False)
            logs[:, k] = [self._log(rest, noise, joints) for noise in (now, other)]
        present, changed = logsumexp(logs + self.evidence.scale_prior, axis=1).tolist()
        return float(max(0.0, changed - present))

    def _log(self, found: Found, noise: Noise, joints: Sequence[int]) -> float:
        """Log density of all rows, with a noise model of some joints [-]."""
        groups = [*self.evidence.refitted(found.trust), *found.true]
        which = columns_of(groups)
        gram, right, log = np.zeros((len(which),) * 2), np.zeros(len(which)), 0.0
        whitening = Whitening(self.setting.table, noise)
        for j in range(self.evidence.data.joints):
            own = self._terms(which, j, whitening if j in joints else self._present)
            gram[np.ix_(own.place, own.place)] += own.gram
            right[own.place] += own.right
            log += own.log
        precision = self.evidence.precision(found.true, np.diag(gram), found.trust)
        return log + solve(which, gram, right, precision).log_evidence

    @cached_property
    def _present(self) -> Whitening:
        return self.setting.whitening

    def _terms(self, which: Indices, joint: int, whitening: Whitening) -> _Terms:
        data, variance = self.evidence.data, float(self.found.base[joint])
        at = data.at[joint, which]
        x, y = data.torque[joint][:, at[at >= 0]], self.setting.table.residual[:, joint, None]
        white = whitening({joint: np.column_stack([x, y])})[joint] / np.sqrt(variance)
        x, y = white[:, :-1], white[:, -1]
        return _Terms(np.flatnonzero(at >= 0), x.T @ x, x.T @ y, whitening.log_scale(joint) - float(y @ y) / 2)
