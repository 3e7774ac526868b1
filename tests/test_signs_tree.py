"""The classical tree of sign choices: small arms whose truth is known, its order, its bounds, its least-squares kin."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import combinations

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sign_beam import beam

from signid.errors import OptionError
from signid.estimation.pbrp import Bounds
from signid.regression.base_parameters import build_base
from signid.regression.motion import Motion, base_rows, regressor
from signid.robot import load_robot
from signid.signs.observations import Observations, threshold_runs
from signid.signs.problem import KnownRows, SignProblem, build_sign_problem, eliminate
from signid.signs.tree import condition_order, search_tree
from signid.types import Array, BaseMap, Parameters

QUICK = {"algorithm": "LD_LBFGS", "restarts": 1, "rounds": 2, "width": 2, "budget": 150}


@dataclass(frozen=True)
class Case:
    """An arm without friction that moved, its torque without signs, and the truth about it."""

    base: BaseMap
    prior: Parameters
    truth: Array  # (p,) standard parameters
    observed: Observations
    problem: SignProblem
    signs: Array  # (S,) true ones


def case(motion: Motion) -> Case:
    """A case whose bodies weigh 0.6 to 1.4 times their stated masses."""
    robot = motion.robot
    base = build_base(robot)
    stated = np.concatenate([body.toDynamicParameters() for body in list(robot.model.inertias)[1:]])
    truth = stated * np.repeat(np.random.default_rng(3).uniform(0.6, 1.4, len(robot.links)), 10)
    torque = regressor(motion) @ truth
    observed = observed_from(motion, base, torque)
    segments, _ = threshold_runs(observed)
    signs = np.array([np.sign(torque[a:b, j].sum()) for j, a, b in segments])
    problem = build_sign_problem(observed, segments, np.ones(len(robot.joints)))
    return Case(base, Parameters(base.labels, stated), truth, observed, problem, signs)


def observed_from(motion: Motion, base: BaseMap, torque: Array) -> Observations:
    count, n = torque.shape
    seen = tuple(np.flatnonzero(base.sees[j]) for j in range(n))
    return Observations(
        part=np.zeros(count, dtype=np.intp),
        first=np.arange(count) == 0,
        t=motion.t,
        q=motion.q,
        v=motion.v,
        columns=tuple(base_rows(motion, (), [base.independent[s] for s in seen])),
        seen=seen,
        count=base.rank,
        joints=motion.robot.joints,
        torque=np.abs(torque),
        signed=np.zeros(n, dtype=bool),
        known=np.ones(n, dtype=bool),
        steady=np.ones((count, n), dtype=bool),
        period=motion.dt,
        coefficients={},
        units=("N.m",) * n,
    )


def swing(name: str, seconds: float, centre: Sequence[float], size: Sequence[float]) -> Motion:
    """Two sines a joint at 50 Hz."""
    robot, t = load_robot(name), np.arange(0, seconds, 0.02)
    k, shape = np.arange(len(robot.joints)), (len(t), len(robot.joints))
    q, v, a = np.tile(np.array(centre), (len(t), 1)), np.zeros(shape), np.zeros(shape)
    for w, share, phase in ((1.3 + 0.4 * k, 1.0, k), (2.9 + 0.3 * k, 0.5, 1.0 + 2 * k)):
        x, amplitude = t[:, None] * w + phase, share * np.array(size)
        q, v, a = q + amplitude * np.sin(x), v + amplitude * w * np.cos(x), a - amplitude * w**2 * np.sin(x)
    return Motion(robot, t, q, v, a)


@cache
def raised() -> Case:
    """A pendulum that is raised ever faster: its torque grows, and keeps its sign."""
    t = np.arange(0, 2, 0.02)[:, None]
    return case(Motion(load_robot("1r"), t[:, 0], 0.2 + 0.1 * t**3, 0.3 * t**2, 0.6 * t))


@cache
def swung() -> Case:
    return case(swing("1r", 4.0, [0.0], [0.5]))


@cache
def arm() -> Case:
    return case(swing("3r", 5.0, [0.3, -0.4, 0.8], [0.9, 0.9, 1.1]))


def test_one_segment_has_the_sign_that_physics_allows() -> None:
    toy = raised()
    got = search_tree(toy.problem, toy.base, toy.prior, restarts=2)
    assert toy.problem.count == 1 and got.nodes == 2
    assert np.array_equal(got.signs, toy.signs)


@pytest.mark.slow_cases("COBYLA")
@pytest.mark.parametrize(
    ("algorithm", "restarts", "budget"),
    [("LN_SBPLX", 2, 3000), ("LN_BOBYQA", 2, 300), ("LN_COBYLA", 2, 3000), ("LD_LBFGS", 2, 100), ("LD_SLSQP", 2, 100)],
)
def test_two_segments_of_a_pendulum_by_any_local_algorithm(algorithm: str, restarts: int, budget: int) -> None:
    toy = swung()
    got = search_tree(toy.problem, toy.base, toy.prior, algorithm=algorithm, restarts=restarts, budget=budget)
    assert toy.problem.count == 2 and got.nodes == 6 and got.evaluations <= 6 * restarts * 3 * budget
    assert np.array_equal(got.signs, toy.signs)
    assert_allclose(got.value, toy.base.combination @ toy.truth, rtol=0, atol=1e-6)
    assert_allclose(
        toy.problem.back @ toy.problem.coordinates(got.signs), toy.base.combination @ toy.truth, rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("algorithm", ["LN_SBPLX", "LN_COBYLA", "LD_LBFGS"])
@pytest.mark.parametrize("budget", [10, 50, 300])
def test_an_end_is_the_optimum_of_its_signs_or_noted(algorithm: str, budget: int) -> None:
    """Random starts and few evaluations end beside the optimum, as other rounding does."""
    toy = swung()
    for seed in range(2):
        options = {"algorithm": algorithm, "restarts": 2, "budget": budget, "seed": seed}
        got = search_tree(toy.problem, toy.base, toy.prior, **options)
        noted = any("least squares with the same signs" in note for note in got.notes)
        off = np.abs(got.value - toy.base.combination @ toy.truth).max()
        assert noted or (off < 1e-6 and np.array_equal(got.signs, toy.signs))


def test_all_signs_of_an_arm() -> None:
    toy, said = arm(), list[float]()
    got = search_tree(toy.problem, toy.base, toy.prior, progress=lambda _, share: said.append(share), **QUICK)
    assert np.array_equal(got.signs, toy.signs) and got.loss < 1e-3 * toy.problem.energies.sum()
    assert got.nodes == 2**2 + 2 * 2 * (toy.problem.count - 2)
    assert said == sorted(said) and said[-1] == 1
    assert_allclose(
        toy.problem.back @ toy.problem.coordinates(got.signs), toy.base.combination @ toy.truth, rtol=0, atol=1e-6
    )


def test_rows_of_known_sign_are_kept() -> None:
    toy = swung()
    joint, start, stop = threshold_runs(toy.observed)[0][0]
    at = slice(start, stop, 3)
    known = KnownRows(toy.observed.rows(joint, at), toy.signs[0] * toy.observed.torque[at, joint])
    problem = build_sign_problem(toy.observed, threshold_runs(toy.observed)[0], np.ones(1), known)
    got = search_tree(problem, toy.base, toy.prior, **QUICK)
    assert problem.anchored and np.array_equal(got.signs, [*toy.signs, 1.0])
    assert got.nodes == 1 + 2 + 4


def test_a_search_that_ends_early_is_flagged() -> None:
    toy = arm()
    got = search_tree(toy.problem, toy.base, toy.prior, **(QUICK | {"budget": 3}))
    assert any("--signs exact needs no such search" in note for note in got.notes)


def test_bad_arguments_are_refused_in_one_sentence() -> None:
    toy = swung()
    for options, sentence in [
        ({"algorithm": "LN_SUBPLEX"}, "no algorithm 'LN_SUBPLEX'; choose from"),
        ({"restarts": 0}, "ask for at least 1 of each"),
        ({"width": 0}, "keep at least 1"),
        ({"bounds": Bounds(np.zeros(3), np.ones(3))}, "have 3 parameters; give the 10"),
    ]:
        with pytest.raises(OptionError, match=sentence):
            search_tree(toy.problem, toy.base, toy.prior, **options)
    with pytest.raises(OptionError, match="choose from pseudo-inverse, factor"):
        beam(toy.problem, np.arange(2), 1, solve="inverse")


def test_least_squares_at_every_node_finds_the_same_up_to_all_signs_at_once() -> None:
    toy = arm()
    ordered = condition_order(toy.problem)
    slow, fast = (beam(toy.problem, ordered.order, ordered.start, 10, solve) for solve in ("pseudo-inverse", "factor"))
    assert np.array_equal(slow.signs * slow.signs[0], toy.signs * toy.signs[0])
    assert np.array_equal(slow.signs * slow.signs[0], fast.signs * fast.signs[0])
    assert slow.nodes == fast.nodes == slow.evaluations
    assert slow.loss <= 1e-9 * toy.problem.energies.sum()


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
