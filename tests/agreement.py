"""Compare an effect's columns with the torque that the simulator applies for it, on the same motion."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import NamedTuple

import numpy as np
from arm import arm, harmonics
from contract import law_of, on_all_joints

from signid.effects import EFFECTS
from signid.effects.base import Effect, TransmissionLaw
from signid.model import Model, stated_inertials
from signid.regression.bandwidth import lowpass, smooth
from signid.regression.motion import Motion
from signid.simulation.plant import simulate, track
from signid.types import Law

SECONDS, CUTOFF, EDGE = 6.0, 15.0, 1000  # [s], [Hz], ignored samples at each end
ROTOR = Law(EFFECTS["armature"], (1,), {"inertia": 0.2})


class Agreement(NamedTuple):
    """Ratio of the simulated to the planted size, and rms residual of the columns over the rms torque of the law."""

    slope: float
    left: float


def agreement(effect: Effect, step: float = 1e-3) -> Agreement:
    """Compare the simulator's torque with the columns."""
    law, bare = law_of(effect), _bare()
    ahead = (ROTOR,) if isinstance(effect, TransmissionLaw) else ()
    found = simulate(replace(bare, laws=(*ahead, law)), track(bare, harmonics(SECONDS, 1)), SECONDS, step=step)
    motion = Motion(arm(), found.t, found.q, found.true_v, found.true_a, recorded=found.tau)
    shown = found.tau - motion.load - sum(on_all_joints(other, motion) for other in ahead)
    seen, planted = (smooth(x[EDGE:-EDGE], lowpass(1 / motion.dt, CUTOFF)) for x in (shown, on_all_joints(law, motion)))
    size = np.sum(planted**2)
    return Agreement(float(np.sum(seen * planted) / size), float(np.sqrt(np.sum((seen - planted) ** 2) / size)))


@cache
def _bare() -> Model:
    return Model(arm(), stated_inertials(arm()))
