"""Coefficients -> the numbers of laws as they are spoken of, with their standard deviations."""

from __future__ import annotations

import numpy as np

from ..effects.law import coefficient_count
from ..types import Array, Coefficient, Law
from .found import Found
from .group import Group
from .linear import Fitted, solve
from .odds import Judge
from .sample import torque_of
from .search import spread
from .setting import Setting
from .whitened import columns_of

STEP = 1e-3  # of a number, for derivatives


def read_laws(group: Group, value: Array) -> tuple[Law, ...]:
    """The laws of a hypothesis with all their numbers.

    Args:
        group: the hypothesis.
        value: (size,) coefficients [of each].
    """
    out, at = list[Law](), 0
    for law in group.claim.laws:
        effect = law.effect
        count = coefficient_count(law)
        own = value[at : at + count]
        numbers = effect.physical(own.tolist(), effect.shape(law.parameters)) if effect.linear() else law.parameters
        out.append(Law(effect, law.joints, dict(numbers)))
        at += count
    return tuple(out)


def deviations(
    setting: Setting, judge: Judge, found: Found, group: Group, laws: tuple[Law, ...]
) -> list[dict[str, float]]:
    """Standard deviation of every number of some laws, shapes too, while everything else is fitted beside.

    Args:
        setting: gives the motions.
        judge: gives what is fitted beside.
        found: what is taken for true.
        group: whose laws.
        laws: with all their numbers.
    """
    keys = [(k, key) for k, law in enumerate(laws) for key in law.parameters]
    if not keys:
        return [{} for _ in laws]
    slopes = {j: x for j, x in _slopes(setting, laws, keys).items() if x.any()}
    dispersion = spread(judge, found)
    fit = _beside(judge, found, group, laws, dispersion)
    own, _, across = judge.evidence.data.products(fit.which, dispersion, setting.whiten(slopes))
    across = fit.below(across)
    information = own - across.T @ across
    size = np.sqrt(np.maximum(np.diag(own), 1e-300))
    covariance = np.linalg.pinv(information / size / size[:, None], rcond=1e-8, hermitian=True) / size / size[:, None]
    told = np.diag(information) > 1e-8 * np.diag(own)
    std = np.where(told, np.sqrt(np.maximum(np.diag(covariance), 0)), np.inf)
    out = [dict[str, float]() for _ in laws]
    for (k, key), s in zip(keys, std, strict=True):
        out[k][key] = float(s)
    return out


def _beside(judge: Judge, found: Found, group: Group, laws: tuple[Law, ...], dispersion: Array) -> Fitted:
    """Everything else, but the plain laws that these contain: their numbers are in those of the laws."""
    held = {(name, law.joints) for law in laws for name in law.effect.contains}
    evidence, rest = judge.evidence, [g for g in found.true if g is not group]
    refitted = [
        g for g in evidence.refitted(found.trust) if g.law is None or (g.law.effect.name, g.law.joints) not in held
    ]
    kept = np.isin(evidence.columns(rest, found.trust), columns_of([*refitted, *rest]))
    which = evidence.columns(rest, found.trust)[kept]
    gram = np.tensordot(1 / dispersion, evidence.data.gram(which)[:, :, which], axes=1)
    whole = np.zeros(len(kept))
    whole[kept] = np.diag(gram)
    precision = evidence.precision(rest, whole, found.trust)[np.ix_(kept, kept)]
    right = (evidence.data.right[:, which] / dispersion[:, None]).sum(0)
    return solve(which, gram, right, precision)


def _slopes(setting: Setting, laws: tuple[Law, ...], keys: list[tuple[int, str]]) -> dict[int, Array]:
    """Per joint, (M, d) change of torque with each number [torque per unit of the number]."""
    n = setting.table.joints
    made = []
    for piece in setting.pieces:
        whole = np.zeros((n, len(piece.motion), len(keys)))
        for i, (k, key) in enumerate(keys):
            law, x = laws[k], laws[k].parameters[key]
            step = STEP * max(abs(x), _least(law, key))
            ahead, behind = (Law(law.effect, law.joints, {**law.parameters, key: x + s}) for s in (step, -step))
            rows = torque_of(ahead, piece.motion)
            for j, y in torque_of(behind, piece.motion).items():
                whole[j, :, i] = (rows[j] - y) / (2 * step)
        made.append(dict(enumerate(whole)))
    return setting.thinned(made)


def _least(law: Law, key: str) -> float:
    kind = law.effect.parameters[key]
    return 1e-3 if isinstance(kind, Coefficient) else 1e-6
