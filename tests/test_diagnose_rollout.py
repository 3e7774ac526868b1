"""Roll-outs of an extended simulation that leave the held-out motion faster are flagged."""

from __future__ import annotations

import numpy as np
import pytest

from signid.diagnose.findings.held_out_prediction import rollout_warnings
from signid.simulation.rollout import RollOut


def rolled(sizes: tuple[float, float], windows: int = 48) -> RollOut:
    """Errors of two joints of given sizes [rad]."""
    noise = np.exp(0.3 * np.random.default_rng(0).standard_normal((windows, 5, 2)))
    return RollOut(
        joints=("a", "b"),
        unit=("rad", "rad"),
        horizons=(0.5,),
        t=np.arange(1, 6) * 0.1,
        recording=np.zeros(windows, dtype=np.intp),
        start=np.arange(windows, dtype=float),
        error=noise * sizes,
        step=1e-3,
    )


def test_a_joint_that_leaves_the_motion_faster_is_named() -> None:
    (flag,) = rollout_warnings(rolled((0.01, 0.02)), rolled((0.005, 0.03)))
    assert "held-out motion of b faster" in flag and "1.50 times" in flag


@pytest.mark.parametrize("after", [(0.01, 0.02), (0.005, 0.021), (0.011, 0.01)])
def test_equal_or_better_roll_outs_are_silent(after: tuple[float, float]) -> None:
    assert not list(rollout_warnings(rolled((0.01, 0.02)), rolled(after)))


def test_without_enough_windows_nothing_is_said() -> None:
    assert not list(rollout_warnings(rolled((0.01, 0.01), 4), rolled((0.1, 0.1), 4)))
    assert not list(rollout_warnings(None, None))


def test_a_simulation_that_diverges_is_worse() -> None:
    before, after = rolled((0.01, 0.02)), rolled((0.01, 0.02))
    broken = RollOut(**{**vars(after), "error": np.full_like(after.error, np.inf)})
    assert len(list(rollout_warnings(before, broken))) == 2
