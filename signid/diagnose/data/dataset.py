"""Recordings, simulation and rows of a diagnosis; whitened rows, the products of their columns, and fits of these."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.linalg.lapack import dtrtrs

from ...errors import RecordingError
from ...model import Model
from ...regression.bandwidth import Decimator
from ...regression.projection import SINGULAR_VALUE_TOLERANCE, least_squares
from ...regression.rows import Task
from ...types import Array, Frozen, Indices, Law, Mask
from .estimated_gains import GainPrior, gain_prior
from .hypotheses import Hypothesis
from .motions import Piece, row_filter, torque_of
from .noise import Noise, Whitening, has_full_window, moving
from .rows import Group, RowTable

PRECISION_RIDGES = (1e-11, 1e-9, 1e-7, 1e-5)  # [1] added to a unit diagonal: the first that lets the matrix be factored


@dataclass(frozen=True, eq=False)
class Dataset(Frozen):
    """Recordings, the simulation, and the rows computed from them."""

    task: Task
    model: Model
    pieces: tuple[Piece, ...]
    periods: tuple[float | None, ...]  # [s] period of the motion in each recording, None where it does not repeat
    table: RowTable
    noise: Noise

    @cached_property
    def thin(self) -> Decimator:
        """Low-pass filter and decimation of columns and torque."""
        return row_filter(self.task)

    def thinned(self, columns: Sequence[Mapping[int, Array]]) -> dict[int, Array]:
        """Filter and decimate columns of each piece, per joint (N, k): per joint (M, k) [torque per coefficient]."""
        rows = np.concatenate([self.thin(np.concatenate(list(made.values()), axis=1)) for made in columns])
        ends = np.cumsum([x.shape[1] for x in columns[0].values()])
        return dict(zip(columns[0], np.split(rows, ends[:-1], axis=1), strict=True))

    def columns(self, hypothesis: Hypothesis) -> dict[int, Array]:
        """Rows of a hypothesis: per joint (M, k) [torque per coefficient]."""
        return self.thinned([hypothesis.columns(piece.motion) for piece in self.pieces])

    def torque(self, law: Law) -> dict[int, Array]:
        """Rows of the torque of a law with all its parameters: per joint (M,) [N.m or N]."""
        made = [{j: x[:, None] for j, x in torque_of(law, piece.motion).items()} for piece in self.pieces]
        return {j: x[:, 0] for j, x in self.thinned(made).items()}

    def remaining(self, data: Whitened, fit: Fitted) -> Array:
        """(M, n) [N.m or N] residual y - X a - S b of a fit."""
        rest = self.table.residual.copy()
        for j in range(data.joints):
            at = data.at[j, fit.which]
            rest[:, j] -= data.torque[j][:, at[at >= 0]] @ fit.value[at >= 0]
        return rest

    @cached_property
    def whitening(self) -> Whitening:
        """Whitening of rows against their noise and discrepancy."""
        return Whitening(self.table, self.noise)


def append(dataset: Dataset, data: Whitened, hypothesis: Hypothesis) -> tuple[Whitened, Group]:
    """Append the columns of one hypothesis to the whitened rows."""
    size, columns = hypothesis.size, dataset.columns(hypothesis)
    group, white = Group(data.count, size, hypothesis), dataset.whitening(columns)
    place, torque, made = list(data.place), list(data.torque), list(data.columns)
    for j, x in columns.items():
        place[j] = np.append(place[j], range(group.start, group.start + size)).astype(np.intp)
        torque[j], made[j] = np.column_stack([torque[j], x]), np.column_stack([made[j], white[j]])
    own: dict[str, Any] = {"place": tuple(place), "torque": tuple(torque), "columns": tuple(made)}
    return replace(data, groups=(*data.groups, group), count=data.count + size, **own), group


@dataclass(frozen=True, eq=False)
class Whitened(Frozen):
    """M whitened rows of n joints; each joint has some of the p columns."""

    groups: tuple[Group, ...]
    count: int  # p, number of columns
    place: tuple[Indices, ...]  # per joint (m_j,) indices of its columns
    columns: tuple[Array, ...]  # per joint (M, m_j) [1 per coefficient]
    residual: Array  # (n, M) [1] y
    moves: Mask  # (M, n) rows that count: the joint is not at rest
    recording: Indices  # (M,) recording of each row
    torque: tuple[Array, ...]  # per joint (N, m_j) [torque per coefficient] columns before whitening
    scale: Array  # (n,) [N.m or N] rms torque
    floor: Array  # (n,) [N.m or N] rms of the noise
    priors: dict[Group, Any] = field(default_factory=dict)  # coefficient priors, the same for any noise

    def __len__(self) -> int:
        return int(self.residual.shape[1])

    @cached_property
    def counts(self) -> Array:
        """(n,) [1] number of rows of each joint that count."""
        return np.asarray(np.maximum(self.moves.sum(axis=0), 1), dtype=np.float64)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return len(self.place)

    @cached_property
    def refitted(self) -> tuple[Group, ...]:
        """Groups of the nuisance terms."""
        return tuple(group for group in self.groups if group.hypothesis is None)

    @cached_property
    def gains(self) -> GainPrior:
        """Prior of the gains whose torque constants were estimated."""
        return gain_prior((group.start, group.law) for group in self.refitted)

    @cached_property
    def right(self) -> Array:
        """(n, p) [1 per coefficient] products of columns and residual, joint by joint."""
        out = np.zeros((self.joints, self.count))
        for j in range(self.joints):
            out[j, self.place[j]] = self.columns[j].T @ self.residual[j]
        return out

    def squares(self, joints: Sequence[int], which: Indices) -> Array:
        """(m, k, k) [1 per coefficient, squared] products of columns `which` (k,) [1] on each of m joints."""
        out = np.zeros((len(joints), len(which), len(which)))
        for own, joint in zip(out, joints, strict=True):
            here, x = self.chosen(joint, which)
            own[np.ix_(here, here)] = x.T @ x
        return out

    def products(self, which: Indices, dispersion: Array, columns: Mapping[int, Array]) -> tuple[Array, Array, Array]:
        """Products of new columns with each other (d, d), the residual (d,), and columns `which` (k,) [1]: (k, d).

        New columns are whitened, per joint (M, d) [1 per coefficient]; dispersion (n,) [1] is that of the residual.
        """
        d = next(iter(columns.values())).shape[1]
        own, right, across = np.zeros((d, d)), np.zeros(d), np.zeros((len(which), d))
        for j, x in columns.items():
            here, beside = self.chosen(j, which)
            own += x.T @ x / dispersion[j]
            right += x.T @ self.residual[j] / dispersion[j]
            across[here] += beside.T @ x / dispersion[j]
        return own, right, across

    def chosen(self, joint: int, which: Indices) -> tuple[Mask, Array]:
        """Mask (k,) of those columns `which` (k,) [1] that a joint has, and these (M, a) [1 per coefficient]."""
        at = self.at[joint, which]
        return at >= 0, self.columns[joint][:, at[at >= 0]]

    @cached_property
    def at(self) -> Indices:
        """(n, p) position of each column among those of each joint; -1 if the joint does not have it."""
        out = np.full((self.joints, self.count), -1)
        for own, place in zip(out, self.place, strict=True):
            own[place] = range(len(place))
        return out

    def columns_at(self, joints: Sequence[int]) -> tuple[Indices, list[Indices]]:
        """Indices (p,) of the columns that some joints have, and the positions (m,) of each joint's own among them."""
        columns = np.flatnonzero((self.at[list(joints)] >= 0).any(axis=0))
        return columns, [np.searchsorted(columns, self.place[j]) for j in joints]

    def part(self, joint: int, group: Group) -> Array:
        """(M, size) [1 per coefficient] whitened columns of a group on one joint; zero if the joint has none."""
        return self._part(self.columns[joint], joint, group)

    def free(self, joint: int, columns: Array) -> Array:
        """Projection of columns (M, k) [1 per coefficient] onto the complement of the joint's own nuisance columns."""
        return np.asarray(columns - self._nuisance_basis[joint] @ (self._nuisance_basis[joint].T @ columns))

    @cached_property
    def _nuisance_basis(self) -> list[Array]:
        """Per joint, (M, a) [1] orthonormal basis of nuisance columns of this joint alone, without bodies."""
        out = list[Array]()
        for j in range(self.joints):
            x = self.chosen(j, columns_of([g for g in self.refitted if not g.bodies and self.rows(g) == [j]]))[1]
            size = np.linalg.norm(x, axis=0)
            left, singular, _ = np.linalg.svd(x[:, size > 0] / size[size > 0], full_matrices=False)
            out.append(left[:, singular > SINGULAR_VALUE_TOLERANCE * singular.max(initial=0.0)])
        return out

    def rows(self, group: Group) -> list[int]:
        """Joints on which a group acts."""
        return (self.at[:, group.start] >= 0).nonzero()[0].tolist()

    def raw(self, joint: int, group: Group) -> Array:
        """(M', size) [torque per coefficient] columns of a group on one joint before whitening; zero if it has none."""
        return self._part(self.torque[joint], joint, group)

    def _part(self, columns: Array, joint: int, group: Group) -> Array:
        at = int(self.at[joint, group.start])
        return columns[:, at : at + group.size] if at >= 0 else np.zeros((len(columns), group.size))


