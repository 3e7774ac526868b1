"""Robots with healthy drives, and their motions."""

from __future__ import annotations

import os
import xml.etree.ElementTree as xml
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .drive import Array, Drive

PENDULUM = """<robot name="pendulum"><link name="base"/><link name="arm"><inertial><origin xyz="0.18 0 0"/>
<mass value="0.6"/><inertia ixx="1e-4" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="joint" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 -1 0"/>
<limit lower="-3" upper="3" velocity="20" effort="20"/></joint></robot>"""

BLOCK = 4.0  # [s] of sines and steps


@dataclass(frozen=True)
class Bench:
    """A robot of the benchmark: description, healthy drives, centre and size of its motion."""

    name: str
    urdf: Path
    drives: dict[str, Drive]  # by joint, in the order from the base
    centre: Array  # (n,) [rad]
    size: Array  # (n,) [rad]


def data_folder() -> Path | None:
    """Folder of the public recordings, $SIGNID_DATA."""
    folder = os.environ.get("SIGNID_DATA")
    return Path(folder) if folder and Path(folder).is_dir() else None


def benches(folder: Path, names: tuple[str, ...] = ("pendulum", "so101", "go2_leg")) -> list[Bench]:
    """Robots whose descriptions are at hand; generated ones are written to `folder`."""
    data, found = data_folder(), []
    if "pendulum" in names:
        path = folder / "pendulum.urdf"
        path.write_text(PENDULUM, encoding="utf-8")
        drives = {"joint": Drive(kp=12.0, kd=0.35, delay=0.012, coulomb_friction=0.06, armature=0.008)}
        found.append(Bench("pendulum", path, drives, np.array([0.2]), np.array([0.9])))
    if "so101" in names and data:
        path = folder / "so101.urdf"
        path.write_text((data / "so101_servo" / "so101.urdf").read_text(encoding="utf-8"), encoding="utf-8")
        numbers = {  # kp, kd, coulomb_friction, armature
            "shoulder_pan": (14.0, 0.5, 0.06, 0.02),
            "shoulder_lift": (16.0, 0.6, 0.07, 0.02),
            "elbow_flex": (12.0, 0.4, 0.06, 0.016),
            "wrist_flex": (8.0, 0.25, 0.04, 0.01),
            "wrist_roll": (5.0, 0.15, 0.03, 0.006),
            "gripper": (4.0, 0.12, 0.03, 0.005),
        }
        drives = healthy(numbers, delay=0.012, viscous_friction=0.04)
        found.append(Bench("so101", path, drives, np.array([0, -0.4, 0.4, 0.2, 0, 0.6]), np.full(6, 0.6)))
    if "go2_leg" in names and data:
        path = folder / "go2_leg.urdf"
        path.write_text(leg((data / "go2_dls" / "go2.urdf").read_text(encoding="utf-8"), "FL_"), encoding="utf-8")
        gains = {"hip": (22.0, 0.9), "thigh": (25.0, 1.1), "calf": (28.0, 1.0)}
        numbers = {f"FL_{part}_joint": (*both, 0.2, 0.012) for part, both in gains.items()}
        drives = healthy(numbers, delay=0.01, viscous_friction=0.1)
        found.append(Bench("go2_leg", path, drives, np.array([0.0, 0.9, -1.8]), np.array([0.4, 0.6, 0.6])))
    return found


def healthy(numbers: dict[str, tuple[float, ...]], **same: float) -> dict[str, Drive]:
    """Drives by joint, from kp, kd, dry friction and armature of each and the numbers that they share."""
    names = ("kp", "kd", "coulomb_friction", "armature")
    return {joint: Drive(**same, **dict(zip(names, own, strict=True))) for joint, own in numbers.items()}  # type: ignore[arg-type]


def leg(urdf: str, prefix: str) -> str:
    """The URDF with one leg: joints and links of a prefix, and the base."""
    root = xml.fromstring(urdf)
    keep = {"base", "base_link", "trunk"}
    for joint in root.findall("joint"):
        if not joint.get("name", "").startswith(prefix):
            root.remove(joint)
        else:
            keep |= {part.get("link", "") for part in (*joint.findall("child"), *joint.findall("parent"))}
    for link in root.findall("link"):
        if link.get("name") not in keep:
            root.remove(link)
    return xml.tostring(root, encoding="unicode")


def motion(bench: Bench, seed: int, seconds: float, rate: float, fast: float = 2.5, steps: float = 0.35) -> Array:
    """Held commands (N, n) [rad]: six sines a joint, and steps for the share `steps` of each block."""
    rng, n = np.random.default_rng([seed, 11]), len(bench.centre)
    t = np.arange(int(seconds * rate)) / rate
    f, phase = rng.uniform(0.15, fast, (n, 6)), rng.uniform(0, 2 * np.pi, (n, 6))
    sines = (np.sin(2 * np.pi * f * t[:, None, None] + phase) / np.sqrt(1 + f)).sum(axis=2)
    u = sines / np.abs(sines).max(axis=0)
    for j in range(n):
        k = int(rng.uniform(0.3, 1.0) * rate)
        while k < len(t):
            end = k + int(rng.uniform(0.3, 0.9) * rate)
            if (k / rate) % BLOCK > BLOCK * (1 - steps):
                u[k:end, j] = rng.uniform(-1, 1)
            k = end
    ramp = np.minimum(t / 0.5, 1.0)[:, None]
    return np.asarray(bench.centre + bench.size * u * ramp)
