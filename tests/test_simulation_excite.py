"""Exciting motions obey every limit, and are more informative than random ones."""

from dataclasses import replace
from pathlib import Path

import coal
import numpy as np
import pinocchio as pin
import pytest

from signid.effects import EFFECT_NAMES, EFFECTS
from signid.model import Model, load_model, stated_inertials, stated_laws
from signid.regression.motion import Motion, regressor
from signid.robot import load_robot
from signid.simulation.excite import Excitation, build_limits, excite
from signid.simulation.excite.design import CRITERIA, Budget, ExcitationCost, make_feasible, predict_precision
from signid.simulation.excite.families import FAMILIES, Fourier, random_parameters
from signid.simulation.excite.limits import build_collision
from signid.simulation.excite.problem import ExcitationProblem, build_design, usual_laws
from signid.types import Law, Trajectory

SMALL = Budget(pool=10, starts=1, short=40, long=40, firm=40)
ARM = [f"panda_joint{i}" for i in range(1, 8)]
DURATION = 10.0


def arm(name: str, joints: list[str] | None = None) -> Model:
    robot = load_robot(name, joints=joints)
    return Model(robot, stated_inertials(robot), stated_laws(robot))


def problem_of(model: Model, family: Fourier) -> ExcitationProblem:
    limits = build_limits(model.robot)
    return build_design(model, usual_laws(model, EFFECT_NAMES), family, limits, 0.01, 0)[0]


def moves_as_it_says(asked: Trajectory) -> None:
    """Velocity and acceleration are those of the positions."""
    dt = asked.t[1] - asked.t[0]
    for lower, higher in ((asked.q, asked.v), (asked.v, asked.a)):
        difference = (lower[2:] - lower[:-2]) / (2 * dt)
        assert np.abs(difference - higher[1:-1]).max() < 2e-3 * np.abs(higher).max()


def obeys(found: Excitation, model: Model) -> None:
    """Check the limits by plain formulas on the result's own samples."""
    asked, robot = found.trajectory, model.robot
    torque = model.inverse(Motion(robot, asked.t, asked.q, asked.v, asked.a))
    assert (asked.q >= robot.lower).all() and (asked.q <= robot.upper).all()
    assert (np.abs(asked.v) <= robot.velocity_limit).all() and (np.abs(torque) <= robot.effort_limit).all()
    assert found.use.largest <= 0.95 + 1e-9
    assert found.distance is None or found.distance >= 0.01


@pytest.fixture(scope="module")
def panda() -> tuple[Model, Excitation]:
    model = arm("panda", ARM)
    return model, excite(model, harmonics=5, budget=SMALL)


@pytest.mark.slow
def test_an_arm_is_excited_within_its_limits(panda: tuple[Model, Excitation]) -> None:
    model, found = panda
    obeys(found, model)
    moves_as_it_says(found.trajectory)
    assert found.distance is not None and not found.flags
    assert np.allclose([found.trajectory.v[[0, -1]], found.trajectory.a[[0, -1]]], 0, atol=1e-9)
    assert len(found.expressions) == len(found.std) == len(found.relative_std)


@pytest.mark.slow
def test_distances_hold_for_the_meshes_themselves(panda: tuple[Model, Excitation]) -> None:
    """Hulls are larger than the meshes that they stand for."""
    model, found = panda
    collision, _ = build_collision(model.robot, build_limits(model.robot), 0.01)
    assert collision is not None
    folder = [str(parent) for parent in Path(model.robot.path).parents]
    meshes = pin.buildGeomFromUrdfString(
        model.robot.model, model.robot.document, pin.GeometryType.COLLISION, package_dirs=folder
    )
    assert any(isinstance(item.geometry, coal.BVHModelBase) for item in meshes.geometryObjects)
    for pair in collision.geometry.collisionPairs:
        meshes.addCollisionPair(pair)
    data, placed = model.robot.model.createData(), meshes.createData()
    motion = Motion(model.robot, *(getattr(found.trajectory, key)[7::40] for key in "tqva"))
    assert not any(
        pin.computeCollisions(model.robot.model, data, meshes, placed, q, True) for q in motion.configuration
    )


