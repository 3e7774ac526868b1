"""What a diagnosis says."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..estimation.fit_quality import Course, Fit
from ..model import Model
from ..signs import Signs
from ..simulation.rollout import RollOut
from ..types import Array, Frozen, Input, Law, Recording, Robot
from .data.locate import Place


@dataclass(frozen=True)
class Alternative:
    """A law that explains a finding as well, or nearly."""

    law: Law  # without numbers but for its shape
    probability: float
    separating_motion: str


@dataclass(frozen=True, eq=False)
class Finding(Frozen):
    """A law that the simulation lacks."""

    law: Law  # with all its numbers
    std: Mapping[str, float]  # of each number [as its parameter]
    role: str  # cause, or secondary
    probability: float
    torque_share: Array  # (n,) rms of its torque over the rms of the measured torque [1]
    where: Place
    statistic: float  # log posterior odds against its absence
    threshold: float  # that it needed
    held_out_gain: float  # share of the held-out sum of squares that it takes away, on its joints [1]
    alternatives: tuple[Alternative, ...]
    stated: Mapping[str, float] = field(
        default_factory=dict
    )  # of numbers that the simulation states [as its parameter]
    in_model: bool = True  # whether the extended simulation has it: held-out torque is predicted no worse with it


@dataclass(frozen=True)
class Unexplained:
    """Torque of a joint that no law explains, beyond noise."""

    joint: int
    place: Place
    share: float  # rms over the rms of the joint's measured torque [1]
    held_out_gain: float = 0.0  # share of the held-out sum of squares that a function of the variable takes away [1]
    modelled: bool = False  # whether the extended simulation has that function, as `empirical` torque


@dataclass(frozen=True, eq=False)
class Diagnosis(Frozen):
    """Where a simulation and recordings differ, and what is behind it."""

    robot: Robot
    verdict: str  # nothing_missing, named or unknown
    findings: tuple[Finding, ...]
    unexplained: tuple[Unexplained, ...]
    located: tuple[Place, ...]  # per joint, before anything was added
    tolerance: float  # share of torque within which nothing is missing [1]
    before: Fit
    after: Fit
    train: Course  # both simulations on what was learned from
    held_out: Course  # and on what was held out
    rollout_before: RollOut | None
    rollout_after: RollOut | None
    model: Model  # the extended simulation
    prior_scale: float  # of the usual tolerance of inertials, how far they seem to be off [1]
    signs: Signs | None
    inputs: tuple[Input, ...]  # the recordings
    flags: tuple[str, ...]
    notes: tuple[str, ...]
    cutoff: float  # [Hz]
    seed: int
    recordings: tuple[Recording, ...] = ()  # held-out ones too, with the signs that were found
    informed: bool = False  # whether the simulation carries the covariance that identification left

    @property
    def causes(self) -> tuple[Finding, ...]:
        """The findings that are causes."""
        return tuple(finding for finding in self.findings if finding.role == "cause")

    @property
    def gain(self) -> Array:
        """(n,) held-out rms after over before [1]."""
        return np.asarray(self.after.held_out_rms / self.before.held_out_rms)
