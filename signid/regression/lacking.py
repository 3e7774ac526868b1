"""Factors of a fit -> laws that it lacks: columns of laws against what it leaves on held-out rows.

All laws are tried beside bodies that stay near the description: a fit of any bodies hides a spring in tens of kg.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from ..effects import EFFECT_NAMES, EFFECTS
from ..effects.law import law_columns
from ..types import Array, Effect, Law, Mask, Parameters
from .factors import Factors
from .motion import Motion
from .projection import least_squares
from .rows import Task

# The residual of a joint matters if its held-out rms exceeds both [noise floors], [standard deviations of its torque]
MIN_RESIDUAL_FLOORS, MIN_RESIDUAL_SHARE = 1.5, 0.02
# [1] of its mean square that a named law explains, in that share of blocks of rows, as neighbours are alike. Measured
# on arms (panda, UR10e, TX40, EMPS): at most 0.26 for laws other than friction of another form; 0.97 and more: springs
MIN_EXPLAINED_SHARE, MIN_BLOCK_SHARE, ROW_BLOCKS = 0.3, 0.8, 8
INERTIAL_DEVIATION = 0.3  # [1] plausible error of stated masses, and of moments over mass times radius
MIN_GYRATION_RADIUS = 0.02  # [m] added to the radius of gyration, for bodies that are stated as points
# [1] mean square change of base parameters, in plausible errors, from which on bodies moved too far, and share of it
# that a law must spare. Measured: at most 0.18 for the arms above; 1.5 and 0.7 for a Baxter without its spring
MAX_BODY_CHANGE, MIN_SPARED_SHARE = 1.0, 0.5
LARGE_RESIDUAL_FLOORS = 10.0  # [noise floors] held-out rms from which on a sentence says so
MIN_COEFFICIENT_GAIN = 0.02  # [1] share by which a law with one coefficient more must explain more, to be named first
MIN_INDEPENDENT_SHARE = 1e-6  # [1] of a column's sum of squares that fitted columns leave, for its law to be tried
SINGLE_JOINT_LAWS = (  # laws of single joints that are linear
    *EFFECT_NAMES,
    *("asymmetric_friction", "quadratic_friction", "load_friction", "spring", "cable_torque", "counterbalance"),
)
VARIABLE_WORDS = {"load": "torque", "a": "acceleration", "q": "position", "v": "velocity", "t": "time"}


@dataclass(frozen=True)
class Lack:
    """Laws that explain most of what a fit leaves of a joint's torque on held-out rows, the best one first."""

    joint: str
    share: float  # [1] of the mean square there that the best one explains, or of the change of bodies that it spares
    variable: str  # that it is a function of: torque, acceleration, position, velocity, time, or none: a constant
    effects: tuple[str, ...]
    moved: bool = False  # whether it would spare a change of bodies beyond what a description can be wrong by
    floors: float = 0.0  # [noise floors] held-out rms

    @property
    def sentence(self) -> str:
        """The flag."""
        which = " or ".join(effect.replace("_", " ") for effect in self.effects[:2])
        percent = f"{100 * self.share:.0f} %"
        fact = f"{self.variable} explains {percent} of the held-out residual of {self.joint}"
        fact += f", {self.floors:.0f} times its noise floor" if self.floors > LARGE_RESIDUAL_FLOORS else ""
        if self.moved:
            fact = "the fit moves bodies beyond what a description can be wrong by"
            fact = f"{fact}, {percent} of it for want of a law at {self.joint}"
        return f"{fact}: {which}? Run signid diagnose"


class Accuracy(Protocol):
    """Accuracy of a fit: rms (n,) [N.m or N] and R2 (n,) [1]."""

    @property
    def train_rms(self) -> Array: ...
    @property
    def held_out_rms(self) -> Array: ...
    @property
    def noise_floor(self) -> Array: ...
    @property
    def held_out_r2(self) -> Array: ...


class _Rows(NamedTuple):
    """K sampled rows of n joints, zero where they are not used."""

    columns: Array  # (n, K, b) of all base parameters
    torque: Array  # (n, K) [N.m or N]
    kept: Mask  # (K, n)
    motion: Motion

    def of(self, law: Law) -> Array:
        """Columns (K, k) of a law at its joint."""
        return np.asarray(law_columns(law, self.motion)[1][:, 0] * self.kept[:, list(law.joints)])


class _Trial(NamedTuple):
    """Law beside bodies near the description."""

    effect: Effect
    joint: int
    explained: float  # [1] share of the mean square of the held-out residual of the joint
    spared: float  # [1] share of the change of the bodies


def find_lacks(
    task: Task, both: tuple[Factors, Factors], fit: Accuracy, value: Array, stated: Parameters, sound: Mask
) -> Iterator[Lack]:
    """Missing laws of the joints of the mask sound (n,), from factors of training and held-out rows.

    value: (b,) [units of base] of the fit; stated: standard parameters of the description.
    """
    train, test = both
    if train.sample is None or test.sample is None or train is test:
        return
    trials, far = _try_laws(task, (_residual_rows(task, train), _residual_rows(task, test)), fit, value, stated, sound)
    left = [trial for trial in trials if trial.explained > MIN_EXPLAINED_SHARE]
    for joint in dict.fromkeys(trial.joint for trial in left):
        found = [(one.explained, one.effect) for one in left if one.joint == joint]
        floors = float(fit.held_out_rms[joint] / max(fit.noise_floor[joint], 1e-300))
        yield _name_lack(task.robot.joints[joint], found, floors)
    best = max(trials, key=lambda trial: trial.spared, default=None)
    if far and best is not None and best.spared > MIN_SPARED_SHARE and all(trial.joint != best.joint for trial in left):
        found = [(one.spared, one.effect) for one in trials if one.joint == best.joint]
        yield _name_lack(task.robot.joints[best.joint], found, 0.0, moved=True)


