"""First and last fits of drives, their common scale with the masses, and roll-outs from commands alone."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from ...errors import OptionError, shorten
from ...model import Model
from ...robot.dynamics import moved_bodies
from ...servos import DRIVE_LAWS, KD_ON, SERVO_NUMBERS, Servo, ServoGrid
from ...types import Array, Robot
from ..fit import ServoFit, fit_servos
from ..given import Assumptions
from ..plant import roll_out
from ..plant.course import bodies_of, groups
from ..search.choice import Candidate, Estimates, ServoProblem, fit_candidate
from ..search.data import ServoData
from .identifiable import VAGUE, moves_while_off
from .result import BY_GAIN, BY_INERTIALS, BY_NOTHING, ServoRollOut, ServoScale, ServoTrace

MAX_OWN_ITERATIONS = 6  # most iterations of a fit of equal joints with own numbers
HORIZON = 1.0  # [s] between measured states of short roll-outs
DIVERGED_ERROR = 1e3  # error from which on a simulation counts as diverged [rad or m]
STATED, IDEAL = "stated numbers", "q = q_des"
NOTABLE_RATIO = 1.1  # ratio of masses from which it is said
FEW_DEVIATIONS = 3.0
COMMON_RATIO_PROBABILITY = 0.05  # probability of such different ratios, from which they count as one
ALWAYS = ("kp", "kd", "delay", "coulomb_friction", "armature", "torque_offset")
LEAST_LAG = 0.005  # [s] kd over kp to start from: a fit hardly leaves zero
LEAST_WAVE = 6e-4  # [s2] the same for armature over kp: 40 rad/s, the slowest of hobby servos have 12 to 41
Stated = Mapping[str, Mapping[str, float]]  # number by joint and name


def final_fit(problem: ServoProblem, data: ServoData, candidate: Candidate) -> ServoFit:
    """Fit to all training data, about the simulated motion in the end."""
    candidate, fit = fit_candidate(problem.model, data.train, candidate, problem.options.window, relinearise=True)
    return replace(fit, servos=candidate.servos)


def number_std(fit: ServoFit, name: str) -> dict[str, float]:
    """Standard deviation of one number of each joint where it is free."""
    std = np.sqrt(np.maximum(np.diag(fit.covariance), 0.0))
    each = zip(fit.names, fit.owners, std, strict=True)
    return {joint: float(s) for (_, number), joints, s in each if number == name for joint in joints}


def weigh_bodies(problem: ServoProblem) -> ServoProblem:
    """Problem whose bodies have the weight that gains imply if these set the scale, and a flag on each that changes."""
    if problem.assumptions.scale != "kp":
        return problem
    problem.say("weighing bodies", 0.05)
    model, rows, stated = problem.model, problem.searched, problem.assumptions.stated
    start = first_candidate(model.robot, rows, problem.regressed, Assumptions(stated=stated))
    fit = fit_servos(model, rows.train, start.servos, start.free, window=problem.options.window)
    gains = {joint: of["kp"] for joint, of in stated.items() if "kp" in of}
    said = []
    for members, ratio, error in implied_ratios(problem.sets, fit.servos, number_std(fit, "kp"), gains):
        model = scaled_masses(model, members, ratio)
        said.append(
            f"with the stated kp, the part that {shorten(list(members))} move is {ratio:.2f} +- {1.96 * error:.2f} "
            f"times as heavy as the description says, and the model has these masses; --known masses if the "
            f"description is right"
        )
    return replace(problem, model=model, flags=(*problem.flags, *said))


def own_numbers(problem: ServoProblem, fit: ServoFit, candidate: Candidate) -> dict[str, Estimates]:
    """Numbers of equal joints with their standard deviations, fitted again without that assumption; empty if none."""
    if not candidate.assumptions.equal:
        return {}
    alone = fit_servos(
        problem.model,
        problem.searched.train,
        fit.servos,
        fit.free,
        window=candidate.window or problem.options.window,
        relinearise=False,
        iterations=MAX_OWN_ITERATIONS,
        scales=False,
        usual=candidate.usual,
        assumptions=replace(candidate.assumptions, equal=()),
    )
    std = {name: number_std(alone, name) for name in SERVO_NUMBERS}
    return {
        joint: {name: (getattr(alone.servos[joint], name), s[joint]) for name, s in std.items() if s.get(joint, 0) > 0}
        for members in candidate.assumptions.equal
        for joint in members
    }


def block(fit: ServoFit, joint: str) -> tuple[tuple[str, ...], Array]:
    """Free numbers of a joint within their bounds, and their covariance; a shared number counts for each joint."""
    owned = enumerate(zip(fit.owners, fit.at_bound, strict=True))
    rows = [k for k, (joints, bound) in owned if joint in joints and not bound]
    return tuple(fit.names[k][1] for k in rows), np.asarray(fit.covariance[np.ix_(rows, rows)])


def closed_loops(
    model: Model,
    servos: Mapping[str, Servo],
    grids: Sequence[ServoGrid],
    held_out: bool = True,
    nominal: tuple[Model, Mapping[str, Servo]] | None = None,
) -> tuple[ServoRollOut, tuple[ServoTrace, ...]]:
    """Roll-outs of recordings from commands alone, whole and from measured states every second.

    nominal: model and drives of stated numbers, for comparison; q = q_des without, and where their loop diverges, as
        that of a gain that is stated without damping.
    """
    joints, measured = grids[0].joints, np.vstack([grid.q for grid in grids])
    driven = np.array([joint in servos for joint in joints]) & np.any([grid.driven for grid in grids], axis=0)
    units = tuple("m" if model.robot.prismatic[model.robot.index(joint)] else "rad" for joint in joints)

    def errors(paths: Sequence[tuple[Array, Array]]) -> list[Array]:
        return [_rms(np.vstack(each) - measured, driven) for each in zip(*paths, strict=True)]

    own, ideal = [_both(model, servos, grid) for grid in grids], [(grid.command,) * 2 for grid in grids]
    beside, name = ideal, IDEAL
    if nominal is not None:
        stated = [_both(*nominal, grid) for grid in grids]
        if not np.isinf(errors(stated)[0]).any():
            beside, name = stated, STATED
    traces = tuple(
        ServoTrace(grid.path, joints, np.asarray(grid.origin + np.arange(len(grid)) * grid.step, float), *each)
        for grid, (whole, short), (other, _) in zip(grids, own, beside, strict=True)
        for each in [(grid.command, grid.q, whole, other, short)]
    )
    (rms, short_rms), (other_rms, other_short_rms) = errors(own), errors(beside)
    sizes = rms, short_rms, other_rms, other_short_rms
    return ServoRollOut(joints, units, *sizes, name, held_out, errors(ideal)[0]), traces


def _both(model: Model, servos: Mapping[str, Servo], grid: ServoGrid) -> tuple[Array, Array]:
    """Positions (N, n) [rad or m] of the whole roll-out, and of one that restarts every second."""
    with np.errstate(all="ignore"):
        return roll_out(model, servos, grid), roll_out(model, servos, grid, HORIZON)


def whole_rms(model: Model, servos: Mapping[str, Servo], grids: Sequence[ServoGrid]) -> Array:
    """Rms (n,) [rad or m] of whole recordings from commands alone; inf where it diverges, NaN without commands."""
    errors = [roll_out(model, servos, grid) - grid.q for grid in grids]
    return _rms(np.vstack(errors), np.array([joint in servos for joint in grids[0].joints]))


def nominal_servos(robot: Robot, servos: Mapping[str, Servo], stated: Stated) -> dict[str, Servo]:
    """Drives of the stated numbers; empty unless every joint has a stated gain."""
    if not all(stated.get(joint, {}).get("kp", 0.0) > 0 for joint in servos):
        return {}
    return {joint: stated_drive(robot, joint).with_(**stated[joint]) for joint in servos}


def _rms(error: Array, driven: Array) -> Array:
    """Root mean square (n,) of errors (N, n); inf where one diverges, NaN for joints without commands."""
    with np.errstate(over="ignore", invalid="ignore"):
        rms = np.sqrt(np.mean(error**2, axis=0))
    return np.where(driven, np.where(rms <= DIVERGED_ERROR, rms, np.inf), np.nan)


def connected_sets(model: Model, joints: Sequence[str], driven: Sequence[str]) -> tuple[tuple[str, ...], ...]:
    """Driven joints that share moved bodies: each set has one common scale. joints: those of the recordings."""
    numbers = [joints.index(joint) for joint in driven]
    return tuple(tuple(joints[k] for k in members) for members in groups(bodies_of(model, joints), numbers))


def scaled_masses(model: Model, joints: Sequence[str], ratio: float) -> Model:
    """Model whose bodies that some joints move are `ratio` times as heavy."""
    columns = [model.robot.index(joint) for joint in joints]
    moved = moved_bodies(model.robot)[columns].any(axis=0)
    factor = np.where(moved, ratio, 1.0)
    return replace(model, inertials=model.inertials * factor[:, None])


def mass_ratio(kp: Array, std: Array, stated: Array) -> tuple[float, float]:
    """Ratio of true masses to those of the description if the gains are as stated, and its standard deviation.

    kp, std, stated: (k,) of the joints of one connected set [N.m/rad]; kp as identified with the described masses.
    """
    weight = (kp / np.maximum(std, 1e-9 * kp)) ** 2
    log = float(np.sum(weight * np.log(stated / kp)) / np.sum(weight))
    spread = float(1.0 / np.sqrt(np.sum(weight)))
    return float(np.exp(log)), float(np.exp(log)) * spread


def mass_ratios(described: Model, weighed: Model) -> list[float]:
    """Masses of a model over those of the description, each once, of the bodies that differ."""
    masses = zip(described.inertials[:, 0].tolist(), weighed.inertials[:, 0].tolist(), strict=True)
    return sorted({round(new / old, 4) for old, new in masses if old > 0 and new != old})


def gain_text(gains: Iterable[float]) -> str:
    """Text for --known of stated gains: their number where it is one."""
    each = {f"kp={gain:.4g}" for gain in gains}
    return each.pop() if len(each) == 1 else "kp"


def known_scale(known: str, stated: Mapping[str, float], other: Sequence[str]) -> ServoScale:
    """Basis of the scale. known: "masses", "kp" or "nothing"; stated: gains by joint; other: alternatives."""
    if known == "masses":
        said = "the scale of gains and friction is that of the masses of the description"
        return ServoScale(BY_INERTIALS, said, tuple(other))
    if known == "kp":
        said = f"the scale of friction, armature and masses is that of the stated kp of {shorten(list(stated))}"
        return ServoScale(BY_GAIN, said)
    return ServoScale(
        BY_NOTHING,
        "kp and masses are identifiable only relative to each other; state one kp, or use the masses of the "
        "description, or repeat with a known payload",
    )


def implied_ratios(
    sets: Sequence[Sequence[str]], servos: Mapping[str, Servo], std: Mapping[str, float], stated: Mapping[str, float]
) -> list[tuple[Sequence[str], float, float]]:
    """Connected sets whose masses differ notably from the description if stated gains are true: ratio and its std.

    servos: identified with the masses of the description; std: of their kp where it is identifiable [N.m/rad];
    stated: kp by joint [N.m/rad].
    """
    notable = []
    for members in sets:
        used = [j for j in members if stated.get(j, 0) > 0 and 0 < std.get(j, 0) < VAGUE * servos[j].kp]
        if not used:
            continue
        kp, spread, nominal = (np.array([of[j] for j in used]) for of in ({j: servos[j].kp for j in used}, std, stated))
        ratio, error = mass_ratio(kp, spread, nominal)
        if max(ratio, 1 / ratio) > NOTABLE_RATIO and abs(np.log(ratio)) > FEW_DEVIATIONS * error / ratio:
            notable.append((members, ratio, error))
    return notable


def alternatives(
    sets: Sequence[Sequence[str]], servos: Mapping[str, Servo], std: Mapping[str, float], stated: Mapping[str, float]
) -> tuple[str, ...]:
    """One sentence for each connected set: the masses if the stated gains are true. Arguments as `implied_ratios`.

    Sets whose masses would change by the same factor, within its uncertainty, share a sentence.
    """
    notable, said = implied_ratios(sets, servos, std, stated), []
    if len(notable) == len(sets) > 1:
        logs = np.log([ratio for _, ratio, _ in notable])
        weight = np.array([(ratio / error) ** 2 for _, ratio, error in notable])
        mean = float(np.average(logs, weights=weight))
        if chi2.sf(np.sum(weight * (logs - mean) ** 2), len(notable) - 1) > COMMON_RATIO_PROBABILITY:
            every = [joint for members, _, _ in notable for joint in members]
            notable = [(every, float(np.exp(mean)), float(np.exp(mean) / np.sqrt(weight.sum())))]
    for members, ratio, error in notable:
        gains = [stated[j] for j in members if j in stated]
        each = ", ".join(dict.fromkeys(f"{gain:.4g}" for gain in gains))
        which = f"the part that {shorten(list(members))} move{'s' if len(members) == 1 else ''}"
        said.append(
            f"if the firmware's kp is {each} as stated, {which} is {ratio:.2f} +- {1.96 * error:.2f} times "
            f"as heavy as the description says; --known {gain_text(gains)} assumes that gain"
        )
    return tuple(said)


def stated_numbers(robot: Robot, joints: Sequence[str]) -> dict[str, dict[str, float]]:
    """Numbers of each drive that the actuators file states."""
    stated = {joint: robot.servo.get(joint, {}) for joint in joints}
    return {joint: {key: float(x) for key, x in of.items() if key in SERVO_NUMBERS} for joint, of in stated.items()}


def stated_drive(robot: Robot, joint: str) -> Servo:
    """Drive with what the actuators file states, and zero or no limit elsewhere."""
    entries = robot.servo.get(joint, {})
    numbers = {key: float(x) for key, x in entries.items() if key in SERVO_NUMBERS}
    register = entries.get("kp_register")
    return Servo(
        law=str(entries.get("law", DRIVE_LAWS[0])),
        kd_on=str(entries.get("kd_on", KD_ON[0])),
        kp_register=None if register is None else float(register),
    ).with_(**numbers)


def stated_laws(
    robot: Robot, joints: Sequence[str], laws: Mapping[str, str] | str | None, assumptions: Assumptions
) -> dict[str, str]:
    """Law of each joint whose law is given, or stated by the actuators file; equal joints have the same.

    Raises:
        OptionError: unknown law or joint, or equal joints of different laws.
    """
    given = dict.fromkeys(joints, laws) if isinstance(laws, str) else dict(laws or {})
    if unknown := [joint for joint in given if joint not in joints]:
        raise OptionError(
            f"laws names {shorten(unknown)}, and the servo joints are {shorten(joints)}; give one of them"
        )
    if wrong := [law for law in given.values() if law not in DRIVE_LAWS]:
        raise OptionError(f"law {wrong[0]!r} is none of {', '.join(DRIVE_LAWS)}")
    filed = {joint: str(robot.servo[joint]["law"]) for joint in joints if "law" in robot.servo.get(joint, {})}
    laws_of = {**filed, **given}
    for members in assumptions.equal:
        stated = {laws_of[joint] for joint in members if joint in laws_of}
        if len(stated) > 1:
            raise OptionError(
                f"{shorten(members)} are equal, and have the laws {' and '.join(sorted(stated))}; give one"
            )
        laws_of |= {joint: law for joint in members for law in stated}
    return laws_of


def first_candidate(
    robot: Robot,
    data: ServoData,
    servos: Mapping[str, Servo],
    assumptions: Assumptions,
) -> Candidate:
    """Drives to start from, with stated numbers and means of priors, and the numbers that are free with every law."""
    started, free, fixed = {}, list[tuple[str, str]](), assumptions.fixed
    for joint, servo in servos.items():
        numbers, nominal = fixed.get(joint, {}), stated_drive(robot, joint)
        means = {name: prior.mean for (owner, name), prior in assumptions.priors.items() if owner == joint}
        if "kp" in numbers and servo.kp > 0:
            scale = numbers["kp"] / servo.kp
            servo = servo.with_(**{key: scale * getattr(servo, key) for key in ("kd", "coulomb_friction", "armature")})
        if "kd" in numbers:
            servo = servo.with_(viscous_friction=max(servo.kd - numbers["kd"], 0.05 * servo.kd))
        servo = servo.with_(kd=max(servo.kd, LEAST_LAG * servo.kp), armature=max(servo.armature, LEAST_WAVE * servo.kp))
        law = assumptions.laws.get(joint, DRIVE_LAWS[0])
        servo = replace(servo, law=law, kd_on=nominal.kd_on, kp_register=nominal.kp_register).with_(
            **{"effort_limit": np.inf, "speed_limit": np.inf, **numbers, **means}
        )
        started[joint] = servo
        names = [name for name in (*ALWAYS, *means) if name not in numbers]
        if ({"kd"} & {*numbers, *means} or moves_while_off(data, joint)) and "viscous_friction" not in numbers:
            names.append("viscous_friction")
        free += [(joint, name) for name in names]
    usual = {joint: servo.kp for joint, servo in started.items()}
    return Candidate(started, tuple(dict.fromkeys(free)), usual=usual, assumptions=assumptions)
