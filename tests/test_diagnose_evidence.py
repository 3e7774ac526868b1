"""The closed-form evidence of hypotheses, against numerical integration and dense normal distributions."""

from __future__ import annotations

import numpy as np
import pytest
from random_rows import (
    BODIES,
    CANDIDATES,
    DISPERSION,
    FRICTION,
    GROUPS,
    JOINTS,
    OFFSET,
    ROWS,
    SPRING,
    SWAP,
    VISCOUS,
    WAVE,
    rows,
)
from scipy.special import logsumexp
from scipy.stats import multivariate_normal

from signid.diagnose.data.dataset import columns_of
from signid.diagnose.data.rows import Group
from signid.diagnose.evidence.bayes_factors import Evidence
from signid.diagnose.evidence.linear_model import SELECTED_SIZE, StatedPrior
from signid.diagnose.evidence.prior import CoefficientPrior
from signid.diagnose.thresholds import EFFECT_SIZES, INERTIAL_SCALES, LOG_INERTIAL_SCALE_PRIOR
from signid.types import Array


def dense(evidence: Evidence, which: Array) -> Array:
    """(joints rows, k) columns, joint after joint."""
    data = evidence.data
    out = np.zeros((JOINTS, len(data), len(which)))
    for j in range(JOINTS):
        here = np.isin(which, data.place[j])
        out[j][:, here] = data.columns[j][:, np.searchsorted(data.place[j], which[here])]
    return out.reshape(-1, len(which))


def covariance(evidence: Evidence, selected: tuple[Group, ...], prior_scale: float) -> Array:
    """Covariance of all rows; fitted coefficients are integrated out under their prior."""
    which = evidence.columns(selected, prior_scale)
    x, noise = dense(evidence, which), np.diag(np.repeat(DISPERSION, len(evidence.data)))
    gram = x.T @ np.linalg.solve(noise, x)
    return noise + x @ np.linalg.inv(evidence.precision(selected, np.diag(gram), prior_scale)) @ x.T


def log_normal(y: Array, spread: Array) -> float:
    return float(multivariate_normal.logpdf(y, np.zeros(len(y)), spread))


def integrated(evidence: Evidence, selected: tuple[Group, ...], prior_scale: float, group: Group, size: float) -> float:
    """Log Bayes factor of a hypothesis at one size of its prior: a sum over a fine grid of its coefficients."""
    prior = evidence.coefficient_priors[group]
    assert prior is not None
    y, spread = evidence.data.residual.ravel(), covariance(evidence, selected, prior_scale)
    x, factor = dense(evidence, columns_of([group])), np.linalg.cholesky(spread)
    white, goal = np.linalg.solve(factor, x), np.linalg.solve(factor, y)
    scale = prior.covariance_factor * (1.0 if prior.mean else size)
    count = 40001 if group.size == 1 else 401
    u, step = np.linspace(-8, 8, count, retstep=True)  # coefficients = mean + scale @ u, u unit normal
    grid = np.stack(np.meshgrid(*[u] * group.size, indexing="ij"), axis=-1).reshape(-1, group.size)
    theta = prior.mean + grid @ scale.T
    misfit = np.array(
        goal @ goal - 2 * theta @ (white.T @ goal) + np.einsum("ki,ij,kj->k", theta, white.T @ white, theta)
    )
    log = -misfit / 2 + goal @ goal / 2 - np.sum(grid**2, axis=1) / 2 + group.size * np.log(step / np.sqrt(2 * np.pi))
    if prior.positive >= 0:
        first = theta[:, prior.positive]
        log = log + np.where(first > 1e-12, np.log(2), np.where(first < -1e-12, -np.inf, 0.0))  # half of the edge
    return float(logsumexp(log))


def by_hand(evidence: Evidence, selected: tuple[Group, ...], group: Group) -> float:
    """Average over prior sizes and inertial scales."""
    y = evidence.data.residual.ravel()
    weight = LOG_INERTIAL_SCALE_PRIOR + [
        log_normal(y, covariance(evidence, selected, prior_scale)) for prior_scale in INERTIAL_SCALES
    ]
    factors = [
        logsumexp([integrated(evidence, selected, prior_scale, group, size) for size in EFFECT_SIZES])
        - np.log(len(EFFECT_SIZES))
        for prior_scale in INERTIAL_SCALES
    ]
    return float(logsumexp(weight - logsumexp(weight) + factors))


@pytest.mark.parametrize("group", CANDIDATES, ids=lambda g: g.hypothesis.key[0])
@pytest.mark.parametrize("size", (0.0, 0.25, -0.4))
def test_the_bayes_factor_is_the_integral(group: Group, size: float) -> None:
    evidence = rows(1, size)
    factors, _ = evidence.log_bayes_factors((), DISPERSION)
    assert factors[GROUPS.index(group)] == pytest.approx(by_hand(evidence, (), group), abs=2e-3)


@pytest.mark.parametrize("group", (OFFSET, SPRING, WAVE), ids=lambda g: g.hypothesis.key[0])
def test_the_bayes_factor_beside_selected_laws_is_the_integral(group: Group) -> None:
    evidence = rows(2, 0.5)
    factors, _ = evidence.log_bayes_factors((VISCOUS,), DISPERSION)
    assert factors[GROUPS.index(group)] == pytest.approx(by_hand(evidence, (VISCOUS,), group), abs=2e-3)
    assert np.isnan(factors[[0, 1, GROUPS.index(VISCOUS)]]).all()