def mean_products(columns: Mapping[int, Array], scale: Array) -> Array:
    """(d, d) mean products of columns (M, d) [torque per coefficient] over scale (n,) [N.m or N], over all joints."""
    return np.asarray(sum(x.T @ x / len(x) / scale[j] ** 2 for j, x in columns.items()))


def whitened(table: RowTable, noise: Noise) -> Whitened:
    """Whiten the residual and all columns against noise and discrepancy."""
    n, order = table.joints, noise.coefficients.shape[1]
    moves, whitening = moving(table, order), Whitening(table, noise)
    return Whitened(
        groups=table.groups,
        count=table.count,
        place=table.place,
        columns=tuple(whitening(dict(enumerate(table.columns))).values()),
        residual=np.array([whitening({j: table.residual[:, j, None]})[j][:, 0] for j in range(n)]),
        moves=moves,
        recording=table.recording[order:][has_full_window(table.piece, order)],
        torque=table.columns,
        scale=table.scale,
        floor=noise.floor,
        priors=table.priors,
    )


def columns_of(groups: Sequence[Group]) -> Indices:
    """Indices of the columns of groups, in order."""
    return np.concatenate([np.arange(0), *(np.arange(group.start, group.start + group.size) for group in groups)])


class Factor(NamedTuple):
    """Cholesky factor of a block of coefficients that is not coupled with the others."""

    place: Indices  # (f,) positions of the block among the k fitted coefficients
    lower: Array  # (f, f) [1] Cholesky factor of Gram plus prior precision, scaled to a unit diagonal
    size: Array  # (f,) [1 per coefficient] square root of the diagonal before scaling

    def forward(self, rows: Array) -> Array:
        """(f, m) [1 per coefficient] forward substitution lower^-1 rows; rows (f, m) [1 per coefficient, squared]."""
        return np.asarray(dtrtrs(self.lower.T, rows / self.size[:, None], trans=1)[0] if len(rows) else rows)

    def backward(self, below: Array) -> Array:
        """(f, m) [unit of each coefficient] back substitution lower^-T below; below (f, m) [1]."""
        return np.asarray(dtrtrs(self.lower.T, below)[0] / self.size[:, None] if len(below) else below)


