"""Staubli TX40 of figaroh: positions and torques of its motors, without time stamps."""

from __future__ import annotations

import numpy as np

from .base import DataSet, Product
from .convert import by_joint, read_numbers, without_meshes, write_table

FOLDER = "examples/staubli_TX40"
STEP = 2e-4  # [s]
RATIO = np.array([32.0, 32.0, 45.0, -48.0, 45.0, 32.0])  # gear ratios; motor 6 also turns with joint 5
OFFSET = np.array([0, -np.pi / 2, np.pi / 2, 0, 0, 0])  # [rad]


def _recording(positions: bytes, torques: bytes) -> str:
    """Recording at the joints; without a matrix product, so digits do not depend on the BLAS library."""
    motor, current = read_numbers(positions, skip=1), read_numbers(torques, skip=1)
    q, tau = motor * (1 / RATIO), current * RATIO
    q[:, 5] -= motor[:, 4] * (1 / RATIO[4])
    tau[:, 4] += current[:, 5] * RATIO[5]
    columns = {"t": np.arange(len(q), dtype=np.float64) * STEP, **by_joint("q", q + OFFSET), **by_joint("tau", tau)}
    return write_table({**columns, **by_joint("q_motor", motor), **by_joint("current", current)}, digits=7)


PLUGIN = DataSet(
    name="tx40",
    title="Staubli TX40, motor torques, coupled wrist, 5 kHz",
    folder="staubli_tx40",
    seconds=9,
    repository="thanhndv212/figaroh-examples",
    commit="c0b5c7f0fda10078be55104f9ee76ac106b7a5ee",
    licence="Apache-2.0 (stated in its program files)",
    cite="Nguyen, Bonnet, Sabbah, Gautier, Fernbach and others, FIGAROH, IEEE-RAS Humanoids, 2023",
    megabytes=5,
    products=(
        Product(
            "exciting_traj.csv.gz",
            (f"{FOLDER}/data/pos_read_data.csv", f"{FOLDER}/data/curr_data.csv"),
            _recording,
            "4b0ba4d6c95e04870101dc6c96a530ffbe141b2470a3a4191f9d0df5a1b5586b",
        ),
        Product(
            "tx40.urdf",
            (f"{FOLDER}/urdf/tx40_mdh_modified.urdf",),
            without_meshes,
            "bdbe0ad7dab085348f20a003af6e585172a6bbe3e1b7a4f65dd86f2a59f2f385",
        ),
    ),
)
