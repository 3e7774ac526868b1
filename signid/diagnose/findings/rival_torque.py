"""Torque of a selected law that its rivals cannot make."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ...regression.projection import RANK, leave
from ...types import Array
from ..data.column_groups import Group
from ..data.hypotheses import Key
from ..evidence.selection import Odds, Posterior
from ..search.contributions import Contributions
from .thresholds import COMPARED_LOG_ODDS, SAME_TORQUE_CHI2


def _is_twin(posterior: Posterior, group: Group, rival: Group) -> bool:
    """Whether a rival at the same place is nearly indistinguishable at any size, as its effect states."""
    name, joints = rival.claim.key
    if joints != group.claim.key[1] or name not in group.claim.laws[0].effect.twins:
        return False
    prior = posterior.evidence.coefficient_priors[rival]
    return prior is not None and not prior.mean


def residual_energies(
    posterior: Posterior, group: Group, odds: Mapping[Key, Odds], contributions: Contributions
) -> dict[Key, float]:
    """Sum of squares of a law's torque that each rival cannot make [variance of noise]; under the law's own key, all.

    Rivals far behind the law, or elsewhere, are left out.

    Args:
        posterior: odds of every hypothesis.
        group: columns of the selected law.
        odds: odds of every hypothesis in its place.
        contributions: torque of the selected laws.
    """
    data, own = posterior.evidence.data, group.claim.key
    joints = set(data.rows(group))
    torque = {j: data.part(j, group) @ contributions.coefficients[group] for j in range(data.joints)}
    energy = {j: float(x @ x) for j, x in torque.items()}
    least = odds[own].log - COMPARED_LOG_ODDS if own in odds else -np.inf
    out = {own: max(sum(energy.values()), 1e-300)}
    for key, rival in odds.items():
        twin, acted_on = _is_twin(posterior, group, rival.best), data.rows(rival.best)
        if rival.best.claim.unknown or (rival.log < least and not twin) or joints.isdisjoint(acted_on):
            continue
        elsewhere = sum(x for j, x in energy.items() if j not in acted_on)
        if key != own and (twin or elsewhere < SAME_TORQUE_CHI2):
            out[key] = elsewhere + _residual_energy(posterior, rival.best, torque)
    return out


def _residual_energy(posterior: Posterior, rival: Group, torque: Mapping[int, Array]) -> float:
    """Sum of squares of a torque, on the rival's joints, that it and refitted laws cannot make [variance of noise]."""
    data, prior = posterior.evidence.data, posterior.evidence.coefficient_priors[rival]
    joints = data.rows(rival)
    own = np.concatenate([data.part(j, rival) for j in joints])
    target = np.concatenate([torque[j] for j in joints])
    if prior is not None and prior.mean:  # a law without numbers has its full torque
        target, own = target - own.sum(axis=1), own[:, :0]
    shared = [group for group in data.refitted if not group.bodies and len(data.rows(group)) > 1]
    columns = np.concatenate(
        [own, *(np.concatenate([data.part(j, group) for j in joints]) for group in shared)], axis=1
    )
    parts = zip(joints, np.split(np.column_stack([target, columns]), len(joints)), strict=True)
    free = np.concatenate([data.free(j, part) for j, part in parts])
    independent = np.linalg.norm(free[:, 1:], axis=0) > RANK * np.linalg.norm(columns, axis=0)
    return float(np.sum(leave(free[:, 0], free[:, 1:][:, independent]) ** 2))
