"""Regressor -> base parameters: combinations of standard parameters that torque depends on, and their covariance."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pinocchio as pin

from ..frozen import Frozen
from ..types import INERTIAL, Array, BaseMap, Label, Law, Robot
from .motion import Motion, labels, regressor

RANK_TOLERANCE = 1e-5  # [1] smallest singular value that counts, over the largest, columns scaled
KEEP_TOLERANCE = 1e-5  # [1] smallest share of an independent column that is orthogonal to the columns kept
REST_VELOCITY_SHARE = 1e-9  # [1] share of a random velocity that leaves its direction and no inertial torque
MIN_PRINTED_COEFFICIENT = 1e-9  # smallest coefficient that is printed
MAX_SNAP_DISTANCE = 2e-3  # [1] of a rotation entry from 0 or 1, if its angle was typed with few digits (3.14)
COEFFICIENT_DIGITS = 6  # significant digits of a printed coefficient
MIN_VARIANCE_DIGITS = 6  # smallest number of significant digits of a variance in a file
EIGENVALUE_DIGITS = 2  # significant digits of the smallest eigenvalue after rounding
TERM_DIGITS = 10  # significant digits of a coefficient of a base parameter
MAX_INDEFINITENESS = 1e-3  # [1] of a negative eigenvalue of the correlation matrix, per row: rounding
_INERTIAL_LABEL = re.compile(rf"(?:{'|'.join(INERTIAL)})_(\d+)")


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
    rng, n = np.random.default_rng(seed), len(snapped.joints)
    count = max(20, 3 * len(names) // n + 5)
    q, v, a = rng.uniform(-np.pi, np.pi, (count, n)), *rng.standard_normal((2, count, n))
    states = Motion(snapped, np.arange(count, dtype=np.float64), np.asarray(q), v, a)
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
        data = robot.model.createData()
        joint, where = robot.model.joints[body + 1], pin.neutral(robot.model)
        pin.computeJointJacobians(robot.model, data, where)
        jacobian = np.reshape(pin.getJointJacobian(robot.model, data, body + 1, pin.LOCAL), (6, robot.model.nv))
        turn = jacobian[3:, joint.idx_v]  # joint axis of the body in its own frame
        axis = (4, 6, 9)[int(np.argmax(np.abs(turn))) if np.any(turn) else 2]
        inertias = [axis, *(k for k in (9, 4, 5, 7, 8, 6) if k != axis)]
        order += [10 * body + k for k in (*inertias[:-1], 1, 2, 3, inertias[-1], 0)]
    return [*order, *range(len(order), len(names))]


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


@dataclass(frozen=True, eq=False)
class Covariance(Frozen):
    """Base parameters = combination @ standard parameters, and the covariance of their errors.

    The p standard parameters are ten for each of the nb bodies in Pinocchio's order, then the coefficients of laws in
    order of appearance in the base parameters. The variance of an unidentifiable base parameter is infinite.
    """

    labels: tuple[str, ...]  # p names: "Izz_2", "coulomb_friction_1"
    expressions: tuple[str, ...]  # b formulas, "Izz_2 + 0.09 m_3"
    combination: Array  # (b, p) [unit of base over unit of standard]
    values: Array  # (b,) [units of base] as identified; a model that was edited later has others
    matrix: Array  # (b, b) [units of base]

    @property
    def std(self) -> Array:
        """(b,) standard deviations [units of base]."""
        return np.sqrt(np.diag(self.matrix))

    def document(self) -> dict[str, Any]:
        """JSON object for model.json, with enough digits to stay positive definite; null stands for infinity."""
        terms = [
            {self.labels[k]: round_digits(row[k], TERM_DIGITS) for k in map(int, np.flatnonzero(row))}
            for row in self.combination
        ]
        return {
            "names": list(self.expressions),
            "values": self.values.tolist(),
            "terms": terms,
            "lower_triangle": lower_triangle(self.matrix),
        }


def lower_triangle(matrix: Array) -> list[float | None]:
    """Lower triangle, row by row, of a covariance matrix: (b, b) [its units], rounded yet definite; null: infinity."""
    lower, digits = matrix[np.tril_indices(len(matrix))], _needed_digits(matrix)
    return [round_digits(x, digits) if np.isfinite(x) else None for x in lower]


def base_covariance(base: BaseMap, values: Array, matrix: Array) -> Covariance:
    """Covariance of base parameters with the names of their standard parameters.

    The values (b,) [units of base] are those of the model, the matrix (b, b) [units of base] is that of their errors.
    """
    bodies = [k for k, label in enumerate(base.labels) if label.body is not None]
    order = list(dict.fromkeys([*bodies, *np.nonzero(base.combination)[1].tolist()]))  # laws in order of appearance
    names = tuple(base.labels[k].name for k in order)
    return Covariance(names, base.expressions, base.combination[:, order], values, matrix)


def read_covariance(content: Mapping[str, Any], bodies: int) -> Covariance:
    """Covariance in the content of a model.json, the object of `Covariance.document`.

    Raises:
        ValueError: the content is malformed; the message says where.
    """
    try:
        expressions = tuple(map(str, content["names"]))
        values = np.array([float(x) for x in content["values"]])
        terms = [{str(name): float(x) for name, x in entry.items()} for entry in content["terms"]]
        lower = np.array([np.inf if x is None else float(x) for x in content["lower_triangle"]])
    except KeyError as error:
        raise ValueError(f"it lacks {error.args[0]!r}") from None
    except (AttributeError, TypeError, ValueError):
        raise ValueError("names, values, terms or lower_triangle are no lists of names, numbers and objects") from None
    b = len(expressions)
    if (len(values), len(terms), len(lower)) != (b, b, b * (b + 1) // 2):
        raise ValueError(
            f"{b} names need {b} values, {b} terms and {b * (b + 1) // 2} numbers in lower_triangle; "
            f"it has {len(values)}, {len(terms)} and {len(lower)}"
        )
    own = [f"{name}_{body + 1}" for body in range(bodies) for name in INERTIAL]
    labels = tuple(dict.fromkeys([*own, *(name for entry in terms for name in entry)]))
    if beyond := [name for name in labels[len(own) :] if _INERTIAL_LABEL.fullmatch(name)]:
        raise ValueError(f"its terms name {beyond[0]}, and the robot has {bodies} bodies")
    labels = labels
    place = {name: k for k, name in enumerate(labels)}
    combination = np.zeros((b, len(labels)))
    for row, entry in zip(combination, terms, strict=True):
        row[[place[name] for name in entry]] = list(entry.values())
    if not (np.all(np.isfinite(values)) and np.all(np.isfinite(combination))):
        raise ValueError("a value or a coefficient of a term is no finite number")
    return Covariance(labels, expressions, combination, values, from_lower_triangle(lower, b))


def from_lower_triangle(lower: Array, b: int) -> Array:
    """Symmetric matrix (b, b) of its lower triangle; eigenvalues that are negative by rounding are raised.

    lower: (t,) [its units] row by row, t = b (b + 1) / 2.

    Raises:
        ValueError: no covariance has this triangle.
    """
    matrix = np.zeros((b, b))
    matrix[np.tril_indices(b)] = lower
    matrix += np.tril(matrix, -1).T
    known = np.flatnonzero(np.isfinite(np.diag(matrix)))
    part = np.ix_(known, known)
    size = np.sqrt(np.maximum(np.diag(matrix)[known], 0))
    if np.isnan(lower).any() or not np.all(np.isfinite(matrix[part])) or (b and not np.all(size > 0)):
        raise ValueError("lower_triangle has a variance that is not positive, or a covariance that is no number")
    if not len(known):
        return matrix
    values, vectors = np.linalg.eigh(matrix[part] / np.outer(size, size))
    if values[0] < -MAX_INDEFINITENESS * len(known):
        raise ValueError("lower_triangle is not that of a covariance: a combination would have a negative variance")
    if values[0] <= 0:
        least = 10.0 ** -(MIN_VARIANCE_DIGITS + EIGENVALUE_DIGITS) * values[-1]
        matrix[part] = (vectors * np.maximum(values, least)) @ vectors.T * np.outer(size, size)
    return matrix


def _needed_digits(matrix: Array) -> int:
    known = np.isfinite(np.diag(matrix))
    size = np.sqrt(np.diag(matrix)[known])
    if not len(size) or not np.all(size > 0):
        return MIN_VARIANCE_DIGITS
    smallest = float(np.linalg.eigvalsh(matrix[np.ix_(known, known)] / np.outer(size, size))[0])
    return int(np.clip(np.ceil(-np.log10(max(smallest, 1e-300))) + EIGENVALUE_DIGITS, MIN_VARIANCE_DIGITS, 15))


def round_digits(x: float, digits: int) -> float:
    """The number with some significant digits."""
    return float(f"{x:.{digits}g}")
