"""Shapes of selected laws are optimised between the values of their grid, on small evidence."""

from __future__ import annotations

import numpy as np
import pytest
from diagnosis_rows import RATE, Question, law, moved, pose

from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.evidence.selection import Selection
from signid.diagnose.search import shapes as shape_optimisation
from signid.diagnose.search.shapes import _options, _stepped, optimise_shapes
from signid.diagnose.search.stepwise import initial_selection
from signid.diagnose.thresholds import SHAPE_FACTOR, WINDOW_REACH
from signid.types import Law

CONTACT = law("external_contact", 0, 1, 2, start=3.03, end=4.41, force_x=2.0, force_y=-1.0, force_z=3.0)


def optimised(one: Question, effect: str, *joints: int) -> Selection:
    return optimise_shapes(one.dataset, one.selection(one.group(effect, *(joints or (0,)))))


def numbers(selection: Selection) -> dict[str, float]:
    (found,) = selection.selected[0].claim.laws
    return dict(found.parameters)


@pytest.mark.parametrize(
    ("grid", "planted", "key"),
    [
        (
            law("torque_ripple", frequency=6.0),
            law("torque_ripple", frequency=6.7, amplitude=0.5, phase=0.3),
            "frequency",
        ),
        (law("stribeck_friction", velocity=0.1), law("stribeck_friction", velocity=0.14, level=0.5), "velocity"),
    ],
    ids=("ripple", "stribeck"),
)
def test_a_shape_off_its_grid_is_found(grid: Law, planted: Law, key: str) -> None:
    one = pose((grid, law("viscous_friction")), planted)
    found = optimised(one, grid.effect.name)
    assert numbers(found)[key] == pytest.approx(planted.parameters[key], rel=0.02)
    before = one.selection(one.group(grid.effect.name, 0))
    assert found.fit().log_evidence > before.fit().log_evidence + 10
    assert list(found.log_odds.values()) == [100.0] and len(found.data.groups) == len(before.data.groups) + 1


def test_shapes_stay_within_reach_of_their_grid() -> None:
    planted = law("torque_ripple", frequency=3.0, amplitude=0.5, phase=0.3)
    found = optimised(pose((law("torque_ripple", frequency=9.0),), planted), "torque_ripple")
    assert 9.0 / SHAPE_FACTOR <= numbers(found)["frequency"] <= 9.0 * SHAPE_FACTOR


def test_the_ends_of_a_window_are_found() -> None:
    grid = law("external_contact", 0, 1, 2, start=3.25, end=4.15)
    found = numbers(optimised(pose((grid, law("viscous_friction")), CONTACT, robot="3r"), "external_contact", 0, 1, 2))
    assert found["start"] == pytest.approx(3.03, abs=1.5 / RATE) and found["end"] == pytest.approx(4.41, abs=1.5 / RATE)


@pytest.mark.parametrize("way", [1, -1])
def test_ends_move_sample_by_sample_while_it_costs_less(way: int) -> None:
    step = 1 / RATE / WINDOW_REACH
    start = (2.2 * step) ** 2
    value, x = _stepped(lambda x: float((x[1] - 2.2 * way * step) ** 2), start, np.zeros(2), [1], step)
    assert x[0] == 0 and x[1] == pytest.approx(2 * way * step) and value == pytest.approx((0.2 * step) ** 2)
    assert _stepped(lambda x: float(x[0] ** 2), 0.0, np.zeros(1), [0], step) == (0.0, np.zeros(1))


def test_laws_without_a_shape_stay() -> None:
    one = pose((law("viscous_friction"),), law("viscous_friction", coefficient=0.3))
    before = one.selection(one.group("viscous_friction", 0))
    assert optimise_shapes(one.dataset, before) is before


@pytest.mark.parametrize("offset", [0.6, -0.5])
def test_laws_of_recordings_have_their_full_size(offset: float) -> None:
    finite = Hypothesis((law("encoder_offset", offset=offset),), finite=True)
    one = pose((law("encoder_offset"), law("viscous_friction")), more=finite.columns(moved())[0] * offset)
    found = optimised(one, "encoder_offset")
    assert numbers(found)["offset"] == pytest.approx(offset, rel=0.03) and found.selected[0].claim.finite
    group = one.group("encoder_offset", 0)
    first = one.selection(group).fit()  # torque to first order in the offset
    assert abs(numbers(found)["offset"] - offset) < abs(float(first.value[first.place(group)][0]) - offset)


def test_impossible_sizes_are_not_tried(monkeypatch: pytest.MonkeyPatch) -> None:
    one = pose((law("encoder_offset"),), law("encoder_offset", offset=2.0))
    monkeypatch.setattr(shape_optimisation, "_optimise", lambda *_: pytest.fail("tried"))
    before = one.selection(one.group("encoder_offset", 0))
    assert optimise_shapes(one.dataset, before) is before


def test_twins_among_laws_of_recordings_are_tried_too() -> None:
    one = pose((law("counterbalance"), law("encoder_offset"), law("viscous_friction")))
    group = one.group("counterbalance", 0)
    both = _options(one.posterior, group, {group.claim.key})
    assert [(x.hypothesis.key[0], x.hypothesis.finite) for x in both] == [
        ("counterbalance", False),
        ("encoder_offset", True),
    ]
    assert len(_options(one.posterior, group, {group.claim.key, ("encoder_offset", (0,))})) == 0


def test_the_same_hypothesis_among_other_rows_has_the_nearest_shape() -> None:
    grid = [law("torque_ripple", frequency=f) for f in (3.0, 6.0, 9.0)]
    one = pose(grid, law("torque_ripple", frequency=8.6, amplitude=0.5, phase=0.3))
    last = one.posterior.evidence.data.groups[-1]
    found = optimise_shapes(one.dataset, one.selection(last))
    (again,) = initial_selection(one.posterior, one.dispersion, found.log_odds).selected
    assert again.claim.laws[0].parameters["frequency"] == 9.0
