"""Regressor -> base parameters: the combinations of standard parameters that the torque depends on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pinocchio as pin

from ..types import Array, BaseMap, Label, Law, Robot
from .motion import Motion, labels, regressor

RANK_TOLERANCE = 1e-5  # [1] smallest singular value that counts, over the largest, columns scaled
KEEP_TOLERANCE = 1e-5  # [1] smallest share of an independent column that is orthogonal to the columns kept
REST_VELOCITY_SHARE = 1e-9  # [1] share of a random velocity that leaves its direction and no inertial torque
MIN_PRINTED_COEFFICIENT = 1e-9  # smallest coefficient that is printed
MAX_SNAP_DISTANCE = 2e-3  # [1] of a rotation entry from 0 or 1, if its angle was typed with few digits (3.14)
COEFFICIENT_DIGITS = 6  # significant digits of a printed coefficient


def build_base(
    robot: Robot, laws: Sequence[Law] = (), seed: int = 0, measured: Sequence[bool] | None = None, static: bool = False
) -> BaseMap:
    """Base map of a robot with laws, from random states, since a periodic motion can hide parameters.

    Columns are taken in order of preference while they are independent of those taken before, so that formulas read as
    in textbooks: bodies from the base on, the inertia about a body's own joint axis first, laws last. Only joints whose
    torque is `measured` count; default: every joint. States are postures at rest if `static`.

    Source: Gautier, Khalil, IEEE T-RA 6(3), 1990; numerically as Gautier, J. Robotic Systems 8(4), 1991.
    """
    snapped, names = _snap_rotations(robot), labels(robot, laws)
    states = _random_motion(snapped, len(names), seed)
    if static:
        states = replace(states, v=REST_VELOCITY_SHARE * states.v, a=0 * states.a)
    known = np.ones(len(robot.joints), dtype=bool) if measured is None else np.array(measured, dtype=bool)
    rows = regressor(states, laws) * known[:, None]  # (N, n, p)
    stacked = rows.reshape(-1, len(names))
    norm = np.linalg.norm(stacked, axis=0) / np.sqrt(len(stacked))
    scale = np.where(norm > 1e-12 * norm.max(initial=1.0), norm, np.inf)
    _, singular, right = np.linalg.svd(stacked / scale, full_matrices=False)
    rank = int(np.sum(singular > RANK_TOLERANCE * singular[0]))
    compact = singular[:rank, None] * right[:rank]  # (rank, p), same Gram as the scaled regressor
    kept = _independent_columns(compact, _preference(snapped, names), rank)
    combination = _base_combination(compact, kept, scale)
    visible = np.abs(rows[:, :, kept]).max(0) > MIN_PRINTED_COEFFICIENT * norm[kept]
    return BaseMap(
        labels=names,
        independent=np.array(kept, dtype=np.intp),
        combination=combination,
        expressions=tuple(_formula(row, kept[i], names) for i, row in enumerate(combination)),
        units=tuple(names[k].unit for k in kept),
        sees=visible,
        singular_values=np.pad(singular, (0, len(names) - len(singular))),
        condition=float(np.linalg.cond(compact[:, kept])) if kept else 1.0,
    )


def _random_motion(robot: Robot, parameters: int, seed: int) -> Motion:
    rng, n = np.random.default_rng(seed), len(robot.joints)
    count = max(20, 3 * parameters // n + 5)
    q, v, a = rng.uniform(-np.pi, np.pi, (count, n)), *rng.standard_normal((2, count, n))
    return Motion(robot, np.arange(count, dtype=np.float64), np.asarray(q), v, a)


def _independent_columns(compact: Array, order: Sequence[int], rank: int) -> list[int]:
    """Indices, ascending, of the columns that are independent of those before them in an order."""
    kept: list[int] = []
    basis = np.zeros((len(compact), 0))
    for k in order:
        if len(kept) == rank:
            break
        column = compact[:, k]
        left = column - basis @ (basis.T @ column)
        left = left - basis @ (basis.T @ left)
        size = np.linalg.norm(left)
        if size > KEEP_TOLERANCE * max(float(np.linalg.norm(column)), 1e-5):
            kept.append(k)
            basis = np.column_stack([basis, left / size])
    return sorted(kept)


def _base_combination(compact: Array, kept: list[int], scale: Array) -> Array:
    """K (b, p) with base = K @ standard."""
    others = [k for k in range(compact.shape[1]) if k not in set(kept)]
    share = np.linalg.lstsq(compact[:, kept], compact[:, others], rcond=None)[0]
    combination = np.zeros((len(kept), compact.shape[1]))
    combination[np.arange(len(kept)), kept] = 1
    finite = np.where(np.isinf(scale), 0.0, scale)
    combination[:, others] = share * finite[others] / scale[kept][:, None]
    combination[np.abs(combination) < MIN_PRINTED_COEFFICIENT] = 0
    return combination


def _preference(robot: Robot, names: Sequence[Label]) -> list[int]:
    order = []
    for body in range(len(robot.links)):
        axis = {0: 4, 1: 6, 2: 9}[_joint_axis(robot, body)]
        inertias = [axis, *(k for k in (9, 4, 5, 7, 8, 6) if k != axis)]
        order += [10 * body + k for k in (*inertias[:-1], 1, 2, 3, inertias[-1], 0)]
    return [*order, *range(len(order), len(names))]


def _joint_axis(robot: Robot, body: int) -> int:
    """Index (0, 1 or 2) of the joint axis of a body in the body's own frame."""
    data = robot.model.createData()
    joint, where = robot.model.joints[body + 1], pin.neutral(robot.model)
    pin.computeJointJacobians(robot.model, data, where)
    jacobian = np.reshape(pin.getJointJacobian(robot.model, data, body + 1, pin.LOCAL), (6, robot.model.nv))
    motion = jacobian[3:, joint.idx_v]
    return int(np.argmax(np.abs(motion))) if np.any(motion) else 2


def _formula(row: Array, lead: int, names: Sequence[Label]) -> str:
    text = names[lead].name
    for k in map(int, np.flatnonzero(row)):
        if k == lead:
            continue
        size = abs(row[k])
        factor = "" if abs(size - 1) < MIN_PRINTED_COEFFICIENT else f"{size:.{COEFFICIENT_DIGITS}g} "
        text += f" {'+' if row[k] > 0 else '-'} {factor}{names[k].name}"
    return text


def _snap_rotations(robot: Robot) -> Robot:
    """Robot with exact rotations for typed ones (1.5708 for pi/2), only for counting parameters."""
    model = robot.model.copy()
    for joint in range(1, model.njoints):
        placement = model.jointPlacements[joint]
        rotation = placement.rotation.copy()
        rotation[np.abs(rotation) < MAX_SNAP_DISTANCE] = 0
        near = np.abs(np.abs(rotation) - 1) < MAX_SNAP_DISTANCE
        rotation[near] = np.sign(rotation[near])
        left, _, right = np.linalg.svd(rotation)
        model.jointPlacements[joint] = pin.SE3(left @ right, placement.translation)
    return replace(robot, model=model)
