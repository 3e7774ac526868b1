"""Documents of a model's covariance and misfit."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..frozen import Frozen
from ..types import INERTIAL, Array, BaseMap
from .factors import Factors
from .rows import Task

MIN_VARIANCE_DIGITS = 6  # smallest number of significant digits of a variance in a file
EIGENVALUE_DIGITS = 2  # significant digits of the smallest eigenvalue after rounding
TERM_DIGITS = 10  # significant digits of a coefficient of a base parameter
MAX_INDEFINITENESS = 1e-3  # [1] of a negative eigenvalue of the correlation matrix, per row: rounding
_INERTIAL_LABEL = re.compile(rf"(?:{'|'.join(INERTIAL)})_(\d+)")
MISFIT_DIGITS = 4  # significant digits of a misfit in a file


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
            {self.labels[k]: _round_digits(row[k], TERM_DIGITS) for k in map(int, np.flatnonzero(row))}
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
    return [_round_digits(x, digits) if np.isfinite(x) else None for x in lower]


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
    labels = _labels(terms, bodies)
    place = {name: k for k, name in enumerate(labels)}
    combination = np.zeros((b, len(labels)))
    for row, entry in zip(combination, terms, strict=True):
        row[[place[name] for name in entry]] = list(entry.values())
    if not (np.all(np.isfinite(values)) and np.all(np.isfinite(combination))):
        raise ValueError("a value or a coefficient of a term is no finite number")
    return Covariance(labels, expressions, combination, values, from_lower_triangle(lower, b))


def _labels(terms: Sequence[Mapping[str, float]], bodies: int) -> tuple[str, ...]:
    own = [f"{name}_{body + 1}" for body in range(bodies) for name in INERTIAL]
    labels = tuple(dict.fromkeys([*own, *(name for entry in terms for name in entry)]))
    if beyond := [name for name in labels[len(own) :] if _INERTIAL_LABEL.fullmatch(name)]:
        raise ValueError(f"its terms name {beyond[0]}, and the robot has {bodies} bodies")
    return labels


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


def _round_digits(x: float, digits: int) -> float:
    return float(f"{x:.{digits}g}")


@dataclass(frozen=True, eq=False)
class Misfit(Frozen):
    """Size and correlation of what the laws of a model leave of the torque of n joints."""

    size: Array  # (n,) [N.m or N] rms; NaN where torque was not held out
    length: Array  # (n,) [s] time over which it counts as one observation of a torque that is correlated as long
    cutoff: float  # [Hz] of the rows that it was measured on

    def document(self, joints: Sequence[str]) -> dict[str, Any]:
        """JSON object for model.json, without joints of unknown misfit."""
        each = zip(joints, self.size.tolist(), self.length.tolist(), strict=True)
        own = {
            name: {"rms": _round_digits(rms, MISFIT_DIGITS), "length": _round_digits(s, MISFIT_DIGITS)}
            for name, rms, s in each
            if np.isfinite(rms)
        }
        return {"cutoff": _round_digits(self.cutoff, MISFIT_DIGITS), "joints": own}


def measure_misfit(task: Task, test: Factors, value: Array) -> Misfit:
    """Misfit of base parameters `value` (b,) [units of base] on held-out rows, from factors alone."""
    period, n = task.band.factor / task.band.rate, len(test.joints)
    size, length = np.full(n, np.nan), np.full(n, np.nan)
    for j, (joint, columns) in enumerate(zip(test.joints, test.columns, strict=True)):
        if joint.counts[0]:
            c = np.append(-value[columns], 1.0)
            own = joint.grams[:, -len(c) :, -len(c) :]
            power = np.einsum("i,dij,j->d", c, own, c) / np.maximum(joint.counts, 1)  # autocovariance of the residual
            size[j], length[j] = np.sqrt(max(power[0], 0.0)), period
            if power[0] > 0:  # rows that count as one against a torque that is correlated as long
                length[j] *= 1 + 2 * np.sum(np.clip(power[1:] / power[0], -1, 1) ** 2)
    return Misfit(size, length, task.band.cutoff)


def read_misfit(content: Mapping[str, Any] | None, joints: Sequence[str]) -> Misfit | None:
    """Misfit in the content of a model.json, the object of `Misfit.document`; None if it has none."""
    if content is None:
        return None
    own = [content["joints"].get(name, {"rms": np.nan, "length": np.nan}) for name in joints]
    size, length = (np.array([float(each[key]) for each in own]) for key in ("rms", "length"))
    return Misfit(size, length, float(content["cutoff"]))
