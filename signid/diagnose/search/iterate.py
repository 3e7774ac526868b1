"""Evidence -> the selected laws: searched, with dispersions and noise that what was found tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...types import Array
from ..data.dataset import Dataset, append
from ..data.hypotheses import Key, is_transient
from ..data.thresholds import DISCREPANCY_SCALE
from ..data.whitened_rows import whitened
from ..evidence.bayes_factors import Evidence
from ..evidence.likelihood import Likelihood
from ..evidence.noise_model import update_noise
from ..evidence.posterior_odds import Posterior
from ..evidence.selection import Selection
from ..result import Diagnosis
from .contact_window import NAME as CONTACT, find_contact
from .contributions import measure_sizes
from .relinearise import linearised
from .shape_optimisation import optimise_shapes
from .stepwise import SEARCH, begin, inflated_dispersion, log_posterior, log_prior_odds, search

NOISE_ERROR, DISCREPANCY = 1.3, 0.003  # of the noise's variance; of torque, in which every simulation is wrong
WINDOWS = 10  # of contact that are looked at, for each row
TANGLED = (
    "laws that were found change what others do, and no two rounds of the search agree on them: their numbers may be "
    "off by more than their intervals; record a motion that tells the alternatives apart"
)
ROUNDS, MORE = 3, 2  # of columns about the simulation with what was found; laws that one may find beside those before
NOISE_ROUNDS = 3  # of noise and search in turn


class Selected(NamedTuple):
    """The selected laws, and the rows that they were selected by."""

    dataset: Dataset
    selection: Selection
    flags: tuple[str, ...] = ()  # columns are not those about the simulation with the selected laws


@dataclass(frozen=True)
class _Question:
    """What stays the same in all rounds."""

    skip: Sequence[str]  # effects that are left out
    known: Diagnosis | None  # of recordings without the mismatch


def select(dataset: Dataset, posterior: Posterior, skip: Sequence[str], known: Diagnosis | None) -> Selected:
    """Select laws; again, with columns about the extended simulation, where selected laws change what others do.

    Args:
        dataset: motions and rows.
        posterior: odds of every hypothesis.
        skip: effects that are left out.
        known: a diagnosis of recordings without the mismatch, if there is one.
    """
    question = _Question(skip, known)
    first = about, found = _select(dataset, posterior, question)
    dataset, named = about, set[Key]()
    for _ in range(ROUNDS):
        if time_is_up(SEARCH):
            return Selected(*first)
        new = linearised(dataset, about, found)
        if new is None:
            return Selected(about, found)
        about, named = new, _names(found)
        found = _search(about, _about(found.posterior, new), question, found)
        if time_is_up(SEARCH):
            return Selected(*first)
        if len(found.selected) > len(first[1].selected) + MORE:  # about a wrong simulation each round asks for more
            break
    else:
        if _names(found) == named:
            return Selected(about, found)
    return Selected(*first, (TANGLED,))


def _names(selection: Selection) -> set[Key]:
    return {group.claim.key for group in selection.selected}


def _about(posterior: Posterior, dataset: Dataset) -> Posterior:
    """The same prior with the rows of another dataset."""
    return replace(
        posterior, evidence=Evidence(whitened(dataset.table, dataset.noise), posterior.evidence.stated_prior)
    )


def _select(dataset: Dataset, posterior: Posterior, question: _Question) -> tuple[Dataset, Selection]:
    """Search and noise estimation in turn, while the posterior density of laws and noise together rises."""
    found = _search(dataset, posterior, question)
    best, highest, asked_again = (dataset, found), -np.inf, False
    for _ in range(NOISE_ROUNDS):
        if time_is_up(SEARCH):
            break
        quieter = replace(dataset, noise=update_noise(dataset, found.evidence, found))
        if (score := _score(quieter, found)) <= highest:
            break
        asked = _about(posterior, quieter)
        once = any(
            is_transient(law) for group in found.selected for law in group.claim.laws
        )  # its window is of these rows
        highest, asked_again = score, not once
        best = (dataset, found) if once else (quieter, replace(found, posterior=asked))
        again = _search(quieter, asked, question, found)
        if time_is_up(SEARCH):
            break
        if _names(again) == _names(found):
            return quieter, again
        dataset, found = quieter, again
    return (best[0], _kept(*best, question)) if asked_again else best


def _score(dataset: Dataset, selection: Selection) -> float:
    """Log posterior density of the selected laws and of the noise estimated beside them, up to a constant [-]."""
    data = selection.data
    rows = Likelihood(dataset, selection.evidence, replace(selection, dispersion=np.ones(data.joints))).density()
    sizes = float(np.sum(np.log1p((dataset.noise.discrepancy / data.scale / DISCREPANCY_SCALE) ** 2)))
    return rows - sizes + log_prior_odds(selection)


def _kept(dataset: Dataset, selection: Selection, question: _Question) -> Selection:
    """The same laws under another noise."""
    start = {group: selection.log_odds[group] for group in selection.selected}
    kept = begin(selection.posterior, _expected(selection.posterior, question.known), start)
    return optimise_shapes(dataset, replace(kept, first=kept.posterior.odds((), kept.dispersion)[0]))


def _search(dataset: Dataset, posterior: Posterior, question: _Question, before: Selection | None = None) -> Selection:
    """Search from the laws selected before; where that changes them, from none too, for what is likelier.

    Then search for a contact. The first time, all that the simulation leaves counts as noise.
    """
    expected = _expected(posterior, question.known)
    if before is None:
        scale = posterior.evidence.prior_scale((), expected)
        left = measure_sizes(posterior.evidence, (), expected, scale).left
        expected = np.maximum(expected, NOISE_ERROR * left)
    start = {} if before is None else {group: before.log_odds[group] for group in before.selected}
    found = search(posterior, expected, start)
    if before is not None and start and _names(found) != _names(before):
        found = max(search(posterior, expected), found, key=log_posterior)
    if CONTACT not in question.skip:
        found = _touched(dataset, found)
    return optimise_shapes(dataset, found)


def _expected(posterior: Posterior, known: Diagnosis | None) -> Array:
    """(n,) variance of the whitened residual that no law explains [1]."""
    data = posterior.evidence.data
    expected = NOISE_ERROR * (1 + (DISCREPANCY * data.scale / data.floor) ** 2)
    if known is None:
        return np.asarray(expected)
    return np.asarray(np.maximum(expected, (known.after.train_rms / known.after.irreducible_rms) ** 2))


def _touched(dataset: Dataset, found: Selection) -> Selection:
    """The selection, searched again with a window of contact where there is one."""
    window = find_contact(dataset, found.data, _local_rest(dataset, found), found.dispersion)
    if window is None:
        return found
    dispersion, columns = inflated_dispersion(found), dataset.columns(window)
    fit = found.evidence.fit(found.selected, dispersion, found.prior_scale)
    odds = found.posterior.candidate_log_odds(fit, dispersion, window, columns, dataset.whiten(columns))
    if odds is None or odds <= np.log(WINDOWS * len(found.data)):
        return found
    data, _ = append(dataset, found.data, window, columns)
    again = search(replace(found.posterior, evidence=replace(found.evidence, data=data)), found.dispersion)
    return found if time_is_up(SEARCH) else again


def _local_rest(dataset: Dataset, selection: Selection) -> Array:
    """(n, M) [1] residual in units of the coloured noise alone, after all that is fitted."""
    rest = {j: x[:, None] for j, x in enumerate(dataset.remaining(selection.data, selection.fit()).T)}
    white = dataset.whitening.local(rest)
    return np.array([white[j][:, 0] for j in range(selection.data.joints)])
