"""A small arm with recorded torque magnitudes and the signed torque, for tests of signs."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from arm import arm
from motions import FRICTION, trial, truth

from signid.recording import read_recording
from signid.regression.rows import Task
from signid.regression.session import Options, prepare
from signid.signs.observations import Observations, observe, threshold_runs
from signid.signs.problem import Segment, build_sign_problem, orthonormalise
from signid.types import Array


@dataclass(frozen=True, eq=False)
class Lost:
    """N samples of 3 joints."""

    task: Task
    observed: Observations  # torque without its sign
    torque: Array  # (N, n) [N.m] with it
    true: Array  # (b,) base parameters [units of base]

    @property
    def weights(self) -> Array:
        return 1 / np.sqrt(np.mean(self.torque**2, axis=0))

    def segments(self) -> list[Segment]:
        return threshold_runs(self.observed)[0]

    def value(self, segments: list[Segment]) -> Array:
        """(b,) by least squares of segments, each with the sign that most of its torque has."""
        signs = np.array([np.sign(self.torque[s.start : s.stop, s.joint].sum()) for s in segments])
        problem = build_sign_problem(self.observed, segments, self.weights)
        return problem.back @ problem.coordinates(signs)

    def with_signs(self) -> Array:
        """(b,) by least squares of all steady rows, their signs known."""
        steady, weights = self.observed.steady.T, self.weights
        rows = np.concatenate([self.observed.rows(j, at) * weights[j] for j, at in enumerate(steady)])
        unitary, back = orthonormalise(rows)
        return np.asarray(back @ (unitary.T @ (self.torque * weights).T[steady]))

    def misfit(self, value: Array) -> float:
        """Relative rms error of a value in weighted torque."""
        off = (self.observed.predict(value - self.true) * self.weights)[self.observed.steady.all(1)]
        return float(np.sqrt(np.mean(off**2)))


@cache
def lost(noise: float, seed: int = 0) -> Lost:
    """Twenty seconds at 100 Hz; noise is white, a share of each joint's rms torque."""
    robot, names = arm(), tuple(FRICTION)
    made = trial(robot, seed=seed, seconds=20, rate=100)
    rms = np.sqrt(np.mean(made.torque**2, axis=0))
    torque = made.torque + noise * rms * np.random.default_rng(seed).standard_normal(made.torque.shape)
    columns = {"t": made.t, "q": made.q, "dq": made.v, "ddq": made.a, "tau": torque}
    seen = []
    for unsigned in (False, True):
        recording = read_recording(columns, robot, unsigned=unsigned)
        session = prepare(robot, [recording], [recording], Options(effects=names, derivatives="recorded"))
        seen.append(observe(session.task, session.train))
    return Lost(session.task, seen[1], seen[0].torque, session.task.base.combination @ truth(robot))
