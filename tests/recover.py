"""Plant an effect, record positions and noisy torques, and find its numbers again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from arm import arm, harmonics
from contract import PLACE
from scipy.ndimage import minimum_filter1d
from scipy.optimize import minimize

from signid.cutoff import Band, choose_band
from signid.effects import EFFECTS
from signid.effects.base import Effect, RecordingLaw
from signid.effects.law import coefficient_count, hypotheses, law_columns, law_torque
from signid.effects.trial import Trial
from signid.filters import Decimator
from signid.model import Model, stated_inertials
from signid.motion import Motion, build_motion
from signid.rows import STILL, choose_reach
from signid.simulate import Simulation, simulate, track
from signid.types import Array, Law, Mask, Samples

ROTOR = {"inertia": 0.15}
USUAL = {"viscous_friction": {"coefficient": 1.0}, "coulomb_friction": {"level": 1.5}, "armature": ROTOR}
INSTEAD = {"asymmetric_friction": ("viscous_friction", "coulomb_friction")}  # of the usual laws, at the same joint
SLOW, RATE = 0.01, 1000.0  # [rad/s] width of a reversal, [Hz]
ROUNDS = 3  # in which torque is predicted anew
EDGE = 0.05  # [s] by which the ends of a window are moved first


@dataclass(frozen=True, eq=False)
class Case:
    """A recording of a planted effect, on the way to the fit."""

    effect: Effect
    known: tuple[Law, ...]  # friction laws whose numbers are sought beside it
    rotors: tuple[Law, ...]  # armature, whose numbers are given
    motion: Motion
    band: Band
    steady: Mask  # (N, n) far from a reversal
    noise: Array  # (n,) [N.m]


class Found(NamedTuple):
    """The effect's numbers, its first coefficient and what is left [1]."""

    parameters: dict[str, float]
    coefficient: float
    left: float
    laws: tuple[Law, ...]


def usual_laws(effect: Effect) -> tuple[Law, ...]:
    """Friction and rotors at every joint, but where the effect itself stands for them."""
    apart = {*INSTEAD.get(effect.name, ()), effect.name}
    return tuple(
        Law(EFFECTS[name], (j,), values)
        for name, values in USUAL.items()
        for j in range(3)
        if not (name in apart and (j,) == PLACE[effect.scope])
    )


@cache
def record(effect: Effect, seed: int, seconds: float) -> Simulation:
    """The arm on its way with the effect and the usual laws."""
    bare = Model(arm(), stated_inertials(arm()))
    laws = (*usual_laws(effect), Law(effect, PLACE[effect.scope], effect.example))
    return simulate(replace(bare, laws=laws), track(bare, harmonics(seconds, seed)), seconds)


def case(effect: Effect, seed: int = 5, seconds: float = 16.0, noise: float = 0.005, cutoff: float = 12.0) -> Case:
    """The recording as positions and noisy torques, differentiated and filtered as signid does it."""
    told = record(effect, seed, seconds)
    deviation = noise * told.tau.std(0)
    tau = told.tau + deviation * np.random.default_rng(seed).normal(size=told.tau.shape)
    samples = Samples(told.t, told.q, tau, None, None, None)
    band = choose_band([samples], RATE, cutoff)
    motion = build_motion(arm(), samples, band, 1 / RATE, slow=np.full(3, SLOW))
    reach = choose_reach([motion], band, np.full(3, SLOW))
    near = [minimum_filter1d(np.abs(v), 2 * r + 1, mode="nearest") for v, r in zip(motion.v.T, reach, strict=True)]
    laws = usual_laws(effect)
    rotors = tuple(law for law in laws if law.effect.name == "armature")
    known = tuple(Law(law.effect, law.joints) for law in laws if law not in rotors)
    return Case(effect, known, rotors, motion, band, np.column_stack(near) >= STILL * SLOW, deviation)


def recover(case: Case) -> Found:
    """Numbers of the effect beside the usual friction, its shape from the grid and then polished.

    Torque columns of records (gain, delay and so on) are those of the torque that the last round predicts.
    """
    case = replace(case, motion=_predicting(case, ()))
    if isinstance(case.effect, RecordingLaw) and not case.effect.parameters:
        return _undone(case)
    found = _best(case)
    for _ in range(ROUNDS if isinstance(case.effect, RecordingLaw) else 0):
        case = replace(case, motion=_predicting(case, found.laws))
        found = _best(case)
    return found