class Fitted(NamedTuple):
    """Fit of nuisance parameters and selected laws at one prior scale k."""

    which: Indices  # (k,) fitted columns
    factors: tuple[Factor, ...]
    forward_right: Array  # (k,) [1] lower^-1 right-hand side
    log_evidence: float  # log marginal likelihood against no fit at all [-]
    gains: GainPrior | None = None  # gains that the covariance contains with the uncertainty of their prior

    @property
    def value(self) -> Array:
        """(k,) [unit of each coefficient] maximum a posteriori."""
        return self.backward(self.forward_right[:, None])[:, 0]

    def place(self, group: Group) -> slice:
        """Slice of the coefficients of a fitted group."""
        at = int(np.flatnonzero(self.which == group.start)[0])
        return slice(at, at + group.size)

    @property
    def covariance(self) -> Array:
        """(k, k) [units of the coefficients, squared] posterior covariance."""
        out = np.zeros((len(self.which),) * 2)
        for block in self.factors:
            inverse = block.forward(np.eye(len(block.place)))
            out[np.ix_(block.place, block.place)] = inverse.T @ inverse
        return out if self.gains is None else self.gains.widened(out, self.gains.among(self.which))

    def restricted(self, free: Mask) -> Fitted:
        """Fit again with all coefficients zero except those that are free (k,)."""
        value, before = np.zeros(len(self.which)), self.value
        for block in self.factors:
            inside = free[block.place]
            factor = block.size[:, None] * block.lower
            square = factor[inside] @ factor.T
            right = square @ before[block.place]
            value[block.place[inside]] = least_squares(square[:, inside], right)
        return self.with_value(value)

    def with_value(self, value: Array) -> Fitted:
        """The same fit with coefficients of another value (k,) [unit of each coefficient]."""
        forward_right = np.zeros(len(self.which))
        for block in self.factors:
            forward_right[block.place] = block.lower.T @ (block.size * value[block.place])
        return self._replace(forward_right=forward_right)

    def forward(self, rows: Array) -> Array:
        """(k, m) [1 per coefficient] forward substitution lower^-1 rows; rows (k, m) [1 per coefficient, squared]."""
        return self._blockwise(Factor.forward, rows)

    def backward(self, below: Array) -> Array:
        """(k, m) [unit of each coefficient] back substitution lower^-T below; below (k, m) [1]."""
        return self._blockwise(Factor.backward, below)

    def _blockwise(self, substitute: Callable[[Factor, Array], Array], x: Array) -> Array:
        out = np.zeros(x.shape)
        for block in self.factors:
            out[block.place] = substitute(block, x[block.place])
        return out