@pytest.mark.slow
def test_it_informs_more_than_random_motions() -> None:
    model, family = arm("3r"), Fourier(DURATION, 5, 1 / DURATION)
    problem, rng = problem_of(model, family), np.random.default_rng(3)
    basis, t = family.basis(np.linspace(0, DURATION, 1001)), np.arange(1001) / 100
    drawn = [random_parameters(basis, problem.limits, rng) for _ in range(20)]
    feasible = [make_feasible(problem, family, x).x for x in drawn]
    random = [predict_precision(problem, family.sample(model.robot.joints, x, t)).log_det for x in feasible]
    found = excite(model, duration=DURATION, harmonics=5, budget=Budget(20, 2, 60, 150, 80))
    obeys(found, model)
    assert found.log_det > max(random)  # than each of them; the best of twenty differs by 6 from one BLAS to another
    assert found.log_det > np.median(random) + 0.65 * len(found.std)  # standard deviations 0.72 of the usual one's


def test_the_condition_number_can_be_the_goal() -> None:
    model = arm("3r")
    both = {name: excite(model, criterion=name, duration=DURATION, harmonics=4, budget=SMALL) for name in CRITERIA}
    assert both["condition"].condition < both["determinant"].condition
    assert both["condition"].value == both["condition"].condition
    assert both["determinant"].log_det > both["condition"].log_det


def test_a_random_motion_is_drawn_and_not_sought() -> None:
    model = load_model("3r")
    first, second = (excite(model, kind="random", duration=6.0, harmonics=4, seed=seed) for seed in (1, 2))
    assert first.evaluations == 1 and not first.flags
    for found in (first, second):
        obeys(found, model)
        assert np.allclose(found.trajectory.v[[0, -1]], 0, atol=1e-9)
    assert not np.allclose(first.trajectory.q, second.trajectory.q)


def test_predicted_deviations_are_those_of_least_squares() -> None:
    model = load_model("1r")
    found = excite(model, duration=5.0, harmonics=3, budget=SMALL)
    laws = tuple(Law(EFFECTS[name], (0,)) for name in EFFECT_NAMES)
    asked, problem = found.trajectory, problem_of(model, Fourier(5.0, 3, 0.2))
    motion = Motion(model.robot, asked.t, asked.q, asked.v, asked.a, slow=np.array([0.01]))
    x = regressor(motion, laws)[:, 0][:, problem.base.independent] / found.noise[0]
    assert found.noise[0] == pytest.approx(0.01 * model.robot.effort_limit[0])
    assert np.allclose(found.std, np.sqrt(np.diag(np.linalg.inv(x.T @ x))), rtol=1e-6)


def test_splines_start_and_end_at_rest_and_pass_all_limits() -> None:
    model = arm("3r")
    found = excite(model, kind="spline", duration=DURATION, harmonics=4, budget=SMALL)
    obeys(found, model)
    moves_as_it_says(found.trajectory)
    assert np.allclose([found.trajectory.v[[0, -1]], found.trajectory.a[[0, -1]]], 0, atol=1e-9)


@pytest.mark.parametrize("kind", FAMILIES)
@pytest.mark.parametrize("periods", [1.0, 2.0, 1.7])
def test_families_keep_their_definitions(kind: str, periods: float) -> None:
    family = FAMILIES[kind](DURATION, 4, periods / DURATION)
    t = np.linspace(0, DURATION, 20001)
    basis = family.basis(t)
    assert basis.shape == (3, len(t), family.size)
    assert np.allclose(basis[:, :, 0], [[1], [0], [0]])
    assert np.abs(basis[1:, [0, -1]]).max() < 1e-9 * np.abs(basis[2]).max()
    for k in (0, 1):
        assert np.abs(np.gradient(basis[k], t, axis=0) - basis[k + 1])[1:-1].max() < 1e-4 * np.abs(basis[2]).max()
    assert np.linalg.matrix_rank(basis[0]) == family.size


@pytest.mark.parametrize("name", ["3r", "panda"])
def test_costs_know_their_slopes(name: str) -> None:
    model, family = arm(name), Fourier(DURATION, 3, 1 / DURATION)
    problem = replace(problem_of(model, family), collision=None)
    cost = ExcitationCost(problem, CRITERIA["determinant"], family, np.linspace(0, DURATION, 31), 100.0, 0.02)
    z = np.random.default_rng(2).uniform(-0.6, 0.6, cost.sizes.size)  # some limits are exceeded
    value, slope = cost.value_and_slope(z)
    assert value == pytest.approx(cost.value(z), rel=1e-12)
    for i in range(1, len(z), 4):
        step = 1e-6 * np.eye(len(z))[i]
        difference = (cost.value(z + step) - cost.value(z - step)) / 2e-6
        assert slope[i] == pytest.approx(difference, rel=1e-4, abs=1e-5 * np.abs(slope).max())
