"""Diagnosis of one case by signid, and its evaluation."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

import signid
from signid.diagnose import Diagnosis
from signid.model import Model
from signid.output.report import diagnosis_document
from signid.types import Recording

from ..concealed.names import Truth, is_right, is_twin
from ..plants.control import Track
from .faults import SIGNS, Case

MAIN = {"base_tilt": "y", "asymmetric_friction": "coulomb_positive"}  # displayed parameter, if not the first


@dataclass(frozen=True)
class Named:
    """One finding with its main parameter."""

    effect: str
    joint: str | None
    role: str
    probability: float
    key: str
    value: float
    std: float | None
    truth: float | None  # true value if effect and joint are right
    right: bool


@dataclass(frozen=True)
class Result:
    """Evaluation of one diagnosis."""

    outcome: str  # named, twin, listed, unknown, nothing, wrong, refused; healthy robot: clean or alarm
    verdict: str
    findings: tuple[Named, ...]
    joints: int  # number of named joints among those with the fault
    before: float  # held-out rms over the noise floor, rms over joints
    after: float
    flags: tuple[str, ...]
    seconds: float

    @property
    def right(self) -> bool:
        """Whether the fault is named first, or the healthy robot is found clean."""
        return self.outcome in ("named", "clean")


def diagnose(case: Case, folder: Path, train: Track, test: Track) -> Result:
    """Diagnose with the description, the drives, and missing signs if they are declared.

    Args:
        case: case with its fault.
        folder: folder with robot.urdf and actuators.toml.
        train: training recording.
        test: held-out recording.
    """
    model = signid.load_model(folder / "robot.urdf")
    one, other = (_read(track, model, case.declared) for track in (train, test))
    start = time.process_time()
    try:
        found = signid.diagnose(model, [one], held_out=[other])
    except signid.SignidError as error:
        nan, named = float("nan"), bool(case.words) and any(word in str(error) for word in case.words)
        return Result(
            "named" if named else "refused",
            "refused",
            (),
            0,
            nan,
            nan,
            (str(error),),
            time.process_time() - start,
        )
    return evaluate(case, found, time.process_time() - start)


def evaluate(case: Case, found: Diagnosis, seconds: float) -> Result:
    """Evaluate a diagnosis."""
    document = diagnosis_document(found)
    named = tuple(_named(case, finding) for finding in document["findings"])
    floor = found.before.irreducible_rms
    before, after = (float(np.sqrt(np.mean((fit.held_out_rms / floor) ** 2))) for fit in (found.before, found.after))
    places = {x.joint for x in named if x.right}
    outcome = _outcome(case, found, document["findings"])
    return Result(outcome, found.verdict, named, len(places), before, after, found.flags, seconds)


def truth(case: Case) -> Truth:
    """Fault in the form of `concealed.names`."""
    return Truth((case.effect,), case.joints, None, {})


def _read(track: Track, model: Model, unsigned: bool) -> Recording:
    return signid.read_recording({"t": track.t, "q": track.q, "tau": track.tau}, model.robot, unsigned=unsigned)


def _named(case: Case, finding: Mapping[str, Any]) -> Named:
    effect, joint, right = finding["effect"], finding["joint"], is_right(finding, truth(case))
    numbers = finding["parameters"]
    key = MAIN.get(effect, next(iter(numbers), ""))
    one = numbers.get(key, {"value": float("nan"), "std": None})
    true = next((f.numbers[key] for f in case.faults if right and f.joint == joint), None)
    return Named(effect, joint, finding["role"], finding["probability"], key, one["value"], one["std"], true, right)


def _outcome(case: Case, found: Diagnosis, findings: Sequence[Mapping[str, Any]]) -> str:
    causes = [x for x in findings if x["role"] == "cause"]
    if not case.effect:
        return "clean" if found.verdict == "nothing_missing" else "alarm"
    if case.effect == SIGNS:
        known = found.signs is not None or any(word in flag for flag in found.flags for word in case.words)
        return "wrong" if causes else "named" if known else "nothing"
    true, listed = truth(case), [*findings, *(rival for x in findings for rival in x["alternatives"])]
    if causes and is_right(causes[0], true):
        return "named"
    if causes and is_twin(causes[0], true, found.robot.joints):
        return "twin"
    if any(is_right(x, true) for x in listed):
        return "listed"
    return "wrong" if causes else {"unknown": "unknown"}.get(found.verdict, "nothing")
