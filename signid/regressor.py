"""Motion -> regressor: how torque depends on every standard parameter, by Pinocchio and by the laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pinocchio as pin

from .effects.law import coefficient_count, law_columns
from .motion import Motion
from .robot import reduced
from .types import INERTIAL, INERTIAL_UNITS, Array, Indices, Label, Law, Robot

BLOCK = 128  # samples whose regressor stays in the cache


def regressor(motion: Motion, laws: Sequence[Law] = ()) -> Array:
    """The whole regressor, (N, n, p): ten columns per body, then one per coefficient of the laws.

    Torque = regressor @ standard parameters [N.m or N]. Long motions go through `base_rows` instead.
    """
    robot = motion.robot
    rigid = np.empty((len(motion), len(robot.joints), 10 * len(robot.links)))
    for start, block in _rigid_blocks(robot.model, motion.configuration, *motion.rates):
        rigid[start : start + len(block)] = np.einsum("irk,rj->ijk", block, robot.drive)
    wide = np.zeros((len(motion), len(robot.joints), sum(coefficient_count(law) for law in laws)))
    at = 0
    for law in laws:
        rows, torque = law_columns(law, motion)
        wide[:, list(rows), at : at + torque.shape[2]] = torque
        at += torque.shape[2]
    return np.concatenate([rigid, wide], axis=2)


def labels(robot: Robot, laws: Sequence[Law] = ()) -> tuple[Label, ...]:
    """What each standard parameter is: bodies by their place in the model (1-based), laws by their joint's number."""
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


def base_rows(motion: Motion, laws: Sequence[Law], wanted: Sequence[Indices]) -> list[Array]:
    """Per joint j, the columns `wanted[j]` of the regressor's rows of that joint: (N, m_j) each.

    Args:
        motion: N samples.
        laws: as given to `labels`.
        wanted: per joint, indices (m_j,) of standard parameters, ascending.
    """
    rigid = 10 * len(motion.robot.links)
    out = [np.empty((len(motion), len(columns))) for columns in wanted]
    split = [int(np.searchsorted(columns, rigid)) for columns in wanted]
    _fill_rigid(motion, [columns[:k] for columns, k in zip(wanted, split, strict=True)], out)
    at, taken = rigid, [(j, i) for j in range(len(wanted)) for i in range(split[j], len(wanted[j]))]
    for law in laws:
        count = coefficient_count(law)
        ours = [(j, i) for j, i in taken if 0 <= wanted[j][i] - at < count]
        if ours:
            rows, torque = law_columns(law, motion)
            for j, i in ours:
                out[j][:, i] = torque[:, rows.index(j), wanted[j][i] - at] if j in rows else 0.0
        at += count
    return out


class _Bodies(NamedTuple):
    """The bodies that move, and where their rows and columns stand in the whole model's regressor."""

    model: Any
    states: tuple[Array, Array, Array]  # (N, nq) [rad, m or 1], (N, nv) [rad/s or m/s], (N, nv) [rad/s2 or m/s2]
    rows: Indices  # (nv,)
    columns: Indices  # (10 nb,)


def _fill_rigid(motion: Motion, wanted: Sequence[Indices], out: Sequence[Array]) -> None:
    """The first columns of `out`, per joint (N, m_j): those of the bodies' inertial parameters."""
    part, drive = _bodies(motion, wanted), motion.robot.drive
    pairs = [(int(row), j) for j in range(len(wanted)) for row in np.flatnonzero(drive[:, j])]
    inside = [np.searchsorted(part.columns, columns) for columns in wanted]
    width, row_of = len(part.columns), {int(row): k for k, row in enumerate(part.rows)}
    places = np.concatenate([row_of[row] * width + inside[j] for row, j in pairs])
    ends = np.cumsum([len(wanted[j]) for _, j in pairs])[:-1]
    for start, block in _rigid_blocks(part.model, *part.states):
        stop, begun = start + len(block), set[int]()
        taken = np.split(block.reshape(len(block), -1).take(places, axis=1), ends, axis=1)
        for (row, j), columns in zip(pairs, taken, strict=True):
            mine = out[j][start:stop, : len(wanted[j])]
            share = columns if drive[row, j] == 1 else columns * drive[row, j]
            mine[...] = mine + share if j in begun else share
            begun.add(j)


def _bodies(motion: Motion, wanted: Sequence[Indices]) -> _Bodies:
    """The model without the joints that are held fixed, unless a column of a body that one carries is wanted."""
    model, q, (v, a) = motion.robot.model, motion.configuration, motion.rates
    spans = [(joint.idx_q, joint.nq, joint.idx_v, joint.nv) for joint in list(model.joints)[1:]]
    moves = np.array([bool(motion.robot.drive[v0 : v0 + nv].any()) for _, _, v0, nv in spans])
    if not len(motion) or not moves[np.concatenate(wanted) // 10].all():
        moves[:] = True
    kept = [span for span, moving in zip(spans, moves, strict=True) if moving]
    slim = model if moves.all() else reduced(model, [int(k) + 1 for k in np.flatnonzero(~moves)], q[0])
    places = np.concatenate([np.arange(q0, q0 + nq) for q0, nq, _, _ in kept])
    rows = np.concatenate([np.arange(v0, v0 + nv) for _, _, v0, nv in kept])
    return _Bodies(slim, (q[:, places], v[:, rows], a[:, rows]), rows, np.flatnonzero(np.repeat(moves, 10)))


def _rigid_blocks(model: Any, q: Array, v: Array, a: Array) -> Iterator[tuple[int, Array]]:
    """Pinocchio's regressor in the model's own rows, a block (k, nv, 10 nb) at a time; the buffer is used again."""
    data, compute = model.createData(), pin.computeJointTorqueRegressor
    buffer = np.empty((min(BLOCK, len(q)), model.nv, 10 * (model.njoints - 1)))
    for start in range(0, len(q), BLOCK):
        states = zip(q[start : start + BLOCK], v[start : start + BLOCK], a[start : start + BLOCK], strict=True)
        count = 0
        for count, state in enumerate(states, 1):
            buffer[count - 1] = compute(model, data, *state)
        yield start, buffer[:count]
