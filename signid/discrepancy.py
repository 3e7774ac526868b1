"""What no law of the model says, as a random function of the state, and what it does to base parameters.

torque of joint j = columns @ base parameters + noise + d_j(state) + delay * slope of the torque,
d_j = the sum of zero-mean Gaussian processes over speed, load, position, speed and load, position and speed.

Noise forgets in a moment; a discrepancy comes back when the robot comes back to the same state. The variance of each
process is what residuals at like states, apart in time, have in common beyond what noise would make them have.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from .row_sample import RowSample
from .types import Array, BaseMap, Indices, Mask

PROCESSES = ("v", "l", "q", "vl", "qv")  # of speed, load and position, of whose like states
LENGTH = 0.3  # over which a process changes, in standard deviations of the state
APART, LAGS = 0.6, 6.0  # [s] and rows: nearer in time, noise may be the same
DOUBT = 1.0  # standard deviations of noise that a variance must exceed; only the excess counts
SURE = 2.0  # standard deviations that a delay must differ from none
FEWEST = 10  # rows of a joint
# Friction of joints 4 to 6 of a real UR10e, whose residual shows next to no discrepancy, in five recordings of three
# weeks (Mamedov, Mikhel, Frontiers in Robotics and AI 7, 2020), noise taken away: it follows the temperature.
VISCOUS_DRIFT, COULOMB_DRIFT = 0.05, 0.02  # relative standard deviation from one recording to another
FRICTION = {"N.m.s/rad": VISCOUS_DRIFT, "N.s/m": VISCOUS_DRIFT, "N.m": COULOMB_DRIFT, "N": COULOMB_DRIFT}


class _Joint(NamedTuple):
    """The rows of one joint that count, K' of them."""

    columns: Indices  # (m,) base parameters
    x: Array  # (K', m) [torque per unit of base]
    rest: Array  # (K',) residual [N.m or N]
    slope: Array  # (K',) of the torque [N.m/s or N/s]
    state: dict[str, Array]  # (K',) each, in standard deviations
    apart: Mask  # (K', K') far enough apart in time
    weight: float  # of a row of the sample [1/N2.m2]
    taken: Array  # (K', m) taken @ x' is the share of a process that the fit takes away
    stride: int  # rows that one of the sample stands for


def discrepancy_covariance(
    sample: RowSample, seen: Sequence[Indices], base: BaseMap, value: Array, variance: Array, white: Array
) -> Array:
    """Covariance (b, b) [units of base] that discrepancy, delay and drift of friction add to that of noise.

    Args:
        sample: of the rows that were learned from.
        seen: per joint, the base parameters (m,) that its torque depends on.
        base: what the base parameters are.
        value: (b,) their estimate [units of base].
        variance: (n,) of each joint's noise [N2.m2 or N2].
        white: (b, b) covariance under white noise [units of base].

    Source: Kennedy, O'Hagan, J. R. Statist. Soc. B 63(3), 2001 (discrepancy); Rao, Biometrics 27(1), 1971 (variance
    components by quadratic forms).
    """
    joints = {j: _joint(sample, j, seen, value, variance[j], white) for j in range(len(seen))}
    used = {j: joint for j, joint in joints.items() if len(joint.rest) >= FEWEST}
    spread, sizes = np.zeros_like(white), np.zeros(len(seen))
    for j, joint in used.items():
        own, sizes[j] = _processes(joint)
        spread[np.ix_(joint.columns, joint.columns)] += own
    late = _delay(list(used.values()), white)
    drift = _drift(used, sizes, base, value)
    return white @ spread @ white + np.outer(late, late) + (base.combination * drift**2) @ base.combination.T


def _joint(sample: RowSample, j: int, seen: Sequence[Indices], value: Array, variance: float, white: Array) -> _Joint:
    here, columns = sample.kept[:, j], seen[j]
    x = sample.of(j, seen)[here]
    load, weight = x @ value[columns], sample.stride / variance
    time = sample.number[here] * sample.period
    state = {"q": sample.q[here, j], "v": sample.v[here, j], "l": load}
    return _Joint(
        columns,
        x,
        sample.torque[here, j] - load,
        sample.slope[here, j],
        {name: signal / max(float(np.std(signal)), 1e-300) for name, signal in state.items() if len(signal)},
        np.abs(time[:, None] - time) >= max(APART, LAGS * sample.period),
        weight,
        x @ white[np.ix_(columns, columns)] * weight,
        sample.stride,
    )


