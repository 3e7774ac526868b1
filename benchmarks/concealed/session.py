"""Recording of a session for the diagnosis, and its concealed answer for the evaluation."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from numpy.typing import NDArray

from ..plants import mujoco_
from ..plants.bodies import Drives
from ..plants.control import Track
from ..plants.faults import Fault
from ..plants.record import log
from .cases import HARD_ERROR, Case
from .motion import draw
from .robots import ROBOTS, described, mistaken
from .scene import DURATION, Scene, rms
from .size import plant

Array = NDArray[np.float64]

MOTIONS, RATE, BITS = 4, 125.0, 17  # recordings per session, rate [Hz], encoder bits per turn
NOISE, COLOURED = (0.01, 0.05), 0.4  # range of white noise over torque [1]; coloured over white noise [1]
PARTS = ("viscous_friction", "coulomb_friction", "asymmetric_friction")  # replace the stated friction
MODULATED = {"position_friction": "amplitude", "friction_drift": "change"}
MARGIN = 1.05  # dry friction over the largest reduction by a fault [1]
LOST = 1.5  # largest tracking error [rad]
ATTEMPTS = 12  # draws of a fault that the robot can follow


def make(case: Case, cache: Path) -> Path:
    """Folder of a session, created if missing: robot.urdf, actuators.toml, recording_1.parquet ...

    Args:
        case: case with concealed faults.
        cache: folder with `sessions/NAME` and `answers/NAME.json`.

    Raises:
        RuntimeError: when the robot follows its motions with none of the drawn faults.
    """
    folder, answer = cache / "sessions" / case.name, cache / "answers" / f"{case.name}.json"
    if answer.is_file():
        return folder
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([case.number, attempt])
        try:
            concealed = _record(case, folder, rng)
        except (ValueError, ArithmeticError) as error:
            reason = error
            continue
        answer.parent.mkdir(parents=True, exist_ok=True)
        answer.write_text(json.dumps({**case.document(), **concealed}, indent=1), encoding="utf-8")
        return folder
    raise RuntimeError(f"{case.key}: {reason}")


def _record(case: Case, folder: Path, rng: np.random.Generator) -> dict[str, Any]:
    """Simulate the robot and write the visible files; return the concealed facts."""
    place, stated = ROBOTS[case.robot], described(case.robot)
    true = mistaken(stated, HARD_ERROR, rng) if case.hard else stated
    scene = Scene(true, tuple(draw(place, rng) for _ in range(MOTIONS)))
    planted, joints = [], true.joints
    for effect in case.effects:
        joint = joints[-1] if effect == "payload" else str(rng.choice(joints))
        planted.append(plant(effect, joint, case.size, scene, rng))
    faults = [fault for fault, _ in planted]
    drives = _known(scene, faults)
    noise = float(rng.uniform(*NOISE))
    tracks = _follow(case, scene, drives, faults)
    folder.mkdir(parents=True, exist_ok=True)
    for k, track in enumerate(tracks):
        share = noise * np.maximum(scene.scale / rms(track.tau), 1.0)
        columns = log(track, int(rng.integers(2**31)), BITS, share, COLOURED * share)
        pl.DataFrame(columns).write_parquet(folder / f"recording_{k + 1}.parquet")
    (folder / "robot.urdf").write_text(stated.urdf, encoding="utf-8")
    (folder / "actuators.toml").write_text(actuators_file(drives, joints), encoding="utf-8")
    concealed = [
        {"effect": fault.effect, "joint": fault.joint, "parameters": dict(fault.parameters), "size": size}
        for fault, size in planted
    ]
    return {"faults": concealed, "noise": noise, "joints": list(joints), "scale": scene.scale.tolist()}


def _known(scene: Scene, faults: Sequence[Fault]) -> Drives:
    """Stated drives: friction without the concealed one, and enough of it where a fault reduces it."""
    viscous, coulomb = (list(x) for x in (scene.drives.viscous_friction, scene.drives.coulomb_friction))
    for fault in faults:
        if fault.effect in MODULATED and fault.joint:
            j = scene.body.joints.index(fault.joint)
            coulomb[j] = max(coulomb[j], MARGIN * abs(fault.numbers[MODULATED[fault.effect]]))
    for fault in faults:
        if fault.effect in PARTS:
            j = scene.body.joints.index(str(fault.joint))
            viscous[j] *= fault.effect == "coulomb_friction"
            coulomb[j] *= fault.effect == "viscous_friction"
    return replace(scene.drives, viscous_friction=tuple(viscous), coulomb_friction=tuple(coulomb))


def _follow(case: Case, scene: Scene, drives: Drives, faults: Sequence[Fault]) -> list[Track]:
    """Simulate the robot along all motions.

    Raises:
        ArithmeticError: when the robot leaves its motion.
    """
    tracks = []
    for k, motion in enumerate(scene.motions):
        start = k * DURATION
        if case.plant == "bullet":
            from ..plants import pybullet_

            track = pybullet_.simulate(scene.body, drives, motion, DURATION, RATE, faults, start)
        else:
            track = mujoco_.simulate(scene.body, drives, motion, DURATION, RATE, faults, start, soft=case.hard)
        if not np.abs(track.q - motion.at(track.t)[0]).max() < LOST:
            raise ArithmeticError("the robot leaves its motion")
        tracks.append(track)
    return tracks


def actuators_file(drives: Drives, joints: Sequence[str]) -> str:
    """Text of actuators.toml with non-zero rotors and friction."""
    lines = []
    for j, joint in enumerate(joints):
        values = {key: getattr(drives, key)[j] for key in ("armature", "viscous_friction", "coulomb_friction")}
        lines += [f'[joint."{joint}"]', *(f"{key} = {float(x)!r}" for key, x in values.items() if x), ""]
    return "\n".join(lines)
