"""Result of a roll-out: position errors of a simulated model, per joint and horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Indices


@dataclass(frozen=True, eq=False)
class RollOut(Frozen):
    """W short simulations of n joints and S samples, from measured states under recorded torque.

    `error` is simulated minus measured position. It is NaN for a joint without recorded torque, and infinite if the
    simulation diverged.
    """

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # rad or m, one per joint
    horizons: tuple[float, ...]  # [s]
    t: Array  # (S,) [s] time since the start of a window
    recording: Indices  # (W,) number of the recording of each window
    start: Array  # (W,) [s] start of each window
    error: Array  # (W, S, n) [rad or m]
    step: float  # [s] of the simulation
    notes: tuple[str, ...] = ()

    def end(self, horizon: float) -> Array:
        """Error (W, n) [rad or m] of each window at a horizon [s].

        Raises:
            OptionError: the windows are shorter.
        """
        return np.asarray(self.error[:, self._last(horizon)])

    def rms(self, horizon: float) -> Array:
        """Root mean square (n,) [rad or m] over windows of the error at a horizon [s]."""
        return _rms(self.end(horizon), axis=0)

    def median(self, horizon: float) -> Array:
        """Median (n,) [rad or m] over windows of the absolute error at a horizon [s], robust against few windows."""
        return np.asarray(np.median(np.abs(self.end(horizon)), axis=0))

    def document(self, before: RollOut, horizon: float | None = None) -> dict[str, Any]:
        """JSON object for diagnosis.json: errors of the original model and of this one, at the longest horizon.

        Args:
            before: roll-out of the original model.
            horizon: other horizon [s].

        Raises:
            OptionError: the roll-outs have different joints or windows.
        """
        if self.joints != before.joints or not np.array_equal(self.start, before.start):
            raise OptionError("the roll-outs have different joints or windows; use the same recordings for both models")
        horizon = max(self.horizons) if horizon is None else horizon
        errors = {"before_rms": before.rms(horizon), "after_rms": self.rms(horizon)}
        numbers = {key: [float(x) if np.isfinite(x) else None for x in rms] for key, rms in errors.items()}
        return {"horizon": horizon, **numbers, "unit": list(self.unit)}

    def _last(self, horizon: float) -> int:
        place = round(horizon / float(self.t[0])) - 1
        if not 0 <= place < len(self.t):
            raise OptionError(f"the horizon is {horizon:g} s; choose one from {self.t[0]:.4g} to {self.t[-1]:.4g} s")
        return place


def _rms(error: Array, axis: int) -> Array:
    return np.asarray(np.sqrt(np.mean(error**2, axis=axis)))
