"""Hand-made evidence on lost signs: small observations, problems and rivals."""

from __future__ import annotations

import numpy as np

from signid.signs.exact import RivalSigns
from signid.signs.observations import Observations
from signid.signs.problem import SignProblem
from signid.signs.samples import RefinedSigns
from signid.types import Array

LAWS = {0: ("coulomb_friction", 0), 1: ("viscous_friction", 0), 2: ("torque_offset", 0)}
T = 0.01 * np.arange(400)
INERTIA = np.sin(2 * np.pi * (T + 0.005))  # the column of a body: half periods of 50 samples


def problem(projections: list[list[float]], joints: list[int], energies: list[float] | None = None) -> SignProblem:
    b = np.array(projections)
    rank, count = b.shape
    return SignProblem(
        projections=b,
        energies=np.sum(b**2, axis=0) if energies is None else np.array(energies),
        grams=np.zeros((count, rank, rank)),
        joints=np.array(joints, dtype=np.intp),
        back=np.eye(rank),
        forward=np.eye(rank),
    )


def rivals(signs: list[list[float]], losses: list[float]) -> RivalSigns:
    return RivalSigns(np.array(signs), np.array(losses), True)


def observations(
    torque: Array, columns: Array, v: Array, laws: dict[int, tuple[str, int]] | None = None
) -> Observations:
    """Joints with unsigned torque (N, n) that depends on the same columns (N, b)."""
    count, n = torque.shape
    return Observations(
        part=np.zeros(count, dtype=np.intp),
        first=np.arange(count) == 0,
        t=0.01 * np.arange(count),
        q=np.zeros((count, n)),
        v=v,
        columns=(columns,) * n,
        seen=(np.arange(columns.shape[1], dtype=np.intp),) * n,
        count=columns.shape[1],
        joints=("shoulder", "elbow", "wrist")[:n],
        torque=np.abs(torque),
        signed=np.zeros(n, dtype=bool),
        known=np.ones(n, dtype=bool),
        steady=np.ones((count, n), dtype=bool),
        period=0.01,
        coefficients=laws or {},
        units=("N.m", "N", "N.m")[:n],
    )


def refined(signs: Array, value: list[float], sigma: float = 0.01) -> RefinedSigns:
    return RefinedSigns(signs, signs, np.array(value), np.full(signs.shape[1], sigma), 0.0, 3, 1e-12)
