"""Types of a diagnosis of position drives: findings, mismatch without a law, repeats, the extended simulation."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from ...frozen import Frozen, Result
from ...model import Model
from ...types import Array, Input, Robot
from ..identify.result import ServoRollOut, ServoTrace


class FoundNumber(NamedTuple):
    """A number of a law; `stated` is the value in the given simulation, None where it had none."""

    value: float
    std: float | None
    unit: str
    stated: float | None = None


@dataclass(frozen=True)
class ServoAlternative:
    """Law that explains a finding as well, or nearly."""

    effect: str
    joint: str
    probability: float
    separating_motion: str


@dataclass(frozen=True)
class ServoFinding:
    """A law that the simulation of loop and robot lacks, or states wrongly."""

    effect: str
    joint: str
    role: str  # "cause" or "secondary"
    probability: float
    parameters: Mapping[str, FoundNumber]
    meaning: str
    share: Mapping[str, float]  # by joint: rms of the mismatch that it explains over rms of the mismatch [1]
    variable: str  # velocity, position, acceleration, torque or time
    region: str
    statistic: float  # log posterior odds against its absence
    threshold: float  # log odds that a law needs
    held_out_gain: float  # reduction of the held-out sum of squares of its joint [1]
    alternatives: tuple[ServoAlternative, ...]


@dataclass(frozen=True)
class ServoUnexplained:
    """Mismatch of a joint that exceeds noise and that no law explains."""

    joint: str
    variable: str  # what it depends on most
    share: float  # its rms over the rms of the mismatch of the given simulation [1]
    rms: float  # [rad or m]
    region: str  # third of the variable, or recording, with the largest mismatch
    region_rms: float  # [rad or m] rms of the mismatch there
    tried: Mapping[str, float]  # laws that were fitted and not added: share of the mean square that each explains [1]


@dataclass(frozen=True, eq=False)
class ServoRepeats(Frozen):
    """Differences of measured positions between repeats of one command, n joints with drives."""

    joints: tuple[str, ...]
    pairs: int  # pairs of stretches with equal commands that were compared
    seconds: float  # of all comparisons together [s]
    rms: Array  # (n,) [rad or m] rms difference of two repeats over sqrt(2): no model of the commands is better
    mismatch_rms: Array  # (n,) [rad or m] of the extended simulation on the same rows, from the commands alone
    share: Array  # (n,) of the mean square mismatch that no model explains [1]


@dataclass(frozen=True, eq=False)
class PositionFit(Frozen):
    """Mismatch of short closed loops from measured states, n joints."""

    joints: tuple[str, ...]
    unit: tuple[str, ...]  # "rad" or "m"
    train_rms: Array  # (n,) [rad or m]
    held_out_rms: Array  # (n,) [rad or m]
    noise_floor: Array  # (n,) [rad or m] of the measured positions
    held_out_r2: Array  # (n,) share of the variance of q_des - q that the simulation explains [1]


@dataclass(frozen=True, eq=False)
class ServoDiagnosis(Result):
    """Differences between a simulation of drives and recordings, in rad, and the laws that explain them."""

    robot: Robot
    verdict: str  # "nothing_missing", "named" or "unknown"
    findings: tuple[ServoFinding, ...]
    unexplained: tuple[ServoUnexplained, ...]
    before: PositionFit
    after: PositionFit
    rollout_before: ServoRollOut
    rollout_after: ServoRollOut
    repeats: ServoRepeats | None  # None if no command is repeated
    traces: tuple[ServoTrace, ...]  # of held-out recordings; `nominal` is the given simulation
    model: Model  # the extended simulation
    inputs: tuple[Input, ...]
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    seed: int

    @property
    def causes(self) -> tuple[ServoFinding, ...]:
        """Findings that are causes."""
        return tuple(finding for finding in self.findings if finding.role == "cause")
