"""Simulation -> recording: columns with the errors of encoders, amplifiers and a logger."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from ...errors import OptionError, unexpected
from ...robot import as_robot
from ...typed import typed
from ...types import Array, Mask, Robot
from .plant import Simulation

CORNER_FREQUENCY = 3.0  # [Hz] corner frequency of coloured noise
MAX_SHARES = {"noise": 10.0, "coloured noise": 10.0, "jitter": 10.0}  # largest shares; more would hide all
MEAN_BURST_ROWS = 4.0  # mean number of consecutive rows that are lost
MAX_TIME_ERROR = 0.4  # [periods] largest error of a sampling time
TIME_DECIMALS = 9  # decimals of time [s]: the clock of a logger counts nanoseconds


@dataclass(frozen=True)
class Sensors:
    """Errors of sensors and logger; by default every step is recorded without error.

    >>> sensors = signid.Sensors(rate=100.0, noise=0.01)
    """

    rate: float | None = None  # [Hz] of the log; None: every step
    encoder_bits: float | None = None  # 2**bits counts per turn, or per metre of a prismatic joint
    noise: float = 0.0  # [1] white torque noise, standard deviation over the joint's rms torque
    coloured_noise: float = 0.0  # [1] the same behind a first-order low-pass at 3 Hz
    jitter: float = 0.0  # [1] standard deviation of the sampling times, over the period
    drop_outs: float = 0.0  # [1] share of the rows that are lost, in bursts
    unsigned: bool = False  # whether torque is recorded without its sign

    def every(self, step: float) -> int:
        """Number of steps of a simulation, each of `step` [s], between two rows.

        Raises:
            OptionError: the rate does not divide the rate of the steps, or a number is invalid.
        """
        shares = {"noise": self.noise, "coloured noise": self.coloured_noise, "jitter": self.jitter}
        for name, value in shares.items():
            if not 0 <= value <= MAX_SHARES[name]:
                raise OptionError(f"{name} is {value:g}; give a share from 0 to {MAX_SHARES[name]:g}")
        if not 0 <= self.drop_outs < 1:
            raise OptionError(f"drop-outs are {self.drop_outs:g}; give the share of lost rows, from 0 to below 1")
        if self.encoder_bits is not None and not 1 <= self.encoder_bits <= 52:
            raise OptionError(f"the encoder has {self.encoder_bits:g} bits; give 1 to 52")
        if self.rate is None:
            return 1
        if not (0 < self.rate < np.inf and 0 < step < np.inf):
            raise OptionError(f"the log has {self.rate:g} Hz and steps of {step:g} s; give positive, finite numbers")
        every = max(1, round(1 / (self.rate * step)))
        if abs(every * self.rate * step - 1) > 1e-9:
            raise OptionError(
                f"a log at {self.rate:g} Hz does not fit steps of {step:g} s; "
                f"give a rate such as {1 / (every * step):.12g} Hz, or other steps"
            )
        return every


@typed
def record(
    robot: Robot, simulation: Simulation, sensors: Sensors | None = None, *, desired: bool = True, seed: int = 0
) -> dict[str, Array]:
    """Columns of a recording: t, then q_J, tau_J (or abs_tau_J) and q_des_J by the names of joints.

    >>> run = signid.simulate("3r", signid.track("3r", signid.excite("3r", kind="random").trajectory), 2.0)
    >>> columns = signid.record(signid.load_robot("3r"), run)

    Sampling times may have jitter, and t has the true sampling times. All signals of a row are sampled at one instant,
    between steps by interpolation: cubic for positions, linear for torque.

    Args:
        robot: simulated robot.
        simulation: K steps of n joints.
        sensors: errors of the sensors; None: no errors.
        desired: whether desired positions are recorded.
        seed: seed of noise, encoder zeros, sampling times and losses.

    Raises:
        OptionError: the rate does not divide the rate of the steps, or a number is invalid.
    """
    from scipy.signal import lfilter  # slow to import

    robot, sensors = as_robot(robot, "record"), sensors or Sensors()
    if not isinstance(simulation, Simulation):
        raise unexpected("record", "a Simulation", simulation, "what signid.simulate returns")
    step = float(simulation.t[1] - simulation.t[0]) if len(simulation.t) > 1 else 1.0
    every = sensors.every(step)
    noise, clock, zeros = (np.random.default_rng([seed, k]) for k in range(3))
    t, q, tau, asked = _sampled_signals(simulation, every, sensors.jitter * every * step, clock)
    q = _quantised(q, sensors.encoder_bits, robot.prismatic, zeros)
    white, coloured = noise.standard_normal((2, *tau.shape))
    keep = float(np.exp(-2 * np.pi * CORNER_FREQUENCY * every * step))
    coloured[1:] *= np.sqrt(1 - keep**2)  # stationary from the first row on
    coloured = np.asarray(lfilter([1.0], [1.0, -keep], coloured, axis=0))
    size = np.sqrt(np.mean(tau**2, axis=0))
    tau = tau + size * (sensors.noise * white + sensors.coloured_noise * coloured)
    torque = ("abs_tau", np.abs(tau)) if sensors.unsigned else ("tau", tau)
    columns = {"t": t.round(TIME_DECIMALS)}
    for name, values in (("q", q), torque, *([("q_des", asked)] if desired else [])):
        columns |= {f"{name}_{joint}": x for joint, x in zip(robot.joints, values.T, strict=True)}
    kept = _kept_rows(len(t), sensors.drop_outs, clock)
    return {name: x[kept] for name, x in columns.items()}


def record_held(
    prismatic: Mask,
    joints: Sequence[str],
    step: float,
    q: Array,
    v: Array,
    *,
    held: Mapping[str, Mapping[str, Array]],
    sensors: Sensors,
    seed: int = 0,
) -> dict[str, Array]:
    """Columns of a recording without torque: t, q_J, dq_J and signals that are held between steps.

    Args:
        prismatic: (n,) whether a joint is prismatic [1].
        joints: n names.
        step: between the K instants [s].
        q: (K, n) positions [rad or m].
        v: (K, n) velocities [rad/s or m/s].
        held: signals (K,) by kind and joint [units of their kinds]; each row gets the value in force at its time.
        sensors: errors of the encoders and of the logger.
        seed: of encoder zeros, sampling times and losses.

    Raises:
        OptionError: torque noise, or a rate that does not divide that of the steps.
    """
    if sensors.noise or sensors.coloured_noise or sensors.unsigned:
        raise OptionError("noise and signs of torque do not apply to a recording without torque; leave them out")
    every = sensors.every(step)
    clock, zeros = (np.random.default_rng([seed, k]) for k in (1, 2))
    at = np.arange(len(q)) * step
    t = at[::every]
    if sensors.jitter:
        late = sensors.jitter * every * step * clock.standard_normal(len(t))
        t = np.clip(t + np.clip(late, -MAX_TIME_ERROR * every * step, MAX_TIME_ERROR * every * step), 0.0, at[-1])
    row = np.minimum(np.floor(t / step + 1e-6).astype(int), len(at) - 1)
    positions = _quantised(
        q[row] if not sensors.jitter else CubicSpline(at, q)(t), sensors.encoder_bits, prismatic, zeros
    )
    speeds = np.column_stack([np.interp(t, at, x) for x in v.T])
    columns: dict[str, Array] = {"t": np.round(np.asarray(t, float), TIME_DECIMALS)}
    for name, values in (("q", positions), ("dq", speeds)):
        columns |= {f"{name}_{joint}": x for joint, x in zip(joints, values.T, strict=True)}
    columns |= {f"{kind}_{joint}": np.asarray(x[row]) for kind, each in held.items() for joint, x in each.items()}
    kept = _kept_rows(len(t), sensors.drop_outs, clock)
    return {name: x[kept] for name, x in columns.items()}


def _sampled_signals(
    simulation: Simulation, every: int, jitter: float, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Sampling times, positions, torques and desired positions; jitter in s."""
    s, rows = simulation, slice(None, None, every)
    if not jitter:
        return s.t[rows], s.q[rows], s.tau[rows], s.desired[rows]
    t, most = s.t[rows], MAX_TIME_ERROR * every * (s.t[1] - s.t[0])
    t = np.clip(t + np.clip(jitter * rng.standard_normal(len(t)), -most, most), s.t[0], s.t[-1])
    tau = np.column_stack([np.interp(t, s.t, x) for x in s.tau.T])
    return t, CubicSpline(s.t, s.q)(t), tau, CubicSpline(s.t, s.desired)(t)


def _quantised(q: Array, bits: float | None, prismatic: Mask, rng: np.random.Generator) -> Array:
    """Quantised positions with a random zero between two counts."""
    if bits is None:
        return q
    count = np.where(prismatic, 1.0, 2 * np.pi) / 2**bits
    zero = rng.uniform(0, count)
    return np.asarray(np.round((q - zero) / count) * count + zero)


def _kept_rows(rows: int, lost: float, rng: np.random.Generator) -> Mask:
    """Mask of the rows that are not lost: alternating runs; the first and the last row are never lost.

    Source: Gilbert, Capacity of a burst-noise channel, Bell System Technical Journal 39(5), 1960.
    """
    kept = np.ones(rows, dtype=bool)
    if not lost:
        return kept
    burst = max(MEAN_BURST_ROWS, lost / (1 - lost))
    fail = lost / (1 - lost) / burst
    runs = int(2 * rows * fail) + 10
    lengths = np.column_stack([rng.geometric(fail, runs), rng.geometric(1 / burst, runs)]).ravel()
    kept[1:-1] = np.repeat(np.tile([True, False], runs), lengths)[: rows - 2]
    return kept
