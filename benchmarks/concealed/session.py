"""Recording of sessions and concealed answers, and diagnosis in parallel; results are kept for the evaluation."""

from __future__ import annotations

import json
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
from rich.progress import Progress

from ..plants import mujoco_
from ..plants.bodies import Drives
from ..plants.control import Track, log
from ..plants.faults import Fault
from .cases import HARD_ERROR, Case
from .faults import plant
from .scene import DURATION, ROBOTS, Scene, described, draw, mistaken, rms

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
    drives = stated_drives(scene, faults)
    noise = float(rng.uniform(*NOISE))
    tracks = follow(scene, drives, faults, soft=case.hard)
    write(folder, stated.urdf, scene, tracks, noise, rng)
    (folder / "actuators.toml").write_text(actuators_file(drives, joints), encoding="utf-8")
    return {"faults": facts(planted), "noise": noise, "joints": list(joints), "scale": scene.scale.tolist()}


def facts(planted: Sequence[tuple[Fault, float]]) -> list[dict[str, Any]]:
    """Planted faults and their sizes as JSON."""
    return [
        {"effect": fault.effect, "joint": fault.joint, "parameters": dict(fault.parameters), "size": size}
        for fault, size in planted
    ]


def write(
    folder: Path, urdf: str, scene: Scene, tracks: Sequence[Track], noise: float, rng: np.random.Generator
) -> None:
    """Write robot.urdf and the noisy recordings; `noise` is white noise over each joint's torque [1]."""
    folder.mkdir(parents=True, exist_ok=True)
    for k, track in enumerate(tracks):
        share = noise * np.maximum(scene.scale / rms(track.tau), 1.0)
        columns = log(track, int(rng.integers(2**31)), BITS, share, COLOURED * share)
        pl.DataFrame(columns).write_parquet(folder / f"recording_{k + 1}.parquet")
    (folder / "robot.urdf").write_text(urdf, encoding="utf-8")


def stated_drives(scene: Scene, faults: Sequence[Fault]) -> Drives:
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


def follow(scene: Scene, drives: Drives, faults: Sequence[Fault], soft: bool) -> list[Track]:
    """Simulate the robot along all motions.

    Raises:
        ArithmeticError: when the robot leaves its motion.
    """
    tracks = []
    for k, motion in enumerate(scene.motions):
        start = k * DURATION
        track = mujoco_.simulate(scene.body, drives, motion, DURATION, RATE, faults, start, soft=soft)
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


def diagnose_session(folder: Path, skip: tuple[str, ...]) -> dict[str, Any]:
    """Diagnose the recordings in a folder without access to the answers, and without the effects to skip."""
    import signid
    from signid.output.report.results.diagnosis import diagnosis_document

    model = signid.load_model(folder / "robot.urdf")
    recordings = [signid.read_recording(path, model.robot) for path in sorted(folder.glob("recording_*.parquet"))]
    return diagnosis_document(signid.diagnose(model, recordings, skip=skip))


def process(case: Case, cache: Path, diagnose: bool, again: bool) -> str:
    """Record and diagnose a session unless done; return the error, or an empty string."""
    try:
        folder, result = make(case, cache), cache / "diagnoses" / f"{case.name}.json"
        if not diagnose or (result.is_file() and not again):
            return ""
        start, wall = time.process_time(), time.perf_counter()
        found = diagnose_session(folder, tuple(case.skip))
        times = {"cpu": time.process_time() - start, "wall": time.perf_counter() - wall}
        result.parent.mkdir(parents=True, exist_ok=True)
        result.write_text(json.dumps({"document": found, **times}), encoding="utf-8")
    except Exception as error:  # one case must not end the others
        return f"{case.key}: {type(error).__name__}: {error} ({traceback.extract_tb(error.__traceback__)[-1].name})"
    return ""


def process_all(
    cases: Sequence[Case], cache: Path, workers: int, progress: Progress, diagnose: bool = True, again: bool = False
) -> Iterator[str]:
    """Process every case in parallel; yield the errors."""
    bar = progress.add_task("diagnose" if diagnose else "record", total=len(cases))
    with ProcessPoolExecutor(workers) as pool:
        job = partial(process, cache=cache, diagnose=diagnose, again=again)
        for done in as_completed([pool.submit(job, case) for case in cases]):
            progress.advance(bar)
            if error := done.result():
                yield error


def results(cases: Sequence[Case], cache: Path) -> Iterator[tuple[dict[str, Any], dict[str, Any]]]:
    """Yield answer and diagnosis of every diagnosed case."""
    for case in cases:
        answer, result = (cache / kind / f"{case.name}.json" for kind in ("answers", "diagnoses"))
        if answer.is_file() and result.is_file():
            yield json.loads(answer.read_text(encoding="utf-8")), json.loads(result.read_text(encoding="utf-8"))
