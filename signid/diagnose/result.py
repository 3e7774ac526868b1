"""Types of a diagnosis: findings, unexplained torque, the extended simulation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ..estimation.fit_quality import Course, Fit
from ..model import Model
from ..signs import Signs
from ..simulation.rollout import RollOut
from ..types import Array, Frozen, Input, Law, Recording, Result, Robot
from .data.locate import Location

MUCH_SHARE = 0.3  # share of a joint's torque that is much if no law explains it [1]: R2 below 0.91; heuristic
MIN_CAUSE_RATIO = (
    0.5  # torque of a cause over the unexplained torque of a joint, below which it hardly acts there [1]; heuristic
)


@dataclass(frozen=True)
class Alternative:
    """Law that explains a finding nearly as well as, or as well as, the selected one."""

    law: Law  # with its shape, without coefficients
    probability: float
    separating_motion: str


@dataclass(frozen=True, eq=False)
class Finding(Frozen):
    """A law that the simulation lacks."""

    law: Law  # with all its parameters
    std: Mapping[str, float]  # standard deviation of each parameter [unit of the parameter]
    role: str  # "cause" or "secondary"
    probability: float
    torque_share: Array  # (n,) rms of its torque over rms of the recorded torque [1]
    where: Location
    statistic: float  # log posterior odds against its absence [-]
    threshold: float  # log odds that a law needed to be selected [-]
    held_out_gain: float  # reduction of the held-out sum of squares on its joints, as a share [1]
    alternatives: tuple[Alternative, ...]
    stated: Mapping[str, float] = field(default_factory=dict)  # stated values of parameters [unit of the parameter]
    in_model: bool = True  # whether the extended simulation has it: held-out torque is predicted better with it
    ordinary: bool = False  # whether it is friction, a rotor or an offset of which the description states nothing
    refused: str = ""  # why the extended simulation does not have it


@dataclass(frozen=True)
class Unexplained:
    """Torque of a joint that exceeds the noise and that no law explains."""

    joint: int
    place: Location
    share: float  # its rms over the rms of the joint's recorded torque [1]
    held_out_gain: float = 0.0  # share of the held-out sum of squares that a function of the variable explains [1]
    modelled: bool = False  # whether the extended simulation has that function, as `empirical` torque


class Detectable(NamedTuple):
    """The smallest law of its effect and joint that the recordings would have named with a probability of .9."""

    effect: str
    joint: str | None  # None: the whole robot
    parameter: str  # its first one; all other coefficients are zero
    smallest: float | None  # [unit], a difference from a stated number; None: no plausible size would have been named
    unit: str


def without_cause(findings: Iterable[Finding], unexplained: Iterable[Unexplained]) -> tuple[Unexplained, ...]:
    """Joints much of whose torque stays unexplained although the causes hardly act on them."""
    causes = [finding.torque_share for finding in findings if finding.role == "cause"]
    return tuple(
        left
        for left in unexplained
        if left.share >= MUCH_SHARE and all(share[left.joint] < MIN_CAUSE_RATIO * left.share for share in causes)
    )


@dataclass(frozen=True, eq=False)
class Diagnosis(Result):
    """Differences between a simulation and recordings, and the laws that explain them."""

    robot: Robot
    verdict: str  # "nothing_missing", "named", "unknown" or "undecided"
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    located: tuple[Location, ...]  # of the residual of the given simulation, per joint
    tolerance: float  # largest residual that counts as no difference, as a share of torque [1]
    before: Fit
    after: Fit
    train: Course  # both simulations on what was learned from
    held_out: Course  # and on what was held out
    rollout_before: RollOut | None
    rollout_after: RollOut | None
    model: Model  # the extended simulation
    prior_scale: float  # k: errors of the given simulation, in standard deviations of their prior [1]
    signs: Signs | None
    inputs: tuple[Input, ...]  # files of the recordings
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    cutoff: float  # [Hz]
    seed: int
    recordings: tuple[Recording, ...] = ()  # training and held-out data, with recovered signs
    informed: bool = False  # whether the simulation has a covariance from identification
    detectable: tuple[Detectable, ...] = ()
    question: str = ""  # of an identified model: what has "changed" since, or what it "lacked" from the start

    @property
    def causes(self) -> tuple[Finding, ...]:
        """Findings that are causes."""
        return tuple(finding for finding in self.findings if finding.role == "cause")

    @property
    def without_cause(self) -> tuple[Unexplained, ...]:
        """Joints much of whose torque stays unexplained although the causes hardly act on them."""
        return without_cause(self.findings, self.unexplained)

    @property
    def gain(self) -> Array:
        """(n,) held-out rms of the extended over the given simulation [1]."""
        return np.asarray(self.after.held_out_rms / self.before.held_out_rms)
