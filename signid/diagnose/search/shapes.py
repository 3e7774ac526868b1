"""Shapes beyond the grids of the search: optimised numbers of selected laws, and the time window of a contact."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...deadline import show_step, time_is_up
from ...effects import EFFECTS
from ...effects.base import RecordingLaw
from ...optimisers import OPTIMISERS, Optimum, Problem
from ...types import Array, Effect, Indices, Law
from .. import thresholds as tuned
from ..data.dataset import Dataset, Fitted, Whitened, append
from ..data.hypotheses import Hypothesis, Key
from ..data.noise import has_full_window
from ..data.rows import Group
from ..evidence.selection import Posterior, Selection
from .contributions import measure_contributions
from .stepwise import LAW_SEARCH, inflated_dispersion

SHAPE_ALGORITHM = "LN_BOBYQA"  # Powell 2009: no derivatives, box constraints
BOUND_STEP = 0.99  # step from which on a size counts as at the bound of its box, over the box [1]
WINDOW_ENDS = ("start", "end")  # shapes that are added to, not multiplied
MAX_END_SHIFT = 6  # samples by which each end of a window is moved at last
CONTACT_EFFECT = "external_contact"
END_SHIFTS = np.arange(-5, 6)  # shifts of the ends of the best window in one refinement [rows]
WINDOW_REFINEMENTS = 3  # refinements of the best window
MIN_WINDOW_ROWS = 4  # shortest window [rows]: more than the three components of a force


class _Option(NamedTuple):
    """A hypothesis that may stand in the place of a selected one, and the columns to begin with."""

    hypothesis: Hypothesis
    group: Group


class _Others(NamedTuple):
    """All other selected laws."""

    selection: Selection
    fit: Fitted
    dispersion: Array  # (n,) variance of the whitened residual [1]


def optimise_shapes(
    dataset: Dataset, selection: Selection, joints: Collection[int] | None = None, each: int = tuned.SHAPE_EVALUATIONS
) -> Selection:
    """Optimise the shape of each selected law; recording laws are taken at finite size, not linearised about zero.

    Only of laws that act on one of some `joints`, unless these are None; by `each` evaluations per number.
    """
    for group in selection.selected:
        if joints is not None and set(joints).isdisjoint(selection.data.rows(group)):
            continue
        options = _options(selection.posterior, group, {other.claim.key for other in selection.selected})
        if not options or time_is_up(LAW_SEARCH):
            continue
        show_step(f"fitting numbers of {group.claim.kind}", 0.7)
        rest = selection.without(group)
        dispersion = inflated_dispersion(rest)
        fit = selection.evidence.fit(rest.selected, dispersion, selection.prior_scale)
        others = _Others(rest, fit, dispersion)
        tried = [_optimise(dataset, option, others, each) for option in options if _has_plausible_size(option, others)]
        if tried:
            ranked = sorted(tried, key=lambda one: -one[0])
            selection = _replaced(dataset, selection, group, [hypothesis for _, hypothesis in ranked])
    return selection


def _replaced(dataset: Dataset, selection: Selection, group: Group, tried: list[Hypothesis]) -> Selection:
    """Replace a selected law by the best of some; the others become hypotheses at their size too, for comparison."""
    data, new = append(dataset, selection.data, tried[0])
    for rival in tried[1:]:
        data, _ = append(dataset, data, rival)
    selected = tuple(new if g is group else g for g in selection.selected)
    log = {(new if g is group else g): x for g, x in selection.log_odds.items()}
    selection.evidence.own_cache.clear()  # large, and rarely asked for again
    posterior = replace(selection.posterior, evidence=replace(selection.evidence, data=data))
    return replace(selection, posterior=posterior, selected=selected, log_odds=log)


def _options(posterior: Posterior, group: Group, taken: Collection[Key]) -> list[_Option]:
    """Hypotheses to optimise in the place of a selected one: itself, and twins among the recording laws."""
    hypothesis = group.claim
    if len(hypothesis.laws) != 1:
        return []
    law = hypothesis.laws[0]
    groups = posterior.evidence.data.groups
    twins = [
        _Option(_at_size(EFFECTS[name], law.joints), groups[posterior.keys[name, law.joints][0]])
        for name in law.effect.twins
        if _is_linearised(EFFECTS[name]) and (name, law.joints) in posterior.keys and (name, law.joints) not in taken
    ]
    if _is_linearised(law.effect):
        return [_Option(_at_size(law.effect, law.joints), group), *twins]
    if isinstance(law.effect, RecordingLaw) or not (twins or law.effect.shape(law.parameters)):
        return []
    return [_Option(hypothesis, group), *twins]


def _at_size(effect: Effect, joints: tuple[int, ...]) -> Hypothesis:
    """A recording law at finite size; its size is not yet known."""
    return Hypothesis((Law(effect, joints, dict.fromkeys(effect.linear(), 0.0)),), finite=True)


def _is_linearised(effect: Effect) -> bool:
    """Whether an effect is a recording law of one number, whose columns are linearised about zero."""
    return isinstance(effect, RecordingLaw) and len(effect.linear()) == 1


def _optimise(dataset: Dataset, option: _Option, others: _Others, each: int) -> tuple[float, Hypothesis]:
    """Maximise the log odds [-] of a law over its shapes, or over the size of a recording law."""
    known, start, posterior = option.hypothesis, _start(option, others), others.selection.posterior
    law, keys = known.laws[0], list(start)

    def hypothesis(x: Array) -> Hypothesis:
        numbers = {  # steps in -1 to 1 move ends of windows by addition, all else by a factor
            key: start[key] + tuned.WINDOW_REACH * step if key in WINDOW_ENDS else start[key] * tuned.SHAPE_FACTOR**step
            for key, step in zip(keys, x.tolist(), strict=True)
        }
        return replace(known, laws=(Law(law.effect, law.joints, {**law.parameters, **numbers}),))

    def cost(x: Array) -> float:
        tried = hypothesis(x).laws[0]
        if not any(
            tried.effect.possible(p.motion.at(tried.joints), **tried.effect.shape(tried.parameters))
            for p in dataset.pieces
        ):
            return 0.0
        columns = dataset.columns(hypothesis(x))
        white = dataset.whitening(columns)
        return -(posterior.candidate_log_odds(others.fit, others.dispersion, known, columns, white) or 0.0)

    zero = np.zeros(len(keys))
    if not keys:
        return -cost(zero), known
    best = _minimised(cost, zero, each * len(zero), tuned.SIZE_ROUNDS if known.finite else 0)
    if known.stated is not None and (stated_cost := cost(zero)) - best.value < tuned.SHAPE_CHANGE_LOG_ODDS:
        return -stated_cost, known
    ends = [k for k, key in enumerate(keys) if key in WINDOW_ENDS]
    value, x = _stepped(cost, best.value, best.x, ends, dataset.pieces[0].motion.dt / tuned.WINDOW_REACH)
    return -value, hypothesis(x)


def _minimised(cost: Callable[[Array], float], start: Array, budget: int, further: int) -> Optimum:
    """Minimise in a box of half-width 1 about the start; `further` times again about an optimum at its upper bound."""
    while True:
        problem = Problem(cost, start - 1, start + 1, start, search=LAW_SEARCH, tolerance=tuned.LOG_ODDS_TOLERANCE)
        best = OPTIMISERS["nlopt"].minimise(problem, algorithm=SHAPE_ALGORITHM, budget_evaluations=budget)
        if further == 0 or np.all(best.x - start < BOUND_STEP) or time_is_up(LAW_SEARCH):
            return best
        start, further = best.x, further - 1


def _stepped(
    cost: Callable[[Array], float], value: float, x: Array, ends: list[int], step: float
) -> tuple[float, Array]:
    """Move ends of windows sample by sample while the cost falls, since it is constant between samples."""
    for k in ends:
        for way in (step, -step):
            for _ in range(MAX_END_SHIFT):
                moved = x + way * (np.arange(len(x)) == k)
                if (moved_cost := cost(moved)) >= value:
                    break
                value, x = moved_cost, moved
    return value, x


def _has_plausible_size(option: _Option, others: _Others) -> bool:
    """Whether the size that a linearised recording law suggests is plausible; True for all other laws."""
    known = option.hypothesis
    if not known.finite:
        return True
    kinds, start = known.laws[0].effect.linear(), _start(option, others)
    return all(
        0 < abs(x) < tuned.RECORDING_LIMITS.get(kinds[key].unit, np.inf) and not (kinds[key].positive and x < 0)
        for key, x in start.items()
    )


def _start(option: _Option, others: _Others) -> dict[str, float]:
    """Numbers to begin with: the shape on its grid, or the coefficient of the linearised recording law."""
    known, group = option
    law = known.laws[0]
    if not known.finite:
        return dict(law.effect.shape(law.parameters))
    rest = others.selection
    contributions = measure_contributions(rest.evidence, (*rest.selected, group), others.dispersion, rest.prior_scale)
    (key,) = law.effect.linear()
    return {key: float(contributions.coefficients[group][0])}


class _Window(NamedTuple):
    """Rows from start to stop of a piece."""

    log_bayes: float  # log Bayes factor of a force in the window [-]
    start: int
    stop: int


def find_contact(dataset: Dataset, data: Whitened, residual: Array, dispersion: Array) -> Hypothesis | None:
    """Contact in the window of highest evidence over all recordings; None if no window has a Bayes factor above 1.

    Cumulative sums of the normal equations make each window cost the same. The residual (n, M) [1] is whitened and has
    the variance dispersion (n,) [1].
    """
    full = [dataset.thin(p.motion.jacobian.reshape(len(p.motion), -1)) for p in dataset.pieces]
    jacobian = np.concatenate(full).reshape(-1, 3, data.joints)  # of the last link [m/rad or 1]
    white = dataset.whitening.local({j: jacobian[:, :, j] for j in range(data.joints)})
    shape = np.stack([white[j] / np.sqrt(dispersion[j]) for j in range(data.joints)])  # (n, M, 3)
    rest = residual / np.sqrt(dispersion)[:, None]
    variance = tuned.CONTACT_TORQUE**2 / 3 / max(float(np.mean(np.sum(jacobian**2 / data.scale**2, axis=2))), 1e-300)
    order = dataset.noise.coefficients.shape[1]
    alive = np.flatnonzero(has_full_window(dataset.table.piece, order)) + order
    rate, best = dataset.task.band.rate / dataset.task.band.factor, _Window(0.0, 0, 0)
    for k in np.unique(dataset.table.piece[alive]):
        own = np.flatnonzero(dataset.table.piece[alive] == k)
        x, y = shape[:, own], rest[:, own]
        square = np.concatenate([np.zeros((1, 3, 3)), np.cumsum(np.einsum("jti,jtk->tik", x, x), axis=0)])
        right = np.concatenate([np.zeros((1, 3)), np.cumsum(np.einsum("jti,jt->ti", x, y), axis=0)])
        window = _best(square, right, variance, rate)
        if window.log_bayes > best.log_bayes:
            first, last = alive[own[window.start]], alive[own[window.stop - 1]]
            best = _Window(window.log_bayes, int(first), int(last))
    if best.log_bayes <= 0:
        return None
    span = {"start": float(dataset.table.t[best.start]), "end": float(dataset.table.t[best.stop])}
    return Hypothesis((Law(EFFECTS[CONTACT_EFFECT], tuple(range(data.joints)), span),))


def _best(square: Array, right: Array, variance: float, rate: float) -> _Window:
    """Search the windows of one piece by cumulative sums: a grid first, then shifts of both ends of the best."""
    count, best = len(square) - 1, _Window(0.0, 0, 0)
    for width in tuned.CONTACT_WIDTHS:
        length = int(width * rate)
        start = np.arange(0, count - length, max(1, int(tuned.CONTACT_STEP * rate)))
        best = _better(best, square, right, variance, start, start + length)
    for _ in range(WINDOW_REFINEMENTS if best.stop else 0):
        low, high = (grid.ravel() for grid in np.meshgrid(best.start + END_SHIFTS, best.stop + END_SHIFTS))
        fits = (low >= 0) & (low + MIN_WINDOW_ROWS <= high) & (high <= count)
        best = _better(best, square, right, variance, low[fits], high[fits])
    return best


def _better(best: _Window, square: Array, right: Array, variance: float, start: Indices, stop: Indices) -> _Window:
    """Best of some windows and the one before, by the log Bayes factor of a force with a Gaussian prior."""
    if not len(start):
        return best
    a, b = np.eye(3) + variance * (square[stop] - square[start]), right[stop] - right[start]
    gain = variance * np.einsum("ki,ki->k", b, np.linalg.solve(a, b[..., None])[..., 0]) / 2
    gain = gain - np.linalg.slogdet(a)[1] / 2
    k = int(np.argmax(gain))
    return _Window(float(gain[k]), int(start[k]), int(stop[k])) if gain[k] > best.log_bayes else best
