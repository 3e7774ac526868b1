"""Output-error fit of drives over short windows of the closed loop (multiple shooting)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from ...frozen import Frozen
from ...model import Model
from ...servos import Servo, ServoGrid
from ...types import Array


@dataclass(frozen=True, eq=False)
class ServoFit(Frozen):
    """Fitted drives: P free numbers, n joints of the grids, W windows.

    Joints of independent branches are fitted apart; the covariance between branches is zero.
    """

    servos: Mapping[str, Servo]  # by joint, fitted
    names: tuple[tuple[str, str], ...]  # P: joint, number
    values: Array  # (P,) in SERVO_UNITS
    covariance: Array  # (P, P) products of SERVO_UNITS; robust, never below the classical one
    information: Array  # (P, P) inverse products of SERVO_UNITS; Gauss-Newton, initial states eliminated
    residual_rms: Array  # (n,) [rad or m] over the windows; NaN for joints without a servo
    windows: tuple[tuple[int, int], ...]  # W: index of the grid, first row
    window_squares: Array  # (W, n) mean square of the residual of each window [rad2 or m2]; NaN without a servo
    saturated_share: Array  # (n,) share of samples at the effort limit while on [1]
    iterations: int
    notes: tuple[str, ...] = ()

    @property
    def std(self) -> Array:
        """Standard deviations (P,) in SERVO_UNITS."""
        raise NotImplementedError


def fit_servos(
    model: Model,
    grids: Sequence[ServoGrid],
    servos: Mapping[str, Servo],
    free: Sequence[tuple[str, str]],
    *,
    window: float = 0.8,
    shared: Sequence[str] = (),
    relinearise: bool = True,
    iterations: int = 15,
) -> ServoFit:
    """Fit the free numbers of drives to the measured positions.

    Args:
        model: bodies and laws of the robot.
        grids: recordings, all of the same joints and one rate.
        servos: drives to start from, by joint; joints without one follow the recorded motion.
        free: joint and number, one of SERVO_NUMBERS; a number that starts at zero or infinity gets a typical start.
        window: length of a window [s]; use .2 first where drives saturate.
        shared: numbers with one value for all joints of a branch, "delay".
        relinearise: whether to fit again about the simulated motion.
        iterations: most steps of the first fit.

    Raises:
        OptionError: unknown joint or number, or no free number.
    """
    raise NotImplementedError