def test_a_forbidden_sign_is_unlikely_and_a_present_law_likely() -> None:
    at, swap = GROUPS.index(VISCOUS), GROUPS.index(SWAP)
    factors = {size: rows(3, size, count=400).log_bayes_factors((), DISPERSION)[0] for size in (-0.5, 0.0, 0.5)}
    assert factors[0.5][at] > 20 > 0 > factors[0.0][at] > factors[-0.5][at]
    assert factors[0.0][swap] < -20  # an absent switched law: 1 / (2 x 0.15^2) against it


@pytest.mark.parametrize("prior_scale", INERTIAL_SCALES)
@pytest.mark.parametrize("selected", ((), (VISCOUS,), (SPRING, OFFSET), (SWAP,)), ids=len)
def test_the_evidence_is_the_marginal_likelihood(prior_scale: float, selected: tuple[Group, ...]) -> None:
    evidence = rows(4)
    y, noise = evidence.data.residual.ravel(), np.diag(np.repeat(DISPERSION, ROWS))
    fit = evidence.fit(selected, DISPERSION, prior_scale)
    other = log_normal(y, covariance(evidence, selected, prior_scale)) - log_normal(y, noise)
    assert fit.log_evidence == pytest.approx(other, abs=1e-3)
    x = dense(evidence, fit.which)
    gram = x.T @ np.linalg.solve(noise, x)
    whole = gram + evidence.precision(selected, np.diag(gram), prior_scale)
    np.testing.assert_allclose(fit.value, np.linalg.solve(whole, x.T @ np.linalg.solve(noise, y)), rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        fit.covariance, np.linalg.inv(whole), rtol=1e-5, atol=1e-8 * np.abs(fit.covariance).max()
    )


def test_prior_precisions_follow_the_prior() -> None:
    evidence = rows(4)
    diagonal = np.full(4, 7.0)
    precision = evidence.precision((VISCOUS,), diagonal, 2.0)
    prior = evidence.coefficient_priors[VISCOUS]
    assert isinstance(prior, CoefficientPrior)
    expected = [7e-6, 1 / 0.8**2, 1 / 0.4**2, 1 / (SELECTED_SIZE * prior.covariance_factor[0, 0]) ** 2]
    np.testing.assert_allclose(np.diag(precision), expected, rtol=1e-6)
    assert BODIES not in evidence.refitted(0.0) and BODIES in evidence.refitted(1.0)


def test_the_inertial_scale_follows_from_the_rows() -> None:
    for bodies, likely in ((0.0, 0.0), (0.3, 1.0), (0.9, 2.0)):
        evidence = rows(5, 0.0, bodies, count=400)
        _, weight = evidence.log_bayes_factors((), DISPERSION)
        y = evidence.data.residual.ravel()
        whole = [
            log_normal(y, covariance(evidence, (), prior_scale)) for prior_scale in INERTIAL_SCALES
        ] + LOG_INERTIAL_SCALE_PRIOR
        np.testing.assert_allclose(weight, np.exp(whole - logsumexp(whole)), atol=1e-3)
        assert evidence.prior_scale((), DISPERSION) == likely == INERTIAL_SCALES[np.argmax(weight)]
        assert weight.sum() == pytest.approx(1)


@pytest.mark.parametrize("selected", ((), (VISCOUS,)), ids=len)
def test_a_candidate_factor_equals_its_bayes_factor(selected: tuple[Group, ...]) -> None:
    evidence = rows(6, 0.4)
    factors, weight = evidence.log_bayes_factors(selected, DISPERSION)
    for group in (g for g in CANDIDATES if g not in selected):
        prior = evidence.coefficient_priors[group]
        assert prior is not None
        own = {j: evidence.data.part(j, group) for j in evidence.data.rows(group)}
        logs = [
            evidence.candidate_log_factor(evidence.fit(selected, DISPERSION, prior_scale), DISPERSION, prior, own)
            for prior_scale in INERTIAL_SCALES
        ]
        assert logsumexp(np.log(weight) + logs) == pytest.approx(factors[GROUPS.index(group)], abs=1e-6)


def test_prior_information_is_equivalent_to_rows() -> None:
    evidence, other = rows(7), rows(8, 0.0, 0.4)
    which = columns_of([BODIES])
    x = dense(other, which)
    known = StatedPrior(which, x.T @ (x / np.repeat(DISPERSION, ROWS)[:, None]))
    fit = Evidence(evidence.data, known).fit((), DISPERSION, 1.0)
    both = [dense(e, fit.which) for e in (evidence, other)]
    both[1][:, fit.which == FRICTION.start] = 0  # friction is unknown
    stack, noise = np.concatenate(both), np.tile(np.repeat(DISPERSION, ROWS), 2)
    target = np.concatenate(
        [evidence.data.residual.ravel(), np.zeros(other.data.residual.size)]
    )  # stated values are right
    gram = stack.T @ (stack / noise[:, None])
    prior = evidence.precision((), np.diag(gram), 1.0)
    np.testing.assert_allclose(fit.value, np.linalg.solve(gram + prior, stack.T @ (target / noise)), rtol=1e-4)


@pytest.mark.parametrize("without", [VISCOUS, SPRING], ids=["one coefficient", "two"])
def test_leaving_one_out_equals_not_selecting_it(without: Group) -> None:
    selected = (OFFSET, VISCOUS, SPRING)
    rest = tuple(group for group in selected if group is not without)
    for one, other in zip(
        rows(4).log_bayes_factors(selected, DISPERSION, without),
        rows(4).log_bayes_factors(rest, DISPERSION),
        strict=True,
    ):
        np.testing.assert_allclose(one, other, rtol=1e-7, atol=1e-7)
