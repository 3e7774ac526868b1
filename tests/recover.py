"""Plant an effect, record positions and noisy torques, and identify its parameters."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import NamedTuple

import numpy as np
from arm import arm, harmonics
from contract import PLACE, on_all_joints
from scipy.ndimage import minimum_filter1d
from scipy.optimize import minimize

from signid.effects import EFFECTS
from signid.effects.base import Effect, RecordingLaw, Trial
from signid.effects.law import coefficient_count, hypotheses, law_columns
from signid.model import Model, stated_inertials
from signid.regression.bandwidth import Band, Decimator, choose_band
from signid.regression.motion import Motion, build_motion
from signid.regression.rows import STEADY_WIDTHS, choose_reach
from signid.simulation.plant import Simulation, simulate, track
from signid.types import Array, Law, Mask, Samples

ROTOR = {"inertia": 0.15}
USUAL = {"viscous_friction": {"coefficient": 1.0}, "coulomb_friction": {"level": 1.5}, "armature": ROTOR}
INSTEAD = {"asymmetric_friction": ("viscous_friction", "coulomb_friction")}  # of the usual laws, at the same joint
TOLERANCE = 0.02  # of the value planted, or of 5 % of the largest of them where that is more
LOOSER = {
    "stribeck_friction": 0.08,  # mostly the jump; its rows are excluded
    "position_friction": 0.1,  # the phase: frequency times a position far from zero
    "friction_drift": 0.04,
    "backlash": 0.03,
    "time_delay": 0.03,
    "torque_lag": 0.03,
    "joint_coupling": 0.15,  # 0.03 but for the inertia, of less torque than the noise
}
UNIDENTIFIABLE = {("link_inertia", "mass"), ("link_inertia", "first_moment_y")}  # for link 2
THERE = {"joint_elasticity": 0.15}  # allowed error of the coefficient of a switched law; else 0.05
SLOW, RATE = 0.01, 1000.0  # [rad/s] width of a reversal, [Hz]
ROUNDS = 3  # of torque prediction
STRIDES = (0.1, 0.02, 0.004, 0.001)  # [s] by which the ends of a window are moved


@dataclass(frozen=True, eq=False)
class Case:
    """A recording of a planted effect, on the way to the fit."""

    effect: Effect
    known: tuple[Law, ...]  # friction laws that are fitted too
    rotors: tuple[Law, ...]  # armature, which is given
    motion: Motion
    band: Band
    steady: Mask  # (N, n) far from a reversal
    noise: Array  # (n,) [N.m]


class Found(NamedTuple):
    """Parameters of the effect, its first coefficient and the residual [1]."""

    parameters: dict[str, float]
    coefficient: float
    left: float
    laws: tuple[Law, ...]


def misses(case: Case, found: Found) -> dict[str, float]:
    """Error of each identifiable parameter, as a share of the allowed error."""
    effect, recorded = case.effect, case.motion.recorded
    assert recorded is not None
    if "limit" in effect.example and np.abs(recorded[:, PLACE[effect.scope]]).max() < effect.example["limit"]:
        return {}
    scale = max(map(abs, effect.example.values()), default=1.0)
    allowed = LOOSER.get(effect.name, TOLERANCE)
    planted = {key: x for key, x in effect.example.items() if (effect.name, key) not in UNIDENTIFIABLE}
    far = {key: abs(found.parameters[key] - x) / (allowed * max(abs(x), 0.05 * scale)) for key, x in planted.items()}
    if not effect.linear():
        far["there"] = abs(found.coefficient - 1) / THERE.get(effect.name, 0.05)
    return far


def usual_laws(effect: Effect) -> tuple[Law, ...]:
    """Friction and rotors at every joint, except those that the effect replaces."""
    apart = {*INSTEAD.get(effect.name, ()), effect.name}
    return tuple(
        Law(EFFECTS[name], (j,), values)
        for name, values in USUAL.items()
        for j in range(3)
        if not (name in apart and (j,) == PLACE[effect.scope])
    )


@cache
def record(effect: Effect, seed: int, seconds: float) -> Simulation:
    """Simulation of the arm with the effect and the usual laws."""
    bare = Model(arm(), stated_inertials(arm()))
    laws = (*usual_laws(effect), Law(effect, PLACE[effect.scope], effect.example))
    return simulate(replace(bare, laws=laws), track(bare, harmonics(seconds, seed)), seconds)


def case(effect: Effect, seed: int = 5, seconds: float = 16.0, noise: float = 0.005, cutoff: float = 12.0) -> Case:
    """The recording as positions and noisy torques, differentiated and filtered as signid does it."""
    recorded = record(effect, seed, seconds)
    deviation = noise * recorded.tau.std(0)
    tau = recorded.tau + deviation * np.random.default_rng(seed).normal(size=recorded.tau.shape)
    samples = Samples(recorded.t, recorded.q, tau, None, None, None)
    band = choose_band([samples], RATE, cutoff)
    motion = build_motion(arm(), samples, band, 1 / RATE, slow=np.full(3, SLOW))
    reach = choose_reach([motion], band, np.full(3, SLOW))
    near = [minimum_filter1d(np.abs(v), 2 * r + 1, mode="nearest") for v, r in zip(motion.v.T, reach, strict=True)]
    if effect.name == "joint_coupling":  # dry friction of the sum of two velocities reverses with the sum
        own = list(PLACE["pair"])
        together = minimum_filter1d(np.abs(motion.v[:, own].sum(1)), 2 * max(reach) + 1, mode="nearest")
        for j in own:
            near[j] = np.minimum(near[j], together)
    laws = usual_laws(effect)
    rotors = tuple(law for law in laws if law.effect.name == "armature")
    known = tuple(Law(law.effect, law.joints) for law in laws if law not in rotors)
    return Case(effect, known, rotors, motion, band, np.column_stack(near) >= STEADY_WIDTHS * SLOW, deviation)


def recover(case: Case) -> Found:
    """Parameters of the effect with the usual friction; the shape comes from the grid and is refined.

    Columns of recording laws (gain, delay and so on) use the torque predicted in the previous round.
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
    """A sign or a swap: fit friction to the corrected recording, then the size of the change."""
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
    there, back = (np.array, np.array) if times else (np.log, np.exp)

    def at(x: Array) -> Law:
        return Law(effect, place, dict(zip(shape, back(x).tolist(), strict=True)))

    def cost(x: Array) -> float:
        return _whole(case, at(x)).left

    start = there(list(shape.values()))
    return solve(case, (*case.known, at(_walk(cost, start) if times else _slide(cost, start))))


