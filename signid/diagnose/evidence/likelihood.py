"""Noise model beside selected laws, and marginal likelihood of the rows under different noise models."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logsumexp

from ...types import Array, Frozen, Indices
from ..data.dataset import Dataset, columns_of, solve
from ..data.noise import (
    Noise,
    NoiseEstimate,
    Whitening,
    estimate_discrepancy,
    features,
    measure_noise,
    noise_of_misfit,
    noise_of_rest,
)
from ..data.rows import Group
from ..thresholds import MIN_FLOOR_SHARE, MISFIT_GROWTH, RELEVANT_FLOOR_SHARE
from .selection import Selection

NEGLIGIBLE_LOG_DENSITY = 12.0  # [-] scales k whose log density is this much below the highest are skipped: factor e^-12
MIN_FREE_SHARE = 0.1  # [1] lower bound of the free rows of a fit, as a share of all rows. Heuristic


def update_noise(dataset: Dataset, selection: Selection) -> Noise:
    """Estimate noise and discrepancy of each joint beside the selected laws.

    The size of the discrepancy by maximum marginal likelihood and the autoregressive model from the residual of fit and
    discrepancy are estimated in turn. If a floor falls far below the saturated floor, a law had been counted as noise:
    the saturated floor is then measured again without the selected laws. The misfit of an identified model is known; it
    is at most `MISFIT_GROWTH` times as large on other recordings.
    """
    if dataset.model.misfit is not None:
        known, table = dataset.noise, dataset.table
        left = np.where(table.at_rest, np.nan, dataset.remaining(selection.data, selection.fit()))
        size = np.sqrt(np.nanmean(left**2, axis=0))
        first = noise_of_misfit(replace(known, floor=np.zeros_like(size)), dataset.model.misfit, dataset.task.band)
        now = np.clip(size / first.floor, 1.0, MISFIT_GROWTH) * first.floor / known.floor
        floor = now * known.floor
        return replace(known, floor=floor, innovation=now * known.innovation, saturated_floor=floor)
    noise = update_joints(dataset, selection, range(dataset.table.joints))
    if not np.any(noise.floor < RELEVANT_FLOOR_SHARE * noise.saturated_floor):
        return noise
    data, table, band = selection.data, dataset.table, dataset.task.band
    fit = selection.fit()
    named = [sum(data.raw(j, g) @ fit.value[fit.place(g)] for g in selection.selected) for j in range(data.joints)]
    rest = replace(table, residual=table.residual - np.column_stack([x + np.zeros(len(table)) for x in named]))
    first = measure_noise(rest, dataset.periods, band.rate / band.factor)
    least = np.minimum(noise.saturated_floor, first.floor)
    raised = np.maximum(1.0, MIN_FLOOR_SHARE * least / noise.floor)
    return replace(noise, saturated_floor=least, floor=raised * noise.floor, innovation=raised * noise.innovation)


def update_joints(dataset: Dataset, selection: Selection, joints: Sequence[int], colour: bool = True) -> Noise:
    """Estimate noise and discrepancy of some joints; without `colour` the autoregressive coefficients stay."""
    noise = dataset.noise
    for last in (False, False, True) if colour else (True,):
        whitening = Whitening(dataset.table, noise)
        floor, coefficients = noise.floor.copy(), noise.coefficients.copy()
        innovation, size = noise.innovation.copy(), noise.discrepancy.copy()
        for j in joints:
            here, rest = _of_joint(dataset, selection, whitening, j)
            size[j], used = here.size, here.used / max(len(rest), 1)
            if last:
                floor[j], innovation[j] = np.sqrt(here.variance) * np.array([floor[j], innovation[j]])
            else:
                free = 1 / np.sqrt(max(1 - used, MIN_FREE_SHARE))
                floor[j], coefficients[j], innovation[j] = noise_of_rest(dataset.table, j, rest, float(free))
        noise = replace(noise, floor=floor, coefficients=coefficients, innovation=innovation, discrepancy=size)
    return noise


def _of_joint(dataset: Dataset, selection: Selection, whitening: Whitening, joint: int) -> tuple[NoiseEstimate, Array]:
    """Noise estimate of a joint, and the residual (M,) [N.m or N] of fit and discrepancy."""
    table, data, evidence = dataset.table, selection.data, selection.evidence
    groups = [g for g in (*evidence.refitted(selection.prior_scale), *selection.selected) if joint in data.rows(g)]
    raw = np.concatenate([np.zeros((len(table), 0)), *(data.raw(joint, g) for g in groups)], axis=1)
    shape, y = features(table, joint), table.residual[:, joint]
    white = whitening.local({joint: np.column_stack([raw, shape, y])})[joint]
    k = raw.shape[1]
    precision = evidence.prior_precision(groups, selection.prior_scale)
    here = estimate_discrepancy(white[:, k:-1], white[:, :k], precision, white[:, -1], float(table.scale[joint]))
    return here, y - np.column_stack([raw, shape]) @ here.value


class _Terms(NamedTuple):
    """Contribution of one joint to the normal equations and to the log density."""

    columns: Indices  # (a,) indices of its columns
    gram: Array  # (a, a) [1 per coefficient, squared]
    right: Array  # (a,) [1 per coefficient]
    log: float  # log density of the rows without any fit [-]


@dataclass(frozen=True, eq=False)
class Likelihood(Frozen):
    """Marginal likelihood of the rows beside selected laws, under the present noise model or the most likely one."""

    dataset: Dataset
    selection: Selection
    _cached_terms: dict[Any, _Terms] = field(default_factory=dict, init=False)  # by joint and its noise model

    def penalty(self, group: Group) -> float:
        """Penalty min(0, G(others, m) - G(others)) of one selected law m [-].

        G lets the discrepancy and the noise take over what the law explained.
        """
        if self.dataset.model.misfit is not None:
            return 0.0
        selected = tuple(g for g in self.selection.selected if g is not group)
        joints = self.selection.data.rows(group)
        return float(min(0.0, self._gained(self.selection.selected, joints) - self._gained(selected, joints)))

    def density(self) -> float:
        """Log density of all rows with the selected laws [-]."""
        return self._log(self.selection, self.dataset.noise, ())

    def _gained(self, selected: tuple[Group, ...], joints: Sequence[int]) -> float:
        """G: log likelihood ratio of the most likely noise model beside some laws and the present one [-]."""
        evidence = self.selection.evidence
        some = [replace(self.selection, selected=selected, prior_scale=scale) for scale in evidence.scales.tolist()]
        logs = np.tile([self._log(rest, self.dataset.noise, joints) for rest in some], (2, 1))
        for k in np.flatnonzero(logs[0] > logs[0].max() - NEGLIGIBLE_LOG_DENSITY):
            logs[1, k] = self._log(some[k], self._most_likely(some[k], joints), joints)
        present, changed = logsumexp(logs + evidence.scale_prior, axis=1).tolist()
        return float(max(0.0, changed - present))

    def _most_likely(self, selection: Selection, joints: Sequence[int]) -> Noise:
        """Noise model with the most likely variance and discrepancy of some joints."""
        noise, data = self.dataset.noise, self.selection.data
        known = selection.evidence.cache.setdefault("noise models", {})  # by joint, prior scale, and laws on it
        arrays = {key: getattr(noise, key).copy() for key in ("floor", "innovation", "discrepancy")}
        for j in joints:
            key = j, selection.prior_scale, tuple(g.start for g in selection.selected if j in data.rows(g))
            if key not in known:
                known[key] = update_joints(self.dataset, selection, [j], colour=False)
            for name, array in arrays.items():
                array[j] = getattr(known[key], name)[j]
        return replace(noise, **arrays)

    def _log(self, selection: Selection, noise: Noise, joints: Sequence[int]) -> float:
        """Log density of all rows, with another noise model of some joints [-]."""
        evidence = selection.evidence
        which = evidence.columns(selection.selected, selection.prior_scale)
        gram, right, log = np.zeros((len(which),) * 2), np.zeros(len(which)), 0.0
        whitening = Whitening(self.dataset.table, noise)
        for j in range(self.selection.data.joints):
            own = self._terms(j, whitening if j in joints else self.dataset.whitening)
            place = np.flatnonzero(np.isin(which, own.columns))
            here = np.searchsorted(own.columns, which[place])
            gram[np.ix_(place, place)] += own.gram[np.ix_(here, here)]
            right[place] += own.right[here]
            log += own.log
        precision = evidence.precision(selection.selected, np.diag(gram), selection.prior_scale)
        return log + solve(which, gram, right, precision).log_evidence

    def _terms(self, joint: int, whitening: Whitening) -> _Terms:
        """Contribution of a joint under a noise model, for all columns that may be fitted."""
        noise, data, variance = whitening.noise, self.selection.data, float(self.selection.dispersion[joint])
        key = joint, *(float(x[joint]) for x in (noise.floor, noise.innovation, noise.discrepancy))
        if key not in self._cached_terms:
            every = np.sort(columns_of([*data.refitted, *self.selection.selected]))
            at = data.at[joint, every]
            x, y = data.torque[joint][:, at[at >= 0]], self.dataset.table.residual[:, joint, None]
            white = whitening({joint: np.column_stack([x, y])})[joint] / np.sqrt(variance)
            x, y = white[:, :-1], white[:, -1]
            log = whitening.log_scale(joint) - float(y @ y) / 2
            self._cached_terms[key] = _Terms(every[at >= 0], x.T @ x, x.T @ y, log)
        return self._cached_terms[key]
