"""Filtered, decimated rows of motions: the residual of each joint, and the columns of all hypotheses.

Groups of columns are nuisance parameters (X a of the README) and hypotheses (S b).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from ...deadline import need_time, show_step
from ...effects.law import law_columns
from ...model import Model
from ...regression.bandwidth import Decimator
from ...regression.motion import Motion
from ...regression.projection import least_squares
from ...regression.rows import Task
from ...types import Array, Frozen, Indices, Law, Mask
from .. import thresholds as tuned
from .estimated_gains import EstimatedGain
from .hypotheses import Hypothesis, finite, is_refitted
from .motions import Piece, reversal_uncertainty, row_filter, standstill, stated_friction

STAMP_DECIMALS = 6  # decimals of times [s] that are differences of large time stamps
BLOCK_GROUPS = 32  # groups of columns that are filtered at once: limits memory
MIN_CENTRED_MASS = 1e-6  # [kg] a body below this mass has no centre of mass. Heuristic
DRY_STRIDE = 8  # every 8th sample is used for the rough estimate of dry friction. Heuristic
LAYOUT_SAMPLES = 64  # samples of the motion from which columns are counted


@dataclass(frozen=True, eq=False)
class RowTable(Frozen):
    """M rows of n joints, one piece after another."""

    groups: tuple[Group, ...]
    count: int  # p, number of columns
    piece: Indices  # (M,) piece of each row
    recording: Indices  # (M,) recording of each row
    t: Array  # (M,) [s]
    q: Array  # (M, n) [rad or m]
    v: Array  # (M, n) [rad/s or m/s]
    a: Array  # (M, n) [rad/s2 or m/s2]
    torque: Array  # (M, n) [N.m or N] recorded torque
    predicted: Array  # (M, n) [N.m or N] torque that the simulation predicts
    residual: Array  # (M, n) [N.m or N] y: recorded - predicted
    at_rest: Mask  # (M, n) whether a joint is at rest within the reach of the filter: static friction is undetermined
    reversal_std: Array  # (M, n) [N.m or N] standard deviation of torque near velocity reversals
    place: tuple[Indices, ...]  # per joint (m_j,) indices of its columns
    columns: tuple[Array, ...]  # per joint (M, m_j) [torque per coefficient]
    origins: tuple[float, ...] = ()  # per piece [s] time stamp from which reports count; empty: 0
    priors: dict[Group, Any] = field(default_factory=dict, init=False)  # coefficient priors: of columns without noise

    def __len__(self) -> int:
        return len(self.t)

    @property
    def joints(self) -> int:
        """Number of joints n."""
        return int(self.residual.shape[1])

    @property
    def scale(self) -> Array:
        """(n,) [N.m or N] rms torque of each joint, with a lower bound relative to the largest."""
        rms = np.sqrt(np.mean(self.torque**2, axis=0))
        return np.asarray(np.maximum(np.maximum(rms, tuned.MIN_TORQUE * rms.max()), 1e-300))

    def since_origin(self) -> Array:
        """(M,) [s] times, from the start of each recording whose time stamps begin far from 0."""
        if not any(self.origins):
            return self.t.copy()
        return np.asarray(np.round(self.t - np.array(self.origins)[self.piece], STAMP_DECIMALS))

    def variable(self, joint: int, name: str) -> Array:
        """(M,) [rad, rad/s, rad/s2, N.m or s; m and N for prismatic joints] variable that torque may depend on."""
        if name == "time":
            return self.t
        signals = {"position": self.q, "velocity": self.v, "acceleration": self.a, "torque": self.predicted}
        return np.asarray(signals[name][:, joint])


def build_table(task: Task, model: Model, groups: Sequence[Group], pieces: Sequence[Piece], dry: Array) -> RowTable:
    """Compute all rows: columns at the rate of the pieces, then the same low-pass filter as the torque.

    The cut-off is twice that of the band; dry friction is `dry` (n,) [N.m or N].
    """
    thin = row_filter(task)
    place, columns = columns_along(task, model, groups, pieces, dry)
    lengths = [len(thin.at(piece.motion.t)) for piece in pieces]

    def inner(signals: Sequence[Array]) -> Array:
        return np.concatenate([thin.at(x) for x in signals])

    rests = inner([standstill(piece.motion, thin, tuned.HOLD_TIME) for piece in pieces]) > 0
    sampled: dict[str, Any] = {name: inner([getattr(p.motion, name) for p in pieces]) for name in ("t", "q", "v", "a")}
    signals = [np.column_stack([p.residual, p.residual + np.asarray(p.motion.predicted)]) for p in pieces]
    residual, torque = np.split(np.concatenate([thin(np.nan_to_num(x)) for x in signals]), 2, axis=1)
    return RowTable(
        groups=tuple(groups),
        count=groups[-1].start + groups[-1].size,
        piece=np.repeat(np.arange(len(pieces)), lengths),
        recording=np.repeat([p.recording for p in pieces], lengths),
        **sampled,
        reversal_std=reversal_uncertainty(thin, pieces, dry),
        at_rest=rests
        & ~_pushed(rests, np.abs(torque) - np.abs(torque - residual), _holding_torque(residual, rests, dry)),
        torque=torque,
        predicted=torque - residual,
        residual=residual,
        place=place,
        columns=columns,
        origins=tuple(piece.origin for piece in pieces),
    )


def _holding_torque(residual: Array, rests: Mask, dry: Array) -> Array:
    """(n,) [N.m or N] largest torque that dry friction may hold at rest; infinite for joints that hardly move.

    Static friction exceeds that of motion by a factor: what the simulation states of it, `dry` (n,), and what it leaves
    in motion, residual (M, n), bound it. A command beyond both and the load is another matter, such as saturation.
    """
    moving = np.where(rests, np.nan, np.abs(residual))
    enough = np.sum(~rests, axis=0) > tuned.MIN_MOVING_ROWS
    largest = np.array([np.nanmax(x) if yes else np.inf for x, yes in zip(moving.T, enough, strict=True)])
    return np.asarray(tuned.STATIC_OVER_DRY * (dry + largest))


def _pushed(rests: Mask, excess: Array, held: Array) -> Mask:
    """(M, n) rests in which the torque exceeds the load, by `excess` (M, n), by more than friction may hold, (n,)."""
    run = np.cumsum(np.diff(rests, axis=0, prepend=False), axis=0)
    beyond = rests & (excess > held)
    return np.column_stack([np.isin(r, r[b]) for r, b in zip(run.T, beyond.T, strict=True)])


def columns_along(
    task: Task, model: Model, groups: Sequence[Group], pieces: Sequence[Piece], dry: Array
) -> tuple[tuple[Indices, ...], tuple[Array, ...]]:
    """Indices of the columns of each joint, and their rows of all pieces; dry friction `dry` (n,) [N.m or N]."""
    thin = row_filter(task)
    made = [_thinned(model, groups, piece, thin, dry) for piece in pieces]
    columns = [np.concatenate([rows[j][1] for rows in made]) for j in range(len(made[0]))]
    return tuple(index for index, _ in made[0]), tuple(columns)


def columns_anew(task: Task, model: Model, table: RowTable, pieces: Sequence[Piece], dry: Array) -> RowTable:
    """The table along pieces of other bodies and predicted torque; dry friction `dry` (n,) [N.m or N].

    Columns of laws that need neither stay as they are.
    """
    absent: Any = None
    bare = replace(pieces[0].motion[:LAYOUT_SAMPLES], robot=absent, predicted=absent)
    kept = set[Group]()
    for group in (group for group in table.groups if group.hypothesis is not None):
        with suppress(AssertionError, AttributeError, TypeError):  # raised where it needs what is absent
            kept |= {group} if group.claim.columns(bare) else set()
    groups = [group for group in table.groups if group not in kept]
    place, made = columns_along(task, model, groups, pieces, dry)
    columns = tuple(x.copy() for x in table.columns)
    for x, own, at, new in zip(columns, table.place, place, made, strict=True):
        x[:, np.searchsorted(own, at)] = new
    out = replace(table, columns=columns)
    out.priors.update({group: table.priors[group] for group in kept & table.priors.keys()})
    return out


def _thinned(
    model: Model, groups: Sequence[Group], piece: Piece, thin: Decimator, dry: Array
) -> list[tuple[Indices, Array]]:
    """For each joint, the indices of its columns and their rows."""
    piece = piece._replace(motion=replace(piece.motion))  # the large arrays that a motion caches are freed afterwards
    joints = range(len(model.robot.joints))
    place, rows, waiting = ([list[Any]() for _ in joints] for _ in range(3))
    for group, made in zip(groups, _columns(model, groups, piece, dry), strict=True):
        for j, x in made.items():
            place[j].extend(range(group.start, group.start + group.size))
            waiting[j].append(x)
            if len(waiting[j]) == BLOCK_GROUPS:
                rows[j].append(thin(np.concatenate(waiting[j], axis=1)))
                waiting[j].clear()
    for j in joints:
        rows[j] += [thin(np.concatenate(waiting[j], axis=1))] if waiting[j] else []
    return [(np.array(p, dtype=np.intp), np.concatenate(r, axis=1)) for p, r in zip(place, rows, strict=True)]


def _columns(model: Model, groups: Sequence[Group], piece: Piece, dry: Array) -> Iterator[dict[int, Array]]:
    yield from ({j: finite(x) for j, x in found.columns.items()} for found in nuisances(model, piece.motion, dry))
    for group in (group for group in groups if group.hypothesis is not None):
        need_time("the search for laws")
        show_step(f"columns of {group.claim.kind}", group.start / max(groups[-1].start, 1))
        yield group.claim.columns(piece.motion)


@dataclass(frozen=True, eq=False)
class Group:
    """`size` consecutive columns from `start` on: a nuisance term or a hypothesis."""

    start: int
    size: int
    hypothesis: Hypothesis | None = None  # None: a nuisance term, which is always fitted
    bodies: bool = False  # inertial parameters of a body: fitted only if the prior scale k is above zero
    law: Law | None = None  # law of the simulation whose coefficients are refitted
    deviation: tuple[float, ...] = ()  # (size,) prior standard deviations [unit of each coefficient]; inf: flat prior

    @property
    def claim(self) -> Hypothesis:
        """The hypothesis of these columns; nuisance terms have none."""
        assert self.hypothesis is not None, "a nuisance term is no hypothesis"
        return self.hypothesis


class Nuisance(NamedTuple):
    """One nuisance term, fitted beside every hypothesis."""

    columns: dict[int, Array]  # per joint (N, k) [torque per coefficient]
    deviation: list[float]  # (k,) prior standard deviations [unit of each coefficient]
    law: Law | None = None  # law of the simulation
    bodies: bool = False


def nuisances(model: Model, motion: Motion, dry: Array, free: Sequence[Law] = ()) -> Iterator[Nuisance]:
    """Nuisance terms X a in the order of their columns, each with its prior; dry friction `dry` (n,) [N.m or N].

    Laws that are `free` have flat priors, as have those of an identified model, whose covariance counts.

    They are coefficients of stated laws, shapes of dry friction near velocity reversals, and all inertial parameters.
    """
    stated = stated_friction(model)
    for law in model.laws:
        if is_refitted(law):
            rows, columns = law_columns(law, motion)
            own = law_tolerance(law, float(stated[law.joints[0]]))
            flat = (model.covariance or law in free) and not isinstance(law.effect, EstimatedGain)
            spread = [np.inf] * columns.shape[2] if flat else own
            yield Nuisance({j: columns[:, k] for k, j in enumerate(rows)}, spread, law)
    for j in np.flatnonzero(dry > 0).tolist():
        yield Nuisance({j: _reversal_columns(motion, j)}, [tuned.REVERSAL_STD * float(dry[j])] * 3)
    for body, spread in enumerate(tolerance(model).tolist()):
        moving = np.flatnonzero(motion.moved[:, body]).tolist()
        yield Nuisance({j: motion.bodies[:, j, body] for j in moving}, spread, bodies=True)


def law_tolerance(law: Law, dry: float) -> list[float]:
    """(k,) prior standard deviations of the coefficients of a stated law [unit of each]; `dry`: friction [N.m or N]."""
    if isinstance(law.effect, EstimatedGain):
        return [float(np.sqrt(law.effect.covariance[law.joints[0]]))]
    share = tuned.FRICTION_STD if law.effect.dissipative or law.effect.name == "torque_offset" else tuned.LAW_STD
    least = tuned.OFFSET_STD * dry if law.effect.name == "torque_offset" else 0.0
    return [max(share * abs(x), least, 1e-9) for x in law.effect.coefficients(law.parameters)]


def tolerance(model: Model) -> Array:
    """(nb, 10) prior standard deviations of stated inertial parameters [kg, kg.m, kg.m2]."""
    out = []
    for inertia in list(model.bodies().inertias)[1:]:
        mass = max(abs(inertia.mass), tuned.MIN_MASS)
        about, lever = np.diag(inertia.inertia), np.abs(inertia.lever)
        if abs(inertia.mass) < MIN_CENTRED_MASS:  # no centre of mass
            about, lever = inertia.toDynamicParameters()[[4, 6, 9]], np.abs(inertia.mass * inertia.lever) / mass
        moment = max(
            tuned.INERTIA_STD * float(np.max(np.abs(about) + mass * (lever @ lever))), mass * tuned.CENTRE_STD**2
        )
        half = moment / 2
        first = np.hypot(tuned.MASS_STD * mass * lever, tuned.CENTRE_STD * mass)
        out.append([tuned.MASS_STD * mass, *first, moment, half, moment, half, half, moment])
    return np.array(out)


def _reversal_columns(motion: Motion, joint: int) -> Array:
    """(N, 3) change of the friction direction if it turns more steeply, more softly or earlier than presumed [1]."""
    assert motion.slow is not None, "a diagnosed motion has the width of a reversal"
    v, slow, presumed = motion.v[:, joint], motion.slow[joint], motion.direction[:, joint]
    ahead = max(1, round(tuned.REVERSAL_LEAD / motion.dt))
    early = np.append(presumed[ahead:], np.full(ahead, presumed[-1]))
    return np.column_stack(
        [*(np.clip(v / (w * slow), -1, 1) - presumed for w in tuned.REVERSAL_WIDTHS), early - presumed]
    )


def dry_friction(model: Model, pieces: Sequence[Piece]) -> Array:
    """(n,) dry friction of each joint [N.m or N]: stated, plus a rough estimate from the residual."""
    return np.asarray(stated_friction(model) + np.maximum(rough_drives(pieces)[:, 0], 0.0))


def rough_drives(pieces: Sequence[Piece]) -> Array:
    """(n, 3) rough estimates of dry friction [N.m or N], viscous friction and offset of each joint in the residual."""
    few = [(piece.motion[::DRY_STRIDE], piece.residual[::DRY_STRIDE]) for piece in pieces]
    out = np.zeros((few[0][1].shape[1], 3))
    for j, drive in enumerate(out):
        tables = list[Array]()
        for motion, y in few:
            bodies = [motion.bodies[:, j, body] for body in np.flatnonzero(motion.moved[j])]
            columns = [motion.direction[:, j], motion.v[:, j], np.ones(len(motion)), *bodies]
            tables.append(np.column_stack([*columns, y[:, j]]))
        x = np.concatenate(tables)
        x = x[np.isfinite(x).all(axis=1)]
        if len(x):
            drive[:] = least_squares(x[:, :-1], x[:, -1], 1e-6)[:3]
    return out


def build_groups(
    model: Model, motion: Motion, hypotheses: Sequence[Hypothesis], dry: Array, free: Sequence[Law] = ()
) -> list[Group]:
    """Groups of all columns: nuisance terms first, then the hypotheses; dry friction `dry` (n,) [N.m or N]."""
    out, at = list[Group](), 0
    for found in nuisances(model, motion[:LAYOUT_SAMPLES], dry, free):
        size = len(found.deviation)
        out.append(Group(at, size, None, found.bodies, found.law, tuple(found.deviation)))
        at += size
    for hypothesis in hypotheses:
        out.append(Group(at, hypothesis.size, hypothesis))
        at += hypothesis.size
    return out
