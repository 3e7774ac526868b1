"""The base-parameter job by figaroh 1.0.2, run by its own Python: `python figaroh_regressor.py FOLDER`.

FOLDER contains robot.urdf, train.npz and test.npz (q, v, a, tau). Each line "run" on standard input runs the job once
and prints its times, until the input ends. Steps: regressor, elimination of zero columns, double QR, solution.
"""

from __future__ import annotations

import json
import logging
import sys
import time
from pathlib import Path

import numpy as np
from figaroh.identification.parameter import add_standard_additional_parameters, get_standard_parameters
from figaroh.tools.load_robot import load_robot
from figaroh.tools.qrdecomposition import QRDecomposer
from figaroh.tools.regressor import build_regressor_basic, build_regressor_reduced, get_index_eliminate

SMALL = 1e-6  # norm of a zero column, as in figaroh's examples


def main(folder: Path) -> None:
    """Answer each request with a line of JSON."""
    answers, sys.stdout = sys.stdout, sys.stderr  # output of the library must not mix with the answers
    logging.disable(logging.WARNING)
    robot = load_robot(str(folder / "robot.urdf"), package_dirs=str(folder))
    train, test = (dict(np.load(folder / f"{name}.npz")) for name in ("train", "test"))
    n = robot.model.nv
    settings = {
        "has_friction": True,
        "has_actuator_inertia": True,
        "has_joint_offset": True,
        "is_joint_torques": True,
        "is_external_wrench": False,
        "act_idxv": list(range(n)),
        "active_joints": list(robot.model.names)[1:],
        **{key: [0.0] * n for key in ("fv", "fs", "Ia", "off")},
    }
    standard = get_standard_parameters(robot.model, settings)
    standard.update(add_standard_additional_parameters(robot.model, settings))
    for _ in sys.stdin:
        start = time.perf_counter()
        whole = build_regressor_basic(robot, train["q"], train["v"], train["a"], settings)
        built = time.perf_counter()
        zero, names = get_index_eliminate(whole, standard, SMALL)
        solver = QRDecomposer()
        reduced = build_regressor_reduced(whole, zero)
        value = solver.double_decomposition(train["tau"].T.ravel(), reduced, names, standard)[3]
        done = time.perf_counter()
        seen = build_regressor_reduced(build_regressor_basic(robot, test["q"], test["v"], test["a"], settings), zero)
        predicted = (seen[:, solver.base_indices] @ value).reshape(n, -1).T
        answer = {
            "seconds": done - start,
            "regressor": built - start,
            "parameters": len(value),
            "torque": float(np.abs(predicted - test["tau"]).max() / np.abs(test["tau"]).max()),
        }
        print(json.dumps(answer), file=answers, flush=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
