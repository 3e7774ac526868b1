"""Feasible inertias: a body of point masses is feasible in every frame; no other set of ten numbers is."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose

from signid.estimation.feasible import TO_INERTIAL, pack
from signid.types import INERTIAL, INERTIAL_UNITS, Array, Label, Parameters, pseudo_inertia

LABELS = tuple(Label(name, unit, body=0) for name, unit in zip(INERTIAL, INERTIAL_UNITS, strict=True))
masses = arrays(float, 6, elements=st.floats(0.1, 10.0))
points = arrays(float, (6, 3), elements=st.floats(-1.0, 1.0))
angles = arrays(float, 6, elements=st.floats(-3.0, 3.0))
factors = arrays(float, 10, elements=st.floats(-1.5, 1.5))


def feasible(ten: Array) -> bool:
    return Parameters(LABELS, ten).is_feasible()


def body(mass: Array, at: Array) -> Array:
    """Ten inertial parameters of point masses, with four of their own so that they are never in a plane."""
    mass, at = np.r_[mass, np.ones(4)], np.vstack([at, np.zeros(3), 0.2 * np.eye(3)])
    first = mass @ at
    second = np.einsum("n,ni,nj->ij", mass, at, at)
    inertia = np.trace(second) * np.eye(3) - second
    return np.r_[mass.sum(), first, inertia[np.tril_indices(3)]]


def from_log_cholesky(ten: Array) -> Array:
    """Rucker and Wensing's ten free numbers: alpha, d1 d2 d3, s12 s23 s13, t1 t2 t3."""
    a, d, s, t = ten[0], ten[1:4], ten[4:7], ten[7:]
    upper = np.array([[0, s[0], s[2], t[0]], [0, 0, s[1], t[1]], [0, 0, 0, t[2]], [0, 0, 0, 0.0]])
    factor = np.exp(a) * (upper + np.diag(np.exp([*d, 0.0])))
    return np.asarray(TO_INERTIAL @ pack(factor @ factor.T))


@given(masses, points)
def test_point_masses_are_possible(mass: Array, at: Array) -> None:
    ten = body(mass, at)
    assert feasible(ten)
    matrix = pseudo_inertia(ten)
    homogeneous = np.c_[np.vstack([at, np.zeros(3), 0.2 * np.eye(3)]), np.ones(10)]
    assert_allclose(matrix, homogeneous.T @ (np.r_[mass, np.ones(4)][:, None] * homogeneous), atol=1e-9)


@given(masses, points)
def test_pinocchio_has_the_same_pseudo_inertia(mass: Array, at: Array) -> None:
    ten = body(mass, at)
    there = pin.Inertia.FromDynamicParameters(ten)
    assert_allclose(pin.PseudoInertia.FromDynamicParameters(ten).toMatrix(), pseudo_inertia(ten), atol=1e-9)
    assert_allclose(there.toDynamicParameters(), ten, atol=1e-9)


@given(masses, points)
def test_packed_and_back(mass: Array, at: Array) -> None:
    ten = body(mass, at)
    assert_allclose(TO_INERTIAL @ pack(pseudo_inertia(ten)), ten, atol=1e-9)


@given(factors)
def test_log_cholesky_numbers_are_always_possible_and_come_back(ten: Array) -> None:
    inertial = from_log_cholesky(ten)
    assert feasible(inertial)
    flipped = np.linalg.cholesky(pseudo_inertia(inertial)[::-1, ::-1])[::-1, ::-1]  # upper triangular
    alpha = np.log(flipped[3, 3])
    unit = flipped / flipped[3, 3]
    back = [alpha, *np.log(np.diag(unit)[:3]), unit[0, 1], unit[1, 2], unit[0, 2], *unit[:3, 3]]
    assert_allclose(back, ten, atol=1e-6)


@given(masses, points, angles)
def test_possible_in_one_frame_possible_in_every_frame(mass: Array, at: Array, twist: Array) -> None:
    ten, moved = body(mass, at), pin.exp6(pin.Motion(twist))
    there = moved.act(pin.Inertia.FromDynamicParameters(ten)).toDynamicParameters()
    assert feasible(ten) and feasible(there)
    change = moved.homogeneous
    assert_allclose(pseudo_inertia(there), change @ pseudo_inertia(ten) @ change.T, atol=1e-6)


@given(masses, points, angles, st.integers(0, 2), st.floats(0.01, 1.0))
def test_a_violated_triangle_inequality_is_impossible_in_every_frame(
    mass: Array, at: Array, twist: Array, axis: int, excess: float
) -> None:
    matrix = pseudo_inertia(body(mass, at))
    centre = matrix[:3, 3] / matrix[3, 3]
    spread, axes = np.linalg.eigh(matrix[:3, :3] - matrix[3, 3] * np.outer(centre, centre))
    spread[axis] = -excess  # one principal moment is above the sum of the other two
    matrix[:3, :3] = (axes * spread) @ axes.T + matrix[3, 3] * np.outer(centre, centre)
    change = pin.exp6(pin.Motion(twist)).homogeneous
    assert not feasible(TO_INERTIAL @ pack(matrix))
    assert not feasible(TO_INERTIAL @ pack(change @ matrix @ change.T))


@given(masses, points)
def test_negative_mass_is_impossible(mass: Array, at: Array) -> None:
    ten = body(mass, at)
    ten[0] = -ten[0]
    assert not feasible(ten)
    assert not feasible(np.zeros(10))


@given(st.floats(-10, 10))
def test_coefficients_that_must_be_positive_count(value: float) -> None:
    labels = (*LABELS, Label("viscous_friction_1", "N.m.s/rad", law=0, positive=True))
    ten = body(np.ones(6), np.zeros((6, 3)))
    assert Parameters(labels, np.r_[ten, value]).is_feasible() == (value >= 0)
    free = (*LABELS, Label("torque_offset_1", "N.m", law=0))
    assert Parameters(free, np.r_[ten, value]).is_feasible()
