"""Selected laws -> the extended simulation that is handed out: the least change that predicts held-out data best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..model import Model
from ..session import Session
from ..types import Array, Law
from .extend import extend
from .fitted import Fitted
from .found import Found
from .group import Group
from .numbers import read_laws
from .odds import Judge
from .prove import Shown, show

BETTER = 0.02  # log of the rms per joint by which refitted numbers must predict held-out torque better than stated ones
LEAST = 1e-3  # of the rms torque: smaller residuals count as this large


class Extended(NamedTuple):
    """The extended simulation, and what it predicts."""

    laws: Mapping[Group, tuple[Law, ...]]  # of every selected hypothesis, with all their numbers
    shown: Shown
    refitted: bool  # whether numbers that the simulation states were refitted as well


def hand_out(session: Session, model: Model, judge: Judge, found: Found, order: Sequence[Group]) -> Extended:
    """The simulation with the selected laws.

    Bodies and laws that the simulation states are refitted where held-out torque is predicted better for it: a short
    recording may override better knowledge. Where nothing was selected, the simulation stays as it is.

    Args:
        session: recordings.
        model: the simulation.
        judge: library and evidence.
        found: what was selected.
        order: the same, in the order in which the simulation gets their laws.
    """
    evidence = judge.evidence
    whole = evidence.fit(found.true, found.base, found.trust)
    laws = _laws(order, whole)
    if not order:
        return Extended(laws, show(session, model), False)
    alone = evidence.fit_alone(found.true, found.base)
    few = _laws(order, alone)
    kept = show(session, extend(model, (), alone, _flat(few), session.task.base))
    full = show(session, extend(model, evidence.data.refitted, whole, _flat(laws), session.task.base))
    if held_out_error(full) < held_out_error(kept) - BETTER:
        return Extended(laws, full, True)
    return Extended(few, kept, False)


def held_out_error(shown: Shown) -> float:
    """Mean over joints of the log of the held-out rms residual, over the rms torque [-]."""
    rest, torque = shown.judged.rest, shown.judged.torque
    left, scale = _mean_square(rest), np.nanmean(torque**2, axis=0)
    counted = np.isfinite(left) & (scale > 0)
    ratio = np.maximum(left[counted] / scale[counted], LEAST**2)
    return float(np.mean(np.log(ratio)) / 2) if counted.any() else 0.0


def _mean_square(x: Array) -> Array:
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan))


def _laws(order: Sequence[Group], fit: Fitted) -> dict[Group, tuple[Law, ...]]:
    return {group: read_laws(group, fit.value[fit.place(group)]) for group in order}


def _flat(laws: Mapping[Group, tuple[Law, ...]]) -> list[Law]:
    return [law for own in laws.values() for law in own]
