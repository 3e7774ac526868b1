"""Motions that distinguish two laws, or the finding that none does; impossible options; random motions."""

from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from signid.effects import EFFECTS
from signid.errors import OptionError
from signid.model import Model, load_model, stated_inertials, stated_laws
from signid.robot import load_robot
from signid.simulation.excite import build_limits, excite, random_motion, separate
from signid.simulation.excite.design import Budget
from signid.simulation.excite.limits import build_collision
from signid.types import Law

TINY = Budget(pool=4, starts=1, short=5, long=5, firm=5)
brief = partial(separate, duration=5.0)


def law(name: str, joint: int = 0, **parameters: float) -> Law:
    return Law(EFFECTS[name], (joint,), parameters)


def model_of(name: str, **options: Any) -> Model:
    robot = load_robot(name, **options)
    return Model(robot, stated_inertials(robot), stated_laws(robot))


def test_a_wide_motion_distinguishes_a_spring_from_a_counterbalance() -> None:
    model = load_model("1r")
    laws = law("spring", stiffness=8.0, rest=0.3), law("counterbalance")
    wide = brief(model, *laws)
    assert min(wide.distances) > 1000 and min(wide.distances) > wide.median
    assert wide.enough and not wide.structural and not wide.flags
    assert "ended with its budget after" in wide.notes[-1]
    assert wide.use.largest <= 0.95 + 1e-9
    narrow = brief(model, *laws, limits=build_limits(model.robot, lower=-0.05, upper=0.05))
    assert max(narrow.distances) < 1e-3 * min(wide.distances)
    assert not narrow.enough and narrow.flags


def test_twins_on_one_joint_are_structural() -> None:
    found = brief(load_model("1r"), law("quadratic_friction"), law("fluid_drag"))
    assert found.structural and max(found.shares) < 1e-8
    assert "structural" in found.flags[0] and not any("budget" in note for note in found.notes)


@pytest.mark.slow
def test_laws_that_an_unknown_body_explains_are_structural() -> None:
    """Armature of the first joint is inertia of the first link about it."""
    model = load_model("3r")
    first = brief(model, law("armature"), law("link_inertia"), nuisance="bodies")
    assert first.structural
    other = brief(model, law("armature", 2), law("link_inertia", 2), nuisance="bodies")
    assert not other.structural and len(other.flags) == 1  # the link is part of the bodies


@pytest.mark.slow
def test_laws_with_memory_and_torque_take_part() -> None:
    model = load_model("1r")
    assert brief(model, law("presliding_friction"), law("coulomb_friction")).shares[0] > 1e-3
    assert brief(model, law("torque_gain"), law("torque_offset")).enough


def test_laws_that_cannot_be_compared_get_a_sentence() -> None:
    model = load_model("1r")
    with pytest.raises(OptionError, match="differ"):
        brief(model, law("spring"), law("spring", stiffness=1.0, rest=0.0))
    with pytest.raises(OptionError, match="cannot act"):
        brief(model, law("spring", 3), law("armature"))
    with pytest.raises(OptionError, match="nuisance"):
        brief(model, law("spring"), law("armature"), nuisance="everything")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("options", "word"),
    [
        ({"kind": "walk"}, "fourier, spline"),
        ({"criterion": "beauty"}, "determinant, condition"),
        ({"duration": 2.0, "base_frequency": 0.1}, "at least 10 s"),
        ({"duration": 0.0}, "positive"),
        ({"harmonics": 0}, "1 to 40"),
        ({"harmonics": 1}, "at rest"),
        ({"rate": 0.0}, "positive"),
        ({"effects": ("stribeck_friction",)}, "separate"),
        ({"effects": ("magic",)}, "choose from"),
    ],
)
def test_impossible_options_get_a_sentence(options: dict[str, Any], word: str) -> None:
    with pytest.raises(OptionError, match=word):
        excite(load_model("1r"), budget=TINY, **options)


@pytest.mark.parametrize(
    "limit",
    [
        {"lower": 1, "upper": 1},
        {"velocity": 0},
        {"torque": -1},
        {"acceleration": [1, 2]},
        {"margin": 0},
        {"lower": np.nan},
    ],
)
def test_impossible_limits_get_a_sentence(limit: dict[str, Any]) -> None:
    with pytest.raises(OptionError):
        build_limits(load_robot("1r"), **limit)


def test_a_robot_that_cannot_hold_itself_gets_a_sentence() -> None:
    model = load_model("1r")
    limits = build_limits(model.robot, lower=1.0, upper=2.0, torque=0.1)
    with pytest.raises(OptionError, match="gravity"):
        excite(model, limits=limits, budget=TINY)


@pytest.mark.slow
def test_grippers_and_joints_without_limits_take_part() -> None:
    """Panda's second finger follows the first; Kinova's joints turn without end."""
    found = excite(model_of("panda"), harmonics=3, budget=TINY)
    assert found.use.largest <= 0.95 + 1e-9 and found.trajectory.joints[-1] == "panda_finger_joint1"
    robot = load_robot("kinova")
    limits = build_limits(robot)
    endless = ~np.isfinite(robot.lower)
    assert endless.any() and np.allclose(limits.upper[endless], np.pi)
    assert any("no position limit" in note for note in limits.notes)


def test_a_model_without_collision_checks_gives_the_reason() -> None:
    robot = load_robot("ur5")
    limits = build_limits(robot)
    lost = replace(robot, document=robot.document.replace("package://", "package://nowhere/"))
    for other, word in ((lost, "not checked"), (replace(robot, kind="mjcf"), "MJCF")):
        collision, why = build_collision(other, limits, 0.01)
        assert collision is None and word in why


def test_random_motion_has_the_size_that_is_asked_for() -> None:
    robot = load_robot("3r")
    found = random_motion(robot, seed=4)
    assert found.q.shape == (2001, 3) and np.allclose(found.q[0], 0)
    assert np.abs(found.q).max() == pytest.approx(np.pi / 6)
    assert not np.array_equal(found.q, random_motion(robot, seed=5).q)
    slow = random_motion(robot, limits=build_limits(robot, velocity=0.1), seed=4)
    assert np.abs(slow.v).max() == pytest.approx(0.095) and np.allclose(slow.q / slow.q.max(), found.q / found.q.max())
    panda = load_robot("panda")
    moved = random_motion(panda, seed=1)
    assert (moved.q >= panda.lower).all() and (moved.q <= panda.upper).all()
    with pytest.raises(OptionError, match="excursion"):
        random_motion(robot, excursion=0.0)


@pytest.mark.slow
def test_a_special_case_is_distinguishable_one_way_only() -> None:
    found = brief(load_model("1r"), law("viscous_friction"), law("asymmetric_friction"))
    assert found.shares[0] < 1e-8 < found.shares[1]
    assert not found.structural and found.flags
