"""Joint maximum a posteriori fit of nuisance parameters and selected hypotheses under their Gaussian priors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cached_property, wraps
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import numpy as np

from ...regression.projection import leave
from ...types import Array, Frozen, Indices
from ..data.dataset import Fitted, Whitened, columns_of, join, mean_products, solve
from ..data.rows import Group
from ..thresholds import FLAT_PRECISION, SELECTED_SIZE
from .prior import CoefficientPrior, StatedPrior, coefficient_prior

MIN_PRIOR_SCALE = 1e-9  # [1] lower bound of the prior scale k, so that its inverse exists

Arguments = ParamSpec("Arguments")
Value = TypeVar("Value")
Method = Callable[Concatenate[Any, Arguments], Value]


class Component(NamedTuple):
    """Connected joints, and the groups that act on them and on no others; different components fit independently."""

    joints: tuple[int, ...]
    refitted: tuple[Group, ...]  # nuisance terms
    selected: tuple[Group, ...]  # selected hypotheses

    @property
    def groups(self) -> tuple[Group, ...]:
        """All fitted groups."""
        return (*self.refitted, *self.selected)


def cached(entries: float, appendable: bool = True) -> Callable[[Method[Arguments, Value]], Method[Arguments, Value]]:
    """Keep the results of a method for its last arguments; unlike with functools.lru_cache, these may be arrays.

    Appendable results depend on some columns only, and stay valid when the rows get more columns.
    """

    def decorate(method: Method[Arguments, Value]) -> Method[Arguments, Value]:
        @wraps(method)
        def call(self: Any, /, *args: Arguments.args, **kwargs: Arguments.kwargs) -> Value:
            results = (self.cache if appendable else self.own_cache).setdefault(method.__name__, {})
            values = (tuple(x) if isinstance(x, list) else x for x in (*args, *kwargs.values()))
            key = tuple(x.tobytes() if isinstance(x, np.ndarray) else x for x in values)
            value: Value = results.pop(key) if key in results else method(self, *args, **kwargs)
            results[key] = value  # the most recent one is the last
            if len(results) > entries:
                del results[next(iter(results))]
            return value

        return call

    return decorate


@dataclass(frozen=True, eq=False)
class LinearModel(Frozen):
    """Normal equations of whitened rows with priors; products are computed once for each selected hypothesis."""

    data: Whitened
    stated_prior: StatedPrior | None = None  # None: the simulation has no covariance
    bare: bool = False  # whether the description states nothing but bodies, whose errors may be large
    cache: dict[str, dict[Any, Any]] = field(default_factory=dict, repr=False)  # of methods, by arguments
    own_cache: dict[str, dict[Any, Any]] = field(default_factory=dict, repr=False, init=False)  # not appendable

    @cached_property
    def coefficient_priors(self) -> dict[Group, CoefficientPrior | None]:
        """Coefficient prior of every hypothesis; None if its columns are zero."""
        claims = [group for group in self.data.groups if group.hypothesis is not None]
        for group in (group for group in claims if group not in self.data.priors):
            torque = {j: self.data.raw(j, group) for j in self.data.rows(group)}
            self.data.priors[group] = coefficient_prior(group.claim, mean_products(torque, self.data.scale))
        return {group: self.data.priors[group] for group in claims}

    @cached(32)
    def fit(self, selected: Sequence[Group], dispersion: Array, prior_scale: float) -> Fitted:
        """Fit nuisance parameters, of prior scale k, and selected hypotheses together; dispersion (n,) [1]."""
        components = self.components(selected, prior_scale > 0)
        fits = [self.part(one, dispersion[list(one.joints)], prior_scale) for one in components]
        return join(self.columns(selected, prior_scale), fits)

    @cached(64)
    def components(self, selected: Sequence[Group], prior_scale: float) -> tuple[Component, ...]:
        """Connected components; of the prior scale it only counts whether it is above zero.

        Two joints are in one component if a group acts on both, or if the stated prior couples groups on both. Groups
        keep their order. For a few dozen groups this takes a fifth of the time of
        scipy.sparse.csgraph.connected_components, or less.
        """
        refitted = self.refitted(prior_scale)
        priors = [self.data.gains.columns, *([] if self.stated_prior is None else [self.stated_prior.columns])]
        coupled = [[group for group in refitted if group.start in columns] for columns in priors]
        # a group that acts on no joint is fitted with the first
        rows = {group: self.data.rows(group) or [0] for group in (*refitted, *selected)}
        label = list(range(self.data.joints))
        for joints in (*rows.values(), *([j for group in some for j in rows[group]] for some in coupled)):
            first, *others = sorted({label[j] for j in joints}) or [0]
            if others:
                label = [first if one in others else one for one in label]

        def within(groups: Sequence[Group], one: int) -> tuple[Group, ...]:
            return tuple(group for group in groups if label[rows[group][0]] == one)

        joints_of = {one: tuple(j for j, other in enumerate(label) if other == one) for one in sorted(set(label))}
        return tuple(Component(own, within(refitted, one), within(selected, one)) for one, own in joints_of.items())

    @cached(64)
    def part(self, component: Component, dispersion: Array, prior_scale: float) -> Fitted:
        """Fit of one connected component of m joints; dispersion (m,) [1]."""
        which = columns_of(component.groups)
        gram = np.tensordot(1 / dispersion, self._squares(component), axes=1)
        right = (self.data.right[list(component.joints)][:, which] / dispersion[:, None]).sum(0)
        return solve(which, gram, right, self._precision(component.groups, np.diag(gram), prior_scale))

    @cached(4, appendable=False)
    def across(self, component: Component, dispersion: Array) -> Array:
        """(k, p) large: products of a component's fitted columns with all its columns; dispersion (m,) [1]."""
        which, (columns, place) = columns_of(component.groups), self.data.columns_at(component.joints)
        out = np.zeros((len(which), len(columns)))
        for joint, at, variance in zip(component.joints, place, dispersion.tolist(), strict=True):
            products = [self._products(joint, groups) for groups in (component.refitted, component.selected)]
            out[np.ix_(self.data.at[joint, which] >= 0, at)] += np.concatenate(products) / variance
        return out

    def columns(self, selected: Sequence[Group], prior_scale: float) -> Indices:
        """(k,) indices of the fitted columns."""
        return columns_of([*self.refitted(prior_scale), *selected])

    def refitted(self, prior_scale: float) -> list[Group]:
        """Nuisance terms; inertial parameters only if the prior scale is above zero."""
        return [group for group in self.data.refitted if prior_scale > 0 or not group.bodies]

    def precision(self, selected: Sequence[Group], diagonal: Array, prior_scale: float) -> Array:
        """(k, k) prior precision L of fitted coefficients; diagonal (k,) of the Gram [1 per coefficient, squared]."""
        return self._precision([*self.refitted(prior_scale), *selected], diagonal, prior_scale)

    def _precision(self, groups: Sequence[Group], diagonal: Array, prior_scale: float) -> Array:
        out = self.prior_precision(groups, prior_scale)
        flat = np.flatnonzero([np.isinf(x) for group in groups for x in group.deviation])
        out[flat, flat] += FLAT_PRECISION * np.maximum(diagonal[flat], 1e-12)
        return out

    def prior_precision(self, groups: Sequence[Group], prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] prior precision of nuisance terms and hypotheses; 0 for a flat prior."""
        stated = [group for group in groups if group.hypothesis is None]
        first = self._stated_precision(stated, prior_scale)
        out, at = np.zeros((sum(g.size for g in groups),) * 2), len(first)
        out[:at, :at] = first
        for group in groups[len(stated) :]:
            place = slice(at, at + group.size)
            out[place, place] = self._own_precision(group)
            at += group.size
        return out

    @cached(32)
    def _stated_precision(self, groups: list[Group], prior_scale: float) -> Array:
        """(k, k) [1 per coefficient, squared] prior precision of nuisance terms."""
        deviation = np.array([x * (prior_scale if group.bodies else 1.0) for group in groups for x in group.deviation])
        out = np.diag(np.where(np.isinf(deviation), 0.0, np.maximum(deviation, 1e-150) ** -2.0))
        which, gains = columns_of(groups), self.data.gains
        if len(here := gains.among(which)):
            there = np.searchsorted(gains.columns, which[here])
            out[np.ix_(here, here)] = np.linalg.inv(gains.beside_bodies[np.ix_(there, there)])
        if self.stated_prior is not None:
            here = np.flatnonzero(np.isin(which, self.stated_prior.columns))
            there = np.searchsorted(self.stated_prior.columns, which[here])
            information = self.stated_prior.information[np.ix_(there, there)]
            out[np.ix_(here, here)] += information / max(prior_scale, MIN_PRIOR_SCALE) ** 2
        return out

    @cached(np.inf)
    def _own_precision(self, group: Group) -> Array:
        """(d, d) [1 per coefficient, squared] prior precision of a selected hypothesis."""
        prior = self.coefficient_priors[group]
        assert prior is not None, "a hypothesis with zero columns is never selected"
        covariance = SELECTED_SIZE**2 * prior.covariance_factor @ prior.covariance_factor.T
        scale = np.sqrt(np.maximum(np.diag(covariance), 1e-200))
        inverse = np.linalg.inv(covariance / scale / scale[:, None] + 1e-9 * np.eye(group.size))
        return np.asarray(inverse / scale / scale[:, None])

    @cached(np.inf)
    def imitated(self, group: Group) -> float:
        """Share of a hypothesis's squared torque that the nuisance terms can explain [1]."""
        data, left, whole = self.data, 0.0, 0.0
        for j in data.rows(group):
            x = data.part(j, group)
            x = x[:, :1] if group.size == 1 else x @ np.ones((group.size, 1))
            rest = leave(x, data.chosen(j, columns_of(data.refitted))[1])
            left, whole = left + float(np.sum(rest**2)), whole + float(np.sum(x**2))
        return 1 - left / whole if whole > 0 else 0.0

    @cached(8)
    def _squares(self, component: Component) -> Array:
        return self.data.squares(component.joints, columns_of(component.groups))

    @cached(np.inf, appendable=False)
    def _products(self, joint: int, groups: tuple[Group, ...]) -> Array:
        """(a, m) products of the columns of groups on a joint, which has a of them, with all its columns."""
        return self.data.chosen(joint, columns_of(groups))[1].T @ self.data.columns[joint]
