"""Odds -> the hypotheses that together explain the recordings: one after another, exchanged, dropped."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from ...deadline import show_step, time_is_up
from ...types import Array
from ..data.column_groups import Group
from ..data.hypotheses import Key
from ..evidence.posterior_odds import Odds, Posterior
from ..evidence.selection import Selection
from ..evidence.thresholds import PRIOR_NOTHING
from ..extend.extend import has_possible_numbers
from .contributions import energies, measure_sizes
from .feasible import is_sound
from .inertial_check import inertial_violations, relieved

SEARCH = "the search for laws"
FIRST, NEXT = 4.0, 3.0  # log odds needed
DISTRUST, LOOKALIKE = 5.0, 8.0  # the same where inertials are not trusted, and of what inertials imitate
IMITATED = 0.9  # share of an effect that inertials can make, from which on it looks like them
MOST = 14  # hypotheses altogether
SHAPE_ERROR = 0.05  # of an effect that is selected: what its law leaves of it
BETTER = 2.0  # log odds by which another hypothesis must be better to take a place


def search(posterior: Posterior, dispersion: Array, start: Mapping[Group, float] | None = None) -> Selection:
    """Stepwise selection: each step adds the likeliest hypothesis, then exchanges those that others explain better.

    Args:
        posterior: odds of every hypothesis.
        dispersion: (n,) variance of the whitened residual that no law explains [1].
        start: hypotheses to begin with, and the log odds of each; None: none.
    """
    state = begin(posterior, dispersion, {})
    first, trusted = posterior.odds((), inflated_dispersion(state))
    odds, seen = first, list[set[Group]]()
    if start:
        state = _exchanged(begin(posterior, dispersion, start), BETTER)
    for step in range(MOST):
        show_step(f"weighing laws beside {len(state.selected)} found", 1 - 0.7 ** (step + 1))
        if state.selected:
            odds, trusted = posterior.odds(state.selected, inflated_dispersion(state))
        chosen = _pick(state, odds, trusted, NEXT if state.selected else FIRST)
        if chosen is None or time_is_up(SEARCH):
            break
        state = larger = _with(state, chosen)
        if len(state.selected) > 1:
            state = _exchanged(_plainer(state), BETTER, state.data.rows(chosen.best))
        state = larger if set(state.selected) in seen else state  # the exchange would go in circles
        if set(state.selected) in seen:
            break
        seen.append(set(state.selected))
    for _ in range(0 if time_is_up(SEARCH) else 2):
        before, state = state.selected, _exchanged(_plainer(state), BETTER / 2)
        if before == state.selected:
            break
    return replace(state, first=first)


def log_posterior(selection: Selection) -> float:
    """Log posterior density of a selection, up to what is common to all selections under the same noise [-].

    Args:
        selection: the selected laws.
    """
    evidence = selection.evidence
    scale = float(evidence.scale_prior[np.argmin(np.abs(evidence.scales - selection.prior_scale))])
    return selection.fit().log_evidence + scale + log_prior_odds(selection)


def log_prior_odds(selection: Selection) -> float:
    """Log prior odds of a selection against no law [-].

    Args:
        selection: the selected laws.
    """
    priors = (selection.posterior.priors.get(group.claim.key, 0.0) for group in selection.selected)
    return sum(priors) - len(selection.selected) * float(np.log(PRIOR_NOTHING))


def begin(posterior: Posterior, dispersion: Array, start: Mapping[Group, float]) -> Selection:
    """Hypotheses that were selected among other rows, with as many coefficients, in any of their shapes.

    An exchange or a fit finds the best shape.

    Args:
        posterior: odds of every hypothesis.
        dispersion: (n,) variance of the whitened residual that no law explains [1].
        start: the hypotheses, and the log odds of each.
    """
    log = {posterior.counterpart(group): x for group, x in start.items() if group.claim.key in posterior.keys}
    scale = posterior.evidence.prior_scale(tuple(log), dispersion)
    return Selection(posterior, tuple(log), log, dispersion, scale)


def inflated_dispersion(selection: Selection, most: float = 1.3) -> Array:
    """(n,) variance of the whitened residual [1] with the errors of shape of the selected laws.

    Args:
        selection: the selected laws.
        most: upper bound, in mean squares of the residual [1].
    """
    dispersion = selection.dispersion
    if not selection.selected:
        return dispersion
    sizes = measure_sizes(selection.evidence, selection.selected, dispersion, selection.prior_scale)
    wide = dispersion + SHAPE_ERROR**2 * sum(energies(sizes).values())
    return np.maximum(dispersion, np.minimum(wide, most * sizes.left))


def needed(
    posterior: Posterior, group: Group, trusted: float, count: int, usual: float, strained: Collection[int] = ()
) -> float:
    """Log odds that a hypothesis needs beside `count` others.

    Inertials within their tolerance imitate bodies, but not those of the joints whose links are strained without them.
    """
    if trusted >= 0.5 or posterior.evidence.informed or group.claim.bodies.intersection(strained):
        return usual
    if posterior.evidence.imitated(group) > IMITATED:
        return max(usual, LOOKALIKE)
    return max(usual, DISTRUST) if count == 0 else usual


def _pick(state: Selection, odds: Mapping[Key, Odds], trusted: float, usual: float) -> Odds | None:
    taken, there = _taken(state), laws_there(state)
    open_ = (o for o in odds.values() if not taken & o.best.claim.names and is_founded(o.best, there))
    strained = inertial_violations(state)
    ranked = sorted(
        open_, key=lambda o: (-max((strained.get(j, 0.0) for j in o.best.claim.bodies), default=0.0), -o.log)
    )
    for candidate in ranked:
        if candidate.log < usual or time_is_up(SEARCH):
            continue
        enough = candidate.log >= needed(state.posterior, candidate.best, trusted, len(state.selected), usual, strained)
        if enough and is_sound(state, candidate.best):
            return candidate
    return None


def _taken(state: Selection) -> set[Key]:
    return {key for group in state.selected for key in group.claim.names}


def laws_there(state: Selection) -> set[Key]:
    """Effects and joints of the laws that the simulation states or that are selected.

    Args:
        state: the selected laws.
    """
    stated = {(g.law.effect.name, g.law.joints) for g in state.data.refitted if g.law is not None}
    return stated | _taken(state)


def is_founded(group: Group, there: Collection[Key]) -> bool:
    """Whether a hypothesis names laws, and what each changes is there.

    Args:
        group: the hypothesis.
        there: effects and joints of laws.
    """
    laws = group.claim.laws
    return bool(laws) and all(
        not law.effect.changes or any((name, law.joints) in there for name in law.effect.changes) for law in laws
    )


def _with(state: Selection, chosen: Odds) -> Selection:
    """The hypothesis as well; laws that are missing together become hypotheses of their own, which may be dropped."""
    parts = tuple(part for part in state.posterior.parts(chosen.best) if part not in state.selected)
    return state.with_selected((*state.selected, *parts), {**state.log_odds, **dict.fromkeys(parts, chosen.log)})


def _exchanged(state: Selection, better: float, joints: Collection[int] | None = None) -> Selection:
    """Each hypothesis in turn against all others that could stand in its place; only those at some joints, or all.

    In the place of a link's that is strained without it, only what relieves that link could.
    """
    for group in state.selected:
        if time_is_up(SEARCH):
            break
        if joints is not None and not set(state.data.rows(group)).intersection(joints):
            continue
        rest = state.without(group)
        odds, trusted = state.posterior.odds(state.selected, inflated_dispersion(state), without=group)
        links = relieved(state, rest, group)
        odds = {key: o for key, o in odds.items() if not links or o.best.claim.bodies & links}
        own = odds.get(group.claim.key)
        log = own.log if own is not None else -np.inf
        alone = {key: o for key, o in odds.items() if len(o.best.claim.laws) == 1 and o.log > log + better}
        rival = _pick(rest, alone, trusted, NEXT) if alone else None
        if rival is not None:
            state = _with(rest, rival)
        elif log < needed(state.posterior, group, trusted, len(rest.selected), NEXT, links):
            state = rest
        elif own is not None and own.best is not group:
            state = _with(rest, own)
    return state


def _plainer(state: Selection) -> Selection:
    """The plain laws that a law contains in its place, where together they are as likely."""
    for group in state.selected:
        law = group.claim.laws[0]
        plain = tuple(
            g
            for g in state.posterior.single_laws([(name, law.joints) for name in law.effect.contains])
            if g not in state.selected
        )
        if not plain:
            continue
        log = {**state.log_odds, **dict.fromkeys(plain, state.log_odds[group])}
        other = state.with_selected((*(g for g in state.selected if g is not group), *plain), log)
        now, then = state.fit(), other.fit()
        possible = all(has_possible_numbers(g, then.value[then.place(g)]) for g in plain)
        if possible and then.log_evidence >= now.log_evidence:
            state = other
    return state
