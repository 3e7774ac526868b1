"""The exact search over signs, against all 2^S of them on small problems."""

from __future__ import annotations

import numpy as np
import pytest
from boolean import CLOSE, Facets, drawn, every, half, losses, problems
from numpy.testing import assert_allclose, assert_array_equal

from signid.signs.branch_and_bound import TreeBudget
from signid.signs.exact import enumerate_near, search_signs
from signid.signs.problem import SignProblem, eliminate
from signid.types import Array


@problems
def test_the_best_signs_are_found_and_proved(seed: int, count: int, noise: float, anchored: bool) -> None:
    problem = drawn(np.random.default_rng(seed), count, noise, anchored)
    least, total = losses(problem, every(problem)).min(), problem.energies.sum()
    found = search_signs(problem)
    assert abs(found.loss - least) <= CLOSE * total
    assert found.proof.optimal and found.proof.gap == 0
    assert not problem.anchored or found.signs[-1] == 1
    assert_array_equal(np.abs(found.signs), 1)
    assert_allclose(found.coordinates, problem.coordinates(found.signs))


@problems
def test_the_best_signs_within_a_cone(seed: int, count: int, noise: float, anchored: bool) -> None:
    rng = np.random.default_rng(seed)
    problem = drawn(rng, count, noise, anchored)
    cone, total = half(problem, rng), problem.energies.sum()
    found = search_signs(problem, cone, start=np.ones(problem.count))
    assert abs(found.loss - losses(problem, every(problem), cone).min()) <= CLOSE * total
    assert found.proof.optimal
    assert np.all(cone.normals @ found.coordinates >= -1e-6 * np.sqrt(total))
    free = search_signs(problem, start=np.ones(problem.count))
    assert abs(free.loss - losses(problem, every(problem)).min()) <= CLOSE * total
    assert free.loss <= found.loss + CLOSE * total


@problems
def test_a_budget_that_bites_leaves_a_true_gap(seed: int, count: int, noise: float, anchored: bool) -> None:
    rng = np.random.default_rng(seed)
    problem = drawn(rng, count, noise, anchored)
    close = CLOSE * problem.energies.sum()
    for widest, most in ((1, 10**6), (3, 10**6), (100, 8)):
        cone = half(problem, rng)
        found = search_signs(problem, cone, budget=TreeBudget(widest, most))
        best = losses(problem, every(problem), cone).min()
        assert found.loss * (1 - found.proof.gap) <= best + close <= found.loss + 2 * close
        assert found.proof.optimal == (found.proof.gap == 0)


@problems
def test_all_rivals_near_the_best_are_listed(seed: int, count: int, noise: float, anchored: bool) -> None:
    rng = np.random.default_rng(seed)
    problem = drawn(rng, count, noise, anchored)
    cone = half(problem, rng) if seed % 2 else None
    found, window = search_signs(problem, cone), 0.2 * problem.energies.sum()
    rivals = enumerate_near(problem, cone, found, window)
    signs = every(problem)
    expected = losses(problem, signs, cone)
    clear = np.abs(expected - found.loss - window) > CLOSE * problem.energies.sum()
    inside = {tuple(s) for s in signs[clear & (expected < found.loss + window)]}
    outside = {tuple(s) for s in signs[clear & (expected > found.loss + window)]}
    listed = {tuple(s) for s in rivals.signs}
    assert rivals.complete and inside <= listed and not listed & outside
    assert_allclose(rivals.losses, losses(problem, rivals.signs, cone), atol=CLOSE * problem.energies.sum())
    assert np.all(np.diff(rivals.losses) >= 0) and len(listed) == len(rivals.losses)
    assert_allclose(rivals.losses[0], found.loss, atol=CLOSE * problem.energies.sum())
    assert tuple(found.signs) in listed
    few = enumerate_near(problem, cone, found, window, TreeBudget(width=1))
    assert {tuple(s) for s in few.signs} <= listed
    assert not few.complete or len(few.losses) == len(rivals.losses)


def test_truth_without_noise_is_certain() -> None:
    rng = np.random.default_rng(0)
    joints = [0] * 15 + [1] * 15
    rows = [rng.normal(size=(20, 8)) for _ in joints]
    truth, model = rng.choice([-1.0, 1.0], 30), rng.normal(size=8)
    problem = eliminate(rows, [s * (r @ model) for s, r in zip(truth, rows, strict=True)], joints)
    found = search_signs(problem)
    assert found.loss <= 1e-12 * problem.energies.sum()
    assert found.proof.optimal
    assert abs(found.signs @ truth) == 30
    assert_allclose(np.abs(problem.back @ found.coordinates), np.abs(model), rtol=1e-9)


@pytest.mark.parametrize("anchored", [False, True])
def test_segments_with_little_information(anchored: bool) -> None:
    """Single samples, the same segment three times, one without torque."""
    rng = np.random.default_rng(2)
    one, other = rng.normal(size=(1, 3)), rng.normal(size=(6, 3))
    rows = [one, other, other, other, np.ones((4, 3)), 2 * one]
    right = [np.ones(1), *[other @ [1.0, 2.0, 3.0] + 0.1] * 3, np.zeros(4), np.ones(1)]
    joints = [0, 0, 0, 1, 1, 1]
    if anchored:
        rows, right, joints = [*rows, np.eye(3)], [*right, np.array([-1.0, -2.0, -3.0])], [*joints, -1]
    problem = eliminate(rows, right, joints)
    found = search_signs(problem)
    assert found.proof.optimal
    assert_allclose(found.loss, losses(problem, every(problem)).min())
    assert len(set(found.signs[1:4])) == 1
    if anchored:
        assert_array_equal(found.signs[1:4], -1)


def friction(cases: int = 10) -> tuple[SignProblem, Array, Facets]:
    """Two joints whose torque is F sign v, which an offset F explains as well; the cone knows |offset| <= 2 F."""
    rng = np.random.default_rng(4)
    forward = np.where(np.arange(2 * cases) % 2 == 0, 1.0, -1.0)
    joints = np.repeat([0, 1], cases)
    rows = [np.repeat(np.kron(np.eye(2)[j], [v, 1.0])[None], 8, axis=0) for v, j in zip(forward, joints, strict=True)]
    right = [1.0 + j + 0.01 * rng.normal(size=8) for j in joints]
    problem = eliminate(rows, right, joints.tolist())
    facets = np.kron(np.eye(2), [[1.0, 0.0], [2.0, 1.0], [2.0, -1.0]]) @ problem.back
    return problem, forward, Facets(facets)


@pytest.mark.parametrize("helped", [False, True])
def test_friction_is_not_taken_for_an_offset(helped: bool) -> None:
    problem, forward, cone = friction()
    moves = [np.where(problem.joints == j, forward, 0.0) for j in (0, 1)] if helped else []
    found = search_signs(problem, cone, moves)
    assert_array_equal(found.signs, forward)
    assert found.proof.optimal
    assert found.loss >= search_signs(problem).loss
