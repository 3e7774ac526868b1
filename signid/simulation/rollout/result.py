"""What a roll-out tells: how far a simulated model strays from the robot, per joint and horizon."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ...errors import OptionError
from ...types import Array, Frozen, Indices


@dataclass(frozen=True, eq=False)
class RollOut(Frozen):
    """W short simulations of n joints from measured states under recorded torque, followed over S samples.

    `error` is simulated minus measured position: NaN at a joint whose torque is not recorded, infinite where the
    simulated robot flew apart.
    """

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # rad or m, one a joint
    horizons: tuple[float, ...]  # [s]
    t: Array  # (S,) since the start of a window [s]
    recording: Indices  # (W,) that a window is out of
    start: Array  # (W,) of the windows [s]
    error: Array  # (W, S, n) [rad or m]
    step: float  # of the simulation [s]
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
        """Median (n,) [rad or m] over windows of the size of the error at a horizon [s]; few bad windows leave it."""
        return np.asarray(np.median(np.abs(self.end(horizon)), axis=0))

    def document(self, before: RollOut, horizon: float | None = None) -> dict[str, Any]:
        """What diagnosis.json says of a model beside the one before it, at a horizon [s], the longest without one.

        Raises:
            OptionError: the two are of different joints or windows.
        """
        if self.joints != before.joints or not np.array_equal(self.start, before.start):
            raise OptionError("two roll-outs of different joints or windows were given; roll both models out alike")
        horizon = max(self.horizons) if horizon is None else horizon
        told = {"before_rms": before.rms(horizon), "after_rms": self.rms(horizon)}
        numbers = {key: [float(x) if np.isfinite(x) else None for x in rms] for key, rms in told.items()}
        return {"horizon": horizon, **numbers, "unit": list(self.unit)}

    def _last(self, horizon: float) -> int:
        place = round(horizon / float(self.t[0])) - 1
        if not 0 <= place < len(self.t):
            raise OptionError(f"horizon {horizon:g} s; choose one from {self.t[0]:.4g} to {self.t[-1]:.4g} s")
        return place


def _rms(error: Array, axis: int) -> Array:
    return np.asarray(np.sqrt(np.mean(error**2, axis=axis)))
