"""Motion -> regressor: how torque depends on every standard parameter, by Pinocchio and by the laws."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import pinocchio as pin

from .effects.law import coefficient_count, law_columns
from .motion import Motion
from .types import INERTIAL, INERTIAL_UNITS, Array, Indices, Label, Law, Robot

BLOCK = 1000  # samples whose regressor stays in the cache


def regressor(motion: Motion, laws: Sequence[Law] = ()) -> Array:
    """The whole regressor, (N, n, p): ten columns per body, then one per coefficient of the laws.

    Torque = regressor @ standard parameters [N.m or N]. Long motions go through `base_rows` instead.
    """
    robot = motion.robot
    rigid = np.empty((len(motion), len(robot.joints), 10 * len(robot.links)))
    for start, block in _rigid_blocks(motion):
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
    robot, rigid = motion.robot, 10 * len(motion.robot.links)
    out = [np.empty((len(motion), len(columns))) for columns in wanted]
    split = [int(np.searchsorted(columns, rigid)) for columns in wanted]
    driven = [np.flatnonzero(robot.drive[:, j]) for j in range(len(robot.joints))]
    for start, block in _rigid_blocks(motion):
        for j, columns in enumerate(wanted):
            first, *rest = driven[j]
            part = block[:, first].take(columns[: split[j]], axis=1)
            part = part * robot.drive[first, j] if robot.drive[first, j] != 1 else part
            for r in rest:
                part = part + robot.drive[r, j] * block[:, r].take(columns[: split[j]], axis=1)
            out[j][start : start + len(block), : split[j]] = part
    at = rigid
    for law in laws:
        count = coefficient_count(law)
        taken = [(j, i) for j in range(len(wanted)) for i in range(split[j], len(wanted[j]))]
        ours = [(j, i) for j, i in taken if 0 <= wanted[j][i] - at < count]
        if ours:
            rows, torque = law_columns(law, motion)
            for j, i in ours:
                out[j][:, i] = torque[:, rows.index(j), wanted[j][i] - at] if j in rows else 0.0
        at += count
    return out


def _rigid_blocks(motion: Motion) -> Iterator[tuple[int, Array]]:
    """Pinocchio's regressor in the model's own rows, a block (k, nv, 10 nb) at a time; the buffer is used again."""
    model, data, compute = motion.robot.model, motion.robot.model.createData(), pin.computeJointTorqueRegressor
    states = list(zip(motion.configuration, *motion.rates, strict=True))
    buffer = np.empty((min(BLOCK, len(states)), model.nv, 10 * len(motion.robot.links)))
    for start in range(0, len(states), BLOCK):
        piece = states[start : start + BLOCK]
        for i, (q, v, a) in enumerate(piece):
            buffer[i] = compute(model, data, q, v, a)
        yield start, buffer[: len(piece)]
