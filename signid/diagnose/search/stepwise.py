"""Stepwise selection of hypotheses by posterior odds: forward steps, exchange, removal, and pruning at the end."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...deadline import show_step, time_is_up
from ...effects.base import ActuatorLaw
from ...regression.projection import least_squares, leave
from ...regression.session import Session
from ...types import INERTIAL, Array, Law
from .. import thresholds as tuned
from ..data.dataset import Dataset, Fitted, columns_of
from ..data.hypotheses import Key
from ..data.rows import Group
from ..evidence.prior import CoefficientPrior
from ..evidence.selection import Odds, Posterior, Selection
from ..extend import extend, has_possible_numbers, is_possible, nearest_bodies, read_laws
from ..holdout import residual_rows
from .contributions import measure_contributions, residual_growth

LAW_SEARCH = "the search for laws"  # name of the search in messages about time limits
UNCHANGED_VARIANCE = 1e-10  # variance of bodies that do not change [kg2, kg2.m2, kg2.m4]: keeps the covariance regular
ANSWER_TOLERANCE = 1.0  # numbers that differ by less get the answer computed before [standard deviations]


def stepwise_search(posterior: Posterior, dispersion: Array, start: Mapping[Group, float] | None = None) -> Selection:
    """Select hypotheses: each step adds the most probable one, then exchanges those that others explain better.

    The dispersion (n,) [1] is that of the whitened residual without any law. `start` has hypotheses and their log odds.
    """
    selection = initial_selection(posterior, dispersion, {})
    first, trusted = posterior.odds((), inflated_dispersion(selection))
    odds, seen = first, list[set[Group]]()
    if start:
        selection = _exchanged(initial_selection(posterior, dispersion, start), tuned.EXCHANGE_LOG_ODDS)
    for step in range(tuned.MAX_SELECTED_LAWS):
        show_step(f"weighing laws beside {len(selection.selected)} selected", 1 - 0.7 ** (step + 1))
        if selection.selected:
            odds, trusted = posterior.odds(selection.selected, inflated_dispersion(selection))
        chosen = _best_candidate(
            selection, odds, trusted, tuned.NEXT_LOG_ODDS if selection.selected else tuned.FIRST_LOG_ODDS
        )
        if chosen is None or time_is_up(LAW_SEARCH):
            break
        selection = larger = _with(selection, chosen)
        if len(selection.selected) > 1:
            acted_on = selection.data.rows(chosen.best)
            selection = _exchanged(_simplified(selection), tuned.EXCHANGE_LOG_ODDS, acted_on)
        selection = larger if set(selection.selected) in seen else selection  # the exchange would cycle
        if set(selection.selected) in seen:
            break
        seen.append(set(selection.selected))
    for _ in range(0 if time_is_up(LAW_SEARCH) else 2):
        before, selection = selection.selected, _exchanged(_simplified(selection), tuned.EXCHANGE_LOG_ODDS / 2)
        if before == selection.selected:
            break
    return replace(selection, first=first)


def log_posterior(selection: Selection) -> float:
    """Log posterior density of a selection, up to what is common to all selections under the same noise [-]."""
    evidence = selection.evidence
    scale = float(evidence.scale_prior[np.argmin(np.abs(evidence.scales - selection.prior_scale))])
    return selection.fit().log_evidence + scale + log_prior_odds(selection)


def log_prior_odds(selection: Selection) -> float:
    """Log prior odds of a selection against no law [-]."""
    priors = (selection.posterior.priors.get(group.claim.key, 0.0) for group in selection.selected)
    return sum(priors) - len(selection.selected) * float(np.log(tuned.PRIOR_NOTHING))


def initial_selection(posterior: Posterior, dispersion: Array, start: Mapping[Group, float]) -> Selection:
    """Selection of hypotheses with their log odds among other rows; dispersion (n,) [1] without any law.

    Each has a shape of as many coefficients; an exchange or a fit finds the best shape.
    """
    log = {posterior.counterpart(group): x for group, x in start.items() if group.claim.key in posterior.keys}
    scale = posterior.evidence.prior_scale(tuple(log), dispersion)
    return Selection(posterior, tuple(log), log, dispersion, scale)


def inflated_dispersion(selection: Selection, most: float = tuned.MAX_INFLATION) -> Array:
    """(n,) variance of the whitened residual [1], inflated by formula errors of the selected laws.

    The upper bound is `most` times the mean square of the residual.
    """
    dispersion = selection.dispersion
    if not selection.selected:
        return dispersion
    contributions = measure_contributions(selection.evidence, selection.selected, dispersion, selection.prior_scale)
    inflated = dispersion + tuned.SHAPE_ERROR**2 * sum(residual_growth(contributions).values())
    return np.maximum(dispersion, np.minimum(inflated, most * contributions.mean_square))


def required_log_odds(
    posterior: Posterior, group: Group, trusted: float, count: int, usual: float, violated: Collection[int] = ()
) -> float:
    """Log odds that a hypothesis needs beside `count` others [-]; `usual` where inertials are as stated.

    More where `trusted`, the probability of that, is low, since wrong inertials imitate changes of bodies; but not for
    bodies of links whose tolerance is violated, given by their joints.
    """
    if trusted >= 0.5 or posterior.evidence.informed or group.claim.bodies.intersection(violated):
        return usual
    if posterior.evidence.imitated(group) > tuned.IMITATED_SHARE:
        return max(usual, tuned.IMITATED_LOG_ODDS)
    return max(usual, tuned.UNTRUSTED_LOG_ODDS) if count == 0 else usual


def present_laws(selection: Selection) -> set[Key]:
    """Effects and joints of the laws that the simulation states or that are selected."""
    stated = {(g.law.effect.name, g.law.joints) for g in selection.data.refitted if g.law is not None}
    return stated | _selected_keys(selection)


def is_applicable(group: Group, present: Collection[Key]) -> bool:
    """Whether a hypothesis names laws, and a law that changes another has that other present."""
    laws = group.claim.laws
    return bool(laws) and all(
        not law.effect.changes or any((name, law.joints) in present for name in law.effect.changes) for law in laws
    )


def _best_candidate(selection: Selection, odds: Mapping[Key, Odds], trusted: float, usual: float) -> Odds | None:
    """Most probable admissible hypothesis with sufficient odds; corrections of violated links come first."""
    taken, present = _selected_keys(selection), present_laws(selection)
    candidates = (o for o in odds.values() if not taken & o.best.claim.names and is_applicable(o.best, present))
    violations = inertial_violations(selection)

    def rank(odds: Odds) -> tuple[float, float]:
        return -max((violations.get(j, 0.0) for j in odds.best.claim.bodies), default=0.0), -odds.log

    count = len(selection.selected)
    for candidate in sorted(candidates, key=rank):
        if candidate.log < usual or time_is_up(LAW_SEARCH):
            continue
        needed = required_log_odds(selection.posterior, candidate.best, trusted, count, usual, violations)
        if candidate.log >= needed and is_admissible(selection, candidate.best):
            return candidate
    return None


def _selected_keys(selection: Selection) -> set[Key]:
    """Effects and joints of all selected laws."""
    return {key for group in selection.selected for key in group.claim.names}


def _with(selection: Selection, chosen: Odds) -> Selection:
    """Add a hypothesis."""
    log_odds = {**selection.log_odds, chosen.best: chosen.log}
    return selection.with_selected((*selection.selected, chosen.best), log_odds)


def _exchanged(selection: Selection, better: float, joints: Collection[int] | None = None) -> Selection:
    """Compare each selected law that acts on one of some joints (None: all) with all others; replace or drop it."""
    for group in selection.selected:
        if time_is_up(LAW_SEARCH):
            break
        if joints is None or not set(selection.data.rows(group)).isdisjoint(joints):
            selection = _exchange(selection, group, better)
    return selection


def _exchange(selection: Selection, group: Group, better: float) -> Selection:
    """Replace a selected law by a better rival, which resolves the same violations, or by another shape, or drop it."""
    rest, posterior = selection.without(group), selection.posterior
    odds, trusted = posterior.odds(selection.selected, inflated_dispersion(selection), without=group)
    links = resolved_violations(selection, rest, group)
    odds = {key: o for key, o in odds.items() if not links or o.best.claim.bodies & links}
    own = odds.get(group.claim.key)
    log = own.log if own is not None else -np.inf
    likelier = {key: o for key, o in odds.items() if o.best.claim.laws and o.log > log + better}
    rival = _best_candidate(rest, likelier, trusted, tuned.NEXT_LOG_ODDS) if likelier else None
    if rival is not None:
        return _with(rest, rival)
    if log < required_log_odds(posterior, group, trusted, len(rest.selected), tuned.NEXT_LOG_ODDS, links):
        return rest
    return _with(rest, own) if own is not None and own.best is not group else selection


def _simplified(selection: Selection) -> Selection:
    """Replace a law by the simpler laws that it contains where these are as probable together."""
    for group in selection.selected:
        law = group.claim.laws[0]
        contained = selection.posterior.single_laws([(name, law.joints) for name in law.effect.contains])
        simpler = tuple(g for g in contained if g not in selection.selected)
        if not simpler:
            continue
        log = {**selection.log_odds, **dict.fromkeys(simpler, selection.log_odds[group])}
        other = selection.with_selected((*(g for g in selection.selected if g is not group), *simpler), log)
        now, then = selection.fit(), other.fit()
        possible = all(has_possible_numbers(g, then.value[then.place(g)]) for g in simpler)
        if possible and then.log_evidence >= now.log_evidence:
            selection = other
    return selection


def prune(dataset: Dataset, session: Session, selection: Selection) -> Selection:
    """Drop laws with impossible or insignificant numbers, and laws that increase the training residual.

    The residual is that of the extended simulation, since laws change each other's torque.
    """
    while selection.selected:  # impossible beside the others, the least probable first
        fit = selection.fit()
        wrong = [group for group in selection.selected if not has_possible_numbers(group, fit.value[fit.place(group)])]
        if not wrong:
            break
        selection = selection.without(min(wrong, key=lambda group: selection.log_odds[group]))
    selection = _significant(selection)
    while selection.selected and not time_is_up(LAW_SEARCH):
        worst, harm = max(_training_harm(dataset, session, selection).items(), key=lambda item: item[1])
        if harm <= 0:
            return selection
        selection = selection.without(worst)
    return selection


def _significant(selection: Selection) -> Selection:
    """Drop insignificant laws; a body change stays if a link would violate its tolerance without it."""
    while selection.selected:
        fit = selection.fit()
        value, covariance, chi2 = fit.value, fit.covariance, dict[Group, float]()
        for group in selection.selected:
            own = fit.place(group)
            theta, spread = value[own], covariance[own, own]
            size = np.sqrt(np.diag(spread))
            turned = least_squares(spread / size / size[:, None], theta / size, 1e-8)
            chi2[group] = float(turned @ (theta / size)) / group.size
        least = min(chi2, key=lambda group: chi2[group])
        rest = selection.without(least)
        if chi2[least] > tuned.SIGNIFICANT_CHI2 or resolved_violations(selection, rest, least):
            break
        selection = rest
    return selection


def _training_harm(dataset: Dataset, session: Session, selection: Selection) -> dict[Group, float]:
    """Increase of the squared training residual by each law, over the irreducible variance [1]."""
    evidence, tried = selection.evidence, list[tuple[float, dict[Group, float]]]()
    whole = evidence.fit(selection.selected, selection.dispersion, selection.prior_scale)
    alone = whole.restricted(np.isin(whole.which, columns_of(selection.selected)))
    for fit, refitted in ((whole, evidence.data.refitted), (alone, ())):
        laws = {group: read_laws(group, fit.value[fit.place(group)]) for group in selection.selected}
        model = extend(dataset.model, refitted, fit, laws, session.task.base)
        rows = residual_rows(session.task, model, session.train)
        noise = rows.irreducible_std(dataset.noise, 1)
        with_all = _square(rows.residual / noise)
        without = {group: rows.residual + _torque(dataset, own) for group, own in laws.items()}
        tried.append((with_all, {group: with_all - _square(rest / noise) for group, rest in without.items()}))
    return min(tried, key=lambda one: one[0])[1]


def _torque(dataset: Dataset, laws: Sequence[Law]) -> Array:
    """(M, n) [N.m or N] torque of some laws."""
    torque = np.zeros_like(dataset.table.residual)
    for law in laws:
        for j, x in dataset.torque(law).items():
            torque[:, j] += x
    return torque


def _square(x: Array) -> float:
    return float(np.nansum(x**2))


def inertial_violations(selection: Selection) -> dict[int, float]:
    """Squared corrections of links beyond any tolerance, by the joint that moves the link [variances].

    Inertials are refitted at the largest prior scale. Empty where they are probably right, or where the model carries
    a covariance.
    """
    if selection.evidence.informed or selection.evidence.prior_scale(selection.selected, selection.dispersion) == 0:
        return {}
    largest = selection.evidence.scales[-1]
    fit = selection.evidence.fit(selection.selected, selection.dispersion, largest)
    bodies = [group for group in selection.data.refitted if group.bodies]
    step = fit.value[np.isin(fit.which, columns_of(bodies))]
    deviation = np.concatenate([group.deviation for group in bodies])
    chi2 = np.sum((step / largest / deviation).reshape(-1, len(INERTIAL)) ** 2, axis=1)
    carried = selection.posterior.carried
    return {j: float(chi2[body]) for j, body in enumerate(carried) if chi2[body] > tuned.INERTIAL_VIOLATION}


def resolved_violations(selection: Selection, rest: Selection, group: Group) -> set[int]:
    """Joints whose links violate the tolerance without a body hypothesis (`rest`) and not with it (`selection`)."""
    violated = inertial_violations(rest).keys() if group.claim.bodies else set()
    return violated - inertial_violations(selection).keys() if violated else set()


def is_admissible(selection: Selection, group: Group) -> bool:
    """Whether a hypothesis may be selected beside others.

    Its torque is large enough, its numbers are physically possible, a coefficient without a number is near 1, and the
    selected laws cannot make the same torque.
    """
    selected = (*selection.selected, group)
    evidence, dispersion = selection.evidence, selection.dispersion
    fit = evidence.fit(selected, dispersion, evidence.prior_scale(selected, dispersion))
    prior = evidence.coefficient_priors[group]
    assert prior is not None, "hypotheses have priors"
    value = fit.value[fit.place(group)]
    data = selection.data
    rms = [np.sqrt(np.mean((data.raw(j, group) @ value) ** 2)) / data.scale[j] for j in data.rows(group)]
    low, high = tuned.ACTUATOR_RANGE if isinstance(group.claim.laws[0].effect, ActuatorLaw) else tuned.ON_OFF_RANGE
    if max(rms) < tuned.MIN_LAW_TORQUE_SHARE or (prior.mean and not low < value[0] < high):
        return False
    if not has_possible_numbers(group, value) or not _has_right_sign(group, prior, fit):
        return False
    return not _is_redundant(selection, group) and _has_bodies(selection.posterior, group, fit)


def _has_right_sign(group: Group, prior: CoefficientPrior, fit: Fitted) -> bool:
    """Whether a coefficient that physics requires to be positive is so, or is not clearly negative beside others."""
    if prior.positive < 0:
        return True
    at = fit.place(group).start + prior.positive
    value = fit.value[at]
    return not (value <= 0 and (group.size == 1 or value <= -2 * np.sqrt(fit.covariance[at, at])))


def _has_bodies(posterior: Posterior, group: Group, fit: Fitted) -> bool:
    """Whether a change of a body gives physically consistent bodies, within its covariance."""
    law, own = group.claim.laws[0], posterior.bodies
    if own is None or law.effect.name not in ("link_inertia", "payload"):
        return True
    place, body, numbers = fit.place(group), posterior.carried[law.joints[0]], group.claim.numbers
    step = np.zeros_like(own.inertials)
    step[body, : len(numbers)] = numbers @ fit.value[place]
    if is_possible(own.inertials, own.inertials + step):
        return True
    std = np.sqrt(np.diag(fit.covariance)[place])
    asked = posterior.feasibility.setdefault(group, [])
    for value, answer in asked:
        if np.all(np.abs(value - fit.value[place]) <= ANSWER_TOLERANCE * std):
            return answer
    covariance = np.diag(np.full(step.size, UNCHANGED_VARIANCE))
    at = 10 * body + np.arange(len(numbers))
    covariance[np.ix_(at, at)] += numbers @ fit.covariance[place, place] @ numbers.T
    near = nearest_bodies(own.base, own.inertials, step, covariance)
    asked.append((fit.value[place], near.feasible_without_moving or near.chi2 < tuned.INFEASIBLE_CHI2 * group.size))
    return asked[-1][1]


def _is_redundant(selection: Selection, group: Group) -> bool:
    """Whether the selected laws can make all the torque that a hypothesis can make."""
    data = selection.data
    joints = data.rows(group)
    near = [g for g in selection.selected if not set(joints).isdisjoint(data.rows(g))]
    if not near:
        return False
    x = np.concatenate([data.part(j, group) for j in joints])
    beside = np.concatenate([np.column_stack([data.part(j, g) for g in near]) for j in joints])
    scale = np.linalg.norm(x, axis=0)
    x = x[:, scale > 0] / scale[scale > 0]
    residual = leave(x, beside)
    return bool(np.sum(residual**2) < tuned.REDUNDANT_SHARE * np.sum(x**2))
