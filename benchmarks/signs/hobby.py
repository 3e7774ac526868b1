"""The SO-101: a hobby arm whose servos tell the magnitude of their current alone. Nobody knows the true signs."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import signid
from signid.identify import Identification
from signid.signs.result import Trace

LEARN, JUDGES = ("multisine", "frequency_sweep"), ("friction_gravity", "random_waypoints")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")  # as the recordings count them
KINDS = {"q": "q", "dq": "dq", "q_des": "q_des", "abs_tau": "tau_abs"}  # the jaw's are shares of its range, no angles
SURE = 0.999


@dataclass(frozen=True)
class Told:
    """What is said of one joint."""

    joint: str
    segments: int
    sure: int  # segments that are given a probability of at least SURE
    train: float  # [1] rms error of |torque| over its rms value
    held_out: float  # the same of recordings that were not learned from


@dataclass(frozen=True)
class Report:
    """What is identified without a truth to compare with."""

    parameters: int
    joints: tuple[Told, ...]
    flags: tuple[str, ...]
    optimal: bool
    gap: float
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether no certainty is claimed without a flag."""
        return bool(self.flags) or not any(told.sure for told in self.joints)


def report() -> Report:
    """Identify from two recordings, and judge by two others."""
    folder = Path(os.environ["SIGNID_DATA"]) / "so101_sage"
    robot = signid.load_robot(folder / "so101.urdf", joints=JOINTS)
    columns = {f"{a}_{name}": f"{b}_{k}" for k, name in enumerate(JOINTS, 1) for a, b in KINDS.items()}
    learn, judges = (
        [signid.read_recording(folder / f"{name}.csv.gz", robot, columns=columns) for name in names]
        for names in (LEARN, JUDGES)
    )
    start = time.process_time()
    found = signid.identify(robot, learn, held_out=judges)
    seconds = time.process_time() - start
    assert found.signs is not None, "the recordings have no signs"
    told = tuple(tell(found, j) for j in range(len(JOINTS)))
    proof = found.signs.proof
    return Report(found.base.rank, told, found.signs.flags, proof.optimal, proof.gap, seconds)


def tell(found: Identification, joint: int) -> Told:
    """One joint's segments and errors."""
    signs = found.signs
    assert signs is not None, "the recordings have no signs"
    own = signs.of(joint)
    errors = [miss(signs.traces[k : k + len(LEARN)], joint) for k in (0, len(LEARN))]
    return Told(signs.joints[joint], len(own), sum(told.confidence >= SURE for told in own), *errors)


def miss(traces: tuple[Trace, ...], joint: int) -> float:
    """[1] rms difference of |predicted| and recorded torque, over the rms of the recorded."""
    seen, predicted = (
        np.concatenate([np.abs(getattr(trace, key)[:, joint]) for trace in traces])
        for key in ("magnitude", "predicted")
    )
    return float(np.linalg.norm(predicted - seen) / np.linalg.norm(seen))
