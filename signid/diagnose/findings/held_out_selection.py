"""Selected laws -> the extended simulation that is handed out: what clearly holds on held-out rows, joint by joint."""

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
from ..extend.holdout import Rows, Shown, show
from ..extend.trials import Choice, Trials, Unit
from ..search.stepwise import SEARCH

BLOCKS = 20  # of held-out rows, for standard errors
CARE = 3.0  # times as much counts where a joint is predicted worse, or not clearly better
CLEARLY = 1.0  # log of the held-out mean square, that refitting stated numbers must gain, or laws fitted without them
FEW = 40  # held-out rows: fewer do not tell whether stated numbers should be refitted
SLIGHTLY = 0.5  # the same, for the numbers of one joint beside others
LEAST = 1e-3  # of the rms torque: smaller residuals count as this large
INDEPENDENT = 4.0  # held-out rows for one that tells something of its own: their errors are correlated


class Extended(NamedTuple):
    """The extended simulation, and what it predicts."""

    laws: Mapping[Group, tuple[Law, ...]]  # of every selected hypothesis, with all their numbers
    shown: Shown
    kept: frozenset[Group]  # hypotheses that are part of it
    refitted: frozenset[Group]  # bodies and laws of the given simulation whose numbers are refitted
    support: Mapping[Group, float]  # of each hypothesis, log Bayes factor of the held-out rows [-]
    gain: Mapping[Group, float]  # share of the held-out sum of squares, on its joints, that each takes away [1]

    def holds(self, group: Group) -> bool:
        """Whether a hypothesis is part of the extended simulation."""
        return group in self.kept


def hand_out(session: Session, model: Model, found: Selection, order: Sequence[Group]) -> Extended:
    """The simulation with the selected laws that hold on held-out rows.

    A law without which held-out torque is predicted no worse is left out. Numbers that the simulation states are
    refitted only where held-out torque is clearly better for it: a short recording may override better knowledge.

    Args:
        session: recordings.
        model: the simulation.
        found: what was selected.
        order: the same, in the order in which the simulation gets their laws.
    """
    trials = Trials(session, model, found)
    alone, beside = Choice(tuple(order)), Choice(tuple(order), beside=True)
    chosen, judged = _settled(trials, beside)
    if not time_is_up(SEARCH):
        other, given = _settled(trials, alone), trials.rows(Choice(()))
        better = _change(trials.rows(other[0]), given) - _change(trials.rows(chosen), given)
        chosen, judged = other if better < -CLEARLY else (chosen, judged)
    refitted = frozenset(group for unit in chosen.refitted for group in unit)
    laws = {**trials.laws(alone), **trials.laws(chosen)}
    support, gain = ({group: x[k] for group, x in judged.items()} for k in (0, 1))
    return Extended(laws, show(session, trials.model_of(chosen)), frozenset(chosen.kept), refitted, support, gain)


def _settled(trials: Trials, start: Choice) -> tuple[Choice, dict[Group, Judged]]:
    """What of a choice holds on held-out rows, with refitted numbers; and what these rows say of each law."""
    chosen, judged = _pruned(trials, start, {})
    more = _refitted(trials, chosen)
    return _pruned(trials, more, judged) if more != chosen else (chosen, judged)


def _pruned(trials: Trials, chosen: Choice, judged: dict[Group, Judged]) -> tuple[Choice, dict[Group, Judged]]:
    """Without laws that held-out rows speak against, the worst first; and what these rows say of each.

    Where time is up, without all of them at once.
    """
    while True:
        now = {group: _judge(trials, chosen, group) for group in chosen.kept}
        judged = {**judged, **now}
        least = CLEARLY if trials.session.judges_itself else 0.0
        out = [group for group, one in now.items() if one.change >= -least and not is_transient(group.claim.laws[0])]
        if not out:
            return chosen, judged
        if time_is_up(SEARCH):
            return chosen._replace(kept=tuple(group for group in chosen.kept if group not in out)), judged
        chosen = chosen.without(max(out, key=lambda group: now[group].change))


