"""Torque lag: the amplifier's filter smooths the recorded torque."""

import numpy as np
from scipy.linalg import solve_banded

from ..types import Array, Coefficient, View
from .base import RecordingLaw

MIN_LAG_PERIODS = 1e-3  # smallest time constant [sample periods], invisible in any recording


class TorqueLag(RecordingLaw):
    """Recorded torque = true torque through a first-order low-pass filter."""

    name, equation = "torque_lag", "z; dz/dt = (torque - z) / time_constant"
    source = "Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd edition, 1998, chapter 6"
    typical = "1 to 10 ms: a current loop of 20 to 200 Hz"
    parameters = {"time_constant": Coefficient("s", positive=True)}
    example = {"time_constant": 0.004}
    scope, common = "any", 0.3  # less common than a delay
    twins = ("time_delay",)

    def recorded_torque(self, x: View, time_constant: float) -> Array:
        """Filtered torque, exact for torque linear between samples, in steady state at the first sample."""
        time_constant = max(time_constant, x.dt * MIN_LAG_PERIODS)
        keep = np.exp(-x.dt / time_constant)
        slope = (1 - keep) * time_constant / x.dt
        torque = x.torque.reshape(len(x.torque), -1)
        driven = np.concatenate([torque[:1], (1 - slope) * torque[1:] + (slope - keep) * torque[:-1]])
        bands = np.outer([1.0, -keep], np.ones(len(driven)))
        return np.asarray(solve_banded((1, 0), bands, driven)).reshape(x.torque.shape)


PLUGIN = TorqueLag()
