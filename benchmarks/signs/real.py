"""Real robots with signed recordings, whose signs are removed, and the SO-101, whose true signs are unknown."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import signid
from signid.identify import Identification
from signid.regression.session import Options
from signid.signs.result import Trace

from ..real.data import LINK_SIDE, ROBOTS, data, ur10e
from .trial import Puzzle, Row, Target, attempt, measured

UR10E = ("20_02_12_40sec_12harm", "20_02_12_50sec_12harm", "20_01_31_unload", "20_02_10_30sec_12harm")
HARD = UR10E[-1]  # reported without target
PANDA_TARGET = Target(segments=1.0, samples=0.989, off=0.01, seconds=2.0)
UR10E_TARGET = Target(segments=0.985)
FAST = 20.0  # low-pass of the true samples in fast logs [Hz]


def rows() -> Iterator[Row]:
    """Yield the rows of Panda, UR10e, TX40 and EMPS."""
    yield attempt(panda(), target=PANDA_TARGET)
    for name in UR10E:
        yield attempt(ur10e_log(name), target=Target() if name == HARD else UR10E_TARGET)
    yield attempt(fast("TX40", data() / "staubli_tx40" / "tx40.urdf", "staubli_tx40/exciting_traj"))
    yield attempt(fast("EMPS", ROBOTS / "emps" / "robot.urdf", "emps_janot/emps_train"))


def panda() -> Puzzle:
    """Panda with link-side torque sensors, 21 s; the last 30 % are held out."""
    folder = data() / "panda_gaz2019"
    robot, options = signid.load_robot(folder / "panda.urdf"), Options(effects=LINK_SIDE)
    return Puzzle("Panda", "21 s", robot, (folder / "exciting_traj_1.csv.gz",), options=options)


def ur10e_log(name: str) -> Puzzle:
    """UR10e with motor currents; another log is held out."""
    train, held_out = (data() / "ur10e_mamedov" / f"identification_data__{key}.csv.gz" for key in (name, other(name)))
    return Puzzle("UR10e", name, ur10e(), (train,), (held_out,))


def other(name: str) -> str:
    """Held-out log for a log of the UR10e."""
    return UR10E[1] if name != UR10E[1] else UR10E[0]


def fast(group: str, description: Path, recording: str) -> Puzzle:
    """Log at a high rate; the last 30 % are held out."""
    robot, path = signid.load_robot(description), data() / f"{recording}.csv.gz"
    whole = signid.read_recording(path, robot).read()
    return Puzzle(
        group, path.name.partition(".")[0], robot, (path,), truths=(measured(whole.t, whole.q, whole.tau, FAST),)
    )


TRAIN, HELD_OUT = ("multisine", "frequency_sweep"), ("friction_gravity", "random_waypoints")
JOINTS = ("shoulder_pan", "shoulder_lift", "elbow_flex", "wrist_flex", "wrist_roll")  # in the order of the recordings
# the jaw is omitted: its positions are shares of its range
KINDS = {"q": "q", "dq": "dq", "q_des": "q_des", "abs_tau": "tau_abs"}
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
    folder = data() / "so101_sage"
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