def _undone(case: Case) -> Found:
    """A sign or a swap: friction from the record turned back, then how much of the change there is."""
    motion, law = case.motion, Law(case.effect, PLACE[case.effect.scope])
    assert motion.recorded is not None
    own, back = list(law.joints), motion.recorded.copy()
    back[:, own] = case.effect.recorded_torque(Trial(torque=back[:, own]))
    friction = solve(replace(case, motion=replace(motion, recorded=back)), case.known).laws
    return solve(replace(case, motion=_predicting(case, friction)), (law,), friction)


def _best(case: Case) -> Found:
    place, effect = PLACE[case.effect.scope], case.effect
    tries = [law for law in hypotheses(effect, case.motion, 3) if law.joints == place]
    best = min((solve(case, (*case.known, law)) for law in tries), key=lambda found: found.left)
    shape = effect.shape(best.parameters)
    if not shape:
        return best
    times = effect.name == "external_contact"  # ends of a window move by seconds, other shapes by shares
    there, back, first = (np.array, np.array, EDGE) if times else (np.log, np.exp, 0.02)

    def at(x: Array) -> Law:
        return Law(effect, place, dict(zip(shape, back(x).tolist(), strict=True)))

    start = there(list(shape.values()))
    corners = np.vstack([start, start + first * np.eye(len(start))])
    options = {"initial_simplex": corners, "xatol": 1e-4, "fatol": 1e-9, "maxfev": 40 * len(start)}
    polished = minimize(lambda x: _whole(case, at(x)).left, start, method="Nelder-Mead", options=options).x
    return solve(case, (*case.known, at(polished)))


def _whole(case: Case, law: Law) -> Found:
    """The fit with a law, which without any coefficient is there as it is."""
    if law.effect.linear():
        return solve(case, (*case.known, law))
    return solve(case, case.known, (law,))._replace(parameters=dict(law.parameters))


def solve(case: Case, laws: Sequence[Law], given: Sequence[Law] = ()) -> Found:
    """Least squares of all joints' rows together, each weighted by its noise, without those near reversals.

    Args:
        case: the recording.
        laws: whose coefficients are sought; their shape is given.
        given: laws whose torque is known.
    """
    motion, thin = case.motion, Decimator(case.band.taps, case.band.factor)
    assert motion.recorded is not None
    wide = np.zeros((len(motion), 3, sum(map(coefficient_count, laws))))
    at = 0
    for law in laws:
        rows, columns = law_columns(law, motion)
        wide[:, list(rows), at : at + columns.shape[2]] = columns
        at += columns.shape[2]
    target = motion.recorded - motion.load - sum(_torque(law, motion) for law in (*case.rotors, *given))
    kept = case.steady[thin.half : len(motion) - thin.half : case.band.factor]
    y = thin(target) / case.noise
    a = thin(wide.reshape(len(wide), -1)).reshape(len(y), 3, -1) / case.noise[:, None]
    y, a = y[kept], a[kept]
    size = np.linalg.norm(a, axis=0)
    size[size < 1e-9 * size.max()] = np.inf  # what this motion cannot tell
    c = np.linalg.lstsq(a / size, y, rcond=1e-9)[0] / size
    left = float(np.sqrt(np.mean((y - a @ c) ** 2)))
    ends = np.cumsum([coefficient_count(law) for law in laws])
    own = np.split(c, ends[:-1])
    full = tuple(
        replace(law, parameters=law.effect.physical(mine, law.effect.shape(law.parameters)))
        for law, mine in zip(laws, own, strict=True)
    )
    return Found(dict(full[-1].parameters), float(own[-1][0]), left, full)


def _predicting(case: Case, laws: Sequence[Law]) -> Motion:
    """The motion with the torque that friction and rotors predict before anything spoils the record."""
    motion = case.motion
    before = [law for law in laws if law.effect is not case.effect] + list(case.rotors)
    return replace(motion, predicted=motion.load + sum(_torque(law, motion) for law in before))


def _torque(law: Law, motion: Motion) -> Array:
    rows, torque = law_torque(law, motion)
    out = np.zeros_like(motion.q)
    out[:, list(rows)] = torque
    return out
