"""Extended simulation: the selected laws and refitted numbers that improve the prediction of the held-out rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...model import Model
from ...regression.session import Session
from ...types import Array, Frozen, Law, Mask
from .. import thresholds as tuned
from ..data.dataset import Fitted, columns_of
from ..data.estimated_gains import as_given
from ..data.hypotheses import is_transient
from ..data.rows import Group
from ..evidence.selection import Selection
from ..extend import extend, read_laws
from ..holdout import Prediction, ResidualRows, predict, residual_rows
from ..search.stepwise import LAW_SEARCH

RefitBlock = tuple[Group, ...]  # stated numbers that are refitted together: all bodies, or the laws of some joints


class ExtendedSimulation(NamedTuple):
    """The extended simulation, its prediction, and the held-out evidence for each law."""

    laws: Mapping[Group, tuple[Law, ...]]  # of every selected hypothesis, with all their numbers
    prediction: Prediction
    kept: frozenset[Group]  # hypotheses that are part of it
    refitted: frozenset[Group]  # bodies and laws of the given simulation whose numbers are refitted
    log_bayes: Mapping[Group, float]  # log Bayes factor of the held-out rows for each hypothesis [-]
    gain: Mapping[Group, float]  # share of the held-out sum of squares, on its joints, that each removes [1]


class HeldOutScore(NamedTuple):
    """Evidence of the held-out rows for a law."""

    log_bayes: float  # log Bayes factor against its absence [-]
    gain: float  # share of the sum of squares, on its joints, that it removes [1]
    change: float  # change of the log mean square by the law [-]; negative: better with it
    tested: bool = True  # whether the law acts on held-out rows at all


Scores = dict[Group, HeldOutScore]


class Extension(NamedTuple):
    """Additions to the simulation: selected laws and refitted numbers."""

    kept: tuple[Group, ...]  # selected laws, in the order in which the simulation gets them
    refitted: frozenset[RefitBlock] = frozenset()
    joint_fit: bool = False  # whether laws are fitted jointly with all stated numbers, though these keep their values

    @property
    def groups(self) -> list[Group]:
        """Refitted bodies and laws of the given simulation."""
        return [group for block in self.refitted for group in block]

    def without(self, group: Group) -> Extension:
        """Remove a law."""
        return self._replace(kept=tuple(g for g in self.kept if g is not group))

    def refitting(self, block: RefitBlock) -> Extension:
        """Refit one more block of stated numbers."""
        return self._replace(refitted=self.refitted | {block})


@dataclass(frozen=True, eq=False)
class Trials(Frozen):
    """Extended simulations, each built once and evaluated on the held-out rows."""

    session: Session
    model: Model
    selection: Selection
    built: dict[Extension, tuple[Model, ResidualRows]] = field(default_factory=dict)

    def fit(self, extension: Extension) -> Fitted:
        """Maximum a posteriori coefficients of all numbers that an extension has."""
        selected = tuple(group for group in self.selection.selected if group in extension.kept)
        fit = self.selection.evidence.fit(selected, self.selection.dispersion, self.selection.prior_scale)
        if extension.joint_fit:
            return fit
        return fit.restricted(_among(fit, selected) | _among(fit, extension.groups))

    def laws(self, extension: Extension) -> dict[Group, tuple[Law, ...]]:
        """Laws of an extension with all their numbers."""
        fit = self.fit(extension)
        return {group: read_laws(group, fit.value[fit.place(group)]) for group in extension.kept}

    def held_out(self, extension: Extension) -> ResidualRows:
        """Residuals of the extended simulation on the held-out rows, without their motions."""
        return self.build(extension)[1]

    def refit_blocks(self) -> list[RefitBlock]:
        """Stated numbers that may be refitted: the laws of each joint, and all bodies."""
        refitted = self.selection.evidence.refitted(self.selection.prior_scale)
        joints = dict.fromkeys(g.law.joints for g in refitted if g.law is not None)
        laws = [tuple(g for g in refitted if g.law is not None and g.law.joints == own) for own in joints]
        bodies = tuple(g for g in refitted if g.bodies)
        return [*laws, bodies] if bodies else laws

    def build(self, extension: Extension) -> tuple[Model, ResidualRows]:
        """Extended simulation and its residuals on the held-out rows."""
        if extension not in self.built:
            fit = self.fit(extension)
            steps = fit.with_value(np.where(_among(fit, extension.groups), fit.value, 0.0))
            bodies = any(group.bodies for group in extension.groups)
            refitted = [g for g in self.selection.evidence.data.refitted if bodies or not g.bodies]
            laws = self.laws(extension)
            own = extend(self.model, refitted if extension.refitted else (), steps, laws, self.session.task.base)
            self.built[extension] = own, residual_rows(self.session.task, own, self.session.held_out, keep=False)
        return self.built[extension]


def _among(fit: Fitted, groups: Sequence[Group]) -> Mask:
    """(k,) mask of the fitted columns that belong to some groups."""
    return np.asarray(np.isin(fit.which, columns_of(groups)))


def select_on_held_out(
    session: Session, model: Model, selection: Selection, order: Sequence[Group], block: RefitBlock = ()
) -> ExtendedSimulation:
    """Extend the simulation by the selected laws, given in `order`, that improve the held-out prediction.

    The numbers of `block`, of which the description states nothing, are always fitted.

    Numbers that the simulation states are refitted only where the held-out prediction is clearly better for it, since
    a short recording may override better knowledge.
    """
    trials = Trials(session, model, selection)
    first = frozenset({block} if block else ())
    separate, joint = Extension(tuple(order), first), Extension(tuple(order), first, joint_fit=True)
    chosen, scores = _select(trials, joint)
    if not time_is_up(LAW_SEARCH):
        other, given = _select(trials, separate), trials.held_out(Extension((), first))
        better = error_change(trials.held_out(other[0]), given) - error_change(trials.held_out(chosen), given)
        chosen, scores = other if better < -tuned.MIN_REFIT_GAIN else (chosen, scores)
    return ExtendedSimulation(
        laws={**trials.laws(separate), **trials.laws(chosen)},
        prediction=predict(session, as_given(trials.build(chosen)[0])),
        kept=frozenset(chosen.kept),
        refitted=frozenset(chosen.groups),
        log_bayes={group: score.log_bayes for group, score in scores.items()},
        gain={group: score.gain for group, score in scores.items()},
    )


def error_change(rows: ResidualRows, other: ResidualRows, errors: float = 1.0) -> float:
    """Change of the log mean square on held-out rows from `other` to `rows`, summed over joints [-].

    Joints that are predicted worse, or not better by `errors` standard errors, have more weight.
    """
    least, out = tuned.MIN_RESIDUAL_RATIO**2 * _mean_square(rows.torque), 0.0
    for j in range(rows.residual.shape[1]):
        both = np.isfinite(rows.residual[:, j]) & np.isfinite(other.residual[:, j])
        after, before = rows.residual[both, j] ** 2, other.residual[both, j] ** 2
        if not len(before) or np.array_equal(after, before):
            continue
        size = max(float(np.mean(before)), float(least[j]), 1e-300)
        blocks = [float(np.mean(x)) for x in np.array_split(after - before, min(tuned.HELD_OUT_BLOCKS, len(before)))]
        error = float(np.std(blocks) / np.sqrt(max(len(blocks) - 1, 1))) / size
        ratio = max(float(np.mean(after)), float(least[j])) / size
        out += float(np.log(ratio) + tuned.WORSE_WEIGHT * np.log(max(ratio + errors * error, 1.0)))
    return out


def _select(trials: Trials, start: Extension) -> tuple[Extension, Scores]:
    """Drop laws that held-out rows do not support, then refit stated numbers; return the scores of all laws.

    Refitted numbers may make the torque of a law, if they leave what is usual of them. The training rows have weighed
    that already, so a law stays unless held-out rows speak against it beside them.
    """
    chosen, scores = _pruned(trials, start, {})
    refitted = _refitted(trials, chosen)
    if refitted == chosen:
        return chosen, scores
    kept, beside = _pruned(trials, refitted, {}, tuned.EQUAL_PREDICTION_GAIN)
    for group, one in beside.items():
        if group not in kept.kept or one.log_bayes > scores[group].log_bayes:
            scores[group] = one
    return kept, scores


def _pruned(trials: Trials, chosen: Extension, scores: Scores, tolerated: float = 0.0) -> tuple[Extension, Scores]:
    """Drop laws that held-out rows do not support, the worst first; where time is up, all of them at once.

    `tolerated` [-]: the log mean square on held-out rows by which a law may be worse than its absence.
    """
    while True:
        now = {group: _score(trials, chosen, group) for group in chosen.kept}
        scores = {**scores, **now}
        least = tuned.MIN_REFIT_GAIN if trials.session.judges_itself else -tolerated
        judged = {group: one for group, one in now.items() if one.tested and not is_transient(group.claim.laws[0])}
        out = [group for group, one in judged.items() if one.change >= -least]
        if not out:
            return chosen, scores
        if time_is_up(LAW_SEARCH):
            return chosen._replace(kept=tuple(group for group in chosen.kept if group not in out)), scores
        chosen = chosen.without(max(out, key=lambda group: now[group].change))


def _refitted(trials: Trials, first: Extension) -> Extension:
    """Refit stated numbers where each block improves the held-out prediction, and all together clearly do."""
    few = (
        time_is_up(LAW_SEARCH)
        or len(trials.held_out(first).residual) < tuned.MIN_REFIT_ROWS
        or trials.session.judges_itself
    )
    blocks, chosen = [] if few else trials.refit_blocks(), first
    alone = {block: error_change(trials.held_out(first.refitting(block)), trials.held_out(first)) for block in blocks}
    for block in sorted(blocks, key=lambda block: alone[block]):
        if alone[block] > -tuned.MIN_REFIT_BLOCK_GAIN or time_is_up(LAW_SEARCH):
            break
        more = chosen.refitting(block)
        if error_change(trials.held_out(more), trials.held_out(chosen)) < -tuned.MIN_REFIT_BLOCK_GAIN:
            chosen = more
    return chosen if error_change(trials.held_out(chosen), trials.held_out(first)) < -tuned.MIN_REFIT_GAIN else first


def _score(trials: Trials, chosen: Extension, group: Group) -> HeldOutScore:
    """Evidence of the held-out rows for a law; all other laws are fitted again without it, as two may cancel.

    The variance of the errors is unknown. Where the training rows take the place of held-out rows, they are no evidence
    for a law, and each of its numbers is penalised.

    Source: the marginal likelihood of normal errors of unknown variance, e.g. Gelman et al., Bayesian Data Analysis,
    2013, section 14.2; Akaike, IEEE Trans. Autom. Control 19(6), 1974 (numbers).
    """
    rows, other = trials.held_out(chosen), trials.held_out(chosen.without(group))
    finite = np.isfinite(rows.residual)
    acts = np.nanmax(np.abs(rows.residual - other.residual), axis=0, initial=0.0, where=finite) > 0
    least = tuned.MIN_RESIDUAL_RATIO**2 * _mean_square(rows.torque)
    after, before = _mean_square(rows.residual), _mean_square(other.residual)
    acts &= np.isfinite(after) & np.isfinite(before)
    count = np.sum(finite, axis=0) / tuned.CORRELATED_ROWS
    log = np.log(np.maximum(before, least)[acts]) - np.log(np.maximum(after, least)[acts])
    missed = float(np.sum((before * count)[acts]))
    gain = 1 - float(np.sum((after * count)[acts])) / missed if missed > 0 else 0.0
    log_bayes, change = float(np.sum(count[acts] / 2 * log)), error_change(rows, other, 0.0)
    if trials.session.judges_itself and acts.any():
        log_bayes, change = min(log_bayes, 0.0), change + 2 * group.size / max(float(np.mean(count[acts])), 1e-9)
    return HeldOutScore(log_bayes, gain, change, bool(acts.any()))


def _mean_square(x: Array) -> Array:
    """(n,) mean square of the finite rows; NaN where there is none."""
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan))
