"""Odds -> the hypotheses that together explain the recordings: one after another, exchanged, dropped."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import numpy as np

from ...deadline import show_step, time_is_up
from ...types import Array
from ..data.column_groups import Group
from ..data.hypotheses import Key
from ..evidence.posterior_odds import Judge, Odds
from ..evidence.prior import NOTHING
from ..evidence.selection import Found
from ..extend.extend import has_possible_numbers
from .contributions import energies, measure_sizes
from .feasible import is_sound
from .inertial_check import relieved, strained_links

SEARCH = "the search for laws"
FIRST, NEXT = 4.0, 3.0  # log odds needed
DISTRUST, LOOKALIKE = 5.0, 8.0  # the same where inertials are not trusted, and of what inertials imitate
IMITATED = 0.9  # share of an effect that inertials can make, from which on it looks like them
MOST = 14  # hypotheses altogether
SHAPE_ERROR = 0.05  # of an effect that is taken for true: what its law leaves of it
BETTER = 2.0  # log odds by which another hypothesis must be better to take a place


def search(judge: Judge, base: Array, start: Mapping[Group, float] | None = None) -> Found:
    """Forward steps, after each an exchange: nothing stays that another hypothesis explains better.

    Args:
        judge: library and evidence.
        base: (n,) dispersion that no effect explains [1].
        start: what to begin with, with the log odds that it was accepted by; None: nothing.
    """
    state = Found((), {}, base, judge.evidence.trust((), base))
    first, trusted = judge.odds((), spread(judge, state))
    odds, seen = first, list[set[Group]]()
    if start:
        state = _exchanged(judge, begin(judge, base, start), BETTER)
    for step in range(MOST):
        show_step(f"weighing laws beside {len(state.true)} found", 1 - 0.7 ** (step + 1))
        if state.true:
            odds, trusted = judge.odds(state.true, spread(judge, state))
        chosen = _pick(judge, state, odds, trusted, NEXT if state.true else FIRST)
        if chosen is None or time_is_up(SEARCH):
            break
        state = larger = _with(judge, state, chosen)
        if len(state.true) > 1:
            state = _exchanged(judge, _plainer(judge, state), BETTER, judge.evidence.data.rows(chosen.best))
        state = larger if set(state.true) in seen else state  # the exchange would go in circles
        if set(state.true) in seen:
            break
        seen.append(set(state.true))
    for _ in range(0 if time_is_up(SEARCH) else 2):
        before, state = state.true, _exchanged(judge, _plainer(judge, state), BETTER / 2)
        if before == state.true:
            break
    return Found(state.true, state.log_odds, base, state.trust, first)


def posterior(judge: Judge, found: Found) -> float:
    """Log posterior density of what was selected, up to what is common to all selections under the same noise [-].

    Args:
        judge: library and evidence.
        found: what was selected.
    """
    evidence = judge.evidence
    fit = evidence.fit(found.true, found.base, found.trust)
    scale = float(evidence.scale_prior[np.argmin(np.abs(evidence.scales - found.trust))])
    return fit.log_evidence + scale + log_prior(judge, found)


def log_prior(judge: Judge, found: Found) -> float:
    """Log of how much likelier or less what was selected was than nothing, before the rows were seen [-]."""
    priors = (judge.priors.get(group.claim.key, 0.0) for group in found.true)
    return sum(priors) - len(found.true) * float(np.log(NOTHING))


def begin(judge: Judge, base: Array, start: Mapping[Group, float]) -> Found:
    """Hypotheses that were selected among other rows, of as many coefficients, in any of their shapes.

    An exchange or a fit finds the best shape.

    Args:
        judge: library and evidence.
        base: (n,) dispersion that no effect explains [1].
        start: the hypotheses, with the log odds that each was accepted by.
    """
    log = {judge.like(group): x for group, x in start.items() if group.claim.key in judge.keys}
    return Found(tuple(log), log, base, judge.evidence.trust(tuple(log), base))


def spread(judge: Judge, state: Found, most: float = 1.3) -> Array:
    """(n,) dispersion [1] that the shape errors of what is taken for true add to: at most `most` times what is left."""
    if not state.true:
        return state.base
    sizes = measure_sizes(judge.evidence, state.true, state.base, state.trust)
    wide = state.base + SHAPE_ERROR**2 * sum(energies(sizes).values())
    return np.maximum(state.base, np.minimum(wide, most * sizes.left))


def without(judge: Judge, state: Found, group: Group) -> Found:
    """What is left when one hypothesis is taken out."""
    rest = tuple(g for g in state.true if g is not group)
    return Found(rest, state.log_odds, state.base, judge.evidence.trust(rest, state.base), state.first)


def needed(
    judge: Judge, group: Group, trusted: float, count: int, usual: float, strained: Collection[int] = ()
) -> float:
    """Log odds that a hypothesis needs beside `count` others.

    Inertials within their tolerance imitate bodies, but not those of the joints whose links are strained without them.
    """
    if trusted >= 0.5 or judge.evidence.informed or group.claim.bodies.intersection(strained):
        return usual
    if judge.evidence.imitated(group) > IMITATED:
        return max(usual, LOOKALIKE)
    return max(usual, DISTRUST) if count == 0 else usual


def _pick(judge: Judge, state: Found, odds: Mapping[Key, Odds], trusted: float, usual: float) -> Odds | None:
    taken, there = _taken(state), laws_there(judge, state)
    open_ = (o for o in odds.values() if not taken & o.best.claim.names and is_founded(o.best, there))
    strained = strained_links(judge, state)
    ranked = sorted(
        open_, key=lambda o: (-max((strained.get(j, 0.0) for j in o.best.claim.bodies), default=0.0), -o.log)
    )
    for candidate in ranked:
        if candidate.log < usual or time_is_up(SEARCH):
            continue
        enough = candidate.log >= needed(judge, candidate.best, trusted, len(state.true), usual, strained)
        if enough and is_sound(judge, state, candidate.best):
            return candidate
    return None


def _taken(state: Found) -> set[Key]:
    return {key for group in state.true for key in group.claim.names}


def laws_there(judge: Judge, state: Found) -> set[Key]:
    """Effects and joints of the laws that the simulation states or that are selected.

    Args:
        judge: library and evidence.
        state: the selected laws.
    """
    stated = {(g.law.effect.name, g.law.joints) for g in judge.evidence.data.refitted if g.law is not None}
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


def _with(judge: Judge, state: Found, chosen: Odds) -> Found:
    """The hypothesis as well; laws that are missing together become hypotheses of their own, which may be dropped."""
    parts = tuple(part for part in judge.parts(chosen.best) if part not in state.true)
    true = (*state.true, *parts)
    log = {**state.log_odds, **dict.fromkeys(parts, chosen.log)}
    return Found(true, log, state.base, judge.evidence.trust(true, state.base), state.first)


def _exchanged(judge: Judge, state: Found, better: float, joints: Collection[int] | None = None) -> Found:
    """Each hypothesis in turn against all others that could stand in its place; only those at some joints, or all.

    In the place of a link's that is strained without it, only what relieves that link could.
    """
    for group in state.true:
        if time_is_up(SEARCH):
            break
        if joints is not None and not set(judge.evidence.data.rows(group)).intersection(joints):
            continue
        rest = without(judge, state, group)
        odds, trusted = judge.odds(state.true, spread(judge, state), without=group)
        links = relieved(judge, state, rest, group)
        odds = {key: o for key, o in odds.items() if not links or o.best.claim.bodies & links}
        own = odds.get(group.claim.key)
        log = own.log if own is not None else -np.inf
        alone = {key: o for key, o in odds.items() if len(o.best.claim.laws) == 1 and o.log > log + better}
        rival = _pick(judge, rest, alone, trusted, NEXT) if alone else None
        if rival is not None:
            state = _with(judge, rest, rival)
        elif log < needed(judge, group, trusted, len(rest.true), NEXT, links):
            state = rest
        elif own is not None and own.best is not group:
            state = _with(judge, rest, own)
    return state


def _plainer(judge: Judge, state: Found) -> Found:
    """The plain laws that a law contains in its place, where together they are as likely."""
    for group in state.true:
        law = group.claim.laws[0]
        plain = tuple(
            g for g in judge.alone([(name, law.joints) for name in law.effect.contains]) if g not in state.true
        )
        if not plain:
            continue
        other = (*(g for g in state.true if g is not group), *plain)
        trust = judge.evidence.trust(other, state.base)
        now, then = (judge.evidence.fit(t, state.base, k) for t, k in ((state.true, state.trust), (other, trust)))
        possible = all(has_possible_numbers(g, then.value[then.place(g)]) for g in plain)
        if possible and then.log_evidence >= now.log_evidence:
            log = {**state.log_odds, **dict.fromkeys(plain, state.log_odds[group])}
            state = Found(other, log, state.base, trust, state.first)
    return state
