"""Model, data and options of a search for drives, its fits and scores, and its result."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ...model import Model
from ...types import Progress
from .choice import STEPS, Candidate, ServoTrial, scored, tried
from .data import ServoData
from .windows import lengthened

FIRST = "load_friction"  # tried before the laws of joints that saturate rarely: else limits are fitted to friction
ADDITIONAL = (FIRST, "dead_band", "droop", "profile_speed")


@dataclass(frozen=True)
class ServoOptions:
    """Options of a servo identification. Defaults come from the data."""

    rate: float | None = None  # [Hz] of the grids
    window: float = 0.0  # [s] of the windows of the fit; 0: 1 s for single joints, 0.8 s for coupled ones (linearised)
    additional: tuple[str, ...] = ADDITIONAL  # numbers that are tried one at a time
    seed: int = 0


@dataclass(frozen=True)
class Chosen:
    """Drives and free numbers that were chosen, and the probability of each law at each joint."""

    candidate: Candidate
    laws: Mapping[str, Mapping[str, float]]  # empty at joints whose law is stated


@dataclass(frozen=True)
class KnownLimits:
    """Known limits of drives before the search, by joint."""

    starts: Mapping[str, Candidate]  # by law: drives by regression, with limits at joints that seem to saturate
    laws: Mapping[str, str]  # stated laws, and `duty` where the recorded PWM shows it

    def joints(self, but: Collection[str]) -> list[str]:
        """Joints that seem to saturate or state a limit, except some."""
        found = {j: 0 for one in self.starts.values() for j, servo in one.servos.items() if servo.effort_limit < np.inf}
        return [joint for joint in found if joint not in but]


@dataclass(frozen=True)
class Searcher:
    """Model, data and options of a search."""

    model: Model
    data: ServoData
    sets: Sequence[Sequence[str]]  # connected joints
    options: ServoOptions
    progress: Progress | None = None

    def fit(self, candidate: Candidate, steps: int = STEPS, coarse: bool = True) -> ServoTrial:
        """Fit to all training data."""
        return tried(self.model, self.data, candidate, self.options.window, steps, coarse)

    def lengthen(self, trial: ServoTrial) -> ServoTrial:
        """Fit again over longer windows, where whole recordings are fitted worse than windows."""
        return lengthened(self.model, self.data, trial, self.options.window)

    def score(self, trial: ServoTrial, joints: Collection[str]) -> ServoTrial:
        """Score some joints, with those that share bodies with them, on windows that took no part."""
        if all(joint in trial.scores for joint in joints):
            return trial
        return trial.with_joints(scored(self.model, self.data, trial.only(joints), self.options.window))

    def near(self, joints: Collection[str]) -> set[str]:
        """Joints that share moved bodies with some joints, and these."""
        return {joint for members in self.sets if any(j in joints for j in members) for joint in members}

    def say(self, step: str, share: float) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(step, share)

    def sharing(self, candidate: Candidate, joints: Collection[str]) -> list[str]:
        """Some joints, of those in branches where several have a free delay."""
        free = {joint for joint, name in candidate.free if name == "delay"}
        return [j for members in self.sets if len(free.intersection(members)) > 1 for j in members if j in joints]
