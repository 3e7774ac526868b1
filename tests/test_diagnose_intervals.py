"""Standard deviations of a law's parameters: a jackknife by hand, Student's t, least squares, unidentifiable."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from diagnosis_rows import NOISE, Question, law, pose
from scipy.stats import t as student

from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.extend import read_laws
from signid.diagnose.findings import intervals
from signid.diagnose.findings.intervals import _by_key, _parts, standard_deviations
from signid.diagnose.thresholds import BLOCK_PERIODS, MAX_JACKKNIFE_PARTS
from signid.estimation.repeats import jackknife_variance
from signid.types import TWO_SIDED, Array

VISCOUS = law("viscous_friction", coefficient=0.3)


def parts_of(x: Array, y: Array, count: int) -> tuple[Array, Array]:
    """Gram and right side of each part, about the coefficients of all rows."""
    residual = y - x @ np.linalg.lstsq(x, y, rcond=None)[0]
    cut = [np.arange(len(x)) % count == k for k in range(count)]
    return np.array([x[own].T @ x[own] for own in cut]), np.array([x[own].T @ residual[own] for own in cut])


def test_a_mean_of_three_parts_by_hand() -> None:
    """Means without one part are 2.5, 2 and 1.5; their jackknife variance is 2/3 (0.25 + 0 + 0.25) = 1/3."""
    square, right = parts_of(np.ones((3, 1)), np.array([1.0, 2.0, 3.0]), 3)
    ratio = student.ppf(0.975, 2) / TWO_SIDED
    assert jackknife_variance(square, right, np.zeros((1, 1)), 1)[0] == pytest.approx(ratio**2 / 3, rel=1e-6)


@pytest.mark.parametrize(("count", "quantile"), [(2, 12.706), (3, 4.303), (6, 2.571), (10, 2.262)])
def test_few_parts_widen_intervals_as_in_students_t(count: int, quantile: float) -> None:
    y = np.arange(count) % 2 * 2.0 - 1.0
    square, right = parts_of(np.ones((count, 1)), y, count)
    means = (y.sum() - y) / (count - 1)
    expected = (count - 1) / count * np.sum((means - means.mean()) ** 2) * (quantile / 1.95996) ** 2
    assert jackknife_variance(square, right, np.zeros((1, 1)), 1)[0] == pytest.approx(expected, rel=1e-3)


def test_the_jackknife_is_that_of_fits_without_each_part() -> None:
    rng, count = np.random.default_rng(0), 5
    x = rng.standard_normal((60, 3))
    y = x @ [1.0, -2.0, 0.5] + 0.3 * rng.standard_normal(60)
    square, right = parts_of(x, y, count)
    fits = np.array(
        [np.linalg.lstsq(*(z[np.arange(60) % count != k] for z in (x, y)), rcond=None)[0] for k in range(count)]
    )
    ratio = student.ppf(0.975, count - 1) / TWO_SIDED
    expected = ratio**2 * (count - 1) * np.var(fits, axis=0)
    np.testing.assert_allclose(jackknife_variance(square, right, np.zeros((3, 3)), 3), expected, rtol=1e-6)
    np.testing.assert_allclose(jackknife_variance(square, right, np.zeros((3, 3)), 2), expected[:2], rtol=1e-6)
    assert np.all(jackknife_variance(square, right, 1e6 * np.eye(3), 3) < 1e-3 * expected)  # the prior holds them


def deviations(one: Question, effect: str) -> dict[str, float]:
    group = one.group(effect, 0)
    found = one.selection(group)
    fit = found.fit()
    ((own,),) = standard_deviations(one.dataset, found, {group: read_laws(group, fit.value[fit.place(group)])}).values()
    return own


def test_white_noise_gives_the_deviation_of_least_squares(monkeypatch: pytest.MonkeyPatch) -> None:
    one = pose((law("viscous_friction"),), VISCOUS)
    column = one.posterior.evidence.data.raw(0, one.group("viscous_friction", 0))[:, 0]
    expected = NOISE * np.sqrt(1.3) / np.linalg.norm(column)
    assert expected < deviations(one, "viscous_friction")["coefficient"] < 4 * expected
    monkeypatch.setattr(intervals, "_variance_over_parts", lambda *_: np.zeros(1))
    assert deviations(one, "viscous_friction")["coefficient"] == pytest.approx(expected, rel=0.05)


def test_shapes_have_a_deviation_too() -> None:
    planted = law("torque_ripple", frequency=6.0, amplitude=0.5, phase=0.3)
    own = deviations(pose((law("torque_ripple", frequency=6.0),), planted), "torque_ripple")
    assert own.keys() == {"frequency", "amplitude", "phase"} and all(0 < x < 0.1 for x in own.values())


def test_unexplained_torque_widens_intervals() -> None:
    one = pose((law("viscous_friction"),), VISCOUS)
    t = one.dataset.pieces[0].motion.t
    drift = 0.2 * np.sign(np.sin(2 * np.pi * t / 3.2))[:, None] * one.dataset.pieces[0].motion.v
    other = pose((law("viscous_friction"),), VISCOUS, more=drift)
    assert deviations(other, "viscous_friction")["coefficient"] > 3 * deviations(one, "viscous_friction")["coefficient"]


def test_an_unidentifiable_parameter_is_unknown() -> None:
    """The phase of a ripple of size zero."""
    one = pose((law("torque_ripple", frequency=6.0), law("viscous_friction")), VISCOUS)
    group = one.group("torque_ripple", 0)
    ripple = replace(law("torque_ripple"), parameters={"frequency": 6.0, "amplitude": 0.0, "phase": 0.3})
    ((own,),) = standard_deviations(one.dataset, one.selection(group), {group: (ripple,)}).values()
    assert own["phase"] == np.inf and own["amplitude"] < np.inf


def test_parameters_of_a_scaled_link_have_one_factor() -> None:
    link: Any = SimpleNamespace(claim=Hypothesis((law("link_inertia", mass=2.0, inertia_xx=-0.5),), scaled=True))
    (own,) = _by_key(link, link.claim.laws, iter([0.1]))
    assert own == {"mass": pytest.approx(0.2), "inertia_xx": pytest.approx(0.05)}


def test_parts_are_stretches_of_each_recording() -> None:
    one = pose((law("viscous_friction"),), VISCOUS, recordings=2)
    part = _parts(one.dataset)
    recording = one.posterior.evidence.data.recording
    length = BLOCK_PERIODS / one.dataset.task.band.cutoff
    assert part.max() + 1 == min(MAX_JACKKNIFE_PARTS, 2 * int(np.ceil(8.0 / length)))
    assert all(len(set(recording[part == k])) == 1 for k in range(part.max() + 1)) and np.all(np.diff(part) >= 0)


def test_repeated_motion_is_cut_by_its_phase() -> None:
    one = pose((law("viscous_friction"),), VISCOUS)
    part = _parts(replace(one.dataset, periods=(4.0,)))
    t = one.dataset.table.t[4:]
    early = part[t < 4.0]
    late = part[t >= 4.0][-len(early) :]
    assert np.count_nonzero(early != late) <= 2 and part.max() == 2  # at edges of parts, by rounding
