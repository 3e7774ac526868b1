"""Torque lag: the amplifier's filter smooths the torque before it is written down."""

import numpy as np
from scipy.linalg import solve_banded

from ..types import Array, Coefficient, View
from .base import RecordingLaw

SHORTEST = 1e-3  # of a sample: a lag that no record shows


class TorqueLag(RecordingLaw):
    """The record follows the true torque through a first-order low-pass."""

    name, equation = "torque_lag", "z; dz/dt = (torque - z) / time_constant"
    source = "Franklin, Powell, Workman, Digital Control of Dynamic Systems, 3rd edition, 1998, chapter 6"
    typical = "1 to 10 ms, a current loop of 20 to 200 Hz"
    parameters = {"time_constant": Coefficient("s", positive=True)}
    example = {"time_constant": 0.004}
    scope, common = "any", 0.3  # a delay is more usual
    twins = ("time_delay",)

    def recorded_torque(self, x: View, time_constant: float) -> Array:
        """Exact where the torque is linear between samples; settled at the first. No time constant is negative."""
        time_constant = max(time_constant, x.dt * SHORTEST)
        keep = np.exp(-x.dt / time_constant)
        slope = (1 - keep) * time_constant / x.dt
        given = x.torque.reshape(len(x.torque), -1)
        given = np.concatenate([given[:1], (1 - slope) * given[1:] + (slope - keep) * given[:-1]])
        bands = np.outer([1.0, -keep], np.ones(len(given)))
        return np.asarray(solve_banded((1, 0), bands, given)).reshape(x.torque.shape)


PLUGIN = TorqueLag()
