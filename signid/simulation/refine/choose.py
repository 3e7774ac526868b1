"""Choice of laws for a robot with one joint, by cross-validation over windows of the training recordings."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ...effects import EFFECTS
from ...errors import OptionError, shorten
from ...model import Model
from ...types import Array, Frozen, Law
from ..rollout.windows import Windows
from .coordinates import coordinates_of
from .fit import fit_windows, subset, window_rms

LAWS = (  # to choose from
    "asymmetric_friction",
    "position_friction",
    "quadratic_friction",
    "spring",
    "stribeck_friction",
    "torque_ripple",
)
BLOCKS, FOLDS = 8, 4  # contiguous parts of a recording, dealt to folds in turn
NUMBERS = 8  # free numbers of a chosen model at most
PERIODS = (0.4, 1.0, 2.5, 5.0)  # start values of a law that is periodic in position, in periods over the travel
SPEEDS = (0.1, 0.4)  # start values of a Stribeck velocity, over the rms speed
FIRST = (1e-3,), 12  # differences and iterations of the fits from each start value and of the folds
SEED = 0.02  # [1] start value of a coefficient, over that of a law that explains the whole torque


@dataclass(frozen=True, eq=False)
class LawTrial(Frozen):
    """A set of laws, fitted and cross-validated."""

    model: Model  # fitted to all windows
    laws: tuple[str, ...]
    numbers: int
    errors: Array  # (W, n) [rad or m] rms of windows that took no part in the fit

    @property
    def score(self) -> float:
        """Geometric mean [rad or m] of the errors over windows and joints."""
        with np.errstate(divide="ignore"):
            return float(np.exp(np.mean(np.log(self.errors))))


def choose(model: Model, windows: Sequence[Windows], scale: Array, candidates: Sequence[str]) -> list[LawTrial]:
    """All trials of a stepwise search; the last one is chosen.

    In each round every candidate is added alone. The one with the smallest error of held-out windows is taken if it has
    at most `NUMBERS` free numbers and is better than the model before by more than a standard error.

    Args:
        model: start values.
        windows: of all recordings.
        scale: (n,) [rad or m] size of the errors of each joint, as weights.
        candidates: names of laws.

    Raises:
        OptionError: a law is not among `LAWS`, or the robot has several joints.
    """
    _check(model, candidates)
    chosen, others, left = cross_validate(model, windows, scale), list[LawTrial](), list(candidates)
    while left:
        found = {name: _added(chosen.model, name, windows, scale) for name in left}
        able = {name: trial for name, trial in found.items() if trial is not None and trial.numbers <= NUMBERS}
        others += able.values()
        if not able:
            break
        name = min(able, key=lambda name: able[name].score)
        if not better(able[name].errors, chosen.errors):
            break
        others, chosen = [*(trial for trial in others if trial is not able[name]), chosen], able[name]
        left.remove(name)
    return [*others, chosen]


def cross_validate(model: Model, windows: Sequence[Windows], scale: Array) -> LawTrial:
    """A model fitted to all windows, and the errors of windows that took no part in the fit of the other folds.

    Args:
        model: start values.
        windows: of all recordings.
        scale: (n,) [rad or m] size of the errors of each joint, as weights.
    """
    errors = list[Array]()
    folds = [np.minimum(np.arange(len(w.t)) * BLOCKS // len(w.t), BLOCKS - 1) % FOLDS for w in windows]
    for w in windows:
        errors.append(np.full((len(w.t), w.q.shape[2]), np.inf))
    fitted = fit_windows(model, windows, scale)
    for k in range(FOLDS):
        learn = [subset(w, np.flatnonzero(f != k)) for w, f in zip(windows, folds, strict=True) if (f != k).any()]
        found = fit_windows(fitted, learn, scale, *FIRST) if learn else model
        for w, fold, out in zip(windows, folds, errors, strict=True):
            if (fold == k).any():
                out[fold == k] = window_rms(found, [subset(w, np.flatnonzero(fold == k))])
    names = tuple(law.effect.name for law in model.laws)
    return LawTrial(fitted, names, len(coordinates_of(model).value), np.concatenate(errors))


def better(errors: Array, before: Array) -> bool:
    """Whether errors of windows are smaller by more than a standard error of their mean log ratio.

    Args:
        errors: (W, n) [rad or m] rms of each window.
        before: (W, n) [rad or m] the same of the other model.
    """
    tiny = np.finfo(float).tiny
    with np.errstate(invalid="ignore"):
        gain = np.nan_to_num(np.log(np.maximum(before, tiny) / np.maximum(errors, tiny)), posinf=10.0, neginf=-10.0)
    gain = gain.mean(axis=1)
    return bool(gain.mean() > gain.std() / np.sqrt(len(gain)))


def _added(model: Model, name: str, windows: Sequence[Windows], scale: Array) -> LawTrial | None:
    """The best trial of a law beside the others, over its start values; None where nothing changes friction."""
    effect, own = EFFECTS[name], {law.effect.name for law in model.laws}
    if name in own or (effect.changes and not own & set(effect.changes)):
        return None
    starts = [fit_windows(start, windows, scale, *FIRST) for start in _starts(model, name, windows)]
    cost = [float(np.mean(window_rms(start, windows) ** 2)) for start in starts]
    return cross_validate(starts[int(np.argmin(cost))], windows, scale)


def _starts(model: Model, name: str, windows: Sequence[Windows]) -> Iterator[Model]:
    """Models with a law of some start values; a law replaces those that it contains."""
    effect = EFFECTS[name]
    torque, speed = (_rms([getattr(w, key) for w in windows]) for key in ("torque", "v"))
    travel = float(np.ptp(np.concatenate([w.q.ravel() for w in windows])))
    per = {"N.m": 1.0, "N.m.s/rad": speed, "N.m.s2/rad2": speed**2, "N.m/rad": travel}
    linear, inside = effect.linear(), [law for law in model.laws if law.effect.name in effect.contains]
    seeds = {key: 0.0 if inside else SEED * torque / per.get(x.unit, np.inf) for key, x in linear.items()}
    for law in inside:
        (value,) = law.effect.coefficients(law.parameters)
        for key, factor in effect.contains[law.effect.name].items():
            seeds[key] += factor * value
    rest = tuple(law for law in model.laws if law not in inside)
    grids = {"frequency": [2 * np.pi * x / travel for x in PERIODS], "velocity": [x * speed for x in SPEEDS]}
    keys = list(effect.shape(effect.example))
    for values in zip(*(grids[key] for key in keys), strict=True) if keys else [()]:
        shape = dict(zip(keys, map(float, values), strict=True))
        law = Law(effect, (0,), effect.physical(list(seeds.values()), shape))
        yield Model(model.robot, model.inertials, (*rest, law))


def _rms(signals: Sequence[Array]) -> float:
    return float(np.sqrt(np.mean(np.concatenate([x.ravel() for x in signals]) ** 2)))


def _check(model: Model, candidates: Sequence[str]) -> None:
    if not candidates:
        return
    if wrong := [name for name in candidates if name not in LAWS]:
        raise OptionError(f"roll-outs cannot choose {shorten(wrong)}; the laws to choose from are {', '.join(LAWS)}")
    if len(model.robot.joints) > 1:
        raise OptionError(
            f"roll-outs choose laws of robots with one joint, and {model.robot.name} has {len(model.robot.joints)}; "
            f"signid diagnose names laws of the others"
        )
