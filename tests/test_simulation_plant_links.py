"""Which body a law acts on, in the simulator as in inverse dynamics: joints held, followed, elastic, out of range."""

from __future__ import annotations

import numpy as np
import pytest
from plant import WIDE, law, model, released
from test_simulation_plant_robots import free
from toys import joint, link, toy

import signid
from signid.effects import EFFECTS
from signid.effects.base import TorqueLaw
from signid.regression.motion import Motion
from signid.robot import hold
from signid.robot.dynamics import own_body
from signid.simulation.plant.plant import Plant
from signid.types import Array, Law, Robot, View


def followed() -> Robot:
    """Joint y follows z, and Pinocchio puts it first."""
    more = f'{WIDE}<mimic joint="z" multiplier="3"/>'
    return toy(*map(link, "abc"), free("z", "a", "b"), free("y", "a", "c", more=more))


def test_a_rotor_turns_with_its_joint_not_with_a_mimic_joint() -> None:
    made = released(model(followed(), law("armature", 0, inertia=0.1)), 0.0, 0.1, torque=2.0)
    assert np.allclose(made.true_a, 2.0 / (1 + 3**2 + 0.1), rtol=1e-9)


def test_a_correction_is_of_the_link_that_the_joint_carries() -> None:
    robot = followed()
    assert robot.links[own_body(robot, 0)] == "b"


def test_held_links_beyond_the_last_joint_do_not_move_its_centre_of_mass() -> None:
    robot = hold(signid.load_robot("3r"), {"joint_3": 0.4})
    given = model(robot, Law(EFFECTS["fluid_drag"], (0, 1), {"coefficient": 6.0}))
    made = released(given, (0.3, -1.0), 0.1, v=2.0)
    motion = Motion(robot, made.t, made.true_q, made.true_v, made.true_a)
    assert np.abs(given.inverse(motion)).max() < 1e-9, "nothing drives it"


class Loaded(TorqueLaw):
    """A law that doubles the links' torque."""

    scope = "robot"

    def columns(self, x: View) -> list[Array]:
        """Load torque (..., n) [N.m]."""
        return [x.load]


def test_the_load_of_an_elastic_joint_counts_once() -> None:
    soft = law("armature", 0), law("joint_elasticity", 0)
    plant = Plant(model("1r", *soft, Law(Loaded(), (0,))), 1e-3)
    q, v = np.full((2, 1, 1), [[[0.5]], [[0.0]]])
    plant.start(q, v)
    taken = plant.resist(0.0, 1e-3, plant.state[None], plant.speed[None], np.ones((1, 1, 2)))
    motor, bent = taken[0, 0]
    weight = 5 * 9.81 * 0.5 * np.sin(0.5)
    assert motor == pytest.approx(weight, rel=0.01) and bent == pytest.approx(0.0, abs=0.02 * weight)


def test_a_joint_may_range_beyond_half_a_turn_only() -> None:
    more = '<limit lower="4" upper="6" effort="9" velocity="9"/>'
    made = released(model(toy(link("a"), link("b"), joint("z", "a", "b", more=more))), 5.0, 0.1, torque=0.5)
    assert np.allclose(made.true_a, 0.5, rtol=1e-9)