def _name_lack(name: str, found: list[tuple[float, Effect]], floors: float, moved: bool = False) -> Lack:
    worth = {effect: share - MIN_COEFFICIENT_GAIN * len(effect.coefficients(effect.example)) for share, effect in found}
    order = sorted((pair for pair in found if pair[0] > MIN_EXPLAINED_SHARE), key=lambda pair: -worth[pair[1]])
    share, first = order[0]
    names = tuple(effect.name for _, effect in order if _variable(effect) == _variable(first))
    return Lack(name, share, _variable(first), names, moved, floors)


def _variable(effect: Effect) -> str:
    names = re.findall(r"\w+", effect.equation)
    return next((variable for name, variable in VARIABLE_WORDS.items() if name in names), "none")


def _candidates(task: Task, joint: int) -> list[Effect]:
    """Laws that are not fitted; friction of another form only where friction is missing."""
    fitted = {law.effect for law in task.laws if joint in law.joints}
    has = {effect.name for effect in fitted}.union(*(effect.contains for effect in fitted))
    new = [EFFECTS[name] for name in SINGLE_JOINT_LAWS if name not in has]
    rubs = any(effect.usual and effect.dissipative for effect in new)
    return [effect for effect in new if rubs or not effect.dissipative]


def _residual_rows(task: Task, factors: Factors) -> _Rows:
    rows = factors.sample
    assert rows is not None, "factors with a sample"
    columns = np.zeros((len(factors.columns), len(rows.number), task.base.rank))
    for j, seen in enumerate(factors.columns):
        columns[j][:, seen] = rows.of(j, factors.columns)
    t = np.asarray(rows.number * rows.period, np.float64)
    motion = Motion(task.robot, t, rows.q, rows.v, rows.a, slow=task.slow)
    return _Rows(columns, rows.torque.T, rows.kept, motion)


def _inertial_information(task: Task, stated: Parameters) -> Array:
    """Inverse covariance (b, b) of base parameters of a description whose bodies are wrong by plausible errors."""
    std = np.full(len(stated.values), 1e3)  # laws are free
    for k, (mass, *_, xx, _, yy, _, _, zz) in enumerate(stated.bodies()):
        size = max(abs(mass), 1e-3)
        radius = MIN_GYRATION_RADIUS + np.sqrt(max(xx + yy + zz, 0.0) / (2 * size))
        std[10 * k : 10 * k + 10] = INERTIAL_DEVIATION * size * np.repeat([1.0, radius, radius**2], [1, 3, 6])
    covariance = (task.base.combination * std**2) @ task.base.combination.T
    scale = np.sqrt(np.diag(covariance))
    return np.asarray(np.linalg.pinv(covariance / np.outer(scale, scale), 1e-12, True) / np.outer(scale, scale))


def _try_laws(
    task: Task, rows: tuple[_Rows, _Rows], fit: Accuracy, value: Array, stated: Parameters, sound: Mask
) -> tuple[list[_Trial], bool]:
    """All laws, fitted to training rows with bodies near the description; and whether bodies moved too far."""
    (train, test), centre = rows, task.base.combination @ stated.values
    weight = np.nan_to_num(1 / np.maximum(np.maximum(fit.train_rms, fit.noise_floor), 1e-300))
    wide = (train.columns * weight[:, None, None]).reshape(-1, len(value))
    gram, prior = wide.T @ wide, _inertial_information(task, stated)
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    free = np.linalg.pinv(gram / np.outer(size, size), 1e-12, True) / np.outer(size, size)
    near = np.linalg.inv(gram + prior)
    start = near @ (wide.T @ (train.torque * weight[:, None]).ravel() + prior @ centre)

    def change(base: Array) -> float:
        return float((base - centre) @ prior @ (base - centre)) / len(value)

    matters = (fit.held_out_rms > MIN_RESIDUAL_FLOORS * fit.noise_floor) & (fit.held_out_r2 < 1 - MIN_RESIDUAL_SHARE**2)
    trials, moved = list[_Trial](), change(start)
    for joint in np.flatnonzero(sound & (matters | (moved > MAX_BODY_CHANGE))).tolist():
        rest = (train.torque[joint] - train.columns[joint] @ start) * weight[joint]
        before = min((test.torque[joint] - test.columns[joint] @ x for x in (value, start)), key=lambda x: float(x @ x))
        for effect in _candidates(task, joint):
            own, judged = (part.of(Law(effect, (joint,))) for part in rows)
            own = own * weight[joint]
            both, square = weight[joint] * train.columns[joint].T @ own, own.T @ own
            new = np.diag(square - both.T @ free @ both) > MIN_INDEPENDENT_SHARE * np.diag(square)
            if not new.any():
                continue
            shift = near @ both[:, new]
            found = least_squares((square[:, new] - both.T @ shift)[new], own[:, new].T @ rest)
            base = start - shift @ found
            after = test.torque[joint] - test.columns[joint] @ base - judged[:, new] @ found
            old, left = (np.array([x @ x for x in np.array_split(y, ROW_BLOCKS)]) for y in (before, after))
            steady = matters[joint] and old.any() and np.mean(left[old > 0] < old[old > 0]) >= MIN_BLOCK_SHARE
            explained = 1 - float(left.sum() / old.sum()) if steady else 0.0
            spared = 1 - change(base) / moved if moved > 0 and left.sum() <= old.sum() else 0.0
            trials.append(_Trial(effect, joint, explained, spared))
    return trials, moved > MAX_BODY_CHANGE
