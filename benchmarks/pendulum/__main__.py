"""Identification of a pendulum with and without the signs of its torque: `python -m benchmarks.pendulum`.

PyBullet swings robots/1r under PD along random motions; position and torque are logged at 50 Hz. Velocity and
acceleration come from differences, filtered as Pennese and Vulcano do (Robotics II project, Sapienza University of
Rome, 2020), or from signid's own filters.
"""

from __future__ import annotations

import argparse
import json
import os
import platform
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pybullet
from rich.console import Console

from signid.robot import load_robot

from .bullet import BITS, NOISE, Pendulum, log, record
from .signs import Signs
from .summary import show_rows, show_signs, summarise
from .trial import LOGS, TRUTH, Trial, read_log, restore, trials

MOTIONS = 40
LOG_TARGET = 1e-4  # upper bound on the coefficient error (norm) from a log


def main() -> None:
    """Record, identify, print the tables and write the numbers; exit with 1 when a target is missed."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.pendulum", description=__doc__)
    parser.add_argument("--motions", type=int, default=MOTIONS, help="number of motions (%(default)s)")
    parser.add_argument("--bits", type=int, default=BITS, help="encoder bits per turn (%(default)s)")
    parser.add_argument("--noise", type=float, default=NOISE, help="torque noise over rms torque (%(default)s)")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers to FILE as JSON")
    options = parser.parse_args()
    robot, pendulum, console = load_robot("1r"), Pendulum(), Console()
    done: list[Trial] = []
    signs: dict[str, list[Signs]] = {f"{options.motions} motions": []}
    for motion in range(options.motions):
        true = record(pendulum, motion)
        logged = log(true, motion, options.bits, options.noise)
        restored, got = restore(logged, true)
        signs[f"{options.motions} motions"].append(got)
        done += trials(robot, motion, logged, restored)
    rows, errors = list(summarise(done, pendulum.truth)), {}
    for name in LOGS if os.environ.get("SIGNID_DATA") else ():
        value, got = read_log(Path(os.environ["SIGNID_DATA"]) / "seed_penne" / f"{name}.csv.gz")
        signs[name] = [got]
        errors[name] = float(np.linalg.norm(value - TRUTH))
    console.print(show_rows(rows))
    console.print(show_signs(signs))
    for name, error in errors.items():
        console.print(f"{name}: coefficient error without signs {error:.2g} (norm)", highlight=False)
    if options.json:
        machine = {"python": platform.python_version(), "pybullet": pybullet.getAPIVersion()}
        document = {"machine": machine, "rows": rows, "trials": done, "signs": signs, "log_errors": errors}
        options.json.write_text(json.dumps(document, default=asdict, indent=1), encoding="utf-8")
    met = all(item.holds for group in (rows, *signs.values()) for item in group)
    raise SystemExit(0 if met and all(error < LOG_TARGET for error in errors.values()) else 1)


if __name__ == "__main__":
    main()
