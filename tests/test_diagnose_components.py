"""Evidence of uncoupled joints is computed joint by joint and is robust to rounding."""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import pytest
from random_rows import DISPERSION, FRICTION, OFFSET, SPRING, SWAP, VISCOUS, rows

from signid.diagnose.evidence.bayes_factors import Evidence, log_bayes_factor, stack_priors
from signid.diagnose.evidence.prior import CoefficientPrior
from signid.regression.projection import leave


def test_uncoupled_joints_are_fitted_separately() -> None:
    evidence = rows(4)
    for selected, prior_scale, expected in (
        ((), 0.0, [(0,), (1,)]),
        ((VISCOUS, OFFSET), 0.0, [(0,), (1,)]),
        ((VISCOUS, SWAP), 0.0, [(0, 1)]),
        ((VISCOUS,), 1.0, [(0, 1)]),
    ):
        found = evidence.components(selected, prior_scale)
        assert [one.joints for one in found] == expected
        assert {group for one in found for group in one.groups} == {*evidence.refitted(prior_scale), *selected}


def test_earlier_queries_do_not_change_results() -> None:
    asked = Evidence(rows(4).data)
    for selected in ((VISCOUS, OFFSET), (VISCOUS,), (VISCOUS, SPRING), (SPRING, OFFSET, VISCOUS), (OFFSET,)):
        for dispersion in (DISPERSION, DISPERSION * [1.0, 1.5]):
            for one, other in zip(
                asked.log_bayes_factors(selected, dispersion),
                Evidence(asked.data).log_bayes_factors(selected, dispersion),
                strict=True,
            ):
                np.testing.assert_array_equal(one, other)


def test_evidence_of_a_far_too_large_law_is_robust_to_rounding() -> None:
    own, right, variance = Fraction(473 * 10**15), Fraction(-25 * 10**7), Fraction(4, 25)
    wide = 1 + variance * own
    exact = float(right - own / 2 + variance * (right - own) ** 2 / wide / 2) - np.log(float(wide)) / 2
    priors = stack_priors([CoefficientPrior(np.eye(1) * 0.4, 1.0, -1)])
    factor = log_bayes_factor(priors, np.array([[[float(own)]]]), np.array([[float(right)]]))
    assert factor[0] == pytest.approx(exact, abs=1e-6)


def test_torque_outside_refitted_columns_remains() -> None:
    data = rows(4).data
    expected = leave(data.part(0, SPRING), data.part(0, FRICTION))
    np.testing.assert_allclose(data.free(0, data.part(0, SPRING)), expected, atol=1e-12)
    np.testing.assert_array_equal(data.free(1, data.part(1, VISCOUS)), data.part(1, VISCOUS))  # bodies do not count
