"""Posterior, friction and jumps of sign recovery on evidence made by hand."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from by_hand import INERTIA, LAWS, observations, problem, refined, rivals

from signid.signs.branch_and_bound import PhysicalCone
from signid.signs.infer import SegmentSearch, apply_signs, joint_flip_probability, recheck_signs, sign_confidence
from signid.signs.observations import Segment, place_sign_changes
from signid.signs.problem import friction_patterns, friction_prior, known_rows
from signid.signs.samples import RefinedSigns


def test_a_rival_nine_times_less_probable_leaves_nine_tenths() -> None:
    clear = problem([[9.0, 9.0, 9.0]], [0, 0, -1])
    both = rivals([[1, 1, 1], [1, -1, 1]], [5.0, 5.0 + 2 * np.log(9)])
    assert both.weights == pytest.approx([1, 1 / 9])
    assert sign_confidence(clear, np.ones(3), both) == pytest.approx([1, 0.9, 1])


def test_confidence_is_at_most_that_of_flipping_the_segment_alone() -> None:
    alone = rivals([[1, 1]], [0.0])
    found = sign_confidence(problem([[2.0, 1.0]], [0, 0]), np.ones(2), alone)
    assert found == pytest.approx(1 / (1 + np.exp(-4)))  # both flips cost 4 * 2 * 1 = 8
    free = sign_confidence(problem([[3.0, 0.0], [0.0, 3.0]], [0, 1]), np.ones(2), alone)
    assert free == pytest.approx(0.5)  # segments that share no parameter


def test_a_joint_is_inverted_where_most_of_its_energy_is() -> None:
    posed = problem([[1.0] * 4], [0, 0, 0, 1], [3.0, 1.0, 1.0, 1.0])
    listed = rivals([[1, 1, 1, 1], [-1, 1, 1, 1], [1, -1, -1, 1]], [0.0, 2 * np.log(2), 2 * np.log(2)])
    assert joint_flip_probability(posed, np.ones(4), listed) == pytest.approx({0: 0.25, 1: 0.0})


def test_prior_rows_expect_a_tenth_of_the_torque_as_friction() -> None:
    torque, v = np.full((100, 1), 2.0), np.full((100, 1), 0.5)
    observed = observations(torque, np.ones((100, 3)), v, LAWS)
    rows = friction_prior(observed, np.ones(1))
    assert np.diag(rows.matrix) == pytest.approx([0.3 / 0.2, 0.3 * 0.5 / 0.2, 0.3 / 0.3])
    assert np.count_nonzero(rows.matrix) == 3
    assert rows.target == pytest.approx([0.3, 0.3, 0.0])
    assert np.linalg.solve(rows.matrix, rows.target) == pytest.approx([0.2, 0.4, 0.0])
    assert len(friction_prior(observed, np.zeros(1)).target) == 0
    signed = replace(observed, signed=np.array([True]))
    assert len(friction_prior(signed, np.ones(1)).target) == 0 and len(known_rows(signed, np.ones(1)).target) == 100


def test_friction_patterns_are_the_signs_of_the_velocity() -> None:
    v = np.repeat([[1.0, -2.0], [-1.0, 3.0]], 10, axis=0)
    observed = observations(np.ones((20, 2)), np.ones((20, 1)), v)
    segments = [Segment(0, 0, 10), Segment(0, 10, 20), Segment(1, 0, 10)]
    patterns = friction_patterns(problem([[1.0] * 4], [0, 0, 1, -1]), observed, segments)
    assert np.array_equal(patterns, [[1, -1, 0, 0], [0, 0, -1, 0]])


def test_offsets_are_at_most_twice_the_friction() -> None:
    cone = PhysicalCone.of(problem([[1.0], [1.0]], [0]), np.array([[2.0, 1.0], [2.0, -1.0]]))  # friction, offset
    for z, squared, nearest in [([1.0, 2.0], 0, [1, 2]), ([-1.0, 0.0], 1, [0, 0]), ([0.0, 5.0], 5, [2, 4])]:
        distance, near = cone.distance(np.array(z))
        assert distance == pytest.approx(squared, abs=1e-12) and near == pytest.approx(nearest, abs=1e-12)


RUNS = [Segment(0, 0, 50), Segment(0, 50, 100), Segment(0, 100, 200), Segment(0, 200, 400)]  # the last is impure


def rechecking() -> tuple[SegmentSearch, RefinedSigns]:
    """A body whose refinement changes sign at every half period, and the first half period once more, by mistake."""
    observed = observations(INERTIA[:, None], INERTIA[:, None], np.ones((400, 1)))
    signs = np.where(INERTIA >= 0, 1.0, -1.0)
    signs[20:50] = -1
    return SegmentSearch(observed, np.ones((1, 1))), refined(signs[:, None], [1.0])


def test_certain_parts_of_a_run_stay_apart() -> None:
    search, before = rechecking()
    found = recheck_signs(search, RUNS, before, np.full(1, 100.0), free=True)
    starts = {s.start: sign for s, sign in zip(found.segments, found.solution.signs, strict=True)}
    assert starts[0] == starts[20] == 1 and starts[200] == 1 and starts[250] == -1
    assert found.confidence.min() > 0.999 and found.solution.proof.optimal
    after = apply_signs(search.observed, before, found)
    assert np.all(after.signs[:50] == 1) and np.all(after.signs[250:300] == -1)
    assert after.value == pytest.approx([1.0], abs=1e-6)


def test_uncertain_parts_of_a_run_are_one_segment_in_the_second_round() -> None:
    search, before = rechecking()
    found = recheck_signs(search, RUNS, before, np.full(1, 0.1), free=True)
    assert sorted(found.segments) == RUNS
    assert found.confidence.max() < 0.999


def test_signs_that_may_not_change_have_rivals_but_no_proof() -> None:
    search, before = rechecking()
    found = recheck_signs(search, RUNS, before, np.full(1, 100.0), free=False)
    starts = {s.start: sign for s, sign in zip(found.segments, found.solution.signs, strict=True)}
    assert RUNS[0] in found.segments and starts[0] == -1  # by the majority of its samples, though wrong
    assert not found.solution.proof.optimal and not found.solution.proof.has_bound
    assert len(found.rivals.losses) > 1 and found.rivals.losses[0] < found.solution.loss


@pytest.mark.parametrize(("smallest", "place"), [(1.0, 14), (0.01, 10)])
def test_only_large_torque_jumps(smallest: float, place: int) -> None:
    """The model changes its sign at 14, the chain at 10: near a reversal the model decides, if |torque| is large."""
    torque = np.ones((30, 1))
    torque[12] = smallest
    observed = replace(
        observations(torque, np.ones((30, 1)), np.ones((30, 1))),
        steady=((np.arange(30) < 8) | (np.arange(30) >= 20))[:, None],
    )
    model = np.where(np.arange(30) < 14, 1.0, -1.0)[:, None]
    signs = np.where(np.arange(30) < 10, 1.0, -1.0)[:, None]
    assert np.flatnonzero(np.diff(place_sign_changes(observed, signs, model)[:, 0]))[0] + 1 == place
