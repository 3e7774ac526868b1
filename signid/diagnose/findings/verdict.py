"""Verdict: whether something is missing, and whether the selected laws explain it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...estimation.fit_quality import rms_of
from ...faults.evidence import judge_amount
from ...regression.projection import leave
from ...regression.session import Session
from ...types import Array, Frozen, Mask
from .. import thresholds as tuned
from ..data.dataset import Dataset
from ..data.noise import has_full_window, weights
from ..data.rows import Group
from ..evidence.selection import Posterior, Selection
from ..holdout import ResidualRows
from ..result import MUCH_SHARE
from ..search.contributions import Contributions, measure_contributions
from .alternatives import Contender


@dataclass(frozen=True, eq=False)
class Verdict(Frozen):
    """Overall result: its name, and the selected laws as causes and as corrections."""

    name: str  # nothing_missing, named, unknown or undecided
    causes: tuple[Group, ...]
    secondary: tuple[Group, ...]
    before: Array  # (n,) excess of the whitened sum of squares of the given simulation [1]
    after: Array  # (n,) excess with all selected laws [1]
    threshold: Array  # (n,) of the excess [1]
    contributions: Contributions
    ranked: tuple[Group, ...] = ()  # causes and corrections, in the order of the torque that they explain

    def without(self, weak: Collection[Group]) -> Verdict:
        """Remove laws that held-out rows do not support; without causes the verdict is unknown or nothing missing."""
        causes, secondary = (tuple(g for g in some if g not in weak) for some in (self.causes, self.secondary))
        bare = "unknown" if np.any(self.before > self.threshold) else "nothing_missing"
        name = bare if self.name == "named" and not causes else self.name
        return replace(self, name=name, causes=causes, secondary=secondary)

    def is_quiet(self, joints: Sequence[int]) -> bool:
        """Whether the residual of the given simulation is within noise and usual model error at some joints."""
        return bool(np.all(self.before[list(joints)] <= self.threshold[list(joints)]))

    def with_promoted(self, contenders: Sequence[Contender], gains: Mapping[Group, float]) -> Verdict:
        """Make large and probable corrections causes; `gains`: shares of the held-out squares that they remove [1]."""
        sure = {contender.group for contender in contenders if contender.probability > 0.5}
        share = self.contributions.torque_share
        large = [g for g in self.secondary if share[g].max() >= tuned.PROMOTED_TORQUE_SHARE]
        more = [g for g in large if g in sure and gains[g] >= tuned.PROMOTED_HELD_OUT_GAIN]
        if self.name != "named" or not more:
            return self
        secondary = tuple(group for group in self.secondary if group not in more)
        return replace(self, causes=(*self.causes, *more), secondary=secondary)

    def with_demoted(self, kept: Collection[Group]) -> Verdict:
        """Make causes that held-out rows do not support corrections, if other causes stay."""
        causes = tuple(group for group in self.causes if group in kept)
        refused = tuple(group for group in self.causes if group not in kept)
        return replace(self, causes=causes, secondary=(*refused, *self.secondary)) if causes else self


def undecided_words(dataset: Dataset, session: Session, given: ResidualRows, verdict: Verdict) -> Iterator[str]:
    """Why it cannot be said that nothing is missing, a sentence for each joint; none where that can be said.

    More than white noise, reversals and a known misfit is left at these joints. `given` has the residual of the
    simulation on the training rows.
    """
    if verdict.name != "nothing_missing":
        return
    data, robot = verdict.contributions.data, dataset.model.robot
    misfit = np.zeros(data.joints) if dataset.model.misfit is None else np.nan_to_num(dataset.model.misfit.size)
    noise = np.hypot(session.task.band.torque_floor, misfit)[None, :]
    left = rms_of(given.residual) / rms_of(
        np.hypot(noise, np.where(np.isnan(given.residual), np.nan, given.reversal_std))
    )
    share = rms_of(given.residual) / np.maximum(rms_of(given.torque), tuned.MIN_JOINT_SHARE * data.scale.max())
    unseen = np.sqrt(verdict.threshold / data.counts) * data.floor / data.scale
    few, rows = not judge_amount(session, session.train).enough, np.sum(np.isfinite(given.residual), axis=0)
    for j in np.flatnonzero((left > tuned.QUIET_NOISE_RATIO) & (share > tuned.QUIET_TORQUE_SHARE)).tolist():
        why = "other bodies could make it, which the held-out rows do not confirm"
        if few or unseen[j] > MUCH_SHARE:
            why = f"they are {'too few' if few else 'too noisy'} to show what it is"
        yield (
            f"{rows[j]} rows leave {share[j]:.0%} of the torque of {robot.joints[j]} unexplained, and {why}; record "
            f"for longer, with more motion of this joint"
        )


def decide_verdict(dataset: Dataset, selection: Selection, contenders: Sequence[Contender]) -> Verdict:
    """Decide between named, unknown and nothing missing; rank the selected laws."""
    data, evidence, noise = selection.data, selection.evidence, dataset.noise
    contributions = measure_contributions(evidence, selection.selected, selection.dispersion, selection.prior_scale)
    bare = measure_contributions(evidence, (), selection.dispersion, evidence.prior_scale((), selection.dispersion))
    residual, given = (dataset.remaining(data, one.fit) for one in (contributions, bare))
    after, before = (_excess(dataset, data.counts, one) for one in (residual, given))
    unknown = (odds for odds in selection.first.values() if odds.best.claim.unknown)
    # largest log odds of a dependence without law, at joints with an excess [-]
    clear = max((odds.log for odds in unknown if np.any(before[data.rows(odds.best)] > 0)), default=-np.inf)
    scale = np.maximum(data.scale, tuned.MIN_JOINT_SHARE * data.scale.max())
    tolerated = (tuned.TOLERATED_DISCREPANCY * scale / noise.saturated_floor) ** 2
    correlated = np.maximum(noise.innovation / noise.floor, 1.0)  # of a known misfit
    threshold = tuned.NOTICED_DEVIATIONS * np.sqrt(2 * data.counts) * correlated + data.counts * tolerated
    threshold = threshold * (tuned.CLEAR_FACTOR if clear > tuned.CLEAR_LOG_ODDS and not selection.selected else 1.0)
    by_group = {contender.group: contender for contender in contenders}
    explained = {g: _explained(selection.posterior, contributions, residual, g) for g in selection.selected}
    left = np.sqrt(np.mean(residual**2, axis=0))
    importance = {g: float(np.sqrt(np.sum(x**2 / np.maximum(left * data.scale, 1e-300)))) for g, x in explained.items()}
    largest = max(importance.values(), default=0.0)
    moved = {g: importance[g] * float(np.sqrt(x.max())) for g, x in explained.items()}  # much torque is never last
    ranked = sorted(selection.selected, key=lambda g: (by_group[g].log_at_scale < 0, -moved[g]))
    ranked = _drifts_first(ranked, contributions)
    causes = tuple(g for g in ranked if importance[g] >= tuned.MIN_CAUSE_SHARE * largest)
    secondary = tuple(group for group in ranked if group not in causes)
    if not causes:
        state = clear > 0 or np.any(noise.discrepancy > tuned.MIN_NOTICED_DISCREPANCY * scale)
        differs = clear > tuned.CLEAR_LOG_ODDS or np.any(after > threshold * (1 if state else tuned.STATELESS_FACTOR))
        name = "unknown" if differs else "nothing_missing"
    else:
        whole = _excess(dataset, data.counts, dataset.table.residual) if evidence.bare else before  # bodies hide laws
        named = _explain(causes, (whole, after, threshold), by_group[causes[0]])
        name = "named" if named else "unknown"
    return Verdict(name, causes, secondary, before, after, threshold, contributions, tuple(ranked))


def _excess(dataset: Dataset, counts: Array, residual: Array) -> Array:
    """(n,) sum of squares of the residual, discrepancy included, beyond that of the floor [variance of the floor]."""
    noise = dataset.noise
    weight, order = weights(dataset.table, noise), noise.coefficients.shape[1]
    kept = has_full_window(dataset.table.piece, order)
    return np.asarray(np.sum((residual[order:][kept] * weight / noise.saturated_floor) ** 2, axis=0) - counts)


def _explained(posterior: Posterior, contributions: Contributions, residual: Array, group: Group) -> Array:
    """(n,) rms torque that a law explains at each joint [N.m or N].

    Only the part of the torque counts that no other selected law could make, since two laws may cancel each other, and
    at most the growth of the (M, n) residual of all laws without it. Bodies count as fitted, since they cannot be of
    any size.
    """
    data, square = posterior.evidence.data, np.zeros(residual.shape[1])
    for j in data.rows(group):
        torque, left = data.raw(j, group) @ contributions.coefficients[group], float(np.mean(residual[:, j] ** 2))
        beside = [(g, x) for g, x in contributions.coefficients.items() if g is not group and j in data.rows(g)]
        others = [data.raw(j, g) @ x if g.claim.bodies else data.raw(j, g) for g, x in beside]
        alone = leave(torque, np.column_stack(others)) if others else torque
        growth = max(float(np.mean((residual[:, j] + torque) ** 2)) - left, 0.0)
        square[j] = min(growth, float(np.mean(alone**2)))
    return np.sqrt(square)


def _drifts_first(ranked: Sequence[Group], contributions: Contributions) -> list[Group]:
    """Ranked laws, where one that changes another stands before it if the other's number is right at another time.

    So friction that drifts to, or from, the stated level is a drift, and not a wrong level.
    """
    out, value = list(ranked), contributions.coefficients
    for group in ranked:
        law = group.claim.laws[0]
        for other in ranked:
            same = group.size == other.size == 1 and other.claim.laws[0].joints == law.joints
            if not same or other.claim.laws[0].effect.name not in law.effect.changes:
                continue
            drift, level = float(value[group][0]), float(value[other][0])
            if (
                drift * level < 0
                and abs(drift) >= tuned.MIN_DRIFT_SHARE * abs(level)
                and out.index(other) < out.index(group)
            ):
                out.remove(group)
                out.insert(out.index(other), group)
    return out


def _explain(causes: Sequence[Group], excess: tuple[Array, Array, Array], first: Contender) -> bool:
    """Whether the causes explain most of the excess, (n,) before, after and its threshold, there and elsewhere."""
    before, after, threshold = excess
    concerned = np.any([_concerned(group, before > threshold) for group in causes], axis=0)
    left, total = np.maximum(after, 0)[concerned].sum(), np.maximum(before, 0)[concerned].sum()
    needed = tuned.MIN_APPROXIMATED_EXCESS if causes[0].claim.laws[0].effect.approximate else tuned.MIN_EXPLAINED_EXCESS
    loud = concerned & (after > threshold) & (after > tuned.SMALL_EXCESS_SHARE * before.max())
    if 1 - left / max(total, 1e-9) < needed and loud.any():
        return False
    elsewhere = ~concerned & (after > tuned.STATELESS_FACTOR * threshold) & (after > tuned.MAX_ELSEWHERE_SHARE * before)
    return not (first.unknown > 0.5 or after[elsewhere].sum() > max(total - left, 0.0))


def _concerned(group: Group, loud: Mask) -> Mask:
    """(n,) joints whose residual a hypothesis should explain."""
    out = np.zeros(len(loud), dtype=bool)
    for law in group.claim.laws:
        if law.effect.scope != "joint":
            out |= loud
        out[list(law.joints) if len(law.joints) <= 2 else []] = True
    return out
