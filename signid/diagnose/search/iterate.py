"""Outer loop of the search: select laws, estimate the noise again, relinearise, repeat."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...deadline import OutOfTimeError, show_step, time_is_up
from ...effects.base import ActuatorLaw, BodyLaw, RecordingLaw
from ...effects.law import law_torque
from ...model import Model
from ...regression.motion import Motion
from ...types import Array, Law, Robot
from .. import thresholds as tuned
from ..data.dataset import Dataset, append, whitened
from ..data.estimated_gains import EstimatedGain
from ..data.hypotheses import Hypothesis, Key, is_transient
from ..data.motions import bodies_without_rotors
from ..data.rows import columns_anew, dry_friction
from ..evidence.bayes_factors import Evidence
from ..evidence.likelihood import Likelihood, update_noise
from ..evidence.selection import Posterior, Selection
from ..extend import inertial_places, read_laws
from ..result import Diagnosis
from .contributions import measure_contributions
from .shapes import CONTACT_EFFECT as CONTACT, find_contact, optimise_shapes
from .stepwise import LAW_SEARCH, inflated_dispersion, initial_selection, log_posterior, log_prior_odds, stepwise_search

DISAGREEMENT_FLAG = (
    "the selected laws change each other's torque, and no two rounds of the search agree on them: their numbers may be "
    "off by more than their intervals; record a motion that separates the alternatives"
)


class SearchResult(NamedTuple):
    """Selected laws, and the dataset with the columns and the noise that they were selected by."""

    dataset: Dataset
    selection: Selection
    flags: tuple[str, ...] = ()  # set if the columns are not those about the simulation with the selected laws


@dataclass(frozen=True)
class _Conditions:
    """Conditions that stay the same in all rounds."""

    skip: Sequence[str]  # excluded effects
    reference: Diagnosis | None  # diagnosis of the healthy reference


def select(dataset: Dataset, posterior: Posterior, skip: Sequence[str], reference: Diagnosis | None) -> SearchResult:
    """Select laws; repeat with columns about the extended simulation where selected laws interact.

    The first round's result is returned, with a flag, if relinearisation diverges or does not converge.
    """
    conditions = _Conditions(skip, reference)
    motions = tuple(p._replace(motion=replace(p.motion)) for p in dataset.pieces)  # large what these will have cached
    about, selection = _select(replace(dataset, pieces=motions), posterior, conditions)
    first = dataset, _ = replace(about, pieces=dataset.pieces), selection
    names = set[Key]()
    for _ in range(tuned.RELINEARISATION_ROUNDS):
        if time_is_up(LAW_SEARCH):
            return SearchResult(*first)
        new = relinearise(dataset, about, selection)
        if new is None:
            return SearchResult(about, selection)
        about, names = new, _names(selection)
        selection = _search(about, _with_rows(selection.posterior, new), conditions, selection)
        if time_is_up(LAW_SEARCH):
            return SearchResult(*first)
        # it diverges from a wrong expansion point
        if len(selection.selected) > len(first[1].selected) + tuned.MAX_ADDED_LAWS:
            break
    else:
        if _names(selection) == names:
            return SearchResult(about, selection)
    return SearchResult(*first, (DISAGREEMENT_FLAG,))


def _names(selection: Selection) -> set[Key]:
    """Effects and joints of the selected hypotheses."""
    return {group.claim.key for group in selection.selected}


def _with_rows(posterior: Posterior, dataset: Dataset) -> Posterior:
    """The same prior with the rows of another dataset, whose results take the place of those kept in memory."""
    rows, known = whitened(dataset.table, dataset.noise), posterior.evidence
    known.cache.clear()
    known.own_cache.clear()
    return replace(posterior, evidence=Evidence(rows, known.stated_prior, known.bare))


def _select(dataset: Dataset, posterior: Posterior, conditions: _Conditions) -> tuple[Dataset, Selection]:
    """Alternate search and noise estimation while the posterior density of laws and noise together rises."""
    selection = _search(dataset, posterior, conditions)
    if dataset.model.misfit is not None:
        return _beside_misfit(dataset, selection, conditions)
    best, highest, refit_best = (dataset, selection), -np.inf, False
    for _ in range(tuned.NOISE_ROUNDS):
        if time_is_up(LAW_SEARCH):
            break
        updated = replace(dataset, noise=update_noise(dataset, selection))
        # log posterior density of the laws and of the noise estimated beside them, up to a constant [-]
        data = selection.data
        rows = Likelihood(updated, replace(selection, dispersion=np.ones(data.joints))).density()
        half_cauchy = np.log1p((updated.noise.discrepancy / data.scale / tuned.DISCREPANCY_SCALE) ** 2)
        score = rows - float(np.sum(half_cauchy)) + log_prior_odds(selection)
        if score <= highest:
            break
        posterior = _with_rows(posterior, updated)
        laws = [law for group in selection.selected for law in group.claim.laws]
        once = any(map(is_transient, laws))  # the window of a contact holds for these rows only
        highest, refit_best = score, not once
        best = (dataset, selection) if once else (updated, replace(selection, posterior=posterior))
        again = _search(updated, posterior, conditions, selection)
        if time_is_up(LAW_SEARCH):
            break
        if _names(again) == _names(selection):
            return updated, again
        dataset, selection = updated, again
    if not refit_best:
        return best
    dataset, selection = best  # the same laws, fitted under the noise of the dataset
    start = {group: selection.log_odds[group] for group in selection.selected}
    posterior = _with_shapes(dataset, selection.posterior, selection)
    kept = initial_selection(posterior, _expected(posterior, conditions.reference), start)
    kept = replace(kept, first=kept.posterior.odds((), kept.dispersion)[0])
    return dataset, optimise_shapes(dataset, kept)


def _beside_misfit(dataset: Dataset, selection: Selection, conditions: _Conditions) -> tuple[Dataset, Selection]:
    """Alternate search and growth of the known misfit until the laws stay."""
    for _ in range(tuned.NOISE_ROUNDS):
        if time_is_up(LAW_SEARCH):
            break
        updated = replace(dataset, noise=update_noise(dataset, selection))
        again = _search(updated, _with_rows(selection.posterior, updated), conditions, selection)
        if time_is_up(LAW_SEARCH):
            break
        same = _names(again) == _names(selection)
        dataset, selection = updated, again
        if same:
            break
    return dataset, selection


def _search(
    dataset: Dataset, posterior: Posterior, conditions: _Conditions, before: Selection | None = None
) -> Selection:
    """Search from the laws selected before, and from none if that changes them; then optimise shapes."""
    expected = _expected(posterior, conditions.reference)
    posterior = posterior if before is None else _with_shapes(dataset, posterior, before)
    if before is None:
        scale = posterior.evidence.prior_scale((), expected)
        mean_square = measure_contributions(posterior.evidence, (), expected, scale).mean_square
        expected = np.maximum(expected, tuned.NOISE_ERROR * mean_square)
    start = {} if before is None else {group: before.log_odds[group] for group in before.selected}
    selection = stepwise_search(posterior, expected, start)
    if before is not None and start and _names(selection) != _names(before):
        selection = max(stepwise_search(posterior, expected), selection, key=log_posterior)
    if CONTACT not in conditions.skip:
        selection = _with_contact(dataset, selection)
    return _without_corrections(dataset, optimise_shapes(dataset, selection))


def _without_corrections(dataset: Dataset, selection: Selection) -> Selection:
    """Drop laws that only correct the shape of others: without them, at the best shape, these explain as much."""
    for group in selection.selected:
        if len(selection.selected) < 2 or time_is_up(LAW_SEARCH):
            break
        if group not in selection.selected:  # replaced beside one that was dropped
            continue
        own = selection
        share = measure_contributions(own.evidence, own.selected, own.dispersion, own.prior_scale).torque_share
        joints = set(selection.data.rows(group))
        beside = [g for g in selection.selected if g is not group and not joints.isdisjoint(selection.data.rows(g))]
        shaped = [g for g in beside if g.claim.finite or any(x.effect.shape(x.parameters) for x in g.claim.laws)]
        if any(share[group].max() < tuned.CORRECTION_SHARE * share[g].max() for g in shaped):
            rest, aim = selection.without(group), log_posterior(selection)
            rough = optimise_shapes(dataset, rest, joints, tuned.ROUGH_EVALUATIONS)
            least = log_posterior(rest)
            if log_posterior(rough) >= least + tuned.RECOVERED_SHARE * (aim - least):
                rest = optimise_shapes(dataset, rest, joints)
                selection = rest if log_posterior(rest) >= aim else selection
    return selection


def _with_shapes(dataset: Dataset, posterior: Posterior, before: Selection) -> Posterior:
    """Evidence that has the optimised shapes and sizes of selected laws among its hypotheses too."""
    data = posterior.evidence.data
    known = {group.hypothesis for group in data.groups}
    for group in before.selected:
        if group.hypothesis not in known and group.claim.key in posterior.keys:
            data, _ = append(dataset, data, group.claim)
    if data is posterior.evidence.data:
        return posterior
    return replace(posterior, evidence=replace(posterior.evidence, data=data))


def _expected(posterior: Posterior, reference: Diagnosis | None) -> Array:
    """(n,) variance of the whitened residual without any law [1]; at least that of the healthy reference."""
    data = posterior.evidence.data
    expected = tuned.NOISE_ERROR * (1 + (tuned.MODEL_ERROR * data.scale / data.floor) ** 2)
    if reference is None:
        return np.asarray(expected)
    return np.asarray(np.maximum(expected, (reference.after.train_rms / reference.after.irreducible_rms) ** 2))


def _with_contact(dataset: Dataset, selection: Selection) -> Selection:
    """Search again with a contact window among the hypotheses, if there is evidence for one."""
    rest = {j: x[:, None] for j, x in enumerate(dataset.remaining(selection.data, selection.fit()).T)}
    local = np.array([white[:, 0] for white in dataset.whitening.local(rest).values()])  # against coloured noise alone
    window = find_contact(dataset, selection.data, local, selection.dispersion)
    if window is None:
        return selection
    dispersion, columns = inflated_dispersion(selection), dataset.columns(window)
    fit = selection.evidence.fit(selection.selected, dispersion, selection.prior_scale)
    odds = selection.posterior.candidate_log_odds(fit, dispersion, window, columns, dataset.whitening(columns))
    if odds is None or odds <= np.log(tuned.WINDOWS_PER_ROW * len(selection.data)):
        return selection
    data, _ = append(dataset, selection.data, window)
    evidence = replace(selection.evidence, data=data)
    again = stepwise_search(replace(selection.posterior, evidence=evidence), selection.dispersion)
    return selection if time_is_up(LAW_SEARCH) else again


def relinearise(dataset: Dataset, about: Dataset, selection: Selection) -> Dataset | None:
    """Recompute the columns about the simulation with the selected laws; None if the change is negligible.

    Laws interact: a payload increases load-dependent friction and is turned by a base tilt, friction is part of a
    delayed torque. Each cross term is attributed to the law that acts on the other's output. The residual stays
    that of the given simulation, as do the rows of `dataset`; `about` has the present columns. Also None if time is up,
    or if the bodies are infeasible.
    """
    if time_is_up(LAW_SEARCH):
        return None
    show_step(f"linearising about {len(selection.selected)} laws", 0.8)
    fit = selection.fit()
    value = {group: fit.value[fit.place(group)] for group in selection.selected}
    laws = [law for group in selection.selected for law in read_laws(group, value[group])]
    numbers = {group.claim: value[group] for group in selection.selected}
    stated = selection.data.refitted if len(selection.data.gains.columns) else ()
    for group, law in ((group, group.law) for group in stated if group.law is not None):
        step = fit.value[fit.place(group)]
        if isinstance(law.effect, EstimatedGain):
            numbers[Hypothesis((law,))] = step
        else:  # a gain also scales the torque that refitted numbers make
            laws.append(replace(law, parameters=law.effect.physical(step.tolist(), law.effect.shape(law.parameters))))
    inertials, places = dataset.model.inertials, inertial_places(selection.data.refitted, fit)
    if len(places):
        inertials = inertials + fit.value[places].reshape(inertials.shape)
    changes = tuple(law for law in laws if isinstance(law.effect, BodyLaw))
    whole = bodies_without_rotors(Model(dataset.model.robot, inertials, (*dataset.model.laws, *changes)))
    whole.gravity = dataset.model.bodies().gravity  # a base tilt has columns of its own
    robot = replace(dataset.model.robot, model=whole)
    new = replace(dataset, pieces=tuple(p._replace(motion=_about(p.motion, robot, laws)) for p in dataset.pieces))
    if any(np.any(n.motion.inertia <= 0) for n in new.pieces) and all(
        np.all(o.motion.inertia > 0) for o in dataset.pieces
    ):
        return None  # infeasible inertias make the relinearisation meaningless
    off = np.zeros((dataset.table.joints, len(dataset.whitening({0: dataset.table.residual[:, :1]})[0])))
    for claim, step in numbers.items():
        old, updated = about.columns(claim), new.columns(claim)
        for j, x in dataset.whitening({j: updated[j] - old[j] for j in updated}).items():
            off[j] += x @ step
    if not np.sum(off**2, axis=1) @ (1 / selection.dispersion) > tuned.RELEVANT_CHI2:
        return None
    dry = dry_friction(dataset.model, dataset.pieces)
    try:
        return replace(new, table=columns_anew(dataset.task, dataset.model, dataset.table, new.pieces, dry))
    except OutOfTimeError:
        return None


def _about(motion: Motion, robot: Robot, laws: Sequence[Law]) -> Motion:
    """Replace robot and predicted torque of a motion by those with the laws."""
    assert motion.predicted is not None, "a diagnosed motion carries predicted torque"
    predicted = motion.predicted.copy()
    for law in laws:
        if not isinstance(law.effect, RecordingLaw | ActuatorLaw):
            rows, torque = law_torque(law, motion)
            predicted[:, list(rows)] += torque
    return replace(motion, robot=robot, predicted=predicted)
