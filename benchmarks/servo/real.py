"""Identification of real servos: held-out error of whole recordings from commands alone."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from signid.recording import read_recording
from signid.robot import load_robot
from signid.servo.compare import compare_models
from signid.servo.diagnose import diagnose_servos
from signid.servo.identify import FrictionModel, ServoIdentification, identify_servos
from signid.types import Robot

from .robots import data_folder

XL330 = ("lift_and_drop", "sin_sin", "sin_time_square", "up_and_down")
HELD = ("sin_time_square", "up_and_down")  # of these, at both gains
MAUICV = (("chirp", "prbs_small", "square_large", "square_small", "step_large", "triangle"), ("prbs_large", "ramp"))
SO101 = (
    (
        "center_workspace",
        "diagonal_sweep",
        "oscillation_low_freq",
        "reaching_points",
        "symmetric_motion",
        "triangle_wave",
    ),
    ("wave_motion", "staircase_motion", "velocity_ramp"),
)
SO101_JOINTS = {  # signs and zeros are those of the description, as far as the load shows them
    "joints": {
        "shoulder_pan": "Rotation",
        "shoulder_lift": "Pitch",
        "elbow_flex": "Elbow",
        "wrist_flex": "Wrist_Pitch",
        "wrist_roll": "Wrist_Roll",
        "gripper": "Jaw",
    }
}


@dataclass(frozen=True)
class RealRow:
    """One real set."""

    name: str
    joints: int
    whole: float  # [rad] rms of held-out recordings, all joints
    second: float  # [rad] restarted every second
    ideal: float  # [rad] q = q_des, or stated numbers
    seconds: float  # processor time
    target: str
    missing: str  # laws that a diagnosis still names


def sets(folder: Path) -> Iterator[RealRow]:
    """Each public set that is at hand."""
    data = data_folder()
    if data is None:
        return
    for held in HELD:
        robot = xl330(data, folder)
        files = [data / "bam_xl330" / f"kp{kp}_{name}.csv.gz" for kp in (100, 400) for name in XL330]
        unseen = [file for file in files if held in file.name]
        yield _row(f"XL330, {held} held out", robot, [f for f in files if f not in unseen], unseen, "")
    go2 = data / "go2_dls"
    yield _row("Go2, last 30 %", load_robot(go2 / "go2.urdf"), [go2 / "held_base_first.csv.gz"], [], ".0065")
    place = data / "mauicv_servo"
    train, unseen = ([place / f"a_{name}.csv.gz" for name in names] for names in MAUICV)
    yield _row("mauicv, other motions", load_robot(place / "arm.urdf"), train, unseen, ".060")
    place = data / "so101_servo"
    train, unseen = ([place / f"{name}.csv.gz" for name in names] for names in SO101)
    yield _row(
        "SO-101, whole arm, other motions", load_robot(place / "so101.urdf"), train, unseen, ".010", SO101_JOINTS
    )


def friction_models(folder: Path) -> Iterator[tuple[str, FrictionModel]]:
    """Friction models of the XL330 beside each other, by the held-out motion."""
    data = data_folder()
    if data is None:
        return
    robot, place = xl330(data, folder), data / "bam_xl330"
    for held in HELD:
        files = {name: [place / f"kp{kp}_{name}.csv.gz" for kp in (100, 400)] for name in XL330}
        unseen = [read_recording(file, robot) for file in files.pop(held)]
        learned = [read_recording(file, robot) for some in files.values() for file in some]
        found = compare_models(identify_servos(robot, learned, held_out=unseen), learned, held_out=unseen)
        yield from ((held, one) for one in found.friction_models)


def xl330(data: Path, folder: Path) -> Robot:
    """The XL330 with the firmware gain of each recording."""
    lines = ["[joint.servo.servo]", "kp_register = 400"]
    for kp in (100, 400):
        for name in XL330:
            lines += [f'[recording."kp{kp}_{name}.csv.gz".servo]', f"kp_register = {kp}"]
    file = folder / "actuators.toml"
    file.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return load_robot(data / "bam_xl330" / "pendulum.urdf", actuators=file)


def _row(
    name: str,
    robot: Robot,
    train: Sequence[Path],
    unseen: Sequence[Path],
    target: str,
    columns: Mapping[str, Any] | None = None,
) -> RealRow:
    learned, held_out = ([read_recording(f, robot, columns=columns) for f in files] for files in (train, unseen))
    start = time.process_time()
    found = identify_servos(robot, learned, held_out=held_out)
    seconds = time.process_time() - start
    missing = diagnose_servos(found.model, learned, held_out=held_out)
    names = ", ".join(f"{x.effect}@{x.joint} {x.probability:.2f}" for x in missing.causes[:3])
    return RealRow(name, len(found.joints), *_errors(found), seconds, target, names or missing.verdict)


def _errors(found: ServoIdentification) -> tuple[float, float, float]:
    rolled = found.rollout
    sizes = (rolled.whole_rms, rolled.one_second_rms, rolled.nominal_whole_rms)
    whole, second, ideal = (float(np.sqrt(np.nanmean(x**2))) for x in sizes)
    return whole, second, ideal
