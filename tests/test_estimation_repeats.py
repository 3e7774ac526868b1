"""Numbers that differ between recordings of one robot are named, and their intervals contain the spread."""

from __future__ import annotations

from unittest import mock

import numpy as np
import pytest
from motions import FRICTION, trial
from numpy.testing import assert_allclose

import signid
from signid.estimation.least_squares import with_spread
from signid.estimation.repeats import spread_between, spread_covariance
from signid.identify import Identification
from signid.output.report.results.identification import identification_document
from signid.types import Recording, Robot

SPREAD = 0.2  # [N.m] standard deviation of the torque offset of joint_2 between recordings


@pytest.fixture(scope="module")
def arm() -> Robot:
    return signid.load_robot("3r")


def repeats(arm: Robot, spread: float, seed: int, count: int = 5) -> list[Recording]:
    """Recordings whose second joint has another torque offset in each."""
    rng, found = np.random.default_rng(seed), []
    for k in range(count):
        made = trial(arm, seed=10 * seed + k, seconds=12)
        torque = made.torque + 0.05 * rng.standard_normal(made.torque.shape)
        torque[:, 1] += spread * rng.standard_normal()
        found.append(made.recording(tau=torque))
    return found


def offset(found: Identification) -> tuple[float, float]:
    """Torque offset of joint_2 and its standard deviation [N.m]."""
    k = found.base.expressions.index("torque_offset_2")
    return float(found.base_value[k]), float(found.estimate.std[k])


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_an_offset_that_varies_is_named_and_its_interval_holds_the_mean(arm: Robot, seed: int) -> None:
    found = signid.identify(arm, repeats(arm, SPREAD, seed))
    document = identification_document(found)
    (named,) = document["varies"]
    assert (named["effect"], named["joint"], named["parameter"]) == ("torque_offset", "joint_2", "offset")
    assert named["unit"] == "N.m" and SPREAD / 3 < named["spread"] < 3 * SPREAD
    value, std = offset(found)
    assert abs(value - FRICTION["torque_offset"]) < 1.96 * std and std > named["spread"] / np.sqrt(5)
    assert sum("torque offset of joint_2 (" in note for note in found.notes) == 1


def test_repeats_without_variation_have_the_intervals_of_before(arm: Robot) -> None:
    recordings = repeats(arm, 0.0, 4)
    found = signid.identify(arm, recordings)
    with mock.patch("signid.identify.with_spread", lambda estimate, *_: estimate):
        before = signid.identify(arm, recordings)
    assert found.varies == () and identification_document(found)["varies"] == []
    assert_allclose(found.estimate.std, before.estimate.std, rtol=0.1)


def test_one_recording_has_no_spread(arm: Robot) -> None:
    found = signid.identify(arm, [trial(arm, seconds=12).noisy()])
    assert found.estimate.spread is None and found.varies == ()
    assert with_spread(found.estimate, found.session.reduce(found.session.train), found.base) is found.estimate


def test_the_spread_is_unbiased_and_its_intervals_hold() -> None:
    rng, held, sizes = np.random.default_rng(0), [], []
    for _ in range(400):
        variances = rng.uniform(0.5, 2.0, (6, 1)) * 0.01
        values = 3 + rng.standard_normal((6, 1)) + np.sqrt(variances) * rng.standard_normal((6, 1))
        spread, information = spread_between(values, variances), 1 / variances[:, :, None]
        inverse = 1 / information.sum(0)
        mean = (inverse @ information @ values[:, :, None]).sum()
        std = np.sqrt(inverse + spread_covariance(spread, information, inverse))[0, 0]
        held.append(abs(mean - 3) < 1.96 * std)
        sizes.append(spread[0] ** 2)
    assert 0.92 < np.mean(held) < 0.98 and 0.9 < np.mean(sizes) < 1.1


def test_numbers_that_a_recording_does_not_identify_do_not_vary() -> None:
    values, variances = np.array([[1.0, 0.0], [9.0, 5.0]]), np.array([[1e-4, 1e-4], [np.inf, 1e-4]])
    spread = spread_between(values, variances)
    assert spread[0] == 0 and spread[1] == pytest.approx(5 / np.sqrt(2), rel=1e-3)
