"""Groups of columns: nuisance parameters (X a of the README) and hypotheses (S b)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ...effects.law import law_columns
from ...model import Model
from ...regression.motion import Motion
from ...regression.projection import least_squares
from ...types import Array, Law
from .estimated_gains import EstimatedGain
from .hypotheses import Hypothesis, is_refitted
from .motions import Piece, stated_friction
from .thresholds import (
    CENTRE_STD,
    FRICTION_STD,
    INERTIA_STD,
    LAW_STD,
    MASS_STD,
    MIN_MASS,
    OFFSET_STD,
    REVERSAL_LEAD,
    REVERSAL_STD,
    REVERSAL_WIDTHS,
)

MIN_CENTRED_MASS = 1e-6  # [kg] a body below this mass has no centre of mass. Heuristic
DRY_STRIDE = 8  # every 8th sample is used for the rough estimate of dry friction. Heuristic
LAYOUT_SAMPLES = 64  # samples of the motion from which columns are counted


@dataclass(frozen=True, eq=False)
class Group:
    """`size` consecutive columns from `start` on: a nuisance term or a hypothesis."""

    start: int
    size: int
    hypothesis: Hypothesis | None = None  # None: a nuisance term, which is always fitted
    bodies: bool = False  # inertial parameters of a body: fitted only if the prior scale k is above zero
    law: Law | None = None  # law of the simulation whose coefficients are refitted
    deviation: tuple[float, ...] = ()  # (size,) prior standard deviations [unit of each coefficient]; inf: flat prior

    @property
    def claim(self) -> Hypothesis:
        """The hypothesis of these columns; nuisance terms have none."""
        assert self.hypothesis is not None, "a nuisance term is no hypothesis"
        return self.hypothesis


class Nuisance(NamedTuple):
    """One nuisance term, fitted beside every hypothesis."""

    columns: dict[int, Array]  # per joint (N, k) [torque per coefficient]
    deviation: list[float]  # (k,) prior standard deviations [unit of each coefficient]
    law: Law | None = None  # law of the simulation
    bodies: bool = False


def nuisances(model: Model, motion: Motion, dry: Array, free: Sequence[Law] = ()) -> Iterator[Nuisance]:
    """Nuisance terms X a in the order of their columns, each with its prior; dry friction `dry` (n,) [N.m or N].

    Laws that are `free` have flat priors, as have those of an identified model, whose covariance counts.

    They are coefficients of stated laws, shapes of dry friction near velocity reversals, and all inertial parameters.
    """
    stated = stated_friction(model)
    for law in model.laws:
        if is_refitted(law):
            rows, columns = law_columns(law, motion)
            own = law_tolerance(law, float(stated[law.joints[0]]))
            flat = (model.covariance or law in free) and not isinstance(law.effect, EstimatedGain)
            spread = [np.inf] * columns.shape[2] if flat else own
            yield Nuisance({j: columns[:, k] for k, j in enumerate(rows)}, spread, law)
    for j in np.flatnonzero(dry > 0).tolist():
        yield Nuisance({j: _reversal_columns(motion, j)}, [REVERSAL_STD * float(dry[j])] * 3)
    for body, spread in enumerate(tolerance(model).tolist()):
        moving = np.flatnonzero(motion.moved[:, body]).tolist()
        yield Nuisance({j: motion.bodies[:, j, body] for j in moving}, spread, bodies=True)


def law_tolerance(law: Law, dry: float) -> list[float]:
    """(k,) prior standard deviations of the coefficients of a stated law [unit of each]; `dry`: friction [N.m or N]."""
    if isinstance(law.effect, EstimatedGain):
        return [float(np.sqrt(law.effect.covariance[law.joints[0]]))]
    share = FRICTION_STD if law.effect.dissipative or law.effect.name == "torque_offset" else LAW_STD
    least = OFFSET_STD * dry if law.effect.name == "torque_offset" else 0.0
    return [max(share * abs(x), least, 1e-9) for x in law.effect.coefficients(law.parameters)]


def tolerance(model: Model) -> Array:
    """(nb, 10) prior standard deviations of stated inertial parameters [kg, kg.m, kg.m2]."""
    out = []
    for inertia in list(model.bodies().inertias)[1:]:
        mass = max(abs(inertia.mass), MIN_MASS)
        about, lever = np.diag(inertia.inertia), np.abs(inertia.lever)
        if abs(inertia.mass) < MIN_CENTRED_MASS:  # no centre of mass
            about, lever = inertia.toDynamicParameters()[[4, 6, 9]], np.abs(inertia.mass * inertia.lever) / mass
        moment = max(INERTIA_STD * float(np.max(np.abs(about) + mass * (lever @ lever))), mass * CENTRE_STD**2)
        half = moment / 2
        first = np.hypot(MASS_STD * mass * lever, CENTRE_STD * mass)
        out.append([MASS_STD * mass, *first, moment, half, moment, half, half, moment])
    return np.array(out)


def _reversal_columns(motion: Motion, joint: int) -> Array:
    """(N, 3) change of the friction direction if it turns more steeply, more softly or earlier than presumed [1]."""
    assert motion.slow is not None, "a diagnosed motion has the width of a reversal"
    v, slow, presumed = motion.v[:, joint], motion.slow[joint], motion.direction[:, joint]
    ahead = max(1, round(REVERSAL_LEAD / motion.dt))
    early = np.append(presumed[ahead:], np.full(ahead, presumed[-1]))
    return np.column_stack([*(np.clip(v / (w * slow), -1, 1) - presumed for w in REVERSAL_WIDTHS), early - presumed])


def dry_friction(model: Model, pieces: Sequence[Piece]) -> Array:
    """(n,) dry friction of each joint [N.m or N]: stated, plus a rough estimate from the residual."""
    return np.asarray(stated_friction(model) + np.maximum(rough_drives(pieces)[:, 0], 0.0))


def rough_drives(pieces: Sequence[Piece]) -> Array:
    """(n, 3) rough estimates of dry friction [N.m or N], viscous friction and offset of each joint in the residual."""
    few = [(piece.motion[::DRY_STRIDE], piece.residual[::DRY_STRIDE]) for piece in pieces]
    out = np.zeros((few[0][1].shape[1], 3))
    for j, drive in enumerate(out):
        x = np.concatenate([np.column_stack([_rough_columns(motion, j), y[:, j]]) for motion, y in few])
        x = x[np.isfinite(x).all(axis=1)]
        if len(x):
            drive[:] = least_squares(x[:, :-1], x[:, -1], 1e-6)[:3]
    return out


def _rough_columns(motion: Motion, joint: int) -> Array:
    """(N, k) [torque per coefficient] columns of dry and viscous friction, an offset and the bodies."""
    bodies = [motion.bodies[:, joint, body] for body in np.flatnonzero(motion.moved[joint])]
    return np.column_stack([motion.direction[:, joint], motion.v[:, joint], np.ones(len(motion)), *bodies])


def build_groups(
    model: Model, motion: Motion, hypotheses: Sequence[Hypothesis], dry: Array, free: Sequence[Law] = ()
) -> list[Group]:
    """Groups of all columns: nuisance terms first, then the hypotheses; dry friction `dry` (n,) [N.m or N]."""
    out, at = list[Group](), 0
    for found in nuisances(model, motion[:LAYOUT_SAMPLES], dry, free):
        size = len(found.deviation)
        out.append(Group(at, size, None, found.bodies, found.law, tuple(found.deviation)))
        at += size
    for hypothesis in hypotheses:
        out.append(Group(at, hypothesis.size, hypothesis))
        at += hypothesis.size
    return out