def solve(which: Indices, gram: Array, right: Array, precision: Array) -> Fitted:
    """Maximum a posteriori coefficients of the columns `which` (k,) [1], and log marginal likelihood of the rows.

    gram (k, k) [1 per coefficient, squared] is F'F, precision (k, k) [same] L, and right (k,) [1 per coefficient] F'y.
    """
    whole = gram + precision
    size = np.asarray(np.sqrt(np.diag(whole)))
    lower = _cholesky(whole / size / size[:, None])
    factor = Factor(np.arange(len(which)), lower, size)
    forward_right = factor.forward(right[:, None])[:, 0]
    half = np.linalg.slogdet(precision)[1] / 2 - float(np.sum(np.log(np.diag(lower)) + np.log(size)))
    return Fitted(which, (factor,), forward_right, float(forward_right @ forward_right) / 2 + half)


def join(which: Indices, fits: Sequence[Fitted]) -> Fitted:
    """Join fits of uncoupled blocks, disjoint sets of the columns `which` (k,) [1]."""
    order, forward_right, factors = np.argsort(which), np.zeros(len(which)), list[Factor]()
    for fit in fits:
        place = order[np.searchsorted(which, fit.which, sorter=order)]
        forward_right[place] = fit.forward_right
        factors += [block._replace(place=place[block.place]) for block in fit.factors]
    return Fitted(which, tuple(factors), forward_right, sum(fit.log_evidence for fit in fits))


def _cholesky(scaled: Array) -> Array:
    """Cholesky factor of a matrix with a unit diagonal that may be slightly indefinite by rounding."""
    for ridge in PRECISION_RIDGES:
        with suppress(np.linalg.LinAlgError):
            return np.asarray(np.linalg.cholesky(scaled + ridge * np.eye(len(scaled))))
    raise RecordingError(
        "the normal equations of the selected laws are singular, so nothing can be estimated; check the units"
    )
