"""Base parameters and report of figaroh 1.0.2, run by its own Python: `python figaroh_report.py`.

Each line on standard input names a folder with job.npz and robot.urdf; the answer is a line of JSON. The job follows
figaroh's UR10 example: a subclass provides the recording (ends masked, where filters have not settled), the second
motion is validation data, the estimator is weighted least squares. The model has friction, rotors and offsets with
their true values stated. The cut-off has the smallest error on the healthy robot.
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
from figaroh.data.trajectory import JOINT_TORQUE, TrajectoryData
from figaroh.identification.base_identification import BaseIdentification
from figaroh.tools.load_robot import load_robot

CUTOFF, ORDER, DECIMATION = 8.0, 4, 10  # cut-off of positions [Hz], filter order, decimation factor
EDGE = 2.0  # masked time at both ends [s]


class Identification(BaseIdentification):
    """Identification from arrays."""

    job: dict[str, Any] = {}

    def load_trajectory_data(self, data_source: str | None = None) -> TrajectoryData:
        """Return the first recording, or the second one if a source is named."""
        t, q, tau = (self.job[("test_" if data_source else "") + key] for key in ("t", "q", "tau"))
        inside = (t >= t[0] + EDGE) & (t <= t[-1] - EDGE)
        return TrajectoryData(t, self.job["joints"].tolist(), q, tau, JOINT_TORQUE, "N.m", mask=inside)


def settings(job: dict[str, Any]) -> dict[str, Any]:
    """Unified configuration of figaroh."""
    drives = {"viscous": job["damping"].tolist(), "static": job["frictionloss"].tolist()}
    joints, n = job["joints"].tolist(), len(job["joints"])
    mechanics = {
        "reduction_ratios": [1.0] * n,
        "friction_coefficients": drives,
        "actuator_inertias": job["armature"].tolist(),
        "joint_offsets": [0.0] * n,
    }
    problem = {
        "use_joint_torques": True,
        "model_components": {"friction": True, "actuator_inertia": True, "joint_offset": True},
    }
    rate = float(round(1 / (job["t"][1] - job["t"][0])))
    signals = {"sampling_frequency": rate, "cutoff_frequency": CUTOFF, "filter_order": ORDER}
    task = {
        "enabled": True,
        "problem": problem,
        "signal_processing": signals,
        "data": {"validation_data_file": "second motion"},
    }
    properties = {"joints": {"active_joints": joints}, "mechanics": mechanics}
    return {"robot": {"name": "arm", "properties": properties}, "tasks": {"identification": task}}


def identify(folder: Path) -> tuple[Any, float]:
    """Run one job; also return its processor time [s]."""
    job = Identification.job = dict(np.load(folder / "job.npz"))
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        yaml.safe_dump(settings(job), file)
        file.flush()
        start = time.process_time()
        robot = load_robot(str(folder / "robot.urdf"), package_dirs=str(folder))
        found = Identification(robot, file.name)
        places = list(range(robot.model.nv))
        found.identif_config.update(act_idxq=places, act_idxv=places, nb_samples=len(job["t"]))
        found.initialize()
        found.solve(decimate=True, decimation_factor=DECIMATION, plotting=False, wls=True)
    return found, time.process_time() - start


def report(folder: Path) -> dict[str, Any]:
    """Figures and insights of the report of one job."""
    found, seconds = identify(folder)
    errors = found.result["validation_metrics"]
    return {
        "rmse": float(found.rms_error),
        "held_out": float(errors["rmse_identified"]),
        "joints": {name: float(one["rmse_identified"]) for name, one in errors["per_joint"].items()},
        "insights": list(found.verify().insights),
        "seconds": seconds,
    }


def main() -> None:
    """Answer until the input ends."""
    logging.disable(logging.CRITICAL)
    warnings.filterwarnings("ignore")
    answer_each("figaroh", report)


if __name__ == "__main__":
    main()