def _refitted(trials: Trials, first: Choice) -> Choice:
    """With stated numbers refitted where held-out rows speak for each, and clearly for all of them together."""
    few = time_is_up(SEARCH) or len(trials.rows(first).rest) < FEW or trials.session.judges_itself
    units, chosen = [] if few else trials.units(), first
    alone = {unit: _change(trials.rows(_with(first, unit)), trials.rows(first)) for unit in units}
    for unit in sorted(units, key=lambda unit: alone[unit]):
        if alone[unit] > -SLIGHTLY or time_is_up(SEARCH):
            break
        more = _with(chosen, unit)
        if _change(trials.rows(more), trials.rows(chosen)) < -SLIGHTLY:
            chosen = more
    return chosen if _change(trials.rows(chosen), trials.rows(first)) < -CLEARLY else first


def _with(choice: Choice, unit: Unit) -> Choice:
    """The same with some more stated numbers refitted."""
    return choice._replace(refitted=choice.refitted | {unit})


class Judged(NamedTuple):
    """What held-out rows say of a law."""

    support: float  # log Bayes factor against its absence [-]
    gain: float  # share of the sum of squares, on its joints, that it takes away [1]
    change: float  # log of the mean square [-]; negative: clearly better with it


def _judge(trials: Trials, chosen: Choice, group: Group) -> Judged:
    """What held-out rows say of a law; without it, all others are fitted again, as two may only undo each other.

    The size of errors is unknown. Rows that judge themselves say nothing for a law, and each of its numbers counts.

    Source: the marginal likelihood of normal errors of unknown variance, e.g. Gelman et al., Bayesian Data Analysis,
    2013, section 14.2; Akaike, IEEE Trans. Autom. Control 19(6), 1974 (numbers).
    """
    rows, other = trials.rows(chosen), trials.rows(chosen.without(group))
    acts = np.nanmax(np.abs(rows.rest - other.rest), axis=0, initial=0.0, where=np.isfinite(rows.rest)) > 0
    least = LEAST**2 * _mean_square(rows.torque)
    after, before = _mean_square(rows.rest), _mean_square(other.rest)
    acts &= np.isfinite(after) & np.isfinite(before)
    count = np.sum(np.isfinite(rows.rest), axis=0) / INDEPENDENT
    log = np.log(np.maximum(before, least)[acts]) - np.log(np.maximum(after, least)[acts])
    missed = float(np.sum((before * count)[acts]))
    gain = 1 - float(np.sum((after * count)[acts])) / missed if missed > 0 else 0.0
    support, change = float(np.sum(count[acts] / 2 * log)), _change(rows, other, 0.0)
    if trials.session.judges_itself and acts.any():
        support, change = min(support, 0.0), change + 2 * group.size / max(float(np.mean(count[acts])), 1e-9)
    return Judged(support, gain, change)


def _change(rows: Rows, other: Rows, errors: float = 1.0) -> float:
    """By how much one simulation predicts held-out rows better than another, log of mean squares, sum over joints [-].

    Joints that are predicted worse, or not better by `errors` standard errors, count more.
    """
    least, out = LEAST**2 * _mean_square(rows.torque), 0.0
    for j in range(rows.rest.shape[1]):
        both = np.isfinite(rows.rest[:, j]) & np.isfinite(other.rest[:, j])
        after, before = rows.rest[both, j] ** 2, other.rest[both, j] ** 2
        if not len(before) or np.array_equal(after, before):
            continue
        size = max(float(np.mean(before)), float(least[j]), 1e-300)
        blocks = [float(np.mean(x)) for x in np.array_split(after - before, min(BLOCKS, len(before)))]
        error = float(np.std(blocks) / np.sqrt(max(len(blocks) - 1, 1))) / size
        ratio = max(float(np.mean(after)), float(least[j])) / size
        out += float(np.log(ratio) + CARE * np.log(max(ratio + errors * error, 1.0)))
    return out


def _mean_square(x: Array) -> Array:
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan))
