"""Torque of a held-out motion by figaroh 1.0.2, run by its own Python: `python figaroh_torque.py`.

Each line on standard input names a folder with job.npz and robot.urdf; predicted.npy is written there. figaroh filters,
differentiates and decimates the recordings in the given band. It fits base parameters with friction, rotors and offsets
by weighted least squares and predicts the torque of the held-out motion.
"""

from __future__ import annotations

import logging
import tempfile
import time
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from answers import answer_each  # next to this file, which runs as a script
from figaroh.data.trajectory import JOINT_FORCE, JOINT_TORQUE, TrajectoryData
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.load_robot import load_robot
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced

ORDER, MOST, PASSED = 4, 10, 0.4  # filter order, largest decimation, passband over the decimated rate [1]


class Identification(BaseIdentification):
    """Identification from arrays, with masked samples between the recordings and at their ends."""

    job: dict[str, Any] = {}

    def load_trajectory_data(self, data_source: str | None = None) -> TrajectoryData:
        """Return the concatenated recordings."""
        job, kinds = self.job, np.where(self.job["prismatic"], JOINT_FORCE, JOINT_TORQUE).tolist()
        units = np.where(job["prismatic"], "N", "N.m").tolist()
        names = job["joints"].tolist()
        return TrajectoryData(job["t"], names, job["q"], job["tau"], kinds, units, mask=job["counts"])


def settings(job: dict[str, Any]) -> dict[str, Any]:
    """Unified configuration of figaroh."""
    joints, n = job["joints"].tolist(), len(job["joints"])
    mechanics = {
        "reduction_ratios": [1.0] * n,
        "friction_coefficients": {"viscous": [0.0] * n, "static": [0.0] * n},
        "actuator_inertias": [0.0] * n,
        "joint_offsets": [0.0] * n,
    }
    problem = {
        "use_joint_torques": True,
        "model_components": {"friction": True, "actuator_inertia": True, "joint_offset": True},
    }
    signals = {
        "sampling_frequency": float(1 / (job["t"][1] - job["t"][0])),
        "cutoff_frequency": float(job["position_cutoff"]),
        "filter_order": ORDER,
    }
    task = {"enabled": True, "problem": problem, "signal_processing": signals}
    properties = {"joints": {"active_joints": joints}, "mechanics": mechanics}
    return {"robot": {"name": "arm", "properties": properties}, "tasks": {"identification": task}}


def predict(folder: Path) -> dict[str, Any]:
    """Run one job."""
    job = Identification.job = dict(np.load(folder / "job.npz"))
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        yaml.safe_dump(settings(job), file)
        file.flush()
        start = time.process_time()
        robot = load_robot(str(folder / "robot.urdf"), package_dirs=str(folder))
        if list(robot.model.names)[1:] != job["joints"].tolist() or robot.model.nq != robot.model.nv:
            raise ValueError("figaroh reads other joints from the description")
        found = Identification(robot, file.name)
        places = list(range(robot.model.nv))
        found.identif_config.update(act_idxq=places, act_idxv=places, nb_samples=len(job["t"]))
        found.initialize()
        factor = min(MOST, int(PASSED / (job["t"][1] - job["t"][0]) / job["cutoff"]))
        found.solve(decimate=factor > 1, decimation_factor=max(factor, 1), plotting=False, wls=True)
        seconds = time.process_time() - start
    motion = (job[f"held_out_{key}"] for key in "qva")
    rows = build_regressor_reduced(build_regressor_basic(robot, *motion, found.identif_config), found._idx_eliminated)
    predicted = (rows[:, found._base_indices] @ found.phi_base).reshape(len(places), -1).T
    np.save(folder / "predicted.npy", predicted)
    return {"seconds": seconds, "note": f"{len(found.phi_base)} base parameters"}


def main() -> None:
    """Answer until the input ends."""
    logging.disable(logging.CRITICAL)
    warnings.filterwarnings("ignore")
    answer_each("figaroh", predict)


if __name__ == "__main__":
    main()
