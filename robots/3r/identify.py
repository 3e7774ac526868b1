"""Identify the arm 3r from a simulated recording: link 3 is heavier than in its URDF, the joints have friction."""

import tomllib
from pathlib import Path

import numpy as np

import signid
from signid.identify import Identification

HERE = Path(__file__).parent


def main() -> Identification:
    """Identify and compare with the true values."""
    robot = signid.load_robot("3r")
    recording, held_out = (signid.read_recording(HERE / f"{name}.parquet", robot) for name in ("recording", "held_out"))
    result = signid.identify(robot, [recording], held_out=[held_out])
    truth = result.base.combination @ true_parameters(result)
    within = np.abs(result.base_value - truth) / result.estimate.std
    for row, expression in enumerate(result.base.expressions):
        print(f"{result.base_value[row]:9.4f}  true {truth[row]:9.4f}  off by {within[row]:3.1f} std  {expression}")
    if within.max() > 5 or result.flags:
        raise SystemExit("the identified parameters are far from the true ones")
    return result


def true_parameters(result: Identification) -> np.ndarray:
    """Standard parameters of truth.toml (p,) [kg, kg.m, kg.m2, N.m.s/rad, N.m]."""
    truth = tomllib.loads((HERE / "truth.toml").read_text(encoding="utf-8"))
    links = (truth["link"][name] for name in result.robot.links)
    bodies = [number for link in links for number in (link["mass"], *link["first_moment"], *link["inertia"])]
    joints = result.robot.joints
    return np.array([*bodies, *(truth["joint"][joints[law.joints[0]]][law.effect.name] for law in result.model.laws)])


if __name__ == "__main__":
    main()
