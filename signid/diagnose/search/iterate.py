"""Evidence -> what is taken for true: searched, with dispersions and noise that what was found tells."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...deadline import time_is_up
from ...types import Array
from ..data.dataset import Setting, append
from ..data.discrepancy import USUAL
from ..data.hypotheses import Key, happens_once
from ..data.whitened_rows import whitened
from ..evidence.bayes_factors import Evidence
from ..evidence.likelihood import Likelihood
from ..evidence.noise_model import update_noise
from ..evidence.posterior_odds import Judge
from ..evidence.selection import Found
from ..result import Diagnosis
from .contact_window import NAME as CONTACT, find_contact
from .contributions import measure_sizes
from .relinearise import linearised
from .shape_optimisation import refine
from .stepwise import SEARCH, begin, log_prior, posterior, search, spread

NOISE_ERROR, DISCREPANCY = 1.3, 0.003  # of the noise's variance; of torque, in which every simulation is wrong
WINDOWS = 10  # of contact that are looked at, for each row
TANGLED = (
    "laws that were found change what others do, and no two rounds of the search agree on them: their numbers may be "
    "off by more than their intervals; record a motion that tells the alternatives apart"
)
ROUNDS, MORE = 3, 2  # of columns about the simulation with what was found; laws that one may find beside those before
NOISE_ROUNDS = 3  # of noise and search in turn


class Explained(NamedTuple):
    """What is taken for true, and what was asked."""

    setting: Setting
    judge: Judge
    found: Found
    flags: tuple[str, ...] = ()  # columns are not those about the simulation with what was found


def explain(setting: Setting, judge: Judge, skip: Sequence[str], known: Diagnosis | None) -> Explained:
    """What is taken for true; searched again where laws that were found change what others do.

    Args:
        setting: motions and rows.
        judge: library and evidence.
        skip: effects that are left out.
        known: a diagnosis of recordings without the mismatch, if there is one.
    """
    first = about, judge_, found = _explain(setting, judge, skip, known)
    setting = about
    named = set[Key]()
    for _ in range(ROUNDS):
        if time_is_up(SEARCH):
            return Explained(*first)
        new = linearised(setting, about, judge_, found)
        if new is None:
            return Explained(about, judge_, found)
        about, evidence, named = new, Evidence(whitened(new.table, new.noise), judge.evidence.known), _names(found)
        judge_, found = _search(about, replace(judge, evidence=evidence), skip, known, found)
        if time_is_up(SEARCH):
            return Explained(*first)
        if (
            len(found.true) > len(first[2].true) + MORE
        ):  # rounds go astray: what is about a wrong simulation asks for more
            break
    else:
        if _names(found) == named:
            return Explained(about, judge_, found)
    return Explained(*first, (TANGLED,))


def _names(found: Found) -> set[Key]:
    return {group.claim.key for group in found.true}


def _explain(
    setting: Setting, judge: Judge, skip: Sequence[str], known: Diagnosis | None
) -> tuple[Setting, Judge, Found]:
    """Searched, and noise estimated beside what was selected, in turn, while both together become likelier."""
    judge_, found = _search(setting, judge, skip, known)
    best, highest, asked_again = (setting, judge_, found), -np.inf, False
    for _ in range(NOISE_ROUNDS):
        if time_is_up(SEARCH):
            break
        noise = update_noise(setting, judge_.evidence, found)
        quieter = replace(setting, noise=noise)
        if (score := _score(quieter, judge_, found)) <= highest:
            break
        asked = replace(judge, evidence=Evidence(whitened(quieter.table, noise), judge.evidence.known))
        once = any(happens_once(law) for group in found.true for law in group.claim.laws)  # its window is of these rows
        highest, asked_again = score, not once
        best = (setting, judge_, found) if once else (quieter, asked, found)
        again = _search(quieter, asked, skip, known, found)
        if time_is_up(SEARCH):
            break
        if _names(again[1]) == _names(found):
            return quieter, *again
        setting, (judge_, found) = quieter, again
    return (best[0], *_kept(*best, known)) if asked_again else best


def _score(setting: Setting, judge: Judge, found: Found) -> float:
    """Log posterior density of what was selected and of the noise estimated beside it, up to a constant [-]."""
    data = judge.evidence.data
    rows = Likelihood(setting, judge.evidence, replace(found, base=np.ones(data.joints))).density()
    sizes = float(np.sum(np.log1p((setting.noise.discrepancy / data.scale / USUAL) ** 2)))
    return rows - sizes + log_prior(judge, found)


def _kept(setting: Setting, judge: Judge, found: Found, known: Diagnosis | None) -> tuple[Judge, Found]:
    """What was selected, under another noise."""
    start = {group: found.log_odds[group] for group in found.true}
    kept = begin(judge, _expected(judge, known), start)
    return refine(setting, judge, replace(kept, first=judge.odds((), kept.base)[0]))


def _search(
    setting: Setting, judge: Judge, skip: Sequence[str], known: Diagnosis | None, before: Found | None = None
) -> tuple[Judge, Found]:
    """Search from what was selected before, and where that changes from nothing as well, for what is likelier.

    Then for a contact. The first time, all that the simulation leaves counts as noise.
    """
    expected = _expected(judge, known)
    if before is None:
        left = measure_sizes(judge.evidence, (), expected, judge.evidence.trust((), expected)).left
        expected = np.maximum(expected, NOISE_ERROR * left)
    start = {} if before is None else {group: before.log_odds[group] for group in before.true}
    found = search(judge, expected, start)
    if before is not None and start and _names(found) != _names(before):
        found = max(search(judge, expected), found, key=lambda one: posterior(judge, one))
    if CONTACT not in skip:
        judge, found = _touched(setting, judge, found)
    return refine(setting, judge, found)


def _expected(judge: Judge, known: Diagnosis | None) -> Array:
    """(n,) dispersion that no law explains [1]."""
    data = judge.evidence.data
    expected = NOISE_ERROR * (1 + (DISCREPANCY * data.scale / data.floor) ** 2)
    if known is None:
        return np.asarray(expected)
    return np.asarray(np.maximum(expected, (known.after.train_rms / known.after.noise_floor) ** 2))


def _touched(setting: Setting, judge: Judge, found: Found) -> tuple[Judge, Found]:
    """Once more, with a window of contact where there is one."""
    window = find_contact(setting, judge.evidence.data, _local_rest(setting, judge, found), found.base)
    if window is None:
        return judge, found
    dispersion, columns = spread(judge, found), setting.columns(window)
    fit = judge.evidence.fit(found.true, dispersion, found.trust)
    odds = judge.ask(fit, dispersion, window, columns, setting.whiten(columns))
    if odds is None or odds <= np.log(WINDOWS * len(judge.evidence.data)):
        return judge, found
    data, _ = append(setting, judge.evidence.data, window, columns)
    wider = replace(judge, evidence=replace(judge.evidence, data=data))
    again = search(wider, found.base)
    return (judge, found) if time_is_up(SEARCH) else (wider, again)


def _local_rest(setting: Setting, judge: Judge, found: Found) -> Array:
    """(n, M) [1] residual in units of the coloured noise alone, after all that is fitted."""
    data, fit = judge.evidence.data, judge.evidence.fit(found.true, found.base, found.trust)
    rest = {j: x[:, None] for j, x in enumerate(setting.remaining(data, fit).T)}
    white = setting.whitening.local(rest)
    return np.array([white[j][:, 0] for j in range(data.joints)])