def _processes(joint: _Joint) -> tuple[Array, float]:
    """Covariance (m, m) of the weighted sums of rows times the discrepancy, and its variance [N2.m2 or N2]."""
    spread, size = np.zeros((len(joint.columns),) * 2), 0.0
    for names in PROCESSES:
        like = _likeness(np.column_stack([joint.state[name] for name in names]))
        reach = like @ joint.x
        variance = _variance(joint, like, reach)
        spread += variance * joint.weight**2 * joint.x.T @ reach
        size += variance
    return spread, size


def _likeness(state: Array) -> Array:
    """Correlation (K, K) of a process at K states (K, d), in standard deviations."""
    state = state / LENGTH
    size = np.sum(state**2, axis=1)
    return np.asarray(np.exp(-np.maximum(size[:, None] + size - 2 * state @ state.T, 0) / 2))


def _variance(joint: _Joint, like: Array, reach: Array) -> float:
    """Variance of a process, by the products of residuals at like states, apart in time.

    The residual is (1 - P) (noise + process), P = taken @ x'; both terms' expectations are traces.
    """
    pairs = like * joint.apart
    near, x, taken = pairs @ np.column_stack([joint.taken, reach]), joint.x, joint.taken
    m = x.shape[1]
    turned = taken @ (x.T @ reach)
    within = float(np.trace(like) - 2 * np.sum(taken * reach) + np.sum(turned * taken))  # of all that is left
    across = float(np.sum(pairs * like) - 2 * np.sum(near[:, m:] * taken) + np.sum(near[:, :m] * turned))
    if across <= 0 or within <= 0:
        return 0.0
    power = float(joint.rest @ joint.rest)
    noise = power / max(len(joint.rest) - float(np.sum(taken * x)) / joint.stride, 1.0)
    products = float(joint.rest @ pairs @ joint.rest) + noise * float(np.sum(near[:, :m] * x)) / joint.stride
    doubt = noise * np.sqrt(2 * float(np.sum(pairs**2)))
    return float(np.clip((products - DOUBT * doubt) / across, 0.0, power / within))


def _delay(joints: Sequence[_Joint], white: Array) -> Array:
    """What a delay of all torques does to base parameters (b,), where the residual shows one."""
    turn, seen, told = np.zeros(len(white)), 0.0, 0.0
    for joint in joints:
        turn[joint.columns] -= joint.weight * joint.x.T @ joint.slope
        told -= joint.weight * float(joint.slope @ joint.rest)
        seen += joint.weight * float(joint.slope @ joint.slope)
    free = seen - float(turn @ white @ turn)
    if free <= 1e-9 * seen or told**2 <= SURE**2 * free:
        return np.zeros(len(white))
    return np.asarray(white @ turn * (told / free))


def _drift(joints: dict[int, _Joint], sizes: Array, base: BaseMap, value: Array) -> Array:
    """By how much each standard parameter may be another in another recording (p,) [units of the labels].

    A robot that has no discrepancy at any joint is taken to keep its friction: where friction is not what the laws
    say, temperature and load are not what they were, either.
    """
    place = {int(k): row for row, k in enumerate(base.independent)}
    drift, shares = np.zeros(len(base.labels)), []
    for j, joint in joints.items():
        own = [
            k for k, x in enumerate(base.labels) if k in place and x.joint == j and x.positive and x.unit in FRICTION
        ]
        rows = np.isin(joint.columns, [place[k] for k in own])
        power = float(np.mean((joint.x[:, rows] @ value[joint.columns[rows]]) ** 2))
        shares += [sizes[j] / power] if power > 0 else []
        for k in own:
            drift[k] = FRICTION[base.labels[k].unit] * abs(value[place[k]])
    share = float(np.sqrt(np.mean(shares))) if shares else 0.0
    return np.asarray(min(1.0, share / VISCOUS_DRIFT) * drift)
