"""Selected laws -> the extended simulation that is handed out: what holds on held-out data, with the least change."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..model import Model
from ..session import Session
from ..types import Array, Law
from .extend import extend
from .found import Found
from .group import Group
from .hypothesis import happens_once
from .numbers import read_laws
from .odds import Judge
from .prove import Rows, Shown, show
from .sample import summed_rows
from .search import without

BETTER = 0.05  # log of the held-out rms, mean over joints, by which more change must predict better than less
REFIT = 0.15  # the same of refitting numbers that identification found
LEAST = 1e-3  # of the rms torque: smaller residuals count as this large
INDEPENDENT = 4.0  # held-out rows for one that tells something of its own: their errors are correlated


class Extended(NamedTuple):
    """The extended simulation, and what it predicts."""

    laws: Mapping[Group, tuple[Law, ...]]  # of every selected hypothesis, with all their numbers
    shown: Shown
    refitted: bool  # whether numbers that the simulation states were refitted as well
    alone: bool  # whether the laws were fitted without these
    support: Mapping[Group, float]  # of each hypothesis, log Bayes factor of the held-out rows [-]
    gain: Mapping[Group, float]  # share of the held-out sum of squares, on its joints, that each takes away [1]

    def holds(self, group: Group) -> bool:
        """Whether a hypothesis is part of the extended simulation: held-out torque is predicted better with it."""
        return happens_once(group.claim.laws[0]) or self.support[group] >= 0


def hand_out(session: Session, model: Model, judge: Judge, found: Found, order: Sequence[Group]) -> Extended:
    """The simulation with the selected laws that hold on held-out rows.

    One law after another that makes the prediction of held-out torque worse is left out, the worst first. Bodies and
    laws that the simulation states are refitted only where held-out torque is predicted clearly better for it: a short
    recording may override better knowledge.

    Args:
        session: recordings.
        model: the simulation.
        judge: library and evidence.
        found: what was selected.
        order: the same, in the order in which the simulation gets their laws.
    """
    laws, judged, kept = dict[Group, tuple[Law, ...]](), dict[Group, tuple[float, float]](), list(order)
    while True:
        extended = _candidate(session, model, judge, found, kept)
        laws = {**laws, **extended.laws}
        judged |= {group: _judged(judge, found, extended, group) for group in kept}
        out = [g for g in kept if judged[g][0] < 0 and not happens_once(g.claim.laws[0])]
        if not out:
            support, gain = ({group: x[k] for group, x in judged.items()} for k in (0, 1))
            return extended._replace(laws=laws, support=support, gain=gain)
        worst = min(out, key=lambda group: judged[group][0])
        kept.remove(worst)
        found = without(judge, found, worst)


def _candidate(session: Session, model: Model, judge: Judge, found: Found, order: Sequence[Group]) -> Extended:
    """The best of three: laws alone, laws fitted beside all that the simulation states, and that refitted as well."""
    evidence, base = judge.evidence, session.task.base
    refit = REFIT if evidence.informed else BETTER
    whole = evidence.fit(found.true, found.base, found.trust)
    tried = [(whole, False, False, 0.0), (whole, True, False, refit)]
    if order:
        tried.insert(1, (evidence.fit_alone(found.true, found.base), False, True, BETTER))
    best, least = None, np.inf
    for fit, refitted, alone, margin in tried:
        laws = {group: read_laws(group, fit.value[fit.place(group)]) for group in order}
        flat = [law for own in laws.values() for law in own]
        shown = show(session, extend(model, evidence.data.refitted if refitted else (), fit, flat, base))
        loss = _loss(shown.judged)
        if best is None or loss < least - margin:
            best, least = Extended(laws, shown, refitted, alone, {}, {}), loss
    assert best is not None, "the first candidate is always taken"
    return best


def _loss(judged: Rows) -> float:
    """Mean over joints of the log of the held-out rms residual over the rms torque [-]."""
    ratio = _mean_square(judged.rest) / np.maximum(_mean_square(judged.torque), 1e-300)
    counted = ratio[np.isfinite(ratio)]
    return float(np.mean(np.log(np.maximum(counted, LEAST**2)))) / 2 if len(counted) else 0.0


def _judged(judge: Judge, found: Found, extended: Extended, group: Group) -> tuple[float, float]:
    """What held-out rows say of a hypothesis: log Bayes factor against its absence [-], and share it takes away [1].

    Without it, all other laws are fitted again: two that only undo each other need none of both. The size of errors
    is unknown.

    Source: the marginal likelihood of normal errors of unknown variance, e.g. Gelman et al., Bayesian Data Analysis,
    2013, section 14.2.
    """
    rest, rows = without(judge, found, group), extended.shown.judged
    fit = (
        judge.evidence.fit_alone(rest.true, rest.base)
        if extended.alone
        else judge.evidence.fit(rest.true, rest.base, rest.trust)
    )
    fewer = (law for g in extended.laws if g is not group for law in read_laws(g, fit.value[fit.place(g)]))
    every = (law for laws in extended.laws.values() for law in laws)
    whole, less, own = (
        summed_rows(rows.thin, rows.pieces, laws, rows.rest) for laws in (every, fewer, extended.laws[group])
    )
    change, acts = whole - less, np.abs(own).max(axis=0) > 0
    after, before = _mean_square(rows.rest), _mean_square(rows.rest + change)
    acts &= np.isfinite(after)
    least = LEAST**2 * _mean_square(rows.torque)
    count = np.sum(np.isfinite(rows.rest), axis=0) / INDEPENDENT
    log = np.log(np.maximum(before, least)[acts]) - np.log(np.maximum(after, least)[acts])
    missed = float(np.sum((before * count)[acts]))
    gain = 1 - float(np.sum((after * count)[acts])) / missed if missed > 0 else 0.0
    return float(np.sum(count[acts] / 2 * log)), gain


def _mean_square(x: Array) -> Array:
    count = np.sum(np.isfinite(x), axis=0)
    return np.asarray(np.nansum(x**2, axis=0) / np.where(count > 0, count, np.nan))
