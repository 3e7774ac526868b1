"""Model discrepancy: the covariance that model error, delay and friction drift add to base parameters.

    torque of joint j = columns @ base parameters + noise + d_j(state) + delay * slope of the torque

d_j is a sum of independent zero-mean Gaussian processes: over velocity, load, position, velocity and load, position and
velocity of the joint. Noise is correlated over short times only; discrepancy returns whenever the robot returns to the
same state. The variance of each process is estimated from products of residuals at similar states and distant times,
after subtraction of their expectation under noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..regression.factors import RowSample
from ..types import Array, BaseMap, Indices

PROCESSES = ("v", "l", "q", "vl", "qv")  # states of each process: velocity, load, position
# Length, thresholds and number of processes were chosen on the recordings of `benchmarks.intervals_real` and on the
# simulations of `benchmarks.coverage`: intervals contain the truth as often as their nominal coverage on both.
LENGTH = 0.3  # [standard deviations of the state] correlation length of a process
APART, LAGS = 0.6, 6.0  # [s], [rows] distance in time from which on noise is uncorrelated
REDUCTION = 1.0  # [standard errors under noise] subtracted from each variance
FEWEST = 10  # smallest number of rows of a joint
# Relative standard deviation of friction between recordings. Measured on joints 4 to 6 of a UR10e, five recordings
# within three weeks, variance of noise subtracted (data: Mamedov, Mikhel, Frontiers in Robotics and AI 7, 2020). Their
# residuals show almost no discrepancy: one recording alone cannot show this change. Temperature is the likely cause.
VISCOUS_DRIFT, COULOMB_DRIFT = 0.05, 0.02  # [1] of the coefficient
FRICTION = {"N.m.s/rad": VISCOUS_DRIFT, "N.s/m": VISCOUS_DRIFT, "N.m": COULOMB_DRIFT, "N": COULOMB_DRIFT}


class _Joint(NamedTuple):
    """Valid sample rows of one joint, K' of them."""

    columns: Indices  # (m,) base parameters
    x: Array  # (K', m) [torque per unit of base]
    rest: Array  # (K',) residual [N.m or N]
    slope: Array  # (K',) derivative of the torque [N.m/s or N/s]
    state: dict[str, Array]  # (K',) each, in standard deviations
    apart: Array  # (K', K') 1 where two rows are distant in time, else 0
    weight: float  # weight of a row of the sample [1/N2.m2]
    taken: Array  # (K', m) taken @ x' projects a process onto the fit
    stride: int  # rows that one sample row represents


def discrepancy_covariance(
    sample: RowSample, seen: Sequence[Indices], base: BaseMap, value: Array, variance: Array, white: Array
) -> Array:
    """Covariance (b, b) [units of base] of discrepancy, delay and friction drift, to be added to that of noise.

    The torque of each joint depends on the base parameters seen (m,), estimated as value (b,) [units of base]
    with covariance white (b, b) [units of base] under white noise of variance (n,) [N2.m2 or N2].

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
        (np.abs(time[:, None] - time) >= max(APART, LAGS * sample.period)).astype(float),
        weight,
        x @ white[np.ix_(columns, columns)] * weight,
        sample.stride,
    )


def _processes(joint: _Joint) -> tuple[Array, float]:
    """Covariance (m, m) of the normal equations' right-hand side due to discrepancy; its variance [N2.m2 or N2]."""
    spread, size = np.zeros((len(joint.columns),) * 2), 0.0
    single = {name: _likeness(state) for name, state in joint.state.items()}
    for names in PROCESSES:
        like = single[names] if len(names) == 1 else single[names[0]] * single[names[1]]
        reach = like @ joint.x
        variance = _variance(joint, like, reach)
        spread += variance * joint.weight**2 * joint.x.T @ reach
        size += variance
    return spread, size


def _likeness(state: Array) -> Array:
    """Correlation (K, K) of a process at K states (K,), in standard deviations."""
    return np.asarray(np.exp((state[:, None] - state) ** 2 * (-0.5 / LENGTH**2)))


def _variance(joint: _Joint, like: Array, reach: Array) -> float:
    """Variance of a process [N2.m2 or N2], from products of residuals at similar states and distant times.

    The residual is (1 - P) (noise + process) with P = taken @ x'; the expectations of both terms are traces.
    """
    pairs = like * joint.apart
    near, x, taken = pairs @ np.column_stack([joint.taken, reach]), joint.x, joint.taken
    m = x.shape[1]
    turned = taken @ (x.T @ reach)
    within = float(np.trace(like) - 2 * np.sum(taken * reach) + np.sum(turned * taken))  # E[residual'residual]
    squares = float(np.vdot(pairs, pairs))
    across = float(squares - 2 * np.sum(near[:, m:] * taken) + np.sum(near[:, :m] * turned))
    if across <= 0 or within <= 0:
        return 0.0
    power = float(joint.rest @ joint.rest)
    noise = power / max(len(joint.rest) - float(np.sum(taken * x)) / joint.stride, 1.0)
    products = float(joint.rest @ pairs @ joint.rest) + noise * float(np.sum(near[:, :m] * x)) / joint.stride
    error = noise * np.sqrt(2 * squares)
    return float(np.clip((products - REDUCTION * error) / across, 0.0, power / within))


def _delay(joints: Sequence[_Joint], white: Array) -> Array:
    """Error (b,) [units of base], one standard deviation with signs, that a common delay of all torques causes."""
    turn, power, product = np.zeros(len(white)), 0.0, 0.0
    for joint in joints:
        turn[joint.columns] -= joint.weight * joint.x.T @ joint.slope
        product -= joint.weight * float(joint.slope @ joint.rest)
        power += joint.weight * float(joint.slope @ joint.slope)
    free = power - float(turn @ white @ turn)
    if free <= 1e-9 * power:
        return np.zeros(len(white))
    excess = (product / free) ** 2 - 1 / free  # squared delay less its expectation under noise [s2]
    return np.asarray(white @ turn * np.sqrt(max(excess, 0.0)))


def _drift(joints: dict[int, _Joint], sizes: Array, base: BaseMap, value: Array) -> Array:
    """Standard deviation (p,) [units of the labels] of each standard parameter between recordings.

    It is proportional to the discrepancy relative to friction, averaged over all joints, up to the measured drift.
    Robots whose friction follows its laws exactly are simulated, or their friction does not depend on temperature.
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
