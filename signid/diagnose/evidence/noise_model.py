"""Estimate the noise model beside selected laws: coloured noise and model discrepancy of each joint."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...types import Array
from ..data.dataset import Dataset
from ..data.discrepancy import NoiseEstimate, estimate_discrepancy, features
from ..data.noise import Noise, measure_noise, noise_of_rest
from ..data.whitening import Whitening
from .linear_model import LinearModel
from .selection import Selection
from .thresholds import MIN_FLOOR, RELEVANT_DROP

MIN_FREE = 0.1  # [1] lower bound of the free rows of a fit, as a share of all rows. Heuristic


def update_noise(dataset: Dataset, linear: LinearModel, selection: Selection) -> Noise:
    """Estimate noise and discrepancy of each joint beside the selected laws.

    The size of the discrepancy by maximum marginal likelihood and the autoregressive model from the residual of fit and
    discrepancy are estimated in turn. If a floor falls far below the saturated floor, a law had been counted as noise:
    the saturated floor is then measured again without the selected laws.

    Args:
        dataset: rows before whitening.
        linear: whitened rows and their fits.
        selection: selected laws.
    """
    noise = update_joints(dataset, linear, selection, range(dataset.table.joints))
    if not np.any(noise.floor < RELEVANT_DROP * noise.saturated_floor):
        return noise
    data, table, band = linear.data, dataset.table, dataset.task.band
    fit = linear.fit(selection.selected, selection.dispersion, selection.prior_scale)
    named = [sum(data.raw(j, g) @ fit.value[fit.place(g)] for g in selection.selected) for j in range(data.joints)]
    rest = replace(table, residual=table.residual - np.column_stack([x + np.zeros(len(table)) for x in named]))
    first = measure_noise(rest, dataset.periods, band.rate / band.factor)
    least = np.minimum(noise.saturated_floor, first.floor)
    raised = np.maximum(1.0, MIN_FLOOR * least / noise.floor)
    return replace(noise, saturated_floor=least, floor=raised * noise.floor, innovation=raised * noise.innovation)


def update_joints(
    dataset: Dataset, linear: LinearModel, selection: Selection, joints: Sequence[int], colour: bool = True
) -> Noise:
    """Estimate noise and discrepancy of some joints.

    Args:
        dataset: rows before whitening.
        linear: whitened rows and their fits.
        selection: selected laws.
        joints: indices of the joints.
        colour: whether the autoregressive models are estimated as well; else only variances and discrepancies.
    """
    noise = dataset.noise
    for last in (False, False, True) if colour else (True,):
        whitening = Whitening(dataset.table, noise)
        floor, coefficients = noise.floor.copy(), noise.coefficients.copy()
        innovation, size = noise.innovation.copy(), noise.discrepancy.copy()
        for j in joints:
            here, rest = _of_joint(dataset, linear, selection, whitening, j)
            size[j], used = here.size, here.used / max(len(rest), 1)
            if last:
                floor[j], innovation[j] = np.sqrt(here.variance) * np.array([floor[j], innovation[j]])
            else:
                free = 1 / np.sqrt(max(1 - used, MIN_FREE))
                floor[j], coefficients[j], innovation[j] = noise_of_rest(dataset.table, j, rest, float(free))
        noise = replace(noise, floor=floor, coefficients=coefficients, innovation=innovation, discrepancy=size)
    return noise


def _of_joint(
    dataset: Dataset, linear: LinearModel, selection: Selection, whitening: Whitening, joint: int
) -> tuple[NoiseEstimate, Array]:
    """Noise estimate of a joint, and the residual (M,) [N.m or N] of fit and discrepancy."""
    table, data = dataset.table, linear.data
    groups = [g for g in (*linear.refitted(selection.prior_scale), *selection.selected) if joint in data.rows(g)]
    raw = np.concatenate([np.zeros((len(table), 0)), *(data.raw(joint, g) for g in groups)], axis=1)
    shape, y = features(table, joint), table.residual[:, joint]
    white = whitening.local({joint: np.column_stack([raw, shape, y])})[joint]
    k = raw.shape[1]
    precision = linear.prior_precision(groups, selection.prior_scale)
    here = estimate_discrepancy(white[:, k:-1], white[:, :k], precision, white[:, -1], float(table.scale[joint]))
    return here, y - np.column_stack([raw, shape])[:, : len(here.value)] @ here.value
