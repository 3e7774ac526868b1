"""Evidence -> corrections with which the model explains the torque far better: order, signs, units, lags and factors.

A greedy search finds the best correction after those before it. Lags of recorded torque against the motion, and factors
between recorded and predicted torque (wrong units of all joints, wrong gains of some) are estimated after it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations
from math import isfinite, log
from typing import NamedTuple

import numpy as np

from ..deadline import time_is_up
from ..recording.sampling.survey import RADIANS
from ..regression.projection import least_squares, leave
from ..types import Array, Frozen, Mask, Robot
from .distortions import nats
from .evidence import (
    LAG,
    MIN_AGREED,
    REST_RATIO,
    Correction,
    FaultEvidence,
    Signals,
    agreement,
    covariances,
    fit_products,
    passive_columns,
    unexplained,
    unexplained_by_others,
)
from .result import REFUSE, WARN, RecordingFault, named, percent

TURNS = 'convert it to radians, or write [units] q = "rev", on two lines, into a column map (--columns)'
METRES = 'convert it to metres, or write [units] q = "mm", on two lines, into a column map (--columns)'
CLAIMS = {  # kind -> fault of some joints, correction that was tried, advice
    "torque sign": ("the torque of {} has the wrong sign", "negated", "negate the column"),
    "position sign": ("the position of {} has the wrong sign", "negated", "negate the column"),
    "axis": (
        "{} turns in the opposite direction to the description",
        "with position and torque negated",
        "negate both columns, or reverse the axis in the description",
    ),
    "torque order": ("the torques of {} are exchanged", "put in order", "rename the columns"),
    "position order": ("the positions of {} are exchanged", "put in order", "rename the columns"),
    "joint order": ("positions and torques of {} are exchanged", "put in order", "rename the columns"),
    "degrees": ("the position of {} is in degrees", "in radians", RADIANS),
    "revolutions": ("the position of {} is in revolutions", "in radians", TURNS),
    "millimetres": ("the position of {} is in millimetres", "in metres", METRES),
    "lag": ("the torque of {} is late or early", "shifted", "shift the column"),
}
DIAGNOSABLE = ("torque sign", "torque order", "lag")  # faults that a diagnosis can handle, since it has laws for them
SEARCH = "the search for recording faults"
WELL, CLOSELY = 0.05, 0.01  # [1] unexplained share of a good fit, and of the criterion for ties
# [nats] smallest reduction of the log unexplained variance by a claim; tolerance for rivals
LEAST_GAIN, NEARLY = 0.8, 0.3
LEAST_LEFT = 0.35  # [1] largest unexplained share after a claim on some joint
REST_INCREASE = 0.25  # [1] increase of the unexplained share of any joint from which on a correction is rejected
DEGREE_RANGE = 2 * np.pi  # least range of a position in degrees; smaller ones are radians, or a motion of a few degrees
POSITION_UNITS = {"degrees": np.pi / 180, "revolutions": 2 * np.pi, "millimetres": 1e-3}


class CorrectionTrial(NamedTuple):
    """Candidate correction."""

    kind: str
    joints: tuple[int, ...]
    correction: Correction


@dataclass(frozen=True, eq=False)
class Claim(Frozen):
    """Accepted correction."""

    kind: str
    joints: tuple[int, ...]
    correction: Correction  # including those before it
    before: float  # [1] unexplained share of the variance, mean over the joints whose torque it improves
    after: float  # [1] the same after the correction
    agreement: float  # [1] share of the blocks in which it improves the fit
    rivals: tuple[CorrectionTrial, ...] = ()  # equally good corrections


def search(evidence: FaultEvidence, informative: Mask) -> list[Claim]:
    """Find all claims, each the best one after those before it; informative: (n,) joints with informative torque."""
    claims, done = list[Claim](), Correction.none(len(informative))
    for _ in range(2 * len(informative)):
        if time_is_up(SEARCH, answer=False):
            break
        if (claim := _next(evidence, done, informative)) is None:
            break
        claims, done = [*claims, claim], claim.correction
    return claims


def _next(evidence: FaultEvidence, done: Correction, informative: Mask) -> Claim | None:
    before = _left(evidence, done)
    if nats(before, informative, WELL) - informative.sum() * np.log(WELL) < LEAST_GAIN:
        return None
    evaluated = []  # rank (smaller is better), candidate, unexplained shares
    for trial in _trials(evidence, done, informative[list(done.tau_from)]):
        if time_is_up(SEARCH, answer=False):
            return None
        left = _left(evidence, trial.correction)
        # An exchange improves all informative torques of its joints: an improvement of one may be chance
        own = [k for k in (done.tau_from[j] for j in trial.joints) if informative[k]] if "order" in trial.kind else []
        if np.any((left - before)[evidence.signed] > REST_INCREASE) or any(left[k] > max(before[k], WELL) for k in own):
            continue
        evaluated.append(((nats(left, informative, WELL), nats(left, informative, CLOSELY)), trial, left))
    if not evaluated:
        return None
    evaluated.sort(key=lambda ranked: (round(ranked[0][0], 1), ranked[0][1]))
    rank, best, left = evaluated[0]
    if best.kind == "lag" and np.abs(best.correction.lag - done.lag).max() < LARGE_LAG:
        return None
    betters = np.flatnonzero(informative & (left <= REST_RATIO * before))
    if nats(before, informative, WELL) - rank[0] < LEAST_GAIN or not np.any(left[betters] <= LEAST_LEFT):
        return None
    before_it, after_it = (evidence.corrected(correction) for correction in (done, best.correction))
    joints, moved = ([c.tau_from.index(k) for k in betters.tolist()] for c in (done, best.correction))
    share = agreement(before_it, after_it, evidence.block, joints, moved)
    if share < MIN_AGREED:
        return None
    rivals = (trial for other, trial, _ in evaluated[1:] if np.all(np.subtract(other, rank) < NEARLY))
    shares = float(before[betters].mean()), float(left[betters].mean())
    return Claim(*best, *shares, share, tuple(rivals))


def _left(evidence: FaultEvidence, correction: Correction) -> Array:
    """Unexplained shares (n,) [1] of the torques' variances, in the order of the recording's columns."""
    out = np.empty(len(correction.tau_from))
    out[list(correction.tau_from)] = unexplained(evidence.corrected(correction))
    return out


def _trials(evidence: FaultEvidence, done: Correction, informative: Mask) -> Iterator[CorrectionTrial]:
    from scipy.optimize import linear_sum_assignment  # its import takes longer than all other checks

    n, prismatic = len(informative), evidence.robot.prismatic
    for i in range(n):
        if informative[i]:
            yield CorrectionTrial("torque sign", (i,), done.scale((i,), torque=-1))
        yield CorrectionTrial("position sign", (i,), done.scale((i,), position=-1))
        yield CorrectionTrial("axis", (i,), done.scale((i,), position=-1, torque=-1))
    if n > 1:  # found one by one, they may look like something else
        all_joints = tuple(range(n))
        yield CorrectionTrial("torque sign", all_joints, done.scale(all_joints, torque=-1))
        yield CorrectionTrial("position sign", all_joints, done.scale(all_joints, position=-1))
    cost, both = np.where(np.eye(n), 0.0, 2.0), np.outer(informative, informative)
    cost[both] = unexplained_by_others(evidence.corrected(done)).min(axis=2)[both]
    order = tuple(linear_sum_assignment(cost)[1].tolist())  # torques by the joint that explains them best, of any sign
    moved = tuple(i for i in range(n) if order[i] != i)
    if len(moved) > 2:
        yield CorrectionTrial("torque order", moved, done.exchange(order, torques=True))
    for i, j in combinations(range(n), 2):
        swapped = tuple(j if k == i else i if k == j else k for k in range(n))
        if informative[i] and informative[j]:
            yield CorrectionTrial("torque order", (i, j), done.exchange(swapped, torques=True))
        yield CorrectionTrial("position order", (i, j), done.exchange(swapped, positions=True))
        yield CorrectionTrial("joint order", (i, j), done.exchange(swapped, positions=True, torques=True))
    for unit, scale in POSITION_UNITS.items():
        which = tuple(np.flatnonzero(prismatic == (unit == "millimetres")).tolist())
        for joints in sorted({which, *((j,) for j in which)} - {()}):
            if unit != "degrees" or np.ptp(evidence.q[:, list(joints)], axis=0).max() > DEGREE_RANGE:
                yield CorrectionTrial(unit, joints, done.scale(joints, position=scale))
    lags, left = lag_table(evidence, done)
    for joints in sorted({tuple(range(n)), *((j,) for j in np.flatnonzero(informative).tolist())}):
        informative_left = left[:, [j for j in joints if informative[j]]]
        best = int(np.argmin(np.log(np.maximum(informative_left, CLOSELY)).sum(axis=1)))
        if lags[best]:
            yield CorrectionTrial("lag", joints, done.earlier(joints, float(lags[best])))


def claim_faults(claims: Sequence[Claim], joints: Sequence[str], blocks: int) -> Iterator[RecordingFault]:
    """One finding per kind of sign or unit, and one per exchange; lags have their own findings."""
    groups: dict[tuple[str, int], list[Claim]] = {}
    for k, claim in enumerate(claims):
        if claim.kind != "lag":
            groups.setdefault((claim.kind, k if "order" in claim.kind else -1), []).append(claim)
    for (kind, _), group in groups.items():
        about = tuple(joints[j] for j in sorted({j for claim in group for j in claim.joints}))
        rivals = [] if len(group) > 1 else [(r.kind, tuple(joints[j] for j in r.joints)) for r in group[0].rivals]
        before, after = (float(np.mean([getattr(c, key) for c in group])) for key in ("before", "after"))
        sure = min(claim.agreement for claim in group)
        fault, how, advice = CLAIMS[kind]
        gain = f"model and friction explain {percent(1 - after)} of the torque instead of {percent(1 - before)}"
        better = f"better in {round(sure * blocks)} of {blocks} blocks of the recordings"
        others = [CLAIMS[rival][0].format(named(who)) for rival, who in rivals if rival != "lag"][:3]
        likely = f" (equally likely: {'; '.join(others)})" if others else ""
        sentence = f"{fault.format(named(about))}: {how}, {gain} ({better}); {advice}{likely}"
        mild = kind in DIAGNOSABLE or any(rival in DIAGNOSABLE for rival, _ in rivals)
        measures = {"explained_before": 1 - before, "explained_after": 1 - after, "agreement": sure}
        yield RecordingFault(kind, about, WARN if mild else REFUSE, measures, sentence, tuple(rivals))


UNITS = {1e3: "mN.m", 1e-3: "kN.m", 10.197: "kgf.cm", 141.61: "ozf.in", 8.851: "lbf.in"}  # per N.m
UNIT_DISTANCE = log(1.35)  # [nats] largest distance of a factor from that of a unit
MEANINGLESS = 5.0  # [1] factor of units from which on a diagnosis is meaningless
STEPS = 25  # candidates on either side of zero
LAG_CHANGE, LARGE_LAG = 0.25, 0.08  # [1] change of the torque over its rms, and [s], from which on a lag is large
# A lag is significant if the unexplained share falls to HALVES of that without, by at least GAINS, to at most LAG_REST
HALVES, GAINS, LAG_REST = 0.5, 0.02, 0.15  # [1]
TOGETHER, FLOOR = 1.5, 0.01  # [1] unexplained share of a common lag, over and above that of the joint's own best lag
TINY = 1e-3  # [1] unexplained share below which lags count as equally good
EDGE = 0.9  # [1] largest lag over the longest candidate; beyond it there is no minimum

# [1] largest unexplained share of a good fit; smallest unexplained share without the prediction, over that with it, and
# absolute
FITS, RIGID, MIN_RIGID_REST = 0.15, 3.0, 0.03
PRECISE = 0.1  # [1] largest standard error of a factor's logarithm
# [1] smallest predicted torque over the strongest, and smallest speed over the fastest, that friction cannot explain
GAIN_TORQUE, MOVES = 0.03, 0.05
ALL, LONE = 1.9, 3.0  # [1] factor of several joints, and of a single one, from which on the model is not the cause
BEYOND = 5.0  # [1] factor from which on no change of a single body is the cause
MAX_FACTOR_RATIO = 1.5  # [1] ratio to the median up to which factors count as equal
ROTOR = 300.0  # [1] largest factor without gravity: geared rotors can dominate the links
ONE = 1.65  # [1] ratio of one joint's factor to the median, from which on it is an error
RIVAL = 0.6  # [1] largest residual with factors, over that with the best change of one body


class Lags(NamedTuple):
    """Lags of the joints."""

    own: Array  # (n,) [s], NaN for a joint that is not informative
    common: float  # [s] of all informative joints, NaN if they differ or there is none
    share: Array  # (n,) [1] change of the torque by the lag over its rms; 0 if the lag is not significant
    large: Mask  # (n,) whether it is more than a mild delay


class Gains(NamedTuple):
    """Factors of the torques, and those that are faults."""

    factor: Array  # (n,) [1] recorded over predicted torque; NaN if it is not identifiable
    spread: Array  # (n,) [1] standard error of its logarithm
    common: float  # [1] factor of all joints; 1 if the model may be the cause
    lone: tuple[int, ...]  # joints with a wrong gain of their own


def lag_table(evidence: FaultEvidence, done: Correction) -> tuple[Array, Array]:
    """Candidate lags (L,) [s], and unexplained shares (L, n) [1] of the torques with each of them."""
    lags, x = np.asarray(LAG / STEPS * np.arange(-STEPS, STEPS + 1)), evidence.corrected(done)
    columns, middle = passive_columns(x), evidence.plain.torque.mean(axis=0)
    right, (power, total) = np.zeros((*columns.shape[::2], len(lags))), np.zeros((2, len(columns), len(lags)))
    ends = np.cumsum([len(t) for t in evidence.moments])[:-1]
    for curve, t, own in zip(evidence.torques, evidence.moments, np.split(columns, ends, axis=1), strict=True):
        for j, k in enumerate(done.tau_from):
            near, weights = curve.near(t, done.lag[k] + lags, k)
            near -= middle[k]
            right[j] += done.tau_sign[j] * (own[j].T @ near) @ weights.T
            power[j] += np.sum(weights @ (near.T @ near) * weights, axis=1)
            total[j] += weights @ near.sum(axis=0)
    power = np.maximum(power - total**2 / columns.shape[1], 0.0) * done.tau_sign[:, None] ** 2
    return lags, fit_products(columns.swapaxes(1, 2) @ columns, right, power)[1].T


def judge_lags(evidence: FaultEvidence, done: Correction, informative: Mask) -> Lags:
    """Estimate the remaining lags of the corrected torques; informative: (n,) joints with informative torque."""
    lags, left = lag_table(evidence, done)
    best = np.array([_minimum(lags, column) for column in left.T])
    zero, least = left[len(lags) // 2], left.min(axis=0)
    inside = informative & (np.abs(best) < EDGE * LAG) & (least <= zero)
    saves = inside & (least <= np.minimum(HALVES * zero, LAG_REST)) & (zero - least >= GAINS)
    lag = np.where(inside, best, np.nan)
    known = left[:, informative]
    common = _minimum(lags, np.log(np.maximum(known, TINY)).sum(axis=1)) if informative.any() else EDGE * LAG
    at = np.array([np.interp(common, lags, column) for column in left.T])
    alike = at[informative] <= TOGETHER * least[informative] + FLOOR
    together = bool(np.all(alike)) and abs(common) < EDGE * LAG
    places, late = list(done.tau_from), np.zeros_like(best)
    late[places] = best
    changed = _rms(evidence.late(done.lag + late * saves.any()) - evidence.late(done.lag))[places]
    size = np.maximum(_rms(evidence.corrected(done).torque), 1e-300)
    share = np.where(saves, changed / size, 0.0)
    if together and 2 * saves.sum() >= max(1, informative.sum()):
        # One clock: the change of all torques together counts, since a joint without gravity changes much alone
        much = np.linalg.norm(changed[saves]) / np.linalg.norm(size[saves]) >= LAG_CHANGE or abs(common) >= LARGE_LAG
        return Lags(lag, common, share, saves & much)
    return Lags(lag, common if together else np.nan, share, saves & (share >= LAG_CHANGE) & (np.abs(best) >= LARGE_LAG))


def _rms(x: Array) -> Array:
    return np.asarray(np.sqrt(np.mean(x**2, axis=0)))


def _minimum(x: Array, y: Array) -> float:
    """Minimum of a curve, by the parabola through its lowest point and the neighbours."""
    k = int(np.argmin(y))
    if k in (0, len(x) - 1):
        return float(x[k])
    left, middle, right = y[k - 1 : k + 2]
    bend = left - 2 * middle + right
    return float(x[k] + (x[1] - x[0]) * (0.5 * (left - right) / bend if bend > 0 else 0.0))


def judge_gains(evidence: FaultEvidence, done: Correction) -> Gains:
    """Estimate factors of the corrected torques."""
    x, n = evidence.corrected(done), len(done.lag)
    factor, spread = np.full(n, np.nan), np.full(n, np.nan)
    strongest, speed = _rms(x.predicted).max(initial=0.0), _rms(x.v)
    usable = evidence.signed & (np.std(x.predicted, axis=0) >= GAIN_TORQUE * strongest) & (speed >= MOVES * speed.max())
    moments = covariances((x.predicted, x.v, x.direction, x.a, x.torque), evidence.block)  # jackknife over blocks
    for j in np.flatnonzero(usable).tolist():
        gain, *gains = _gains(moments[:, j], not evidence.rotors[j]).tolist()
        if gain:
            spread[j] = np.sqrt((len(gains) - 1) * np.mean((np.array(gains) - gain) ** 2)) / gain
            factor[j] = gain if spread[j] <= PRECISE else np.nan
    known = np.isfinite(factor)
    if not known.any():  # gravity does not show them: that of the strongest joint, without a rotor
        size = np.where(evidence.signed, np.std(x.predicted, axis=0), 0.0)
        joint = int(np.argmax(size))
        gain = float(_gains(moments[:1, joint], rotor=False)[0]) if size[joint] else 0.0
        return Gains(factor, spread, gain if gain and not 1 / LONE < gain < ROTOR else 1.0, ())
    middle, least = float(np.median(factor[known])), ALL if known.sum() > 1 else LONE
    motion = evidence.along(done)

    def beaten(factor: float, factors: Array) -> bool:
        """Whether factors (n,) explain far more than one common factor with a change of any one body."""
        scaled = x._replace(predicted=x.predicted * factor)
        rival = min(_residual(scaled, known, motion.body_columns(body)) for body in range(n))
        return _residual(x._replace(predicted=x.predicted * factors), known) <= RIVAL * rival

    alike = np.mean(np.abs(np.log(factor[known] / middle)) <= np.log(MAX_FACTOR_RATIO)) > 0.5
    off = abs(np.log(middle))
    common = alike and (off >= np.log(BEYOND) or (off >= np.log(least) and beaten(1.0, np.full(n, middle))))
    apart = known & (np.abs(np.log(np.where(known, factor, 1.0) / middle)) >= np.log(ONE))
    lone = apart.any() and known.sum() > 1 and apart.sum() <= known.sum() / 2
    factors = np.where(apart, factor, middle)
    chosen = np.flatnonzero(apart).tolist() if lone and beaten(middle, factors) else []
    return Gains(factor, spread, middle if common else 1.0, tuple(chosen))


def _gains(moments: Array, rotor: bool) -> Array:
    """Gains (S,) [1] of one joint's torque in subsets of the rows, the first of all; zeros where these do not show it.

    The fit must be good, and far better than without the predicted torque. moments: (S, 5, 5) covariances of predicted
    torque, velocity, direction, acceleration and torque.
    """
    used = (slice(k, 3 + rotor) for k in (0, 1))
    fits = [fit_products(moments[:, at, at], moments[:, at, 4:], moments[:, 4, 4:]) for at in used]
    (value, left), (_, without) = fits
    good = left[0, 0] <= FITS and without[0, 0] >= max(MIN_RIGID_REST, RIGID * left[0, 0])
    return np.asarray(value[:, 0, 0] * good)


def _residual(x: Signals, known: Mask, shared: Array | None = None) -> float:
    """Sum of unexplained shares [1] with prediction, friction and a change of one body, columns (K, n, 10)."""
    rows = []
    for j in np.flatnonzero(known):
        friction = np.stack([x.v[:, j], x.direction[:, j], x.a[:, j], np.ones(len(x.v))], axis=1)
        rest = (x.torque[:, j] - x.predicted[:, j])[:, None]
        free = rest if shared is None else np.column_stack([shared[:, j], rest])
        rows.append(leave(free, friction) / np.std(x.torque[:, j]))
    columns, y = np.split(np.concatenate(rows), [-1], axis=1)
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    fitted = scaled @ least_squares(scaled, y, 1e-6) if scaled.shape[1] else 0.0
    return float(np.sum((y - fitted) ** 2)) / len(x.v)


def lag_faults(lags: Lags, done: Correction, joints: Sequence[str]) -> Iterator[RecordingFault]:
    """One finding for a lag of all joints, else one per joint."""
    before = done.lag[list(done.tau_from)]
    odd = np.flatnonzero((before != 0) | lags.large).tolist()
    one_clock = len(set(before.tolist())) == 1 and (before[0] != 0 or isfinite(lags.common)) and len(joints) > 1
    rest = np.where(lags.share > 0, np.nan_to_num(lags.own), 0.0)
    for group in [odd] if odd and one_clock else [[j] for j in odd]:
        lag = float(before[group[0]] + (lags.common if isfinite(lags.common) else np.median(rest[group])))
        about = tuple(joints) if one_clock else (joints[group[0]],)
        who, side = "all joints" if one_clock else about[0], "late" if lag > 0 else "early"
        fact = f"the torque of {who} is recorded {1e3 * abs(lag):.0f} ms {side} against the motion"
        advice = "record both with one clock, or shift the columns by that time"
        measures = {"lag": lag, "share": float(lags.share[group].max())}
        yield RecordingFault("lag", about, WARN, measures, f"{fact}; {advice}")


def factor_faults(gains: Gains, robot: Robot) -> Iterator[RecordingFault]:
    """Findings on the unit of all torques, and on gains of single joints."""
    middle = gains.common
    if middle != 1.0:
        unit = next((name for factor, name in UNITS.items() if abs(log(middle / factor)) < UNIT_DISTANCE), "")
        constant = robot.actuators.torque_constant
        fits = np.abs(np.log(np.where(constant > 0, constant, np.nan) * gains.factor))
        guess = "their unit or the description's masses are wrong"
        if unit:
            guess = f"they seem to be in {unit}"
        elif np.isfinite(fits).any() and np.nanmedian(fits) < UNIT_DISTANCE:
            guess = "they are currents, according to the torque constants"
        elif middle < 1:
            guess = "they may be currents [A], or torques before the gear"
        fact = f"all torques are {middle:.3g} times the predicted ones: {guess}"
        advice = "convert them to N.m (N), name currents current_J with a torque_constant, or correct the masses"
        severity = REFUSE if abs(log(middle)) > log(MEANINGLESS) else WARN
        yield RecordingFault("units", (), severity, {"factor": middle}, f"{fact}; {advice}")
    known = gains.factor[np.isfinite(gains.factor)]
    for j in gains.lone:
        ratio = float(gains.factor[j] / np.median(known))
        fact = f"the torque of {robot.joints[j]} is {ratio:.3g} times the one that the other joints suggest"
        sure = f"± {percent(2 * gains.spread[j])}; no other mass of a link explains it"
        advice = "check its unit, its torque constant and its gear ratio"
        yield RecordingFault("gain", (robot.joints[j],), WARN, {"factor": ratio}, f"{fact} ({sure}); {advice}")
