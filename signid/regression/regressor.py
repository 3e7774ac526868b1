"""Motion -> regressor: columns of all standard parameters, from Pinocchio and from the laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from ..effects.law import coefficient_count, law_columns
from ..robot import weld
from ..types import INERTIAL, INERTIAL_UNITS, Array, Indices, Label, Law, Robot
from .filters import Decimator
from .motion import Motion


def regressor(motion: Motion, laws: Sequence[Law] = ()) -> Array:
    """Full regressor (N, n, p): ten columns per body, then one per coefficient of the laws.

    Torque = regressor @ standard parameters [N.m or N]. For long motions `base_rows` takes less memory.
    """
    robot = motion.robot
    rigid = motion.bodies.reshape(len(motion), len(robot.joints), 10 * len(robot.links))
    wide = np.zeros((len(motion), len(robot.joints), sum(coefficient_count(law) for law in laws)))
    at = 0
    for law in laws:
        rows, torque = law_columns(law, motion)
        wide[:, list(rows), at : at + torque.shape[2]] = torque
        at += torque.shape[2]
    return np.concatenate([rigid, wide], axis=2)


def labels(robot: Robot, laws: Sequence[Law] = ()) -> tuple[Label, ...]:
    """Label of each standard parameter: bodies by their index in the model (from 1), laws by their joint's number."""
    found = [
        Label(f"{name}_{body + 1}", unit, body=body)
        for body in range(len(robot.links))
        for name, unit in zip(INERTIAL, INERTIAL_UNITS, strict=True)
    ]
    for k, law in enumerate(laws):
        where = "_".join(str(robot.numbers[j]) for j in law.joints)
        coefficients = law.effect.linear()
        for key, coefficient in coefficients.items():
            name = law.effect.name if len(coefficients) == 1 else f"{law.effect.name}.{key}"
            joint = law.joints[0]
            unit = coefficient.unit_at(bool(robot.prismatic[joint]))
            found.append(Label(f"{name}_{where}", unit, law=k, joint=joint, positive=coefficient.positive))
    return tuple(found)


def base_rows(
    motion: Motion,
    laws: Sequence[Law],
    wanted: Sequence[Indices],
    thin: Decimator | None = None,
    sparse: tuple[Motion, Decimator] | None = None,
) -> list[Array]:
    """Columns `wanted[j]` (N, m_j) of the regressor's rows of each joint j: indices of standard parameters, ascending.

    The filter `thin` decimates the columns, which then are (M, m_j). The columns of bodies are computed from `sparse`,
    a decimated motion and its filter for the same rows, if there is one.
    """
    thin, rigid = thin or Decimator(np.ones(1), 1), 10 * len(motion.robot.links)
    split = [int(np.searchsorted(columns, rigid)) for columns in wanted]
    inertial = [columns[:k] for columns, k in zip(wanted, split, strict=True)]
    bodies = _rigid_rows(*(sparse or (motion, thin)), inertial)
    further = _law_rows(motion, laws, [columns[k:] - rigid for columns, k in zip(wanted, split, strict=True)])
    parts = np.split(thin(np.concatenate(further, axis=1)), _ends(further), axis=1)
    return [np.concatenate(pair, axis=1) for pair in zip(bodies, parts, strict=True)]


def _law_rows(motion: Motion, laws: Sequence[Law], wanted: Sequence[Indices]) -> list[Array]:
    """Columns (N, m_j) of the laws' coefficients for each joint; coefficients are counted from 0."""
    out = [np.zeros((len(motion), len(columns))) for columns in wanted]
    at, taken = 0, [(j, i) for j, columns in enumerate(wanted) for i in range(len(columns))]
    for law in laws:
        count = coefficient_count(law)
        ours = [(j, i) for j, i in taken if 0 <= wanted[j][i] - at < count]
        if ours:
            rows, torque = law_columns(law, motion)
            for j, i in ours:
                if j in rows:
                    out[j][:, i] = torque[:, rows.index(j), wanted[j][i] - at]
        at += count
    return out


class _Bodies(NamedTuple):
    """Moving bodies, and the places of their rows and columns in the regressor of the whole model."""

    model: Any
    states: tuple[Array, Array, Array]  # (N, nq) [rad, m or 1], (N, nv) [rad/s or m/s], (N, nv) [rad/s2 or m/s2]
    rows: Indices  # (nv,)
    columns: Indices  # (10 nb,)


def _rigid_rows(motion: Motion, thin: Decimator, wanted: Sequence[Indices]) -> list[Array]:
    """Columns (M, m_j) of the bodies' inertial parameters for each joint."""
    part, drive = _bodies(motion, wanted), motion.robot.drive
    pairs = [(int(row), j) for j in range(len(wanted)) for row in np.flatnonzero(drive[:, j])]
    inside = [np.searchsorted(part.columns, columns) for columns in wanted]
    width, row_of = len(part.columns), {int(row): k for k, row in enumerate(part.rows)}
    places = [row_of[row] * width + inside[j] for row, j in pairs]
    found = thin.gather(_rigid_blocks(part, np.concatenate(places), thin.segment), len(motion), sum(map(len, places)))
    out: list[Array] = [np.zeros(0)] * len(wanted)
    for (row, j), columns in zip(pairs, np.split(found, _ends(places), axis=1), strict=True):
        share = columns if drive[row, j] == 1 else columns * drive[row, j]
        out[j] = out[j] + share if out[j].ndim == 2 else share
    return out


def _ends(parts: Sequence[Array | Indices]) -> list[int]:
    """Ends of parts that are concatenated along their last axis, without the last end."""
    return [int(end) for end in np.cumsum([part.shape[-1] for part in parts])[:-1]]


def _bodies(motion: Motion, wanted: Sequence[Indices]) -> _Bodies:
    """Model without its fixed joints, unless a column of a body that one of them carries is wanted."""
    model, q, (v, a) = motion.robot.model, motion.configuration, motion.rates
    spans = [(joint.idx_q, joint.nq, joint.idx_v, joint.nv) for joint in list(model.joints)[1:]]
    moves = np.array([bool(motion.robot.drive[v0 : v0 + nv].any()) for _, _, v0, nv in spans])
    if not len(motion) or not moves[np.concatenate(wanted) // 10].all():
        moves[:] = True
    kept = [span for span, moving in zip(spans, moves, strict=True) if moving]
    slim = model if moves.all() else weld(model, [int(k) + 1 for k in np.flatnonzero(~moves)], q[0])
    places = np.concatenate([np.arange(q0, q0 + nq) for q0, nq, _, _ in kept])
    rows = np.concatenate([np.arange(v0, v0 + nv) for _, _, v0, nv in kept])
    return _Bodies(slim, (q[:, places], v[:, rows], a[:, rows]), rows, np.flatnonzero(np.repeat(moves, 10)))


def _rigid_blocks(part: _Bodies, places: Indices, size: int) -> Iterator[Array]:
    """Entries `places` (c,) of Pinocchio's flattened regressor, as blocks (k, c) of k = `size` samples.

    All blocks share one buffer.
    """
    model, data, compute = part.model, part.model.createData(), pin.computeJointTorqueRegressor
    q, v, a = part.states
    buffer = np.empty((min(size, len(q)), len(places)))
    for start in range(0, len(q), size):
        states = zip(q[start : start + size], v[start : start + size], a[start : start + size], strict=True)
        count = 0
        for count, state in enumerate(states, 1):
            compute(model, data, *state).take(places, out=buffer[count - 1], mode="clip")
        yield buffer[:count]
