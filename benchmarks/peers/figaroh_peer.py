"""figaroh 1.0.2, run by its own Python: `python figaroh_peer.py report` or `python figaroh_peer.py torque`.

Each line on standard input names a folder with job.npz and robot.urdf; the answer is a line of JSON. The job follows
figaroh's UR10 example: a subclass provides the recording (ends masked, where filters have not settled), the estimator
is weighted least squares of base parameters with friction, rotors and offsets.

report: the second motion is validation data, friction, rotors and offsets are stated with their true values, and the
cut-off has the smallest error on the healthy robot. torque: figaroh filters, differentiates and decimates the
recordings in the given band; the torque of a held-out motion is written to predicted.npy.
"""

from __future__ import annotations

import logging
import sys
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

ORDER = 4  # of the filter
CUTOFF, DECIMATION, EDGE = 8.0, 10, 2.0  # report: cut-off of positions [Hz], decimation, masked time at both ends [s]
MOST, PASSED = 10, 0.4  # torque: largest decimation, passband over the decimated rate [1]


class Identification(BaseIdentification):
    """Identification from arrays."""

    job: dict[str, Any] = {}

    def load_trajectory_data(self, data_source: str | None = None) -> TrajectoryData:
        """Return the recordings in one with their mask, or the first or (if a source is named) second recording."""
        job = self.job
        names = job["joints"].tolist()
        if "counts" in job:
            kinds = np.where(job["prismatic"], JOINT_FORCE, JOINT_TORQUE).tolist()
            units = np.where(job["prismatic"], "N", "N.m").tolist()
            return TrajectoryData(job["t"], names, job["q"], job["tau"], kinds, units, mask=job["counts"])
        t, q, tau = (job[("test_" if data_source else "") + key] for key in ("t", "q", "tau"))
        inside = (t >= t[0] + EDGE) & (t <= t[-1] - EDGE)
        return TrajectoryData(t, names, q, tau, JOINT_TORQUE, "N.m", mask=inside)


def settings(job: dict[str, Any], rate: float, cutoff: float, more: dict[str, Any]) -> dict[str, Any]:
    """Unified configuration of figaroh; drives that are not stated are zero."""
    joints, zero = job["joints"].tolist(), np.zeros(len(job["joints"]))
    stated = {key: job.get(key, zero).tolist() for key in ("damping", "frictionloss", "armature")}
    mechanics = {
        "reduction_ratios": [1.0] * len(joints),
        "friction_coefficients": {"viscous": stated["damping"], "static": stated["frictionloss"]},
        "actuator_inertias": stated["armature"],
        "joint_offsets": zero.tolist(),
    }
    components = {"friction": True, "actuator_inertia": True, "joint_offset": True}
    signals = {"sampling_frequency": rate, "cutoff_frequency": cutoff, "filter_order": ORDER}
    problem = {"use_joint_torques": True, "model_components": components}
    task = {"enabled": True, "problem": problem, "signal_processing": signals, **more}
    properties = {"joints": {"active_joints": joints}, "mechanics": mechanics}
    return {"robot": {"name": "arm", "properties": properties}, "tasks": {"identification": task}}


def identify(folder: Path, configuration: dict[str, Any], factor: int) -> tuple[Any, Any, float]:
    """Run one job: identification, robot, processor time [s].

    Raises:
        ValueError: figaroh reads other joints from the description.
    """
    job = Identification.job
    with tempfile.NamedTemporaryFile("w", suffix=".yaml", encoding="utf-8") as file:
        yaml.safe_dump(configuration, file)
        file.flush()
        start = time.process_time()
        robot = load_robot(str(folder / "robot.urdf"), package_dirs=str(folder))
        if list(robot.model.names)[1:] != job["joints"].tolist() or robot.model.nq != robot.model.nv:
            raise ValueError("figaroh reads other joints from the description")
        found = Identification(robot, file.name)
        places = list(range(robot.model.nv))
        found.identif_config.update(act_idxq=places, act_idxv=places, nb_samples=len(job["t"]))
        found.initialize()
        found.solve(decimate=factor > 1, decimation_factor=factor, plotting=False, wls=True)
    return found, robot, time.process_time() - start


def report(folder: Path) -> dict[str, Any]:
    """Figures and insights of the report of one job."""
    job = Identification.job = dict(np.load(folder / "job.npz"))
    rate = float(round(1 / (job["t"][1] - job["t"][0])))
    validation = {"data": {"validation_data_file": "second motion"}}
    found, _, seconds = identify(folder, settings(job, rate, CUTOFF, validation), DECIMATION)
    errors = found.result["validation_metrics"]
    return {
        "rmse": float(found.rms_error),
        "held_out": float(errors["rmse_identified"]),
        "joints": {name: float(one["rmse_identified"]) for name, one in errors["per_joint"].items()},
        "insights": list(found.verify().insights),
        "seconds": seconds,
    }


def predict(folder: Path) -> dict[str, Any]:
    """Torque of the held-out motion of one job."""
    job = Identification.job = dict(np.load(folder / "job.npz"))
    step = job["t"][1] - job["t"][0]
    factor = max(min(MOST, int(PASSED / step / job["cutoff"])), 1)
    found, robot, seconds = identify(folder, settings(job, float(1 / step), float(job["position_cutoff"]), {}), factor)
    motion = (job[f"held_out_{key}"] for key in "qva")
    whole = build_regressor_basic(robot, *motion, found.identif_config)
    rows = build_regressor_reduced(whole, found._idx_eliminated)
    predicted = rows[:, found._base_indices] @ found.phi_base
    np.save(folder / "predicted.npy", predicted.reshape(len(job["joints"]), -1).T)
    return {"seconds": seconds, "note": f"{len(found.phi_base)} base parameters"}


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    warnings.filterwarnings("ignore")
    answer_each("figaroh", {"report": report, "torque": predict}[sys.argv[1]])
