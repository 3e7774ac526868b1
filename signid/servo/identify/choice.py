"""Trials of drives: fits to all training data, and errors on windows that took no part."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ...model import Model
from ...parameters import Array
from ...servos import Servo, ServoGrid
from ..fit import ServoFit, fit_servos
from ..plant import roll_out
from .data import ServoData
from .evidence import improves, window_scores

WINDOW = 1.0  # [s] of the scores
STEPS, REFIT = 15, 3  # most iterations on all training data, and from there without a fold
SHORT = 0.2  # [s] of the first windows where drives saturate: nearly linear
ROUNDS = 2  # fits in which a limit that is tied to kp follows it
DIVERGED = 10.0  # [rad or m] an error beyond this counts as this
WORTH = 0.98  # error on the training data, over that without a number, from which the number is cross-validated


@dataclass(frozen=True)
class Candidate:
    """Drives to start a fit from, and their free numbers."""

    servos: Mapping[str, Servo]
    free: tuple[tuple[str, str], ...]
    tied: Mapping[str, float] = field(default_factory=dict)  # effort limit over kp [rad or m], by joint

    def changed(self, servos: Mapping[str, Servo], free: Sequence[tuple[str, str]] = ()) -> Candidate:
        """With other drives at some joints, and more free numbers."""
        return replace(self, servos={**self.servos, **servos}, free=tuple(dict.fromkeys((*self.free, *free))))

    def only(self, joints: Collection[str]) -> Candidate:
        """Of some joints; the others follow the recorded motion."""
        return Candidate(
            {joint: servo for joint, servo in self.servos.items() if joint in joints},
            tuple(name for name in self.free if name[0] in joints),
            {joint: error for joint, error in self.tied.items() if joint in joints},
        )

    def follow(self, servos: Mapping[str, Servo]) -> Candidate:
        """With other drives, whose tied limits follow their gains."""
        tied = {j: servos[j].with_(effort_limit=servos[j].kp * error) for j, error in self.tied.items()}
        return replace(self, servos={**servos, **tied})


@dataclass(frozen=True)
class Trial:
    """A candidate, fitted to all training data."""

    candidate: Candidate  # with the fitted drives
    residual: Mapping[str, float]  # rms on windows of the training data [rad or m], by joint
    scores: Mapping[str, Array] = field(default_factory=dict)  # log rms (W,) of windows that took no part, by joint

    def only(self, joints: Collection[str]) -> Trial:
        """Of some joints."""
        residual = {joint: x for joint, x in self.residual.items() if joint in joints}
        scores = {joint: x for joint, x in self.scores.items() if joint in joints}
        return Trial(self.candidate.only(joints), residual, scores)

    def with_joints(self, other: Trial) -> Trial:
        """With some joints of another trial."""
        candidate = self.candidate.changed(other.candidate.servos, other.candidate.free)
        return Trial(candidate, {**self.residual, **other.residual}, {**self.scores, **other.scores})


def fit_candidate(
    model: Model,
    grids: Sequence[ServoGrid],
    candidate: Candidate,
    window: float,
    steps: int = STEPS,
    relinearise: bool = False,
    rounds: int = ROUNDS,
) -> tuple[Candidate, ServoFit]:
    """Fit a candidate; limits that are tied to gains follow them."""
    rounds = rounds if candidate.tied else 1
    for k in range(rounds):
        fit = fit_servos(
            model,
            grids,
            candidate.servos,
            candidate.free,
            window=window,
            shared=("delay",),
            relinearise=relinearise and k == rounds - 1,
            iterations=steps,
            scales=False,
        )
        candidate = candidate.follow(fit.servos)
    return candidate, fit


def tried(model: Model, data: ServoData, candidate: Candidate, window: float, steps: int = STEPS) -> Trial:
    """Fit a candidate to all training data."""
    candidate, fit = fit_candidate(model, data.train, candidate, window, steps)
    return Trial(candidate, {joint: float(fit.residual_rms[data.joints.index(joint)]) for joint in candidate.servos})


def scored(model: Model, data: ServoData, trial: Trial, window: float) -> Trial:
    """The same with its scores on windows that took no part in refits."""
    found: dict[str, list[Array]] = {joint: [] for joint in trial.residual}
    for part, unseen in data.folds:
        candidate, _ = fit_candidate(model, part, trial.candidate, window, REFIT, rounds=1)
        for grid in unseen:
            scores = roll_out_scores(model, candidate.servos, grid)
            for joint in found:
                found[joint].append(scores[:, grid.joints.index(joint)])
    return replace(trial, scores={joint: np.concatenate(some) for joint, some in found.items() if some})


def roll_out_scores(model: Model, servos: Mapping[str, Servo], grid: ServoGrid) -> Array:
    """Log rms (W, n) of the whole roll-out of a grid over windows of one second."""
    error = np.nan_to_num(roll_out(model, servos, grid) - grid.q, nan=DIVERGED, posinf=DIVERGED, neginf=DIVERGED)
    step = round(WINDOW * grid.rate)
    windows = [slice(a, a + step) for a in range(0, max(len(grid) - step, 0) + 1, step)]
    return window_scores(np.clip(error, -DIVERGED, DIVERGED), windows)


def worth(before: Trial, after: Trial, joints: Sequence[str]) -> list[str]:
    """Joints whose training data a change fits notably better."""
    return [joint for joint in joints if after.residual[joint] < WORTH * before.residual[joint]]


def improved(before: Trial, after: Trial, joints: Sequence[str]) -> list[str]:
    """Joints whose windows that took no part improve surely."""
    return [joint for joint in joints if improves(before.scores[joint], after.scores[joint])]
