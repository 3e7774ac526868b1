"""The cone of feasible parameters: true robots are inside, mirror images and rectified friction outside."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import cvxpy
import numpy as np
import pinocchio as pin
import pytest
from signless import Lost, lost

from signid.signs import exact
from signid.signs.branch_and_bound import PhysicalCone, cone_inequalities, kinetic_rows
from signid.signs.observations import law_coefficients
from signid.signs.problem import SignProblem, build_sign_problem
from signid.types import Array


def posed(case: Lost) -> SignProblem:
    return build_sign_problem(case.observed, case.segments(), case.weights)


def posed_in_cone(noise: float) -> tuple[Lost, SignProblem, PhysicalCone]:
    case = lost(noise)
    problem = posed(case)
    return case, problem, PhysicalCone.of(problem, cone_inequalities(case.task, case.observed))


def exhausted(*_: object, **__: object) -> None:
    raise RuntimeError("Maximum number of iterations reached.")


def standard(case: Lost, seed: int) -> Array:
    """Parameters (p,) of a random robot: bodies of random pseudo-inertia, laws that brake."""
    rng = np.random.default_rng(seed)
    bodies = [pin.Inertia.Random().toDynamicParameters() for _ in case.task.robot.links] if seed < 0 else []
    for _ in case.task.robot.links[len(bodies) :]:
        root = rng.standard_normal((4, 4))
        bodies.append(pin.PseudoInertia.FromMatrix(root @ root.T).toDynamicParameters())
    laws = [label for label in case.task.base.labels if label.law is not None]
    friction = np.array([rng.exponential() if label.positive else 0.0 for label in laws])
    return np.concatenate([*bodies, friction])


def mass(case: Lost, q: Array, parameters: Array) -> Array:
    """Mass matrix (n, n) of the bodies alone."""
    model = case.task.robot.model.copy()
    for k in range(len(case.task.robot.links)):
        model.inertias[k + 1] = pin.Inertia.FromDynamicParameters(parameters[10 * k : 10 * k + 10])
    full = pin.crba(model, model.createData(), q)
    return np.asarray(np.triu(full) + np.triu(full, 1).T)


@pytest.mark.parametrize("seed", range(6))
def test_true_robots_are_inside_and_their_negatives_outside(seed: int) -> None:
    case = lost(0.02)
    rows, value = cone_inequalities(case.task, case.observed, seed), case.task.base.combination @ standard(case, seed)
    slack = rows @ value
    assert slack.min() >= -1e-9 * np.abs(slack).max()
    assert (rows @ -value).min() < -0.1 * np.abs(slack).max()


def test_kinetic_rows_are_those_of_the_mass_matrix() -> None:
    case, rng = lost(0.02), np.random.default_rng(0)
    parameters = standard(case, 0)
    q, x = rng.uniform(-3, 3, (10, 3)), rng.standard_normal((10, 3))
    armature = parameters[[label.name.startswith("armature") for label in case.task.base.labels]]
    energy = [v @ (mass(case, p, parameters) + np.diag(armature)) @ v for p, v in zip(q, x, strict=True)]
    rows = kinetic_rows(case.task, q, x)
    assert rows @ case.task.base.combination @ parameters == pytest.approx(np.array(energy), rel=1e-9)
    friction = [k for k, (name, _) in law_coefficients(case.task).items() if name != "armature"]
    assert np.abs(rows[:, friction]).max() < 1e-12


def test_friction_that_an_offset_replaces_is_outside() -> None:
    case = lost(0.02)
    own = {law: k for k, law in law_coefficients(case.task).items()}
    rows = cone_inequalities(case.task, case.observed)
    for joint in range(3):
        for factor, inside in ((1.9, True), (-1.9, True), (5.0, False), (-5.0, False)):
            value = case.true.copy()
            value[own["torque_offset", joint]] = factor * value[own["coulomb_friction", joint]]
            assert bool((rows @ value).min() >= -1e-9) == inside


def test_negative_friction_is_outside() -> None:
    case = lost(0.02)
    rows = cone_inequalities(case.task, case.observed)
    for k, (name, _) in law_coefficients(case.task).items():
        if name != "torque_offset":
            value = case.true.copy()
            value[k] *= -0.1
            assert (rows @ value).min() < 0


def projected(rows: Array, z: Array) -> Array:
    x = cvxpy.Variable(len(z))
    cvxpy.Problem(cvxpy.Minimize(cvxpy.sum_squares(x - z)), [rows @ x >= 0]).solve(solver="CLARABEL")
    assert x.value is not None
    return np.asarray(x.value)


@pytest.mark.parametrize("seed", range(5))
def test_distance_is_that_of_a_quadratic_program(seed: int) -> None:
    (_, problem, cone), rng = posed_in_cone(0.02), np.random.default_rng(seed)
    z = problem.coordinates(rng.choice([-1.0, 1.0], problem.count))
    squared, near = cone.distance(z)
    other = projected(cone.rows, z)
    assert squared == pytest.approx(np.sum((other - z) ** 2), rel=1e-5, abs=1e-6 * float(z @ z))
    assert near == pytest.approx(other, abs=1e-4 * np.linalg.norm(z))
    assert (cone.rows @ near).min() > -1e-8 * np.linalg.norm(z)
    assert (near - z) @ near == pytest.approx(0, abs=1e-8 * float(z @ z))


def test_points_inside_stay() -> None:
    case, problem, cone = posed_in_cone(0.0)
    signs = np.array([np.sign(case.torque[s.start : s.stop, s.joint].sum()) for s in case.segments()])
    z = problem.coordinates(signs)
    squared, near = cone.distance(z)
    assert squared == 0 and near is z
    assert cone.distance(-z)[0] > 0.1 * float(z @ z)


def test_a_solver_that_gives_up_leaves_a_bound_and_no_proof(monkeypatch: pytest.MonkeyPatch) -> None:
    def unfinished(matrix: Array, *_: object, **__: object) -> SimpleNamespace:
        return SimpleNamespace(x=np.ones(matrix.shape[1]))

    _, problem, cone = posed_in_cone(0.02)
    z = problem.coordinates(np.ones(problem.count))
    squared, _ = cone.distance(z)
    monkeypatch.setattr("scipy.optimize.nnls", exhausted)
    monkeypatch.setattr("scipy.optimize.lsq_linear", unfinished)
    bound, near = cone.distance(z)
    assert 0 < bound < squared and np.sum((near - z) ** 2) == pytest.approx(bound)
    monkeypatch.setattr(exact, "_prove_bound", lambda scores, *_: (scores.best, 1))
    monkeypatch.setattr(exact, "climb", lambda problem, seed: np.ones(problem.count))
    found = exact.search_signs(problem, cone)
    assert not found.proof.optimal and not found.proof.has_bound


def test_joints_without_torque_do_not_enter() -> None:
    case = lost(0.02)
    torque = case.observed.torque.copy()
    torque[:, 0] = 0
    partial = replace(case.observed, torque=torque, known=np.array([False, True, True]))
    rows = cone_inequalities(case.task, partial)
    assert (rows @ case.true).min() > -1e-9
