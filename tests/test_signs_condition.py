"""The classical order of segments, against all sets of the stacked rows of toys."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import combinations, product

import numpy as np
import pytest
from sign_beam import beam

from signid.signs import tree as condition_module
from signid.signs.search.problem import SignProblem, eliminate
from signid.signs.tree import condition_order
from signid.types import Array


def toy(blocks: Sequence[Array], known: int = 0, joints: Sequence[int] | None = None) -> SignProblem:
    """Segments with these rows, the last of them of known sign, where there is one."""
    rng = np.random.default_rng(0)
    right = [rng.uniform(1, 2, len(b)) for b in blocks]
    return eliminate(blocks, right, list(joints or [0] * (len(blocks) - known)) + [-1] * known)


def random_blocks(count: int, columns: int, rows: int = 2, seed: int = 1) -> list[Array]:
    rng = np.random.default_rng(seed)
    return [rng.standard_normal((rows, columns)) * np.logspace(0, 1.5, columns) for _ in range(count)]


def condition(blocks: Sequence[Array], members: Sequence[int]) -> float:
    values = np.linalg.svd(np.concatenate([blocks[i] for i in members]), compute_uv=False)
    return float(values[0] / values[-1]) if len(values) == blocks[0].shape[1] else np.inf


def test_a_known_sign_is_kept_and_fixes_the_others() -> None:
    blocks = random_blocks(6, 3)
    problem = toy(blocks, known=1)
    ordered = condition_order(problem)
    assert ordered.order[0] == 5
    got = beam(problem, ordered.order, ordered.start, width=64)
    every = [np.array([*signs, 1.0]) for signs in product((1.0, -1.0), repeat=5)]
    assert got.signs[5] == 1 and got.loss == pytest.approx(min(problem.loss(signs) for signs in every))


def test_the_first_set_is_the_smallest_well_conditioned_one() -> None:
    blocks = random_blocks(8, 5)
    ordered = condition_order(toy(blocks), threshold=500.0)
    assert ordered.complete and sorted(ordered.order) == list(range(8))
    smaller = [s for k in range(1, ordered.start) for s in combinations(range(8), k)]
    assert all(condition(blocks, s) >= 500 for s in smaller)
    same = [condition(blocks, s) for s in combinations(range(8), ordered.start)]
    assert ordered.condition == pytest.approx(min(same)) and ordered.condition < 500
    assert condition(blocks, ordered.order[: ordered.start]) == pytest.approx(ordered.condition)


def test_each_next_segment_keeps_the_condition_smallest() -> None:
    blocks = random_blocks(8, 5)
    ordered = condition_order(toy(blocks))
    for k in range(ordered.start, 8):
        rest = [condition(blocks, [*ordered.order[:k], i]) for i in ordered.order[k:]]
        assert rest[0] == pytest.approx(min(rest))


def test_segments_too_many_to_try_are_taken_one_by_one() -> None:
    """Seven joints, each with a column of its own that no other joint's segments see."""
    rng, blocks, joints = np.random.default_rng(2), list[Array](), list[int]()
    for k in range(28):
        block = np.zeros((6, 12))
        block[:, :5], block[:, 5 + k % 7] = rng.standard_normal((6, 5)), rng.standard_normal(6)
        blocks.append(block)
        joints.append(k % 7)
    ordered = condition_order(toy(blocks, joints=joints))
    assert not ordered.complete and 7 <= ordered.start <= 8 and ordered.condition < 1000
    assert {joints[i] for i in ordered.order[: ordered.start]} == set(range(7))
    short = condition_order(toy(random_blocks(8, 5)), budget=3)
    assert not short.complete and sorted(short.order) == list(range(8))


@pytest.mark.parametrize("budget", [40, 41])
def test_sets_too_many_to_look_at_are_not_looked_at(monkeypatch: pytest.MonkeyPatch, budget: int) -> None:
    """Each of two joints has one segment, which every set needs: of 4060 sets of three, 28 would be tried."""
    joints, looked = [0, 1, *[2] * 28], list[int]()
    blocks = [
        np.column_stack([b, np.full((2, 2), np.arange(2) == j)])
        for b, j in zip(random_blocks(30, 4), joints, strict=True)
    ]

    def recorded(segments: range, size: int) -> Iterator[tuple[int, ...]]:
        looked.append(size)
        return combinations(segments, size)

    monkeypatch.setattr(condition_module, "combinations", recorded)
    ordered = condition_order(toy(blocks, joints=joints), threshold=0.0, budget=budget)
    assert not ordered.complete and looked == ([3] if budget == 41 else [])
