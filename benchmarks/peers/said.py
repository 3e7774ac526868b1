"""What signid says of one case, and whether that is what is wrong."""

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

MAIN = {"base_tilt": "y", "asymmetric_friction": "coulomb_positive"}  # the number that is shown, if not the first


@dataclass(frozen=True)
class Named:
    """One finding; its number that counts."""

    effect: str
    joint: str | None
    role: str
    probability: float
    key: str
    value: float
    std: float | None
    truth: float | None  # where effect and joint are right
    right: bool


@dataclass(frozen=True)
class Said:
    """One diagnosis."""

    outcome: str  # named, twin, listed, unknown, nothing, wrong, refused; of the healthy robot clean or alarm
    verdict: str
    findings: tuple[Named, ...]
    joints: int  # of those with the fault, how many are named
    before: float  # held-out rms over the noise floor, rms over joints
    after: float
    flags: tuple[str, ...]
    seconds: float

    @property
    def right(self) -> bool:
        """Whether what is wrong, if anything, is what comes first."""
        return self.outcome in ("named", "clean")


def say(case: Case, folder: Path, train: Track, test: Track) -> Said:
    """What signid says, told nothing but the description, the drives, and where it is so that torque has no sign.

    Args:
        case: what is wrong.
        folder: robot.urdf and actuators.toml.
        train: to learn from.
        test: to judge by.
    """
    model = signid.load_model(folder / "robot.urdf")
    one, other = (_read(track, model, case.told) for track in (train, test))
    start = time.process_time()
    try:
        found = signid.diagnose(model, [one], held_out=[other])
    except signid.SignidError as error:
        nothing, told = float("nan"), bool(case.words) and any(word in str(error) for word in case.words)
        return Said(
            "named" if told else "refused",
            "refused",
            (),
            0,
            nothing,
            nothing,
            (str(error),),
            time.process_time() - start,
        )
    return judge(case, found, time.process_time() - start)


def judge(case: Case, found: Diagnosis, seconds: float) -> Said:
    """A diagnosis held against what is wrong."""
    document = diagnosis_document(found)
    named = tuple(_named(case, finding) for finding in document["findings"])
    floor = found.before.irreducible_rms
    before, after = (float(np.sqrt(np.mean((fit.held_out_rms / floor) ** 2))) for fit in (found.before, found.after))
    places = {x.joint for x in named if x.right}
    outcome = _outcome(case, found, document["findings"])
    return Said(outcome, found.verdict, named, len(places), before, after, found.flags, seconds)


def truth(case: Case) -> Truth:
    """What is wrong, as the judge of names has it."""
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
    true, told = truth(case), [*findings, *(rival for x in findings for rival in x["alternatives"])]
    if causes and is_right(causes[0], true):
        return "named"
    if causes and is_twin(causes[0], true, found.robot.joints):
        return "twin"
    if any(is_right(x, true) for x in told):
        return "listed"
    return "wrong" if causes else {"unknown": "unknown"}.get(found.verdict, "nothing")
