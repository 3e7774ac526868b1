"""Segments: where absolute torque keeps one sign, and the message where it is unknown."""

from __future__ import annotations

import numpy as np
import pytest

from signid.errors import RecordingError
from signid.signs.observations import Observations, runs_between_minima, split_impure, threshold_runs
from signid.signs.problem import Segment
from signid.types import Array, Mask

PERIOD = 0.01  # s


def seen(torque: Array, first: tuple[int, ...] = (0,), moving: Mask | None = None) -> Observations:
    """One joint with its absolute torque (N,) alone."""
    count = len(torque)
    begins = np.isin(np.arange(count), first)
    still = np.zeros((count, 1))
    return Observations(
        part=np.zeros(count, dtype=np.intp),
        first=begins,
        t=PERIOD * np.arange(count),
        q=still,
        v=still,
        columns=(np.ones((count, 1)),),
        seen=(np.array([0], dtype=np.intp),),
        count=1,
        joints=("elbow",),
        torque=np.abs(torque)[:, None],
        signed=np.array([False]),
        known=np.array([True]),
        steady=np.ones((count, 1), dtype=bool) if moving is None else moving[:, None],
        period=PERIOD,
        coefficients={},
        units=("N.m",),
    )


def wave(count: int = 1000, periods: float = 5.0) -> Array:
    return np.sin(2 * np.pi * periods * np.arange(count) / count + 0.1)


HIDDEN = np.concatenate([np.linspace(1, 0.3, 100), np.linspace(-0.25, -1, 100), np.full(30, -0.01)])  # a jump


def pure(segments: list[Segment], torque: Array) -> bool:
    return all(np.all(torque[s.start : s.stop] > 0) or np.all(torque[s.start : s.stop] < 0) for s in segments)


def test_runs_above_the_quantile_hold_one_sign_each() -> None:
    torque = wave()
    segments, threshold = threshold_runs(seen(torque))
    assert pure(segments, torque)
    assert len(segments) == 10
    assert np.mean(np.abs(torque) < threshold[0]) == pytest.approx(0.1, abs=0.002)
    assert sum(s.stop - s.start for s in segments) >= 0.88 * len(torque)


def test_cuts_at_low_minima_find_a_change_of_sign_between_samples() -> None:
    torque = HIDDEN
    assert not pure(threshold_runs(seen(torque))[0], torque)
    assert pure(runs_between_minima(seen(torque)), torque)


def test_a_model_of_the_other_sign_splits_a_segment_where_torque_is_lowest() -> None:
    torque = HIDDEN
    observed = seen(torque)
    whole = [Segment(0, 0, 200)]
    noise = np.array([0.05])
    cut, count = split_impure(observed, whole, torque[:, None], noise)
    assert count == 1
    assert pure(cut, torque)
    assert split_impure(observed, whole, np.abs(torque)[:, None], noise) == (whole, 0)
    flicker = torque.copy()
    flicker[100:] *= -1
    flicker[50:52] *= -1  # two samples are too few for a sign change
    assert split_impure(observed, whole, flicker[:, None], noise) == (whole, 0)


@pytest.mark.parametrize(
    ("torque", "message"),
    [
        (np.zeros(100), "absolute torque of elbow is zero throughout"),
        (np.tile([1.0, 0.0], 100), "longest has 1 sample,"),
        (np.tile([1.0, 1.0, 1.0, 0.0], 50), "above its threshold is long enough"),
    ],
)
def test_torque_without_a_segment_is_refused(torque: Array, message: str) -> None:
    with pytest.raises(RecordingError, match=message):
        threshold_runs(seen(torque))


def test_a_joint_that_rests_is_not_asked_to_move_more_slowly() -> None:
    for moving in (np.zeros(1000, dtype=bool), np.arange(1000) % 250 < 4):
        with pytest.raises(RecordingError) as caught:
            threshold_runs(seen(wave(), moving=moving))
        assert f"clearly moves in {100 * moving.mean():.0f} % of the samples only" in str(caught.value)
        assert "finer positions" in str(caught.value) and "slowly" not in str(caught.value)
