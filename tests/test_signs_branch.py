"""Parts of the search over signs, against all 2^S of them on small problems: tree, certificate, climb, order."""

from __future__ import annotations

from itertools import product

import numpy as np
import pytest
from boolean import CLOSE, Facets, drawn, every, half, losses, problems
from numpy.testing import assert_allclose, assert_array_equal

from signid.signs.search import exact as climb_module
from signid.signs.search.branch_and_bound import Incumbent, TreeBudget, _branching_order, _Tree, bounds, branch
from signid.signs.search.exact import ascend, climb
from signid.signs.search.problem import certify


@problems
def test_a_budget_that_bites_leaves_a_true_bound(seed: int, count: int, noise: float, anchored: bool) -> None:
    problem = drawn(np.random.default_rng(seed), count, noise, anchored)
    least, close = losses(problem, every(problem)).min(), CLOSE * problem.energies.sum()
    for widest, most in ((1, 10**6), (3, 10**6), (100, 8)):
        tree = branch(problem, Incumbent(np.ones(problem.count)), budget=TreeBudget(widest, most))
        found = min(losses(problem, np.array([*tree.leaves, np.ones(problem.count)])))
        assert min(found, tree.beyond) <= least + close <= found + 2 * close
        assert len(tree.leaves) <= widest


@problems
def test_all_signs_in_the_window_are_leaves(seed: int, count: int, noise: float, anchored: bool) -> None:
    rng = np.random.default_rng(seed)
    problem = drawn(rng, count, noise, anchored)
    signs, cuts = every(problem), rng.normal(size=(len(problem.projections), 3 * (seed % 3 > 0)))
    cone = Facets(-cuts.T) if cuts.size else None
    window = 0.3 * problem.energies.sum() + rng.normal() * 1e-3
    tree = branch(problem, Incumbent(np.ones(problem.count), cuts=cuts), window)
    inside = signs[losses(problem, signs, cone) <= tree.beyond - CLOSE * problem.energies.sum()]
    if not anchored and cone is None:  # one of s and -s
        first = _branching_order(problem, problem.coordinates(np.ones(problem.count)))[0]
        inside = inside[inside[:, first] > 0]
    assert {tuple(s) for s in tree.leaves} >= {tuple(s) for s in inside}
    lower = bounds(problem, tree.leaves, cuts)
    assert np.all(lower <= problem.loss(np.ones(problem.count)) + window)
    assert np.all(np.diff(lower) >= -CLOSE * problem.energies.sum())


@problems
def test_no_node_promises_too_much(seed: int, count: int, noise: float, anchored: bool) -> None:
    """The bound of a node is below the losses of all its leaves, and rises towards them."""
    rng = np.random.default_rng(seed)
    problem = drawn(rng, count, noise, anchored)
    cone, total = half(problem, rng), problem.energies.sum()
    far = [problem.coordinates(s) for s in every(problem)[:2]]
    cuts = np.array([z - cone.distance(z)[1] for z in far if cone.distance(z)[0] > 1e-3 * total])
    signs = every(problem)
    expected = losses(problem, signs, cone)
    tree = _Tree(problem, cuts.reshape(-1, len(far[0])).T, far[0], np.inf)
    if not cuts.size and not anchored:
        signs, expected = np.concatenate([signs, -signs]), np.tile(losses(problem, signs), 2)
    while tree.level < problem.count:
        before = tree.floors.min()
        tree.grow(10**6)
        assert tree.floors.min() >= before
        at = tree.order[: tree.level]
        for prefix, floor in zip(tree.leaves()[:, at], tree.floors, strict=True):
            below = expected[(signs[:, at] == prefix).all(1)].min()
            assert floor <= below + CLOSE * total


@problems
def test_a_certificate_is_true(seed: int, count: int, noise: float, anchored: bool) -> None:
    problem = drawn(np.random.default_rng(seed), count, noise, anchored)
    all_losses, total = losses(problem, every(problem)), problem.energies.sum()
    for signs in (climb(problem), np.ones(problem.count), every(problem)[all_losses.argmin()]):
        lower, optimal = certify(problem, signs)
        assert lower <= all_losses.min() + CLOSE * total
        assert not optimal or problem.loss(signs) <= all_losses.min() + CLOSE * total


@problems
def test_ascent_ends_where_no_flip_helps(seed: int, count: int, noise: float, anchored: bool) -> None:
    rng = np.random.default_rng(seed)
    problem = drawn(rng, count, noise, anchored)
    starts = np.where(rng.normal(size=(5, problem.count)) >= 0, 1.0, -1.0)
    free = problem.count - int(problem.anchored)
    for start, end in zip(starts, ascend(problem, starts, pairs=True), strict=True):
        assert problem.loss(end) <= problem.loss(start) + CLOSE * problem.energies.sum()
        for i, j in product(range(free), repeat=2):
            other = end.copy()
            other[[i, j]] *= -1
            assert problem.loss(other) >= problem.loss(end) - CLOSE * problem.energies.sum()
        assert not problem.anchored or end[-1] == 1


def test_an_ascent_is_cut_short_rather_than_endless(monkeypatch: pytest.MonkeyPatch) -> None:
    problem = drawn(np.random.default_rng(1), 12, 0.1)
    starts = np.where(np.random.default_rng(0).normal(size=(5, 12)) >= 0, 1.0, -1.0)
    assert not np.array_equal(ascend(problem, starts), starts)
    monkeypatch.setattr(climb_module, "TURNS", 0)
    assert_array_equal(ascend(problem, starts), starts)


def test_a_climb_arrives_and_does_so_again() -> None:
    problem = drawn(np.random.default_rng(1), 12, 0.1)
    first, again = climb(problem, seed=3), climb(problem, seed=3)
    assert_array_equal(first, again)
    assert_allclose(problem.loss(first), losses(problem, every(problem)).min())


def test_a_known_segment_comes_first() -> None:
    problem = drawn(np.random.default_rng(6), 8, 0.3, anchored=True)
    order = _branching_order(problem, problem.coordinates(np.ones(9)))
    assert order[0] == 8
    assert_array_equal(np.sort(order), np.arange(9))
