"""Rows of a robot that moves along sines, with planted laws: small evidence for the diagnosis, without MuJoCo."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

import signid
from signid.diagnose.data.dataset import Dataset, whitened
from signid.diagnose.data.hypotheses import Hypothesis
from signid.diagnose.data.motions import Piece
from signid.diagnose.data.noise import Noise
from signid.diagnose.data.rows import Group, build_groups, build_table
from signid.diagnose.evidence.bayes_factors import Evidence
from signid.diagnose.evidence.selection import Posterior, Selection
from signid.diagnose.search.stepwise import initial_selection
from signid.effects import EFFECTS
from signid.effects.law import law_torque
from signid.model import Model, stated_inertials
from signid.regression.bandwidth import Decimator
from signid.regression.motion import Motion
from signid.types import Array, Law

RATE, SECONDS, NOISE, CUTOFF = 50.0, 8.0, 0.02, 5.0  # Hz, s of each recording, N.m, Hz
DISPERSION = 1.3


class Question(NamedTuple):
    """Data that a search is given."""

    dataset: Dataset
    posterior: Posterior

    def group(self, effect: str, *joints: int) -> Group:
        """Columns of a hypothesis."""
        return self.posterior.evidence.data.groups[self.posterior.keys[effect, joints][0]]

    @property
    def dispersion(self) -> Array:
        """(n,) variance of the whitened residual [1]."""
        return np.full(self.posterior.evidence.data.joints, DISPERSION)

    def selection(self, *selected: Group) -> Selection:
        """Selection of some hypotheses."""
        bare = initial_selection(self.posterior, self.dispersion, {})
        return bare.with_selected(selected, dict.fromkeys(selected, 100.0))


def law(effect: str, *joints: int, **parameters: float) -> Law:
    """A law with given or unknown parameters."""
    return Law(EFFECTS[effect], joints or (0,), parameters)


def moved(robot: str = "1r", seed: int = 0) -> Motion:
    """Motion of all joints along four sines each."""
    described, rng = signid.load_robot(robot), np.random.default_rng(seed)
    n, t = len(described.joints), np.arange(int(SECONDS * RATE)) / RATE
    w = 2 * np.pi * rng.uniform(0.1, 0.8, (4, n))
    size, phase = rng.uniform(0.3, 1.0, (4, n)) / w, rng.uniform(0, 2 * np.pi, (4, n))
    angle = w * t[:, None, None] + phase  # (N, 4, n)
    q, v, a = (
        np.sum(x, axis=1) for x in (size * np.sin(angle), size * w * np.cos(angle), -size * w**2 * np.sin(angle))
    )
    motion = Motion(described, t, q, v, a, slow=np.full(n, 0.02))
    return Motion(described, t, q, v, a, recorded=motion.load, predicted=motion.load, slow=motion.slow)


def pose(
    hypotheses: Sequence[Law | Hypothesis],
    *planted: Law,
    more: Array | float = 0.0,
    robot: str = "1r",
    recordings: int = 1,
    noise: float = NOISE,
) -> Question:
    """Evidence for these hypotheses; planted laws, extra torque (N, n) [N.m] and white noise make the residual."""
    rng, described = np.random.default_rng(7), signid.load_robot(robot)
    model, pieces = Model(described, stated_inertials(described), ()), list[Piece]()
    for k in range(recordings):
        motion = moved(robot, k)
        residual = noise * rng.standard_normal(motion.q.shape) + more
        for one in planted:
            rows, torque = law_torque(one, motion)
            residual[:, list(rows)] += torque
        pieces.append(Piece(k, motion, residual))
    claims = [one if isinstance(one, Hypothesis) else Hypothesis((one,)) for one in hypotheses]
    n, task = len(described.joints), _task()
    table = build_table(task, model, build_groups(model, pieces[0].motion, claims, np.zeros(n)), pieces, np.zeros(n))
    floor, zero = np.full(n, max(noise, 1e-3)), np.zeros(n)
    measured = Noise(floor, np.zeros((n, 4)), floor, zero, floor, zero)
    dataset = Dataset(task, model, tuple(pieces), (None,) * recordings, table, measured)
    carried = tuple(range(n))
    return Question(dataset, Posterior(Evidence(whitened(table, measured)), len(list(EFFECTS)), carried))


def _task() -> Any:
    """A band whose low-pass leaves every sample as it is."""
    band = SimpleNamespace(decimator=lambda _: Decimator(np.ones(1), 1), rate=RATE, factor=1, cutoff=CUTOFF)
    return SimpleNamespace(band=band, parts=1)


def names(selection: Selection) -> set[str]:
    """Effects of the selected laws."""
    return {group.claim.key[0] for group in selection.selected}
