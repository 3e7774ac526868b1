"""Record the 3R arm in MuJoCo and write its true parameters: `python -m benchmarks.record_3r`.

Results are reproducible: the seeds are fixed.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from pathlib import Path

import mujoco
import numpy as np
import polars as pl

from .plants.mujoco_ import STEP, Body, Drives, draw_motion, inertials, log, simulate

FOLDER = Path(__file__).parents[1] / "robots" / "3r"
JOINTS = 3
HEAVIER = {"link_3": 1.1}  # factor on the URDF's mass and inertia of the last link [1]
DRIVES = Drives(
    armature=(0.12, 0.10, 0.03),
    viscous_friction=(0.60, 0.50, 0.20),
    coulomb_friction=(0.90, 0.80, 0.30),
    torque_offset=(0.05, -0.12, 0.04),
)
CENTRE = (0.0, 0.3, 0.5)  # centre of the motions [rad]
RATE, BITS, NOISE = 250.0, 17, 0.02  # rate [Hz], encoder bits per turn, torque noise over each joint's rms torque [1]
RECORDINGS = {"recording": (24.0, 1), "held_out": (12.0, 2)}  # file -> duration [s], seed of motion and of noise
UNITS = {"armature": "kg.m2", "viscous_friction": "N.m.s/rad", "coulomb_friction": "N.m", "torque_offset": "N.m"}
ROWS, COLUMNS = (0, 0, 1, 0, 1, 2), (0, 1, 1, 2, 2, 2)  # entries of a symmetric matrix in Pinocchio's order


def record(folder: Path = FOLDER) -> None:
    """Write recording.parquet, held_out.parquet and truth.toml next to robot.urdf in a folder."""
    body = read_body(folder / "robot.urdf")
    for name, (duration, seed) in RECORDINGS.items():
        track = simulate(body, DRIVES, draw_motion(CENTRE, seed), duration, RATE)
        columns = log(track, seed, BITS, NOISE)
        table = pl.DataFrame({key: np.round(x, 6 if key.startswith("q") else 5) for key, x in columns.items()})
        table.write_parquet(folder / f"{name}.parquet", compression="zstd", compression_level=15)
    (folder / "truth.toml").write_text("\n".join(truth_lines(body)) + "\n", encoding="utf-8")


def read_body(path: Path) -> Body:
    """The URDF's arm with a heavier last link."""
    return Body(path.read_text(encoding="utf-8"), tuple(f"joint_{j + 1}" for j in range(JOINTS)), HEAVIER)


def truth_lines(body: Body) -> Iterator[str]:
    """Lines of truth.toml: recording conditions, then true parameters of each joint and link in SI units."""
    yield "# True parameters of the arm in recording.parquet and held_out.parquet; robot.urdf differs on purpose."
    yield "# Link 3 is 10 % heavier than robot.urdf states (mass and inertia, same centre); it states no drives."
    yield "[made]"
    yield 'by = "python -m benchmarks.record_3r"'
    yield f'simulator = "MuJoCo {mujoco.__version__}, implicitfast, steps of {STEP:g} s"'
    yield 'control = "PD at 8 Hz, feed-forward of 0.9 times the dynamics that robot.urdf states, without friction"'
    yield 'torque = "motor torque at the moment of the position, plus white noise"'
    yield f"rate = {RATE:g}  # Hz"
    yield f"encoder_bits = {BITS}"
    yield f"torque_noise = {NOISE:g}  # of each joint's rms torque"
    for name, (duration, seed) in RECORDINGS.items():
        yield f"{name} = {{ duration = {duration:g}, seed = {seed} }}  # s"
    for j, joint in enumerate(body.joints):
        yield f"\n[joint.{joint}]"
        for key, unit in UNITS.items():
            yield f"{key} = {getattr(DRIVES, key)[j]:g}  # {unit}"
    for link, (mass, moment, inertia) in inertials(body).items():
        yield f"\n[link.{link}]  # first moment and inertia about the frame of its joint"
        yield f"mass = {mass:.9g}  # kg"
        yield f"first_moment = [{_numbers(moment)}]  # kg.m"
        yield f"inertia = [{_numbers(inertia[ROWS, COLUMNS])}]  # kg.m2: Ixx, Ixy, Iyy, Ixz, Iyz, Izz"


def _numbers(values: np.ndarray) -> str:
    return ", ".join(f"{x + 0.0:.9g}" for x in np.round(values, 12))


if __name__ == "__main__":
    argparse.ArgumentParser(prog="python -m benchmarks.record_3r", description=__doc__).parse_args()
    record()