def _slide(cost: Callable[[Array], float], start: Array) -> Array:
    """Local optimisation of smooth shapes."""
    corners = np.vstack([start, start + 0.02 * np.eye(len(start))])
    options = {"initial_simplex": corners, "xatol": 1e-4, "fatol": 1e-9, "maxfev": 40 * len(start)}
    return np.asarray(minimize(cost, start, method="Nelder-Mead", options=options).x)


def _walk(cost: Callable[[Array], float], start: Array) -> Array:
    """Optimise the ends of a window in turn, with decreasing steps."""
    x, least = start, cost(start)
    for step in STRIDES:
        tries = [x + k * step * end for end in np.eye(len(x)) for k in (-2, -1, 1, 2)]
        costs = [cost(y) for y in tries]
        while min(costs) < least:
            x, least = tries[int(np.argmin(costs))], min(costs)
            tries = [x + k * step * end for end in np.eye(len(x)) for k in (-2, -1, 1, 2)]
            costs = [cost(y) for y in tries]
    return x


def _whole(case: Case, law: Law) -> Found:
    """Fit with a law; a law without coefficients keeps its size."""
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
    target = motion.recorded - motion.load - sum(on_all_joints(law, motion) for law in (*case.rotors, *given))
    kept = case.steady[thin.half : len(motion) - thin.half : case.band.factor]
    y = thin(target) / case.noise
    a = thin(wide.reshape(len(wide), -1)).reshape(len(y), 3, -1) / case.noise[:, None]
    y, a = y[kept], a[kept]
    size = np.linalg.norm(a, axis=0)
    size[size < 1e-9 * size.max()] = np.inf  # unidentifiable with this motion
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
    """The motion with the torque predicted from friction and rotors, before any recording law."""
    motion = case.motion
    before = [law for law in laws if law.effect is not case.effect] + list(case.rotors)
    return replace(motion, predicted=motion.load + sum(on_all_joints(law, motion) for law in before))
