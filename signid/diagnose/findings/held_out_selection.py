"""Extended simulation: the selected laws and refitted numbers that improve the prediction of the held-out rows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...model import Model
from ...regression.session import Session
from ...types import Array, Law
from ..data.column_groups import Group
from ..data.hypotheses import is_transient
from ..evidence.selection import Selection
from ..extend.holdout import Prediction, ResidualRows, predict
from ..extend.trials import Extension, RefitBlock, Trials
from ..search.stepwise import SEARCH
from .thresholds import (
    CORRELATED_ROWS,
    HELD_OUT_BLOCKS,
    LEAST_BLOCK_GAIN,
    LEAST_GAIN,
    LEAST_REFIT_ROWS,
    LEAST_RESIDUAL,
    WORSE_WEIGHT,
)


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


Scores = dict[Group, HeldOutScore]


def select_on_held_out(
    session: Session, model: Model, selection: Selection, order: Sequence[Group]
) -> ExtendedSimulation:
    """Extend the simulation by the selected laws that improve the held-out prediction.

    Numbers that the simulation states are refitted only where the held-out prediction is clearly better for it, since
    a short recording may override better knowledge.

    Args:
        session: recordings.
        model: the simulation.
        selection: the selected laws.
        order: their columns, in the order in which the simulation gets the laws.
    """
    trials = Trials(session, model, selection)
    separate, joint = Extension(tuple(order)), Extension(tuple(order), joint_fit=True)
    chosen, scores = _select(trials, joint)
    if not time_is_up(SEARCH):
        other, given = _select(trials, separate), trials.held_out(Extension(()))
        better = error_change(trials.held_out(other[0]), given) - error_change(trials.held_out(chosen), given)
        chosen, scores = other if better < -LEAST_GAIN else (chosen, scores)
    return ExtendedSimulation(
        laws={**trials.laws(separate), **trials.laws(chosen)},
        prediction=predict(session, trials.model_of(chosen)),
        kept=frozenset(chosen.kept),
        refitted=frozenset(group for block in chosen.refitted for group in block),
        log_bayes={group: score.log_bayes for group, score in scores.items()},
        gain={group: score.gain for group, score in scores.items()},
    )


def error_change(rows: ResidualRows, other: ResidualRows, errors: float = 1.0) -> float:
    """Change of the log mean square on held-out rows from one simulation to another, summed over joints [-].

    Joints that are predicted worse, or not better by `errors` standard errors, have more weight.

    Args:
        rows: residuals of the simulation.
        other: residuals of the simulation that it is compared with.
        errors: standard errors by which a joint must be better [1].
    """
    least, out = LEAST_RESIDUAL**2 * _mean_square(rows.torque), 0.0
    for j in range(rows.residual.shape[1]):
        both = np.isfinite(rows.residual[:, j]) & np.isfinite(other.residual[:, j])
        after, before = rows.residual[both, j] ** 2, other.residual[both, j] ** 2
        if not len(before) or np.array_equal(after, before):
            continue
        size = max(float(np.mean(before)), float(least[j]), 1e-300)
        blocks = [float(np.mean(x)) for x in np.array_split(after - before, min(HELD_OUT_BLOCKS, len(before)))]
        error = float(np.std(blocks) / np.sqrt(max(len(blocks) - 1, 1))) / size
        ratio = max(float(np.mean(after)), float(least[j])) / size
        out += float(np.log(ratio) + WORSE_WEIGHT * np.log(max(ratio + errors * error, 1.0)))
    return out


def _select(trials: Trials, start: Extension) -> tuple[Extension, Scores]:
    """Drop laws that held-out rows do not support, then refit stated numbers; return the scores of all laws."""
    chosen, scores = _pruned(trials, start, {})
    refitted = _refitted(trials, chosen)
    return _pruned(trials, refitted, scores) if refitted != chosen else (chosen, scores)


def _pruned(trials: Trials, chosen: Extension, scores: Scores) -> tuple[Extension, Scores]:
    """Drop laws that held-out rows do not support, the worst first; where time is up, all of them at once."""
    while True:
        now = {group: _score(trials, chosen, group) for group in chosen.kept}
        scores = {**scores, **now}
        least = LEAST_GAIN if trials.session.judges_itself else 0.0
        out = [group for group, one in now.items() if one.change >= -least and not is_transient(group.claim.laws[0])]
        if not out:
            return chosen, scores
        if time_is_up(SEARCH):
            return chosen._replace(kept=tuple(group for group in chosen.kept if group not in out)), scores
        chosen = chosen.without(max(out, key=lambda group: now[group].change))


def _refitted(trials: Trials, first: Extension) -> Extension:
    """Refit stated numbers where each block improves the held-out prediction, and all together clearly do."""
    few = time_is_up(SEARCH) or len(trials.held_out(first).residual) < LEAST_REFIT_ROWS or trials.session.judges_itself
    blocks, chosen = [] if few else trials.refit_blocks(), first
    alone = {block: error_change(trials.held_out(_with(first, block)), trials.held_out(first)) for block in blocks}
    for block in sorted(blocks, key=lambda block: alone[block]):
        if alone[block] > -LEAST_BLOCK_GAIN or time_is_up(SEARCH):
            break
        more = _with(chosen, block)
        if error_change(trials.held_out(more), trials.held_out(chosen)) < -LEAST_BLOCK_GAIN:
            chosen = more
    return chosen if error_change(trials.held_out(chosen), trials.held_out(first)) < -LEAST_GAIN else first


def _with(extension: Extension, block: RefitBlock) -> Extension:
    """Refit one more block of stated numbers."""
    return extension._replace(refitted=extension.refitted | {block})


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
    least = LEAST_RESIDUAL**2 * _mean_square(rows.torque)
    after, before = _mean_square(rows.residual), _mean_square(other.residual)
    acts &= np.isfinite(after) & np.isfinite(before)
    count = np.sum(finite, axis=0) / CORRELATED_ROWS
    log = np.log(np.maximum(before, least)[acts]) - np.log(np.maximum(after, least)[acts])
    missed = float(np.sum((before * count)[acts]))
    gain = 1 - float(np.sum((after * count)[acts])) / missed if missed > 0 else 0.0
    log_bayes, change = float(np.sum(count[acts] / 2 * log)), error_change(rows, other, 0.0)
    if trials.session.judges_itself and acts.any():
        log_bayes, change = min(log_bayes, 0.0), change + 2 * group.size / max(float(np.mean(count[acts])), 1e-9)
    return HeldOutScore(log_bayes, gain, change)


def _mean_square(x: Array) -> Array:
    """(n,) mean square of the finite rows; NaN where there is none."""
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan))
