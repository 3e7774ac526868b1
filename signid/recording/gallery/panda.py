"""Franka Panda of Gaz et al.: text with seven numbers per sample."""

from __future__ import annotations

from .base import DataSet, Product
from .convert import by_joint, read_numbers, write_table

LOG = "matlab/data/Exciting_Traj/Trajectory_1/rbt_log/exciting_traj_{}.txt"


def _recording(*raw: bytes) -> str:
    time, *parts = (read_numbers(part) for part in raw)
    columns = {"t": time[:, 0]}
    for kind, values in zip(("q", "dq", "tau"), parts, strict=True):
        columns |= by_joint(kind, values.reshape(-1, 7))
    return write_table(columns)


PLUGIN = DataSet(
    name="panda",
    title="Franka Panda, torque sensors behind the gears, 1 kHz",
    folder="panda_gaz2019",
    seconds=21,
    repository="marcocognetti/FrankaEmikaPandaDynModel",
    commit="24d85ce4e648e2e894c832bfeee9b16711eb1a1a",
    licence="GPL-3.0",
    cite="Gaz, Cognetti, Oliva, Robuffo Giordano, De Luca, IEEE Robotics and Automation Letters 4(4), 2019",
    megabytes=4.1,
    products=(
        Product(
            "exciting_traj_1.csv.gz",
            tuple(LOG.format(part) for part in ("time", "positions", "velocity", "torques")),
            _recording,
            "edea80d89d487dfd7c95a151a2b8e3745e7ad7693a1bc25d52bcefe323fa9303",
        ),
    ),
    carried=(("panda.urdf", "panda/arm.urdf"),),
)
