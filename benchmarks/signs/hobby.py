"""The SO-101, a hobby arm whose servos report absolute current only; the true signs are unknown."""

from __future__ import annotations

import os
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import signid
from signid.identify import Identification
from signid.signs.result import Trace

TRAIN, HELD_OUT = ("multisine", "frequency_sweep"), ("friction_gravity", "random_waypoints")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")  # in the order of the recordings
KINDS = {
    "q": "q",
    "dq": "dq",
    "q_des": "q_des",
    "abs_tau": "tau_abs",
}  # the jaw is omitted: its positions are shares of its range
SURE = 0.999  # probability above which a segment counts as certain [1]


@dataclass(frozen=True)
class JointResult:
    """Segments and errors of one joint."""

    joint: str
    segments: int
    sure: int  # segments with a probability of at least SURE
    train: float  # rms error of |torque| over its rms value [1]
    held_out: float  # the same for held-out recordings [1]


@dataclass(frozen=True)
class Report:
    """Identification without known truth."""

    parameters: int
    joints: tuple[JointResult, ...]
    flags: tuple[str, ...]
    optimal: bool
    gap: float
    seconds: float

    @property
    def holds(self) -> bool:
        """Whether certain segments occur only together with a flag."""
        return bool(self.flags) or not any(joint.sure for joint in self.joints)


def report() -> Report:
    """Identify from two recordings with two others held out."""
    folder = Path(os.environ["SIGNID_DATA"]) / "so101_sage"
    robot = signid.load_robot(folder / "so101.urdf", joints=JOINTS)
    columns = {f"{a}_{name}": f"{b}_{k}" for k, name in enumerate(JOINTS, 1) for a, b in KINDS.items()}
    train, held_out = (
        [signid.read_recording(folder / f"{name}.csv.gz", robot, columns=columns) for name in names]
        for names in (TRAIN, HELD_OUT)
    )
    start = time.process_time()
    found = signid.identify(robot, train, held_out=held_out)
    seconds = time.process_time() - start
    assert found.signs is not None, "the recordings have no signs"
    joints = tuple(joint_result(found, j) for j in range(len(JOINTS)))
    proof = found.signs.proof
    return Report(found.base.rank, joints, found.signs.flags, proof.optimal, proof.gap, seconds)


def joint_result(found: Identification, joint: int) -> JointResult:
    """Segments and errors of one joint."""
    signs = found.signs
    assert signs is not None, "the recordings have no signs"
    own = signs.of(joint)
    errors = [miss(signs.traces[k : k + len(TRAIN)], joint) for k in (0, len(TRAIN))]
    return JointResult(signs.joints[joint], len(own), sum(segment.confidence >= SURE for segment in own), *errors)


def miss(traces: tuple[Trace, ...], joint: int) -> float:
    """Rms difference of |predicted| and recorded torque over the rms of the latter [1]."""
    seen, predicted = (
        np.concatenate([np.abs(getattr(trace, key)[:, joint]) for trace in traces])
        for key in ("magnitude", "predicted")
    )
    return float(np.linalg.norm(predicted - seen) / np.linalg.norm(seen))
