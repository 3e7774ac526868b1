"""The simulator against physics: rest, springs, energy, a pendulum; and against itself."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
import pytest
from plant import law, model, pitch, released, waves, wheel
from scipy.special import ellipk

import signid
from signid.errors import SignidError
from signid.model import Model
from signid.simulation.plant import Simulation, Torques, simulate, track
from signid.simulation.plant.plant import simulate_many
from signid.types import Law

WEIGHT, INERTIA = 5 * 9.81 * 0.5, 0.42085 + 5 * 0.25  # N.m and kg.m2 of the pendulum 1r
ALONG, SIDE = np.pi / 2, 1.2 * WEIGHT


def still(made: Simulation, first: int = 0) -> bool:
    return bool(np.ptp(made.true_q[first:], axis=0).max() == 0 and not made.true_v[first + 1 :].any())


@pytest.mark.slow_cases("rk4")
@pytest.mark.parametrize(
    "laws",
    [
        (law("coulomb_friction", 0, level=SIDE),),
        (law("coulomb_friction", 0, level=SIDE / 2), law("stribeck_friction", 0, level=SIDE / 2, velocity=0.1)),
        (law("coulomb_friction", 0, level=SIDE / 2), law("load_friction", 0, coefficient=0.6)),
        (
            law("asymmetric_friction", 0, viscous_positive=2.0, viscous_negative=3.0, coulomb_positive=0.1 * SIDE,
                coulomb_negative=SIDE),
        ),
        (law("coulomb_friction", 0, level=SIDE), law("viscous_friction", 0, coefficient=2.0), law("armature", 0)),
    ],
)  # fmt: skip
@pytest.mark.parametrize("integrator", ["semi-implicit", "rk4"])
def test_a_mass_on_a_slope_does_not_creep(laws: tuple[Law, ...], integrator: str) -> None:
    assert still(released(model("1r", *laws), ALONG, 3.0, integrator=integrator))


@pytest.mark.parametrize(("share", "holds"), [(0.999, False), (1.001, True)])
def test_it_slips_where_the_weight_is_more_than_friction(share: float, holds: bool) -> None:
    assert still(released(model("1r", law("coulomb_friction", 0, level=share * WEIGHT)), ALONG, 1.0)) == holds


def test_an_arm_let_go_comes_to_rest_and_stays() -> None:
    laws = [law("coulomb_friction", j, level=f) for j, f in enumerate((20.0, 80.0, 60.0, 20.0, 9.0, 9.0))]
    made = released(model("ur5", *laws), (0, -1.2, 1.2, -0.6, 0.9, 0.3), 3.0, v=1.0)
    assert np.abs(made.true_v[0]).min() == 1 and still(made, 1500)


def test_bristles_settle() -> None:
    laws = law("presliding_friction", 0, level=SIDE, distance=1e-3), law("viscous_friction", 0, coefficient=0.5)
    made = released(model("1r", *laws), ALONG, 15.0)
    assert 0 < np.ptp(made.true_q) < 1e-2
    assert np.abs(made.true_v[-1000:]).max() < 1e-6


@pytest.mark.parametrize("stiffness", [1e3, 1e4, 1e5, 1e6, 1e7])
def test_stiff_springs_ring_at_their_frequency(stiffness: float) -> None:
    made = released(model(wheel(inertia=1.6), law("spring", 0, stiffness=stiffness, rest=0.0)), 0.1, 2.0)
    assert np.abs(made.true_q).max() < 0.11
    assert pitch(made.true_q[:, 0], 1e-3) == pytest.approx(np.sqrt(stiffness / 1.6), rel=0.02)


@pytest.mark.parametrize("stiffness", [300.0, 3000.0])
def test_two_inertias_ring_at_their_frequency(stiffness: float) -> None:
    robot, laws = wheel(inertia=0.5), (law("armature", 0, inertia=0.1), law("joint_elasticity", 0, stiffness=stiffness))
    t = np.arange(0, 1.0, 1e-3)
    drive = Torques(t, np.where(t < 0.005, 5.0, 0.0)[:, None], np.zeros(1), np.zeros(1))
    made = simulate(model(robot, *laws), drive, 1.0)
    relative = (made.link_q - made.true_q)[10:, 0]
    assert pitch(relative, 1e-3) == pytest.approx(np.sqrt(stiffness * (1 / 0.5 + 1 / 0.1)), rel=0.02)


def energy(given: Model, made: Simulation) -> np.ndarray:
    body, data = given.robot.model, given.robot.model.createData()
    states = zip(made.true_q, made.true_v, strict=True)
    return np.array(
        [pin.computeKineticEnergy(body, data, q, v) + pin.computePotentialEnergy(body, data, q) for q, v in states]
    )


def test_energy_is_kept() -> None:
    given = model("3r")
    made = released(given, (0.0, -1.4, -0.2), 10.0, v=0.2, integrator="rk4")
    total = energy(given, made)
    assert np.ptp(made.true_q, axis=0).min() > 0.1
    assert np.abs(total - total[0]).max() < 1e-9 * abs(total[0])


def test_a_pendulum_swings_as_elliptic_integrals_say() -> None:
    given, start = model("1r"), 2.0
    made = released(given, start, 8.0, integrator="rk4")
    q, t = made.true_q[:, 0], made.t
    k = np.flatnonzero(np.diff(np.sign(q)))
    crossings = t[k] - q[k] * (t[k + 1] - t[k]) / (q[k + 1] - q[k])
    period = 4 * ellipk(np.sin(start / 2) ** 2) * np.sqrt(INERTIA / WEIGHT)
    assert np.allclose(np.diff(crossings), period / 2, rtol=1e-6)


def test_steps_half_as_long_err_half_as_much() -> None:
    given = model("3r", *(law("viscous_friction", j, coefficient=0.1) for j in range(3)))
    start = {"q": (0.3, -1.2, -0.4), "seconds": 0.8, "v": 0.2, "torque": (0.02, -0.1, 0.02)}
    exact = released(given, **start, integrator="rk4", step=1e-3).true_q[::4]
    errors = [np.abs(released(given, **start, step=4e-3 / n, substeps=1).true_q[::n] - exact).max() for n in (2, 4, 8)]
    assert 1.9 < errors[0] / errors[1] < 2.1 and 1.9 < errors[1] / errors[2] < 2.1


def friction(n: int) -> tuple[Law, ...]:
    kinds = {"viscous_friction": 0.5, "coulomb_friction": 0.4, "armature": 0.1}
    return tuple(
        Law(signid.effects.EFFECTS[k], (j,), signid.effects.EFFECTS[k].physical([x], {}))
        for k, x in kinds.items()
        for j in range(n)
    )


@pytest.mark.parametrize("integrator", ["semi-implicit", "rk4"])
def test_many_copies_are_each_as_alone(integrator: str) -> None:
    given = model("3r", *friction(3))
    drives = [track(model("3r"), waves(given.robot.joints, 0.6, seed=seed)) for seed in range(3)]
    together = simulate_many(given, drives, 0.6, integrator=integrator)
    for drive, one in zip(drives, together, strict=True):
        alone = simulate(given, drive, 0.6, integrator=integrator)
        assert np.allclose(one.true_q, alone.true_q, rtol=0, atol=1e-10)
        assert np.allclose(one.tau, alone.tau, rtol=0, atol=1e-7)


def test_track_names_the_motion_that_it_needs() -> None:
    with pytest.raises(SignidError, match=r"track needs a Trajectory, not float; give signid.excite\(robot\)"):
        track(signid.load_robot("1r"), 1.0)  # type: ignore[arg-type]


def test_friction_on_the_other_side_does_not_hold() -> None:
    weak = law("asymmetric_friction", 0, viscous_positive=2.0, viscous_negative=3.0, coulomb_positive=SIDE,
               coulomb_negative=0.1 * SIDE)  # fmt: skip
    made = released(model("1r", weak), ALONG, 0.2)
    assert made.true_q[-1] < ALONG - 0.1, "gravity turns it backwards"
