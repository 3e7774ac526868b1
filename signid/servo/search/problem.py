"""Identification problem of the drives of a robot: what is known of them, and the fits and scores of a search."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...model import Model
from ...servos import Servo
from ...types import Progress
from ..given import Assumptions, unions
from ..plant.course import recorded_course
from ..plant.roll_out import roll_out_along
from .choice import DIVERGED, STEPS, Candidate, ServoTrial, scored, tried
from .data import ServoData

EARLY_NUMBER = "load_friction"  # tried before laws of joints that saturate rarely: else limits fit friction
ADDITIONAL = (EARLY_NUMBER, "dead_band", "droop", "profile_speed")
FACTORS = (2.0, 4.0, 16.0)  # of the windows, one after another
MIN_WINDOWS = 16  # windows in all recordings: fewer give no intervals
LONGER = 8  # most iterations
LONGER_WINDOW_RATIO = 1.15  # error of whole recordings over that of windows from which longer windows are tried
WHOLE_ERROR_RATIO = 0.98  # error of whole recordings over that before, geometric mean of the joints, so that they stay
Estimates = Mapping[str, tuple[float, float]]  # value and standard deviation by number [SERVO_UNITS]


@dataclass(frozen=True)
class ServoOptions:
    """Options of a servo identification. Defaults come from the data."""

    rate: float | None = None  # [Hz] of the grids
    window: float = 0.0  # [s] of the windows of the fit; 0: 1 s for single joints, 0.8 s for coupled ones (linearised)
    additional: tuple[str, ...] = ADDITIONAL  # numbers that are tried one at a time
    seed: int = 0


@dataclass(frozen=True)
class ServoProblem:
    """Model, rows, knowledge and options of an identification, and what its steps have found so far."""

    described: Model  # with ideal drives, and the masses of the description
    model: Model  # the same with the masses that are used
    data: ServoData  # all rows
    searched: ServoData  # rows of the search
    sets: Sequence[Sequence[str]]  # driven joints that share moved bodies
    assumptions: Assumptions
    options: ServoOptions
    progress: Progress | None = None
    flags: tuple[str, ...] = ()
    full_duty: Mapping[str, float] = field(default_factory=dict)  # error [rad or m] by joint, from the recorded PWM
    regressed: Mapping[str, Servo] = field(default_factory=dict)  # drives by regression, by joint
    start: Candidate = Candidate({}, ())  # without limits, unless they are stated or tied to a gain
    limited: Mapping[str, Candidate] = field(default_factory=dict)  # by law: the start, with limits by regression
    command_timing: Mapping[str, float] = field(default_factory=dict)  # time [s] by which a delay may be longer
    unequal: Mapping[str, Estimates] = field(default_factory=dict)  # of equal joints: numbers without that assumption

    def saturating(self) -> list[str]:
        """Joints that seem to saturate or state a limit that no gain ties, with those that share their numbers."""
        servos = [item for start in self.limited.values() for item in start.servos.items()]
        names = dict.fromkeys(joint for joint, servo in servos if servo.effort_limit < np.inf)
        return self.assumptions.with_peers([joint for joint in names if joint not in self.start.tied])

    def fit(self, candidate: Candidate, steps: int = STEPS, coarse: bool = True) -> ServoTrial:
        """Fit to all training data."""
        return tried(self.model, self.searched, candidate, self.options.window, steps, coarse)

    def lengthen(self, trial: ServoTrial) -> ServoTrial:
        """Fit again over longer windows, where whole recordings are fitted worse than windows.

        Short windows begin at measured states, which take up what repeats of an error would add to.
        """
        whole, grids, window = self._whole_rms(trial.candidate), self.searched.train, self.options.window
        if not any(whole[joint] > LONGER_WINDOW_RATIO * trial.residual[joint] for joint in whole):
            return trial
        best, seconds = trial, sum(len(grid) / grid.rate for grid in grids)
        for factor in FACTORS:
            if seconds / (factor * window) < MIN_WINDOWS and factor * window > max(len(g) / g.rate for g in grids):
                break
            new = self.fit(replace(best.candidate, window=factor * window), LONGER)
            after = self._whole_rms(new.candidate)
            if np.mean([np.log(after[joint] / whole[joint]) for joint in whole]) > np.log(WHOLE_ERROR_RATIO):
                break
            best, whole = new, after
        return best

    def shorten(self, trial: ServoTrial) -> ServoTrial:
        """Fit again over short windows, whose cost is smooth, unless whole recordings are then fitted worse."""
        new = self.fit(replace(trial.candidate, window=0.0))
        before, after = (self._whole_rms(one.candidate) for one in (trial, new))
        return trial if np.mean([np.log(after[joint] / before[joint]) for joint in before]) > 0.0 else new

    def _whole_rms(self, candidate: Candidate) -> dict[str, float]:
        """Rms error by joint [rad or m] of whole recordings from commands alone."""
        grids = self.searched.train
        errors = [roll_out_along(recorded_course(self.model, g), candidate.servos, g) - g.q for g in grids]
        both = np.clip(np.nan_to_num(np.concatenate(errors), nan=DIVERGED), -DIVERGED, DIVERGED)
        rms = np.maximum(np.sqrt(np.mean(both**2, axis=0)), 1e-12)
        return {joint: float(rms[grids[0].joints.index(joint)]) for joint in candidate.servos}

    def score(self, trial: ServoTrial, joints: Collection[str]) -> ServoTrial:
        """Score some joints, with those that share bodies with them, on windows that took no part."""
        if all(joint in trial.scores for joint in joints):
            return trial
        return trial.with_joints(scored(self.model, self.searched, trial.only(joints), self.options.window))

    def near(self, joints: Collection[str]) -> set[str]:
        """Joints that share moved bodies or numbers with some joints, and these."""
        sets = unions((*self.sets, *self.assumptions.equal))
        return {joint for members in sets if any(j in joints for j in members) for joint in members}

    def say(self, step: str, share: float) -> None:
        """Report progress."""
        if self.progress is not None:
            self.progress(step, share)
