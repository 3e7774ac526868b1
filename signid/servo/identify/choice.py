"""Cross-validated choice of the law of each drive and of additional numbers."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...model import Model
from ...parameters import Array
from ...servos import Servo, ServoGrid
from ..fit import fit_servos
from ..plant import roll_out
from .data import ServoData
from .evidence import improves, law_probabilities, window_scores

WINDOW = 1.0  # [s] of the scores
STEPS, REFIT = 15, 5  # most iterations on all training data, and from there without a fold
DIVERGED = 10.0  # [rad or m] an error beyond this counts as this

Free = tuple[tuple[str, str], ...]
Fitter = Callable[[Model, Sequence[ServoGrid], Mapping[str, Servo], Free], Mapping[str, Servo]]


@dataclass(frozen=True)
class Candidate:
    """Drives to start a fit from, and their free numbers."""

    servos: Mapping[str, Servo]
    free: Free

    def changed(self, servos: Mapping[str, Servo], free: Sequence[tuple[str, str]] = ()) -> Candidate:
        """With other drives at some joints, and more free numbers."""
        return Candidate({**self.servos, **servos}, tuple(dict.fromkeys((*self.free, *free))))


def unseen_scores(model: Model, data: ServoData, candidate: Candidate, window: float) -> dict[str, Array]:
    """Log rms (W,) of each joint on windows of whole roll-outs that took no part in the fit."""
    found: dict[str, list[Array]] = {joint: [] for joint in candidate.servos}
    near = replace(candidate, servos=fitted(model, data.train, candidate, window, STEPS))
    for fit, unseen in data.folds:
        servos = fitted(model, fit, near, window, REFIT)
        for grid in unseen:
            scores = roll_out_scores(model, servos, grid)
            for joint in found:
                found[joint].append(scores[:, grid.joints.index(joint)])
    return {joint: np.concatenate(some) if some else np.zeros(0) for joint, some in found.items()}


def fitted(
    model: Model, grids: Sequence[ServoGrid], candidate: Candidate, window: float, steps: int
) -> Mapping[str, Servo]:
    """Drives fitted to some grids, without the second linearisation."""
    return fit_servos(
        model,
        grids,
        candidate.servos,
        candidate.free,
        window=window,
        shared=("delay",),
        relinearise=False,
        iterations=steps,
    ).servos


def roll_out_scores(model: Model, servos: Mapping[str, Servo], grid: ServoGrid) -> Array:
    """Log rms (W, n) of the whole roll-out of a grid over windows of one second."""
    error = np.nan_to_num(roll_out(model, servos, grid) - grid.q, nan=DIVERGED, posinf=DIVERGED, neginf=DIVERGED)
    step = round(WINDOW * grid.rate)
    windows = [slice(a, a + step) for a in range(0, max(len(grid) - step, 0) + 1, step)]
    return window_scores(np.clip(error, -DIVERGED, DIVERGED), windows)


def choose_laws(
    scores: Mapping[str, Mapping[str, Array]], joints: Sequence[str], seed: int
) -> dict[str, dict[str, float]]:
    """Probability of each law at each joint. scores: by law, by joint, (W,)."""
    return {joint: law_probabilities({law: of[joint] for law, of in scores.items()}, seed) for joint in joints}


def improved(before: Mapping[str, Array], after: Mapping[str, Array]) -> list[str]:
    """Joints whose windows that took no part improve surely."""
    return [joint for joint in before if improves(before[joint], after[joint])]
