"""Misfit of an identified model: the torque that its laws leave, on rows that took no part in the fit.

It is small and stands in model.json, so that a later diagnosis can distinguish what has changed since from what the
model never explained.

Source: Kennedy, O'Hagan, J. R. Statist. Soc. B 63(3), 2001 (model inadequacy is learned from data of the system);
Bartlett, J. R. Statist. Soc. Suppl. 8(1), 1946 (rows of two correlated series that count as one).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..frozen import Frozen
from ..types import Array
from .factors import Factors, JointFactors
from .rows import Task

DIGITS = 4  # significant digits in a file


@dataclass(frozen=True, eq=False)
class Misfit(Frozen):
    """Size and correlation of what the laws of a model leave of the torque of n joints."""

    size: Array  # (n,) [N.m or N] rms; NaN where torque was not held out
    length: Array  # (n,) [s] time over which it counts as one observation of a torque that is correlated as long
    cutoff: float  # [Hz] of the rows that it was measured on

    def document(self, joints: Sequence[str]) -> dict[str, Any]:
        """JSON object for model.json, without joints of unknown misfit."""
        each = zip(joints, self.size.tolist(), self.length.tolist(), strict=True)
        own = {name: {"rms": _rounded(rms), "length": _rounded(s)} for name, rms, s in each if np.isfinite(rms)}
        return {"cutoff": _rounded(self.cutoff), "joints": own}


def measure_misfit(task: Task, test: Factors, value: Array) -> Misfit:
    """Misfit of base parameters `value` (b,) [units of base] on held-out rows, from factors alone."""
    period, n = task.band.factor / task.band.rate, len(test.joints)
    size, length = np.full(n, np.nan), np.full(n, np.nan)
    for j, (joint, columns) in enumerate(zip(test.joints, test.columns, strict=True)):
        if joint.counts[0]:
            power = _autocovariance(joint, np.append(-value[columns], 1.0))
            size[j], length[j] = np.sqrt(max(power[0], 0.0)), period * _rows_of_one(power)
    return Misfit(size, length, task.band.cutoff)


def read_misfit(content: Mapping[str, Any] | None, joints: Sequence[str]) -> Misfit | None:
    """Misfit in the content of a model.json, the object of `Misfit.document`; None if it has none."""
    if content is None:
        return None
    own = [content["joints"].get(name, {"rms": np.nan, "length": np.nan}) for name in joints]
    size, length = (np.array([float(each[key]) for each in own]) for key in ("rms", "length"))
    return Misfit(size, length, float(content["cutoff"]))


def _autocovariance(joint: JointFactors, c: Array) -> Array:
    """(d,) [N2.m2 or N2] of the residual y - x b at each lag; c (m + 1,) is [-b 1]."""
    own = joint.grams[:, -len(c) :, -len(c) :]
    return np.asarray(np.einsum("i,dij,j->d", c, own, c) / np.maximum(joint.counts, 1))


def _rows_of_one(power: Array) -> float:
    """Rows that count as one against a torque that is correlated as long [1]; power: (d,) autocovariance."""
    if power[0] <= 0:
        return 1.0
    return float(1 + 2 * np.sum(np.clip(power[1:] / power[0], -1, 1) ** 2))


def _rounded(x: float) -> float:
    return float(f"{x:.{DIGITS}g}")
